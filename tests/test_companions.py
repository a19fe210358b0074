"""The companions: the core knows none of them, and each builds on what the core exports."""

from __future__ import annotations

import ast
import importlib
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_layout import ORDER

import tactile_fem

PACKAGE = Path(tactile_fem.__file__).parent
COMPANIONS = sorted(file.parent.name for file in PACKAGE.glob("*/companion.toml"))


def imported_by(folder: Path) -> dict[str, set[tuple[str, str]]]:
    """Return module and name of what each file below a folder imports of the package."""
    found = {}
    for file in folder.rglob("*.py"):
        tree = ast.parse(file.read_text("utf-8"))
        names = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tactile_fem"):
                names |= {(node.module, alias.name) for alias in node.names}
            elif isinstance(node, ast.Import):
                names |= {(alias.name, "") for alias in node.names}
        found[str(file.relative_to(PACKAGE))] = {
            one for one in names if one[0].split(".")[0] == "tactile_fem"
        }
    return found


def companion_of(module: str, name: str) -> str | None:
    words = [*module.split(".")[1:], name]
    return words[0] if words[0] in COMPANIONS else None


def test_there_are_companions():
    assert {"calibration", "people", "shapes", "surrogate", "vibration"} <= set(COMPANIONS)


def test_the_core_imports_no_companion():
    wrong = {
        file: sorted(module for module, name in names if companion_of(module, name))
        for file, names in imported_by(PACKAGE).items()
        if Path(file).parts[0] not in COMPANIONS
    }
    assert not {file: names for file, names in wrong.items() if names}


@pytest.mark.parametrize("gone", COMPANIONS)
def test_the_core_does_without(gone, tmp_path):
    skipped = shutil.ignore_patterns("__pycache__", gone)
    shutil.copytree(PACKAGE, tmp_path / "tactile_fem", ignore=skipped)
    code = (
        "import sys\n"  # an editable installation would find the folder elsewhere
        "sys.meta_path = [one for one in sys.meta_path if 'editable' not in repr(one).lower()]\n"
        "import tactile_fem\n"
        f"assert {str(tmp_path)!r} in tactile_fem.__file__\n"
        "from tactile_fem import Study\n"
        "for names in tactile_fem._MODULES.values():\n"
        "    [getattr(tactile_fem, name) for name in names]\n"
        "from tactile_fem.study.template import commented_template\n"
        "assert commented_template()\n"
        "from tactile_fem.simulation.checks import check\n"
        "check(Study())\n"
        "from tactile_fem.cli.app import main\n"
        "main(['--help'])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "scan" in done.stdout


# The rooms of the core whose lists are what it exports, and what everybody may use.
ROOMS = {*ORDER} - {"errors", "runtime", "cli"}
BELOW = ("tactile_fem.errors", "tactile_fem.runtime", "tactile_fem.cli.options")
# A function that has the name of its module.
EXEMPT = {("tactile_fem.output.panels", "panels")}


@pytest.mark.parametrize("companion", COMPANIONS)
def test_a_companion_imports_what_the_core_exports(companion):
    wrong = []
    for file, names in imported_by(PACKAGE / companion).items():
        for module, name in sorted(names - EXEMPT):
            other = companion_of(module, name)
            if module.startswith(BELOW) or other == companion:
                continue
            words = module.split(".")
            is_room = len(words) == 2 and (other or words[1] in ROOMS)
            exported = set(getattr(importlib.import_module(module), "__all__", ()))
            if not (len(words) == 1 or is_room) or name not in exported | ROOMS | {""}:
                wrong.append(f"{file}: {module} {name}")
    assert not wrong
