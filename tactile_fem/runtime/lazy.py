"""Names of a package that are imported when they are first used."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import Any

from tactile_fem.runtime.version import warn_of_former


def lazily(
    package: str, names: Mapping[str, Iterable[str]], former: Mapping[str, str] | None = None
) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package.

    Parameters
    ----------
    package
        Its name.
    names
        Names of each of its modules, by the module's name.
    former
        Names of an earlier version, and the present one of each; they warn.
    """
    module_of = {name: module for module, each in names.items() for name in each}

    def find(name: str) -> Any:
        if former and name in former:
            warn_of_former(f"{package}.{name}", f"write {former[name]}", stacklevel=3)
            name = former[name]
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{module_of[name]}"), name)

    return find
