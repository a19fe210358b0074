"""Brings a command to where mechanics can be computed: the compiler, the ranks, the libraries."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from types import ModuleType

from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime import doctor, ranks


def with_mechanics(module: str, count: int, arguments: Sequence[str]) -> ModuleType:
    """Return a module that computes mechanics, on `count` ranks.

    `arguments` are the command's own, with which it is started on the ranks.

    Raises
    ------
    TactileError
        The compiler or a library of the mechanics is missing; or this is one of several ranks and
        `count` is not 1.
    """
    finding = doctor.compiler_finding()
    if finding is not None:
        raise TactileError(str(finding))
    if count > 1:
        if ranks.launched_rank() is not None:
            raise StudyError("--ranks does not go together with mpiexec: use one of them.")
        ranks.restart(count, arguments)
    try:
        return import_module(module)
    except ImportError as error:
        raise TactileError(str(error)) from error
