"""Hides from each test the libraries that it does not declare by a mark of `needs`.

So a test whose mark was forgotten fails on every machine, not only where the library is missing.
The library is hidden from the test's process, from those that it starts, and from the collection of
all tests. A fixture that several tests share sees what all of them declare.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FunctionType, ModuleType
from typing import NamedTuple

import pytest
from needs import MISSING

from tactile_fem.runtime import doctor


class Library(NamedTuple):
    """A module, and shared libraries without which it cannot be used."""

    module: str
    loads: tuple[str, ...]


LIBRARIES = {
    "needs_gmsh": Library("gmsh", ("libGLU.so.1",)),
    "needs_graphics": Library("pyvista", doctor.OFF_SCREEN_LIBRARIES),
}
_STUBS = tempfile.TemporaryDirectory(prefix="tactile-hidden-")
_shared: dict[object, set[str]] = {}  # what all tests that share a fixture declare


def stub_folder(mark: str) -> str:
    """Return a folder which hides a library from a process that has it on its two paths."""
    folder, library = Path(_STUBS.name, mark), LIBRARIES[mark]
    if not folder.exists():
        folder.mkdir()
        for name in library.loads:
            (folder / name).touch()  # no library: the loader refuses it
        sentence = f"{library.loads[0]}: hidden from tests that do not carry {mark}"
        (folder / f"{library.module}.py").write_text(f'raise OSError("{sentence}")\n')
    return str(folder)


@contextmanager
def hidden(marks: Collection[str]) -> Iterator[None]:
    """Hide libraries from this process and from those that it starts."""
    folders = [stub_folder(mark) for mark in marks]
    loads = {name for mark in marks for name in LIBRARIES[mark].loads}
    real = doctor.has_library
    sys.path[:0] = folders
    try:
        with pytest.MonkeyPatch.context() as patch:
            for folder in folders:
                for variable in ("PYTHONPATH", "LD_LIBRARY_PATH"):
                    patch.setenv(variable, folder, prepend=os.pathsep)
            for name in _loaded({LIBRARIES[mark].module for mark in marks}):
                patch.delitem(sys.modules, name)
                parent, _, child = name.rpartition(".")
                if parent:  # or `from parent import child` would find it
                    patch.delattr(sys.modules[parent], child, raising=False)
            patch.setattr(doctor, "has_library", lambda name: name not in loads and real(name))
            yield
    finally:
        for folder in folders:
            sys.path.remove(folder)


def _loaded(modules: set[str]) -> set[str]:
    """Return those of the modules that are loaded, and the package's modules that use them."""
    found = modules & sys.modules.keys()
    ours = [name for name in sys.modules if name.startswith("tactile_fem.")]
    users, more = found, bool(found)
    while more:
        more = {name for name in ours if name not in users and _uses(sys.modules[name], users)}
        users = users | more
    return users


def _uses(module: ModuleType, names: set[str]) -> bool:
    if hasattr(module, "__path__"):  # a package: its submodules are no use of them
        return False
    values = vars(module).values()
    named = (v.__name__ if isinstance(v, ModuleType) else v.__module__ for v in values
             if isinstance(v, ModuleType | FunctionType | type))  # fmt: skip
    return any(name in names for name in named)


def declared(item: pytest.Item) -> set[str]:
    """Return the marks of a test."""
    return {mark.name for mark in item.iter_markers()} & LIBRARIES.keys()


def _use(item: pytest.Item, name: str) -> tuple[object, frozenset[tuple[str, int]]]:
    """Return a fixture of a test, and which of the parameters that it depends on."""
    definitions = item._fixtureinfo.name2fixturedefs
    indices = item.callspec.indices if hasattr(item, "callspec") else {}
    names, left = set(), [name]
    while left:
        names.add(left[-1])
        for definition in definitions.get(left.pop(), ()):
            left += [argument for argument in definition.argnames if argument not in names]
    return definitions[name][-1], frozenset((n, indices[n]) for n in names & indices.keys())


# --- pytest's hooks, for conftest.py ------------------------------------------------------------


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    with hidden(LIBRARIES):
        return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        for name in item._fixtureinfo.name2fixturedefs:
            use = _use(item, name)
            _shared[use] = _shared.get(use, declared(item)) & declared(item)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    with hidden(LIBRARIES.keys() - declared(item)):
        return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    for mark in declared(item):
        if MISSING[mark] is not None:
            pytest.skip(MISSING[mark])


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef, request):
    if fixturedef.scope == "function":
        return (yield)
    item = request._pyfuncitem
    known = fixturedef.argname in item._fixtureinfo.name2fixturedefs  # not if asked for by its name
    of_all = _shared.get(_use(item, fixturedef.argname)) if known else None
    with hidden(set() if of_all is None else declared(item) - of_all):
        return (yield)
