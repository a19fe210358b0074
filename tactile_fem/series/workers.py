"""The workers of a series: processes, each with its ranks, that run one scan after the other."""

from __future__ import annotations

import json
import queue
import subprocess
import tempfile
import threading
import time
from collections import deque
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from tactile_fem.errors import StoppedError
from tactile_fem.runtime.ranks import on_ranks
from tactile_fem.series.members import Member
from tactile_fem.series.units import are_beside

_MARK = "tactile_fem answers: "  # begins the line that answers a request

_POLL_S = 0.3
_SAVED_SCANS = "scans that ran are saved up to their last steps; start it again to continue"


@dataclass(frozen=True)
class Outcome:
    """How a scan of a series ended."""

    member: Member
    problem: str  # why it failed, in one sentence; empty if it is complete
    wall_s: float  # of this run; 0 if it was complete before


def run_units(
    units: Sequence[Sequence[Member]],
    same: Mapping[str, Sequence[str]],
    folder: Path,
    jobs: int,
    ranks: int,
    signals: Sequence[int],
) -> Generator[Outcome]:
    """Yield how each scan ended; a worker runs the scans of a unit in turn.

    `same` names for each scan those that have its mechanics. Workers are stopped when the iterator
    is closed.

    Raises
    ------
    StoppedError
        `signals` contains one.
    """
    waiting, ended = deque(units), queue.SimpleQueue[Outcome]()
    workers = [_Worker(folder, ranks) for _ in range(min(jobs, len(units)))]

    def work(worker: _Worker) -> None:
        with suppress(IndexError):
            while not worker.is_stopped:
                unit = waiting.popleft()
                for member, following in zip_longest(unit, unit[1:]):
                    if worker.is_stopped:
                        return
                    keep = following and are_beside(member.study, following.study)
                    ended.put(worker.run(member, same[member.name], keep=bool(keep)))
        worker.close()

    with ThreadPoolExecutor(max(len(workers), 1)) as pool:
        futures = [pool.submit(work, worker) for worker in workers]
        try:
            left = sum(map(len, units))
            while left:
                if signals:
                    raise StoppedError(signals[0], _SAVED_SCANS)
                for future in futures:
                    if future.done():
                        future.result()  # raises what failed
                with suppress(queue.Empty):
                    outcome = ended.get(timeout=_POLL_S)
                    left -= 1
                    yield outcome
        except BaseException:
            for worker in workers:
                worker.stop()
            raise


class _Worker:
    """A process that runs scans when asked; if it ends before its answer, the scan has failed."""

    def __init__(self, folder: Path, ranks: int) -> None:
        self._start = on_ranks(ranks, "tactile_fem.series.worker", [str(folder), _MARK])
        self._process: subprocess.Popen[str] | None = None
        self._errors = tempfile.TemporaryFile("w+", errors="replace")
        self._lock, self.is_stopped = threading.Lock(), False

    def run(self, member: Member, same: Sequence[str], *, keep: bool) -> Outcome:
        """Run a scan; see `tactile_fem.series.worker.Worker.run`."""
        begun = time.perf_counter()
        problem = self._answer_to({"name": member.name, "same": same, "keep": keep})
        return Outcome(member, problem, time.perf_counter() - begun)

    def _answer_to(self, request: dict[str, object]) -> str:
        process = self._running()
        assert process.stdin and process.stdout
        with suppress(BrokenPipeError):
            print(json.dumps(request), file=process.stdin, flush=True)
        for line in process.stdout:  # PETSc's monitors write there too
            if line.startswith(_MARK):
                return str(json.loads(line.removeprefix(_MARK)))
        self.close()
        self._errors.seek(0)
        lines = self._errors.read().strip().splitlines()
        return (lines or [f"exit code {process.returncode}"])[-1]

    def _running(self) -> subprocess.Popen[str]:
        """Return the process, which is started if there is none."""
        with self._lock:
            if self._process is None:
                command, environment = self._start
                self._errors.truncate(0)
                self._process = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=self._errors,
                    text=True,
                    errors="replace",
                    env=environment,
                )
                if self.is_stopped:
                    self._process.terminate()
            return self._process

    def stop(self) -> None:
        """Ask the process to end, and let it start no more; from any thread."""
        with self._lock:
            self.is_stopped = True
            if self._process is not None:
                self._process.terminate()

    def close(self) -> None:
        """Let the process end, and wait for it."""
        process = self._process
        if process is not None:
            with suppress(BrokenPipeError):
                assert process.stdin
                process.stdin.close()
            process.wait()
            self._process = None
