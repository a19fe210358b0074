"""Errors shown to users; each message is one clear sentence."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable
from typing import Any


class TactileError(Exception):
    """Base of the package's own errors."""

    exit_code = 1

    def __reduce__(self) -> tuple[Any, ...]:
        """Allow pickling, to send the error to other ranks, whatever its constructor takes."""
        return type(self).__new__, (type(self), *self.args), vars(self)


class StudyError(TactileError):
    """Bad input: names the field, the value and what is allowed."""

    exit_code = 2


def raise_all(*checks: Callable[[], object]) -> None:
    """Call all checks; raise a StudyError with what each of them finds, a line each."""
    found: dict[str, StudyError] = {}
    for check in checks:
        try:
            check()
        except StudyError as error:
            found.setdefault(str(error), error)
    if len(found) == 1:
        raise next(iter(found.values()))
    if found:
        raise StudyError("\n".join(found))


class MeshError(StudyError):
    """A finger that cannot be meshed, or a mesh that cannot be used."""


class PlaceError(MeshError):
    """What is wrong with a finger at one place.

    Parameters
    ----------
    message
        One sentence, in which ``{place}`` is replaced by the place.
    place_mm
        (3,) in the finger's axes.
    """

    def __init__(self, message: str, place_mm: Iterable[float]) -> None:
        self.message, self.place_mm = message, tuple(float(x) for x in place_mm)
        x, y, z = self.place_mm
        place = f"at X {x:.1f}, Y {y:.1f}, Z {z:.1f} mm in the finger's axes"
        super().__init__(message.format(place=place))


class ConvergenceError(TactileError):
    """The mechanics diverged at the smallest allowed step.

    Parameters
    ----------
    message
        One sentence: where, and what to try.
    stimulator_mm
        Place of the body at the last converged step, (3,).
    reason
        PETSc's reason in words.
    """

    exit_code = 3

    def __init__(self, message: str, stimulator_mm: Iterable[float], reason: str) -> None:
        super().__init__(message)
        self.stimulator_mm = tuple(float(x) for x in stimulator_mm)
        self.reason = reason


class StoppedError(TactileError):
    """A signal ended the work; the exit code is 128 plus its number, as in a shell.

    Parameters
    ----------
    number
        The signal.
    kept
        What was saved, in words; empty if that is not known.
    """

    def __init__(self, number: int, kept: str = "") -> None:
        self.number, self.kept = number, kept
        self.exit_code = 128 + number
        super().__init__(
            f"stopped by {signal.Signals(number).name}" + (f": {kept}" if kept else "")
        )
