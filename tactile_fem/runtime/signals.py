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


@contextmanager
def signal_handler(answer: Callable[[int], None]) -> Iterator[None]:
    """Call `answer` with the number of a received SIGTERM or SIGINT; main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    for number in _SIGNALS:
        signal.signal(number, lambda caught, frame: answer(caught))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def raise_stopped(number: int) -> None:
    """Raise StoppedError; for `signal_handler` while there is nothing to save."""
    raise StoppedError(number)


class StopRequest:
    """A signal received on any rank, handled at the same point on all ranks, which must check."""

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._number = 0

    def request(self, number: int) -> None:
        """Store a signal; for `signal_handler`."""
        self._number = number

    def check(self, *args: Any) -> None:
        """Raise StoppedError on all ranks if one received a signal; usable as a SNES monitor."""
        number = self._comm.allreduce(self._number, op=max)
        if number:
            raise StoppedError(number)
