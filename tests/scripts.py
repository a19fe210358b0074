"""Runs the scripts of `demos` in the process of the tests, which has compiled their forms."""

from __future__ import annotations

import io
import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from cyclopts import App

from tactile_fem import Piece, Stimulus
from tactile_fem.neuron import DRIVES

DEMOS = Path(__file__).resolve().parents[1] / "demos"
SMALL = "--pad-size", "3", "--far-size", "6"  # the shipped finger of 3,000 tetrahedra


@contextmanager
def beside(path: Path) -> Iterator[None]:
    """Let a script import the modules beside it: other folders may have some of the same names."""
    before = set(sys.modules)
    kinds = Stimulus.kinds, Piece.kinds, DRIVES  # which a script's own join
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
    """Run a script; return exit code, output and errors."""
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
    """Return what a script prints."""
    code, printed, said = start(name, *arguments)
    assert code == 0, said
    return printed


def number(pattern: str, text: str) -> float:
    """Return the number in the first group of a pattern."""
    found = re.search(pattern, text)
    assert found, text
    return float(found[1])


def imports(path: Path) -> None:
    """Import a script without running it: what it computes is tested by slow tests.

    The commands at its head have arguments that it takes.
    """
    with beside(path):
        names = runpy.run_path(str(path))
    commands = re.findall(rf"^#     python demos/\S+/{path.name} ?(.*)", path.read_text(), re.M)
    if "run_script" in names:
        assert commands
        script = App()
        script.default(names["main"])
        for arguments in commands:
            script.parse_args(shlex.split(arguments, comments=True), exit_on_error=False)
