"""What surrounds every computation: its log, signals, locks, and errors on one rank alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_fem.runtime.files import locked
from tactile_fem.runtime.logs import log_to, shown
from tactile_fem.runtime.ranks import (
    StopRequest,
    abort_if_one_fails,
    on_root,
    raise_stopped,
    signal_handler,
)

if TYPE_CHECKING:
    from mpi4py import MPI


@dataclass(frozen=True)
class Session:
    """A computation that is running on all ranks of `comm`; what it opens ends with it."""

    comm: MPI.Comm
    _opened: ExitStack = field(default_factory=ExitStack, repr=False)

    def on_root[T](self, action: Callable[[], T]) -> T:
        """Return what an action returns on rank 0, or raise its error, on all ranks."""
        return on_root(self.comm, action)

    def open[T](self, context: AbstractContextManager[T]) -> T:
        """Enter a context until the session ends."""
        return self._opened.enter_context(context)

    def lock(self, folder: Path) -> None:
        """Lock a folder on rank 0; raise StudyError on all ranks if another run has it."""
        on_root(self.comm, lambda: self.open(locked(folder)), share=False)

    def log_to(self, file: Path) -> None:
        """Also write the log, with every step, to a file."""
        self.open(log_to(file, self.comm.rank))

    @contextmanager
    def heeding(self, kept: str) -> Iterator[StopRequest]:
        """Heed signals only where all ranks check them; `kept` says what is saved then."""
        stop = StopRequest(self.comm, kept)
        with signal_handler(stop.request):
            yield stop


@contextmanager
def session(comm: MPI.Comm | None = None) -> Iterator[Session]:
    """Provide what a computation needs around it.

    The log is shown, unless logging is configured; SIGTERM and SIGINT raise StoppedError; if only
    some ranks fail, all end.

    Parameters
    ----------
    comm
        Its ranks, which must all enter. Default: all ranks.
    """
    from mpi4py import MPI

    comm = comm or MPI.COMM_WORLD
    with shown(), signal_handler(raise_stopped), abort_if_one_fails(comm), ExitStack() as opened:
        yield Session(comm, opened)
