"""Saves a running scan: trace after each step, checkpoints and fields at intervals."""

from __future__ import annotations

import json
import platform
import resource
import time
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import common

from tactile_fem import __version__
from tactile_fem.finger import FingerMesh
from tactile_fem.mechanics.compile import compiled_by
from tactile_fem.neuron import Response
from tactile_fem.receptors.probe import CellEnergy
from tactile_fem.runtime import backend
from tactile_fem.runtime.ranks import on_root
from tactile_fem.simulation.checkpoint import Origin
from tactile_fem.simulation.fields import FieldWriter
from tactile_fem.simulation.results import Results
from tactile_fem.simulation.simulation import Observation, Simulation
from tactile_fem.simulation.step import Step
from tactile_fem.simulation.trace import Array, Trace
from tactile_fem.stimulus.sampled import DistanceGrid
from tactile_fem.study.kept import keep_files

_TIMERS = (
    "solve",
    "jacobian",
    "residual",
    "obstacle",
    "preconditioner",
    "load",
    "probe",
    "output",
)


class Recorder:
    """Writes a scan into its results folder; all ranks call, rank 0 writes.

    An observer of a simulation's steps.

    Parameters
    ----------
    results
        Where to write.
    simulation, origin
        What is run, and what its checkpoints are made from.
    trace
        Its histories, which observe each step before.
    """

    def __init__(
        self, results: Results, simulation: Simulation, origin: Origin, trace: Trace
    ) -> None:
        self._results, self._simulation, self._study = results, simulation, simulation.study
        self._trace = trace
        self._problem = problem = simulation.problem
        finger = simulation.finger
        self._comm = problem.domain.comm
        self._energy = CellEnergy(problem)
        self._origin = origin
        self._started = time.perf_counter()
        self._timers_before = _timers()
        self._memory_MB = 0.0
        self._next_field_mm = 0.0
        self._field_rows: list[int] = []  # of the trace, on the first rank
        self._mesh = on_root(self._comm, lambda: _measured(finger))
        self._compiled_by = on_root(self._comm, compiled_by)
        self._fields = (
            FieldWriter(results.fields, finger.nodes, finger.cells, finger.tissue)
            if finger is not None and self._comm.rank == 0
            else None
        )

    def begin(self) -> None:
        """Save the state at rest, so that a scan that fails at once leaves a complete folder."""
        study, simulation, folder = self._study, self._simulation, self._results.folder
        on_root(self._comm, lambda: keep_files(study, folder, afresh=False))  # if cut off before
        on_root(self._comm, lambda: self._results.save_trace(**self._trace.arrays()))
        if simulation.parts.body is not None or study.stimulus.is_kept_sampled:
            grid = DistanceGrid.of(simulation.body, simulation.path.places_mm())
            on_root(self._comm, lambda: self._results.save_stimulator(grid))
        self._save_run("running")

    def __call__(self, seen: Observation) -> None:
        """Save an accepted step: trace, checkpoint, and a field where one is due."""
        step, trace = seen.step, self._trace
        sed = self._energy.gather() if self._field_due(step) else None
        state, spent = self._simulation.gather(), self._spent()

        def write() -> None:
            if sed is not None and self._fields is not None:
                moved = self._problem.domain.plane.vectors(state["u"])
                self._fields.write(float(trace.time_s[-1]), moved, sed)
                self._field_rows.append(len(trace) - 1)
            if step.indenting and self._fields is not None:
                self._fields.set_times(trace.time_s[self._field_rows])
            self._results.save_trace(**trace.arrays())
            saved = {
                **self._origin.stamp(),
                "rows": len(trace),
                "fields": np.array(self._field_rows, dtype=int),
                "next_field_mm": self._next_field_mm,
                "spent": json.dumps(spent),
                **state,
            }
            self._results.save_checkpoint(**saved)
            if sed is not None and self._fields and self._study.output.states:
                self._results.save_state(self._fields.count - 1, **saved)

        with common.Timer("tactile: output"):
            on_root(self._comm, write)

    def _field_due(self, step: Step) -> bool:
        """Return whether to write a field: at the end of a piece of the path and at intervals."""
        slid = step.displacement_mm >= self._next_field_mm - 1e-9
        if not step.output or not (slid or step.ends_piece):
            return False
        self._next_field_mm = step.displacement_mm + self._study.output.fields_mm
        return True

    def restore(self, saved: dict[str, Array]) -> None:
        """Go back to a checkpoint, and to the trace up to it.

        Raises
        ------
        StudyError
            The trace is shorter than the checkpoint says.
        """
        arrays = on_root(self._comm, lambda: self._results.trace)
        self._trace.restore(arrays, int(saved["rows"]))
        self._simulation.restore(saved)
        self._next_field_mm = float(saved["next_field_mm"])
        self._spend(json.loads(str(saved["spent"])))
        if self._fields is not None:
            self._field_rows = saved["fields"].tolist()
            self._fields.set_times(self._trace.time_s[self._field_rows])
        self._save_run("running")

    def finish(self, status: str, response: Response) -> None:
        """Save the spikes, and how the scan ended."""
        on_root(self._comm, lambda: self._results.save_spikes(response.spikes, self._trace))
        self._save_run(status)

    def _spent(self) -> dict[str, Any]:
        """Return seconds and memory of the scan, those before an interruption included."""
        now, before = _timers(), self._timers_before
        memory_MB = self._comm.allreduce(
            resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, MPI.SUM
        )
        return {
            "wall_s": time.perf_counter() - self._started,
            "peak_memory_MB": max(memory_MB, self._memory_MB),
            "timers_s": {
                name: now.get(name, 0.0) - before.get(name, 0.0) for name in {**before, **now}
            },
        }

    def _spend(self, earlier: dict[str, Any]) -> None:
        """Add the cost of the scan before it was interrupted."""
        self._started -= earlier["wall_s"]
        self._memory_MB = earlier["peak_memory_MB"]
        for name, seconds in earlier["timers_s"].items():
            self._timers_before[name] = self._timers_before.get(name, 0.0) - seconds

    def _save_run(self, status: str) -> None:
        run = {
            "status": status,
            "versions": {
                "tactile_fem": __version__,
                "dolfinx": backend.DOLFINX_VERSION,
                "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
                "python": platform.python_version(),
            },
            "mesh": {**self._mesh, "unknowns": self._problem.unknowns},
            "ranks": self._comm.size,
            "compiler": {"flags": self._study.solver.compiler_flags, **self._compiled_by},
            "petsc_options": self._problem.solver.options,
            "files": self._origin.files,
            "own_parts": self._origin.own_parts,
            **self._spent(),
        }
        on_root(self._comm, lambda: self._results.save_run(run))


def _measured(finger: FingerMesh) -> dict[str, Any]:
    """Return the measures of a mesh."""
    return {
        "hash": finger.hash,
        finger.simplex.plural: len(finger.cells),
        "pad_thickness_mm": finger.pad_thickness_mm,
        "layers_mm": finger.layers_mm,
    }


def _timers() -> dict[str, float]:
    """Return the process's wall time, in s, of each of the package's timers that has run."""
    seconds = {}
    for name in _TIMERS:
        try:
            seconds[name] = common.timing(f"tactile: {name}")[1].total_seconds()
        except RuntimeError:  # DOLFINx's word for a timer that never ran
            continue
    return seconds
