import tomllib
from pathlib import Path

import numpy as np
import pytest

from tactile_fem.runtime import backend, doctor

ROOT = Path(__file__).parents[1]


def test_this_machine_can_compile():
    assert doctor.compiler_finding() is None


def test_a_library_that_is_nowhere_is_missing():
    assert not doctor.has_library("libnosuchthing.so.1")


@pytest.mark.parametrize("names", [["gcc"], ["cc"]])
def test_any_c_compiler_will_do(monkeypatch, names):
    monkeypatch.setenv("CC", "nosuchcompiler -O2")
    monkeypatch.setattr(
        doctor.shutil, "which", lambda name: f"/bin/{name}" if name in names else None
    )
    assert doctor.compiler() == names


def test_headers_that_are_missing_name_their_package(monkeypatch):
    monkeypatch.setattr(doctor, "_compiles", lambda compiler, code: "Python.h" not in code)
    finding = doctor.compiler_finding()
    assert finding is not None and finding.fatal
    assert finding.packages[0].startswith("python3.") and finding.packages[0].endswith("-dev")
    monkeypatch.setattr(doctor, "_compiles", lambda compiler, code: False)
    finding = doctor.compiler_finding()
    assert finding is not None and finding.packages == ("gcc", "libc6-dev")


def test_missing_graphics_is_a_warning_and_a_missing_compiler_an_error(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "has_library", lambda name: name == "libGL.so.1")
    assert doctor.main() == 0
    out = capsys.readouterr().out
    assert out.count("Warning") == 2
    assert "apt-get install libglu1-mesa libxcursor1 libxft2 libxinerama1 libegl1" in out
    monkeypatch.setattr(doctor, "compiler", list)
    assert doctor.main() == 1
    assert "Error: There is no C compiler" in capsys.readouterr().out


def test_nothing_missing_is_nothing_said(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "findings", list)
    assert doctor.main() == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("version", ["0.11.0", "0.11.0.post0", "0.11.2"])
def test_the_tested_dolfinx_is_taken(version):
    backend.check(version, np.float64)


@pytest.mark.parametrize(
    ("version", "scalar", "found"),
    [
        ("0.10.0", np.float64, "needs DOLFINx 0.11 and found 0.10.0. "),
        ("0.12.0.dev0", np.float64, "needs DOLFINx 0.11 and found 0.12.0.dev0. "),
        ("1.11.0", np.float64, "needs DOLFINx 0.11 and found 1.11.0. "),
        ("0.11.0", np.complex128, "real scalars and found complex128. "),
    ],
)
def test_an_unfit_dolfinx_names_the_three_routes(version, scalar, found):
    with pytest.raises(ImportError) as caught:
        backend.check(version, scalar)
    message = str(caught.value)
    assert found in message and "\n" not in message
    for route in ("tactile-fem[solver]", "fenics-dolfinx=0.11", "dolfinx/dolfinx:v0.11.0"):
        assert route in message


def test_pip_and_conda_bring_the_tested_dolfinx():
    release = backend.DOLFINX_RELEASE
    bounds = ">={}.{},<{}.{}".format(*release, release[0], release[1] + 1)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["optional-dependencies"]["solver"] == [f"dolfinx-solver-real{bounds}"]
    assert f"- fenics-dolfinx {bounds}\n" in (ROOT / "docker" / "environment.yml").read_text()
