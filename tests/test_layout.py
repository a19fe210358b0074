"""How modules import one another: never in a circle, not even deferred or for types alone."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted((ROOT / "tactile_fem").glob("*/**/*.py"))
}


def imported(path: Path) -> set[str]:
    """Return the package's modules that a file imports anywhere, or names in a string."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {name if name in FILES else str(node.module) for name in names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found & FILES.keys()


@pytest.mark.parametrize("path", sorted((ROOT / "tactile_fem/assembly").glob("*.py")), ids=str)
def test_assembly_knows_no_fingers(path):
    """Another FEniCSx user could take it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("tactile_fem"):
            assert str(node.module).split(".")[1] in ("assembly", "runtime", "errors")
    assert not re.search(r"\b(?:finger|skin|tissue|contact)s?\b", path.read_text(encoding="utf-8"))


def room(module: str) -> str:
    return ".".join(module.split(".")[:2])


@pytest.mark.parametrize("unit", [str, room], ids=["modules", "rooms"])
def test_imports_have_no_circle(unit: Callable[[str], str]):
    graph: dict[str, set[str]] = {}
    for module, path in FILES.items():
        needs = {unit(name) for name in imported(path)} - {unit(module)}
        graph.setdefault(unit(module), set()).update(needs)
    assert len(graph) > 10
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


# The rooms of the core, from the bottom up: a room imports those before it.
ORDER = (
    *("errors", "runtime", "tissue", "finger", "path", "stimulus", "neuron", "receptors", "study"),
    *("results", "assembly", "mechanics", "solvers", "simulation", "output", "series", "cli"),
)


def rooms_used_by(own: str) -> set[str]:
    """Return the other rooms whose modules those of a room import, by their names."""
    files = [path for module, path in FILES.items() if module.split(".")[1] == own]
    return {name.split(".")[1] for path in files for name in imported(path)} - {own}


@pytest.mark.parametrize("own", ORDER[1:])
def test_a_room_imports_those_below_it(own):
    assert rooms_used_by(own) <= set(ORDER[: ORDER.index(own)])


@pytest.mark.parametrize("own", ["results", "output"])
def test_what_reads_and_draws_needs_no_solver(own):
    assert not rooms_used_by(own) & {"assembly", "mechanics", "solvers"}


def test_every_folder_is_a_room_or_a_companion():
    package = ROOT / "tactile_fem"
    folders = {file.parent.name for file in package.glob("*/__init__.py")}
    companions = {file.parent.name for file in package.glob("*/companion.toml")}
    assert folders - companions == set(ORDER) - {"errors"}
