"""Expected memory and time of a scan.

The laws are fitted to whole scans of the default study at 37,000 to 332,000 unknowns on one and
two cores (demos/pages/how/solver.md); another machine or stimulus may differ by a factor of two.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from pathlib import Path as FilePath

from mpi4py import MPI

from tactile_fem.path import Path
from tactile_fem.simulation.simulation import Simulation
from tactile_fem.study import Study

logger = logging.getLogger(__name__)

_MB = 1e6
_RANK_MB = 240.0
_UNKNOWN_MB = 0.0088
_REFERENCE_UNKNOWNS = 37_000
_FACTORS_MB = 390.0  # of the direct solver, at the reference
# One iteration at the reference on one core; of 0.26 s, what keeping the tangent and so on leave.
_NEWTON_S = 0.107
_DIRECT_NEWTON_S = 1.6
# Of a section, for each unknown.
_SECTION_NEWTON_S, _SECTION_UNKNOWN_MB = 2.0e-6, 0.003
_NEWTON_PER_STEP = 6.9
_FIRST_STEPS = 3  # shorter ones, of each piece of the path
# Cost of a step at a held force, relative to one at a held depth, and of each further held load.
_SOLVES_AT_FORCE, _SOLVES_AT_LOAD = 1.8, 0.5


@dataclass(frozen=True)
class Cost:
    """Memory of all ranks together, and wall time."""

    memory_MB: float
    wall_s: float


def estimate(study: Study, path: Path, unknowns: int, ranks: int) -> Cost:
    """Return the expected cost for `unknowns` displacement components on `ranks` cores."""
    size = unknowns / _REFERENCE_UNKNOWNS
    flat = study.finger.is_section
    memory = _RANK_MB * ranks + (_SECTION_UNKNOWN_MB if flat else _UNKNOWN_MB) * unknowns
    if flat:
        newton = _SECTION_NEWTON_S * unknowns
    elif study.solver.linear == "direct":
        memory += _FACTORS_MB * size**1.35
        newton = _DIRECT_NEWTON_S * size**1.7
    else:
        newton = _NEWTON_S * size**1.1
    solver, steps = study.solver, 0.0
    for _, motion in path.plan():
        count = motion.least_steps(solver.max_slide_step_mm, solver.max_press_step_mm)
        loads = 0 if motion.held is None else len(motion.held.components)
        steps += count * (_SOLVES_AT_FORCE + _SOLVES_AT_LOAD * (loads - 1) if loads else 1.0)
    steps += _FIRST_STEPS * len(path.pieces)
    return Cost(memory, newton * _NEWTON_PER_STEP * steps * ranks**-0.7)


def announce(simulation: Simulation) -> None:
    """Log the expected cost; warn if this machine has too little memory."""
    comm = simulation.comm
    needed = estimate(simulation.study, simulation.path, simulation.problem.unknowns, comm.size)
    minutes = math.ceil(needed.wall_s / 60)
    logger.info("expect about %d min and %.1f GB for all ranks", minutes, needed.memory_MB / 1000)
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    here = needed.memory_MB * node.size / comm.size
    node.Free()
    free = available_memory_MB()
    if free is not None and here > free:
        logger.warning(
            "this scan needs about %.1f GB here, but %.1f GB are free: "
            'take a smaller finger.preset, solver.linear = "multigrid" or more machines',
            here / 1000,
            free / 1000,
        )


def available_memory_MB() -> float | None:
    """Return the free memory, within the limit of a container; None if not known."""
    try:
        lines = FilePath("/proc/meminfo").read_text(encoding="ascii").splitlines()
        available = next(line.split()[1] for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration):
        return None
    free = int(available) * 1024 / _MB
    try:
        limit = FilePath("/sys/fs/cgroup/memory.max").read_text(encoding="ascii").strip()
        used = FilePath("/sys/fs/cgroup/memory.current").read_text(encoding="ascii").strip()
    except OSError:
        return free
    return free if limit == "max" else min(free, (int(limit) - int(used)) / _MB)
