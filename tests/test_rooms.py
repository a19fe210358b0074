"""The rooms of the core, from the bottom up: a room imports those before it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import tactile_fem

PACKAGE = Path(tactile_fem.__file__).parent
ORDER = (
    *("errors", "runtime", "tissue", "finger", "path", "stimulus", "neuron", "receptors", "study"),
    *("results", "assembly", "mechanics", "solvers", "simulation", "output", "series", "cli"),
)


def rooms_used_by(room: str) -> set[str]:
    """Return the rooms that a room imports when its modules run, by their names."""
    found = set()
    for file in (PACKAGE / room).rglob("*.py"):
        tree = ast.parse(file.read_text("utf-8"))
        of_types = {
            id(inner)
            for node in ast.walk(tree)
            if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
            for inner in ast.walk(node)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and id(node) not in of_types:
                words = (node.module or "").split(".")
                if words[0] == "tactile_fem" and len(words) > 1:
                    found.add(words[1])
    return found - {room, "companions"}


@pytest.mark.parametrize("room", ORDER[1:])
def test_a_room_imports_those_below_it(room):
    assert rooms_used_by(room) <= set(ORDER[: ORDER.index(room)])


@pytest.mark.parametrize("room", ["results", "output"])
def test_what_reads_and_draws_needs_no_solver(room):
    assert not rooms_used_by(room) & {"assembly", "mechanics", "solvers"}


def test_every_folder_is_a_room_or_a_companion():
    folders = {file.parent.name for file in PACKAGE.glob("*/__init__.py")}
    companions = {file.parent.name for file in PACKAGE.glob("*/companion.toml")}
    assert folders - companions == set(ORDER) - {"errors"}
