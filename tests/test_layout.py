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
