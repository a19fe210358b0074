"""Starts a command on several MPI ranks, and detects whether this process is one of them."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tactile_fem.errors import TactileError

TERMINAL_VARIABLE = "TACTILE_FEM_TERMINAL"
# Open MPI (from version 5 on, and 4) needs these to run more ranks than cores; MPICH does not.
SHARED_CORES = {
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
}
_RANK_VARIABLES = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK", "MV2_COMM_WORLD_RANK")


def launched_rank(environment: Mapping[str, str] = os.environ) -> int | None:
    """Return this process's rank from its launcher's variables, before MPI starts, or None."""
    for name in _RANK_VARIABLES:
        if environment.get(name, "").isdigit():
            return int(environment[name])
    return None


def is_first() -> bool:
    """Return whether this process is the first rank, or the only one."""
    rank = launched_rank()
    if rank is None and "mpi4py.MPI" in sys.modules:  # a launcher that is not known
        rank = sys.modules["mpi4py.MPI"].COMM_WORLD.rank
    return not rank


def launcher() -> str:
    """Return the mpiexec next to this Python, else the one on the path.

    Raises
    ------
    TactileError
        There is no mpiexec.
    """
    folder = Path(sys.executable).parent
    for path in (folder, None):
        for name in ("mpiexec", "mpirun"):
            if found := shutil.which(name, path=path):
                return found
    raise TactileError(
        "There is no mpiexec next to this Python or on the path: only one rank can be started."
    )


def restart(ranks: int, arguments: Sequence[str]) -> None:
    """Replace this process by `ranks` processes of the package's command line."""
    command = [launcher(), "-n", str(ranks), sys.executable, "-m", "tactile_fem", *arguments]
    environment = {"OMP_NUM_THREADS": "1", **SHARED_CORES, **os.environ}
    if sys.stderr.isatty():  # behind mpiexec this is not visible
        environment[TERMINAL_VARIABLE] = str(shutil.get_terminal_size().columns)
    sys.stdout.flush()
    os.execve(command[0], command, environment)
