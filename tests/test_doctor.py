import os
import re
import runpy
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement

from tactile_fem.errors import TactileError
from tactile_fem.runtime import backend, doctor

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def environment_restored():
    """Restore what is changed for the compiler."""
    before = dict(os.environ)
    yield
    os.environ.clear()
    os.environ.update(before)


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


def test_headers_that_are_missing_are_named_with_their_packages(monkeypatch):
    monkeypatch.setattr(doctor.sysconfig, "get_path", lambda name: "/nowhere")
    monkeypatch.setattr(doctor.sys, "prefix", "/nowhere")
    finding = doctor.compiler_finding()
    assert finding is not None and finding.fatal
    assert "Python.h" in str(finding) and "apt-get install gcc libc6-dev python3." in str(finding)


@pytest.mark.parametrize("command", ["false", "true", "sh -c 'echo no licence >&2; exit 3'"])
def test_a_compiler_that_does_not_work_is_told(monkeypatch, command):
    monkeypatch.setenv("CC", command)
    finding = doctor.compiler_finding()
    assert finding is not None and finding.fatal
    assert f"DOLFINx needs {command} to compile" in str(finding) and "unset it" in str(finding)
    assert ("no licence" in str(finding)) == ("licence" in command)


@pytest.mark.parametrize("command", ["/nonexistent/gcc -O2", "gcc 'x"])
def test_a_compiler_that_cannot_be_run_is_told_and_another_compiles(
    monkeypatch, capsys, caplog, command
):
    monkeypatch.setenv("CC", command)
    assert doctor.compiler() and doctor.compiler_finding() is None
    assert f'Warning: CC is "{command}", which cannot be run: ' in said_by_doctor(capsys)
    backend._prepare_compilation()  # or the forms would be compiled by the former
    assert os.environ["CC"] == shlex.join(doctor.compiler())
    assert f'CC is "{command}", which cannot be run' in caplog.text
    assert "CC is" not in said_by_doctor(capsys)


def said_by_doctor(capsys) -> str:
    assert doctor.main() == 0
    return capsys.readouterr().out


def test_where_the_compiler_cannot_write_another_folder_is_taken(monkeypatch):
    monkeypatch.setenv("TMPDIR", "/proc")
    monkeypatch.setattr(tempfile, "tempdir", None)  # what Python has found before
    assert doctor.compiler_finding() is None
    backend._prepare_compilation()
    assert os.environ["TMPDIR"] == tempfile.gettempdir() != "/proc"


def test_a_user_without_home_needs_a_cache(monkeypatch, tmp_path):
    def home():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setenv("HOME", "/none")
    monkeypatch.setattr(Path, "home", home)
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    with pytest.raises(TactileError, match=r"no home folder .* set HOME or XDG_CACHE_HOME to"):
        backend._prepare_compilation()
    assert "XDG_CACHE_HOME" not in os.environ  # DOLFINx would take the working directory
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    backend._prepare_compilation()
    assert os.environ["HOME"] == str(tmp_path)


def test_a_working_directory_that_was_removed_is_told(monkeypatch, tmp_path):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(TactileError, match=r"working directory cannot be used \(No such file"):
        backend._prepare_compilation()


def test_dolfinx_is_loaded_whatever_the_arguments_are():
    code = "import sys; from tactile_fem.runtime import backend; print(ascii(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", code, b"f\xfcr"], capture_output=True, text=True)
    assert done.stdout == "'f\\udcfcr'\n", done.stderr


def test_missing_graphics_is_a_warning_and_a_missing_compiler_an_error(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "has_library", lambda name: name == "libGL.so.1")
    assert doctor.main() == 0
    out = capsys.readouterr().out
    assert out.count("Warning") == 2
    assert "apt-get install libglu1-mesa libxcursor1 libxft2 libxinerama1 libegl1" in out
    monkeypatch.setattr(doctor, "compiler", list)
    assert doctor.main() == 1
    assert "Error: There is no C compiler" in capsys.readouterr().out


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


