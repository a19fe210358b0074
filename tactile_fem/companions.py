"""The companions: folders beside the rooms of the core that build on what it exports.

Each has a file ``companion.toml``, which says what it adds; without the folder it is not there.
Its keys:

- ``summary``: a line of the package's docstring.
- ``names``, ``study_names``: what `tactile_fem` and `tactile_fem.study` offer, by module.
- ``commands``: functions of its module ``command``, which imports little before they run.
- ``tables``: those of a study, each the name of a class of settings as ``module:Class``.
- ``kinds``: modules that register kinds, imported before a study is read.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

_PACKAGE = __name__.rpartition(".")[0]


@cache
def _declared() -> dict[str, dict[str, Any]]:
    """Return what each companion declares, by the name of its folder."""
    files = sorted(Path(__file__).parent.glob("*/companion.toml"))
    return {file.parent.name: tomllib.loads(file.read_text("utf-8")) for file in files}


def summaries() -> list[str]:
    """Return the lines of the package's docstring."""
    return [each["summary"] for each in _declared().values() if "summary" in each]


def names(key: str = "names") -> dict[str, list[str]]:
    """Return names that companions offer, by the module in the package."""
    return {
        f"{folder}.{module}": found
        for folder, each in _declared().items()
        for module, found in each.get(key, {}).items()
    }


def commands() -> Iterator[Callable[..., Any]]:
    """Yield the functions that are commands of the command line."""
    for folder, each in _declared().items():
        for name in each.get("commands", ()):
            yield getattr(import_module(f"{_PACKAGE}.{folder}.command"), name)


def tables() -> dict[str, Any]:
    """Return the classes of the tables of a study, by the table's name."""
    found = {}
    for folder, each in _declared().items():
        for name, where in each.get("tables", {}).items():
            module, _, kind = where.partition(":")
            found[name] = getattr(import_module(f"{_PACKAGE}.{folder}.{module}"), kind)
    return found


def import_kinds() -> None:
    """Import what registers kinds."""
    for folder, each in _declared().items():
        for module in each.get("kinds", ()):
            import_module(f"{_PACKAGE}.{folder}.{module}")
