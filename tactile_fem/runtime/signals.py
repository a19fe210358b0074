"""SIGTERM and SIGINT stop a scan between two Newton iterations, on all ranks together."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from tactile_fem.errors import StoppedError

if TYPE_CHECKING:
    from mpi4py import MPI

_SIGNALS = (signal.SIGTERM, signal.SIGINT)


class _Handler:
    """Calls `answer` until a StoppedError is on its way: saving and closing must not be cut off."""

    def __init__(self, answer: Callable[[int], None]) -> None:
        self._answer, self.stopping = answer, False

    def __call__(self, number: int, frame: object) -> None:
        if self.stopping:
            return
        try:
            self._answer(number)
        except StoppedError:
            self.stopping = True
            raise


@contextmanager
def signal_handler(answer: Callable[[int], None]) -> Iterator[None]:
    """Call `answer` with the number of a received SIGTERM or SIGINT; main thread only.

    Handlers may be nested. Once a StoppedError leaves one, those around it ignore further signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    handler = _Handler(answer)
    for number in _SIGNALS:
        signal.signal(number, handler)
    try:
        yield
    except StoppedError:
        for outer in before.values():
            if isinstance(outer, _Handler):
                outer.stopping = True
        raise
    finally:
        for number, former in before.items():
            signal.signal(number, former)


def raise_stopped(number: int) -> None:
    """Raise StoppedError; for `signal_handler` while there is nothing to save."""
    raise StoppedError(number)


class StopRequest:
    """A signal received on any rank, handled at the same point on all ranks, which must check.

    `kept` says in the error what is saved.
    """

    def __init__(self, comm: MPI.Comm, kept: str = "") -> None:
        self._comm, self._kept = comm, kept
        self._number = 0

    def request(self, number: int) -> None:
        """Store a signal; for `signal_handler`."""
        self._number = number

    def check(self, *args: Any) -> None:
        """Raise StoppedError on all ranks if one received a signal; usable as a SNES monitor."""
        number = self._comm.allreduce(self._number, op=max)
        if number:
            raise StoppedError(number, self._kept)
