"""The version of the package, names of the version before, and files that another one wrote.

A former name is understood for one release, with a warning.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import cache
from typing import Any

UNSTATED = "0.1"  # what wrote files that do not state it
_FORMER_UNTIL = "0.3"


@cache
def this_version() -> str:
    """Return the version of the installed package, which ``pyproject.toml`` states."""
    from importlib.metadata import PackageNotFoundError, version  # few need it, and it takes time

    try:
        return version("tactile-fem")
    except PackageNotFoundError:
        return "unknown (not installed)"


def why_unreadable(written_by: object) -> str:
    """Return who wrote a file that cannot be read, as a sentence to add; empty for this version."""
    if not isinstance(written_by, str) or written_by == this_version():
        return ""
    return f" It was written by tactile-fem {written_by}; this is {this_version()}."


def warn_of_former(name: str, instead: str, *, stacklevel: int = 2) -> None:
    """Warn that a name is a former one; what to write instead begins with a verb."""
    warnings.warn(
        f"{name} is a name of an earlier version and goes with {_FORMER_UNTIL}: {instead}.",
        FutureWarning,
        stacklevel=stacklevel + 1,
    )


def renamed(table: Any, names: Mapping[str, str], where: str, *, warns: bool = True) -> Any:
    """Return a table of a study with the present names of its keys, and warn of former ones.

    ValueError if a key is given by both names. What is no table is returned as it is.
    """
    if not isinstance(table, dict):
        return table
    for former in names.keys() & table.keys():
        now = names[former]
        if now in table:
            raise ValueError(f"{former} is the former name of {now}: give one of them")
        if warns:
            warn_of_former(f"{where}.{former}", f"write {where}.{now}")
    return {names.get(key, key): value for key, value in table.items()}
