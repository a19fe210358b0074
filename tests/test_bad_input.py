"""What a wrong study, command, mesh, font or results folder is answered with: one sentence."""

from __future__ import annotations

import logging
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic import make_results

from tactile_fem.cli import app as cli
from tactile_fem.finger import write_mesh
from tactile_fem.runtime import doctor, logs, ranks
from tactile_fem.study import Finger

# Settings and commands, each with the sentence that answers it.
SETTINGS, COMMANDS = (
    [line.split(" -> ") for line in block.splitlines() if line and not line.startswith("#")]
    for block in Path(__file__).with_name("bad_input.txt").read_text("utf-8").split("# Commands")
)

# What starts from a study, with what each needs besides.
_STARTS = {
    "scan": "",
    "preview": " -o new.png",
    "mesh": " -o new.msh",
    "sweep": " --over protocol.depth_mm=1,2",
    "fibre": "",
    "people": " --number 2",
}
_SPEED = (
    'afferents.fast.feels: There is no drive "speed"; there are sed, von_mises, largest_stretch, '
    "smallest_stretch, largest_stress, smallest_stress, compression, indentation, "
    'directed_stretch, pressure, and their "_rate".'
)
_GRID = (
    'receptors.placement = "grid" does not lie in a section: use "line", "intermediate_ridges" or '
    '"papillae".'
)

COMMANDS += [
    *(
        (
            f"{command} --set receptors.side=subcutaneous",
            "receptors.average_radius_mm = 0.25: no subcutaneous within reach of the receptor at X "
            "-5, Y 0 mm.",
        )
        for command in ("scan", "sweep --over protocol.depth_mm=1,2")
    ),
    *((f"{command} speed.toml{options}", _SPEED) for command, options in _STARTS.items()),
    *(
        (f"{command}{options} --set finger.kind=section --set receptors.placement=grid", _GRID)
        for command, options in _STARTS.items()
    ),
    ("fit forces.csv --study speed.toml", _SPEED),
]


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> Path:
    """A folder full of things that cannot be used."""
    folder = tmp_path_factory.mktemp("bad")
    _write_meshes(folder)
    (folder / "no.ttf").write_bytes(b"no font")
    (folder / "twice.toml").write_text("[protocol]\ndepth_mm = 1.0\ndepth_mm = 2.0\n")
    (folder / "comma.toml").write_text("[protocol]\ndepth_mm = 1,0\n")
    (folder / "thick.toml").write_text('[finger]\npreset = "paper"\ndermis_mm = 1.5\n')
    (folder / "flat.toml").write_text("depth_mm = 1.0\n")
    (folder / "value.toml").write_text("protocol = 3\n")
    (folder / "list.toml").write_text("[[finger]]\ndermis_mm = 1.0\n")
    (folder / "one.toml").write_text('[afferents]\nname = "RA"\n')
    (folder / "two.toml").write_text('[[afferents]]\nname = "SA1"\n[[afferents]]\nname = "RA"\n')
    (folder / "speed.toml").write_text('[[afferents]]\nname = "fast"\nfeels = "speed"\n')
    (folder / "forces.csv").write_text(
        "indenter,speed_mm_s,depth_mm,force_N,sd_N\nplate,0.2,1,0.2,0.1\n"
    )
    (folder / "turns.csv").write_text("time_s,rz_deg\n0,0\n1,95\n")
    (folder / "binary.toml").write_bytes(b"\xff\xfe")
    (folder / "full").mkdir()
    (folder / "full" / "notes.md").write_text("mine")
    for name in ("done", "emptied", "pickled", "foreign", "cut", "old", "spikes", "run"):
        make_results(folder / name)
    trace = "trace.npz"
    (folder / "emptied" / trace).unlink()
    np.savez(folder / "pickled" / trace, time_s=np.array([{}], dtype=object))
    np.savez(folder / "foreign" / trace, x=np.zeros(3))
    (folder / "cut" / trace).write_bytes((folder / "cut" / trace).read_bytes()[:500])
    (folder / "old" / "study.toml").write_text("[finger]\ndermis = 1.0\n")
    (folder / "spikes" / "spikes.csv").write_text("receptor,time_s\nx,y\n")
    return folder


def _write_meshes(folder: Path) -> None:
    mesh = Finger().mesh()
    write_mesh(folder / "finger.msh", mesh)
    factors = {"nan": [1, 1, np.nan], "metres": [1e-3, 1e-3, 1e-3], "mirrored": [-1, 1, 1]}
    for name, own in factors.items():
        write_mesh(folder / f"{name}.npz", replace(mesh, nodes=mesh.nodes * own))
    whole = (folder / "nan.npz").read_bytes()
    (folder / "half.npz").write_bytes(whole[: len(whole) // 2])
    (folder / "text.msh").write_text("hello")
    (folder / "binary.msh").write_bytes(bytes(range(256)) * 20)


@pytest.fixture
def answer(here, monkeypatch, capsys):
    """Return a function that runs a command and returns its one sentence."""
    monkeypatch.chdir(here)
    monkeypatch.setattr(logs, "set_up", lambda *args, **kwargs: None)
    monkeypatch.setattr(logging.getLogger(logs.PACKAGE), "handlers", [])
    for name in ranks._RANK_VARIABLES:
        monkeypatch.delenv(name, raising=False)

    def too_far():
        raise AssertionError("a bad study comes as far as the compiler")

    monkeypatch.setattr(doctor, "compiler_finding", too_far)
    before = {path: path.stat().st_mtime_ns for path in here.rglob("*")}

    def run(arguments: list[str]) -> str:
        assert cli.main(arguments) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert {path: path.stat().st_mtime_ns for path in here.rglob("*")} == before
        return line.removeprefix("tactile-fem: ").replace(str(here), "{here}")

    return run


def assert_says(sentence: str, expected: str) -> None:
    if expected.endswith("..."):
        assert sentence.startswith(expected.removesuffix("..."))
    else:
        assert sentence == expected


@pytest.mark.parametrize("setting, sentence", SETTINGS)
def test_a_bad_value(answer, setting, sentence):
    assert_says(answer(["scan", "--set", setting]), sentence)


@pytest.mark.parametrize("command, sentence", COMMANDS)
def test_a_bad_command(answer, command, sentence):
    assert_says(answer(shlex.split(command)), sentence)
