"""MPI ranks: how they are started, and what reaches all of them: results, errors, signals.

Nothing here imports MPI, so ranks can be detected before it starts.
"""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
import signal
import stat
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_fem.errors import StoppedError, TactileError

if TYPE_CHECKING:
    from mpi4py import MPI

logger = logging.getLogger(__name__)

TERMINAL_VARIABLE = "TACTILE_FEM_TERMINAL"
# Open MPI (from version 5 on, and 4) needs these to run more ranks than cores; MPICH does not.
SHARED_CORES = {
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
}
_RANK_VARIABLES = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK", "MV2_COMM_WORLD_RANK")
_SIGNALS = (signal.SIGTERM, signal.SIGINT)
# How long a failed rank waits for the others to fail too, and then for its message to be read.
_WAIT_S = 5.0


def launched_rank() -> int | None:
    """Return the rank from the variables of the launcher, before MPI starts, or None."""
    values = (os.environ.get(name, "") for name in _RANK_VARIABLES)
    return next((int(value) for value in values if value.isdigit()), None)


def is_first() -> bool:
    """Return whether this process is the first rank, or the only one."""
    rank = launched_rank()
    if rank is None and "mpi4py.MPI" in sys.modules:  # an unknown launcher
        rank = sys.modules["mpi4py.MPI"].COMM_WORLD.rank
    return not rank


def launcher() -> str:
    """Return the mpiexec next to this Python, else the one on the path; else TactileError."""
    for path in (Path(sys.executable).parent, None):
        for name in ("mpiexec", "mpirun"):
            if found := shutil.which(name, path=path):
                return found
    raise TactileError(
        "There is no mpiexec next to this Python or on the path: only one rank can be started."
    )


def on_ranks(
    ranks: int, module: str, arguments: Sequence[str] = ()
) -> tuple[list[str], dict[str, str]]:
    """Return command and environment of a module of Python on a number of ranks."""
    command = [sys.executable, "-m", module, *arguments]
    if ranks > 1:
        command = [launcher(), "-n", str(ranks), *command]
    return command, {"OMP_NUM_THREADS": "1", **SHARED_CORES, **os.environ}


def restart(ranks: int, arguments: Sequence[str]) -> None:
    """Replace this process by `ranks` processes of the command line of the package."""
    command, environment = on_ranks(ranks, "tactile_fem", arguments)
    if sys.stderr.isatty():  # behind mpiexec this is not visible
        environment[TERMINAL_VARIABLE] = str(shutil.get_terminal_size().columns)
    sys.stdout.flush()
    os.execve(command[0], command, environment)


def on_root[T](comm: MPI.Comm, action: Callable[[], T], *, share: bool = True) -> T:
    """Run `action` on rank 0 and return its result on all ranks, or None if `share` is false.

    All ranks of the communicator must call. If the action raises, all of them raise its error.
    """
    result: Any = None
    with shared_errors(comm):
        if comm.rank == 0:
            result = action()
    return comm.bcast(result) if share else result


@contextmanager
def shared_errors(comm: MPI.Comm) -> Iterator[None]:
    """Raise an error of any rank on all ranks, which must all enter; they must not communicate."""
    error: Exception | None = None
    try:
        yield
    except Exception as caught:
        error = caught
    if not comm.allreduce(error is not None, op=max):
        return
    errors = comm.allgather(_sendable(error))
    raise error or next(found for found in errors if found is not None)


def _sendable(error: Exception | None) -> Exception | None:
    """Return an error that can be pickled: a built-in or own one as it is, others as text."""
    known = isinstance(error, TactileError) or type(error).__module__ == "builtins"
    return error if known else TactileError(f"{type(error).__name__}: {error}")


@contextmanager
def abort_if_one_fails(comm: MPI.Comm) -> Iterator[None]:
    """Raise an error if all ranks have one; end all ranks if only some of them do.

    Otherwise the other ranks would wait for ever. The ranks synchronize on a communicator of
    their own, so that communication in the block is not disturbed.
    """
    if comm.size == 1:
        yield
        return
    own = comm.Dup()
    try:
        yield
    except BaseException as error:
        arrival = own.Ibarrier()
        if not _happens(arrival.Test):
            trace = None if isinstance(error, TactileError | OSError) else error
            code = getattr(error, "exit_code", 1)
            try:
                logger.critical("rank %d ends all: %s", comm.rank, error, exc_info=trace)
                # MPICH's mpiexec ends at once after an abort, and its proxy forwards the abort
                # before the rank's stderr: on a busy machine the message was lost.
                _happens(lambda: _is_read(2))
            finally:
                comm.Abort(code)
                os._exit(code)  # in some MPI libraries, Abort returns
        raise
    finally:
        own.Free()


def _happens(condition: Callable[[], bool]) -> bool:
    """Return whether a condition is met within a few seconds."""
    end = time.monotonic() + _WAIT_S
    while not (met := condition()) and time.monotonic() < end:
        time.sleep(0.01)
    return met


def _is_read(file: int) -> bool:
    """Return whether all that was written to a pipe has been read; true of any other file."""
    if not stat.S_ISFIFO(os.fstat(file).st_mode):
        return True
    return not int.from_bytes(fcntl.ioctl(file, termios.FIONREAD, bytes(4)), sys.byteorder)


class _Handler:
    """Calls `answer` until a StoppedError is raised: saving and closing must not be cut off."""

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

    Handlers may be nested. Once a StoppedError is raised in one, those around it ignore further
    signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = _Handler(answer)
    before = {number: signal.signal(number, handler) for number in _SIGNALS}
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

    `kept` is the part of the error's message that names what is saved.
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
