"""Every demo runs at small size and prints its numbers."""

from __future__ import annotations

import io
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from importlib.util import find_spec
from pathlib import Path

import pytest
from needs import needs_gmsh

from tactile_fem import Piece, Stimulus
from tactile_fem.neuron import DRIVES

# The shipped finger of 3,000 tetrahedra.
COARSE = "--set", "finger.pad_size_mm=3.0", "finger.far_size_mm=6.0"
DEMOS = Path(__file__).resolve().parents[1] / "demos"


@contextmanager
def beside(path: Path) -> Iterator[None]:
    """Let a demo import the modules beside it: other folders may have some of the same names."""
    before = set(sys.modules)
    kinds = Stimulus.kinds, Piece.kinds, DRIVES  # which a demo's own join
    known = [dict(entries) for entries in kinds]
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(path.parent)
        yield
    for entries, saved in zip(kinds, known, strict=True):
        entries.clear()
        entries.update(saved)
    for name in sys.modules.keys() - before:
        if str(DEMOS) in (getattr(sys.modules[name], "__file__", None) or ""):
            del sys.modules[name]


def start(name: str, *arguments: str) -> tuple[int, str, str]:
    """Run a demo in this process, which has its forms; return exit code, output and errors."""
    path, printed, said = DEMOS / name, io.StringIO(), io.StringIO()
    with beside(path), redirect_stdout(printed), redirect_stderr(said):
        sys.argv, usual = [str(path), *arguments], sys.argv
        try:
            runpy.run_path(str(path), run_name="__main__")
        except SystemExit as end:
            return end.code, printed.getvalue(), said.getvalue()
        finally:
            sys.argv = usual
    raise AssertionError("it does not exit")


def run(name: str, *arguments: str) -> str:
    """Return what a demo prints."""
    code, printed, said = start(name, *arguments)
    assert code == 0, said
    return printed


def run_command(*command: str) -> str:
    finished = subprocess.run(command, check=True, capture_output=True, text=True)
    return finished.stdout


@pytest.mark.parametrize(
    ("demo", "options", "sentence"),
    [],
)
def test_bad_input_gets_one_sentence(demo, options, sentence, tmp_path):
    code, _, said = start(demo, str(tmp_path / "none"), *options)
    assert code == 2
    assert said == f"tactile-fem: {sentence}\n".format(tmp_path / "none")


def number(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found, text
    return float(found[1])


SMALL = ("--pad-size", "3", "--far-size", "6")


def test_brian(tmp_path):
    way = ["--afferents", "20", "--duration", "0.3", "--steps-ms", "0.1"]
    output = run("verification/brian.py", str(tmp_path), *way)
    if not find_spec("brian2"):
        assert "not installed" in output
        return
    assert number(r"first spikes differ by at most ([\d.]+) steps", output) < 1
    assert number(r"99% of all by at most ([\d.]+) ms", output) < 10


@pytest.mark.slow
@needs_gmsh
def test_strains(tmp_path):
    options = "--forces", "0.005", "--edge-force", "0.005", "--pad-size", "0.1175"
    output = run("validation/strains.py", str(tmp_path), *options)
    assert 50 < number(r"plate, ridged, 0.*; (\d+) % of the ridges", output) < 100
    proximal, distal = re.search(r"corneum: shear (\S+) and (\S+),", output).groups()
    assert float(proximal) * float(distal) < 0


@pytest.mark.slow
def test_vibration(tmp_path):
    way = ["--depth", "0.3", "--hold", "0.05", *SMALL]
    output = run("validation/vibration.py", str(tmp_path), *way)
    assert 10 <= number(r"RA best frequency: (\d+) Hz", output) <= 100
    assert 100 <= number(r"PC best frequency: (\d+) Hz", output) <= 500
    assert number(r"RA 50 Hz, fitted: .*rms (\d+)", output) < 25


@pytest.mark.parametrize(
    "path",
    sorted(DEMOS.glob("[bnosv]*/*.py")),  # not those of the gallery, which are no modules
    ids=lambda path: str(path.relative_to(DEMOS)),
)
def test_what_a_demo_imports_exists(path):
    """Without running it: what it computes is tested above, mostly by the slow tests."""
    with beside(path):
        names = runpy.run_path(str(path))
    assert path.read_text().startswith("# %%") == ("main" in names)