# Of the extras, conda brings all but the browser page, the site and what slow tests read spikes
# with, the image those of its file.
IN_CONDA = {
    "dolfinx-solver-real": "fenics-dolfinx",
    "gmsh": "python-gmsh",
    "libigl": "igl",
    "matplotlib": "matplotlib-base",
    "neo": "python-neo",
}


def required(extras: Iterable[str]) -> list[Requirement]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    of_extras = [line for e in extras for line in project["optional-dependencies"][e]]
    return [Requirement(line) for line in (*project["dependencies"], *of_extras)]


def of_conda(text: str) -> dict[str, str]:
    return dict(re.findall(r"^ +- ([\w-]+) ?([<>=][^\s#]*)?", text, re.MULTILINE))


def named_by_conda(wanted: list[Requirement]) -> dict[str, str]:
    return {
        IN_CONDA.get(r.name, r.name): ",".join(sorted(str(r.specifier).split(","), reverse=True))
        for r in wanted
    }


def test_conda_brings_what_pip_does():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = of_conda((ROOT / "docker" / "environment.yml").read_text())
    wanted = required(project["optional-dependencies"].keys() - {"html", "docs", "readers"})
    assert named_by_conda(wanted).items() <= lines.items()


def test_the_recipe_of_conda_says_what_the_project_does():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = (ROOT / "docker" / "recipe" / "recipe.yaml").read_text()
    python = project["requires-python"].removeprefix(">=")
    (main,) = project["scripts"].items()
    for line in (
        f'version: "{project["version"]}"',
        f'python_min: "{python}"',
        f"- {' = '.join(main)}",
        f"- {project['name']} --help",
        f"summary: {project['description']}",
    ):
        assert re.search(rf"^ +{re.escape(line)}( +#.*)?$", text, re.MULTILINE), line
    _, run, constraints, _ = re.split(r"^  run:|^  run_constraints:|^tests:", text, flags=re.M)
    found = of_conda(run)
    assert named_by_conda(required(["solver"])).items() <= found.items()
    assert len(found) == len(required(["solver"])) + len(["python", "petsc", "c-compiler"])
    extras = ["mesh", "pictures", "cad", "drawings", "reduce", "neo", "nwb"]
    wanted = named_by_conda(required(extras)).items() - named_by_conda(required([])).items()
    assert of_conda(constraints).items() == wanted


def test_the_image_pins_what_it_installs():
    (extras,) = re.findall(r"^ARG EXTRAS=(\S+)$", (ROOT / "docker/Dockerfile").read_text(), re.M)
    pins = dict(re.findall(r"^([\w-]+)==(\S+)$", (ROOT / "docker/pins.txt").read_text(), re.M))
    for wanted in required(extras.split(",")):
        assert wanted.name in pins and wanted.specifier.contains(pins[wanted.name]), wanted


def test_the_image_copies_all_that_its_first_installation_imports(tmp_path):
    before = (ROOT / "docker" / "Dockerfile").read_text().partition("pip install")[0]
    for *names, folder in map(str.split, re.findall(r"^COPY (.+)$", before, re.MULTILINE)):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        for path in (ROOT / name for name in names if (ROOT / name).is_file()):
            (tmp_path / folder / path.name).write_bytes(path.read_bytes())
    (tmp_path / "setuptools").mkdir()
    (tmp_path / "setuptools" / "build_meta.py").touch()
    # Without site-packages: there the package is complete.
    command = [sys.executable, "-S", "-E", "-c", "import tactile_fem.runtime.build"]
    subprocess.run(command, cwd=tmp_path, check=True)


def test_an_older_python_is_refused_before_pip_looks_for_packages(monkeypatch):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    monkeypatch.setattr(sys, "version_info", (3, 11, 7))
    with pytest.raises(SystemExit, match=r"^tactile-fem needs Python >= 3\.12: this is 3\.11\.$"):
        runpy.run_module("tactile_fem.runtime.build")
    assert project["requires-python"] == ">=3.12"
