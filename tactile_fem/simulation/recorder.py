"""Saves a running scan: a row of the trace after each step, checkpoints and fields at intervals."""

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

from tactile_fem.assembly.compile import compiled_by
from tactile_fem.neuron import Response
from tactile_fem.path.rotations import ARM_MM, angle_rad
from tactile_fem.results.contact_fields import SkinContact
from tactile_fem.results.fields import FieldWriter
from tactile_fem.results.results import Results
from tactile_fem.results.trace import Array, Trace
from tactile_fem.runtime import backend
from tactile_fem.runtime.ranks import on_root
from tactile_fem.runtime.version import this_version
from tactile_fem.simulation.cell_fields import CellFields
from tactile_fem.simulation.checkpoint import Checkpoints, origin_of
from tactile_fem.simulation.simulation import Observation, Simulation
from tactile_fem.simulation.step import Step
from tactile_fem.stimulus.sampled import DistanceGrid
from tactile_fem.study.input_copies import keep_files

_TIMERS = (
    *("solve", "jacobian", "residual", "obstacle", "preconditioner"),
    *("load", "probe", "output"),
)


class Recorder:
    """Writes a scan into its results folder; all ranks call, rank 0 writes.

    An observer of a simulation's steps, after its trace.
    """

    def __init__(self, results: Results, simulation: Simulation, trace: Trace) -> None:
        self._results, self._simulation, self._trace = results, simulation, trace
        self._comm = simulation.comm
        self._cells = CellFields(simulation.problem)
        self._started, self._timers_before = time.perf_counter(), _timers()
        # Cost of the scan before it was interrupted.
        self._earlier: dict[str, Any] = {"wall_s": 0.0, "peak_memory_MB": 0.0, "timers_s": {}}
        # Rows of the trace whose fields are kept.
        self._field_rows: list[int] = []
        # On the first rank: what stays the same in checkpoints and in run.json, and the files.
        self._origin, self._run = dict[str, Any](), dict[str, Any]()
        self._fields: FieldWriter | None = None
        self._checkpoints = Checkpoints(self._comm)

        def prepare() -> None:
            self._origin, self._run = origin_of(simulation), _described(simulation)
            finger = simulation.finger
            self._contact = SkinContact(finger)
            self._fields = FieldWriter(results.fields, finger.nodes, finger.cells, finger.tissue)

        on_root(self._comm, prepare)

    def begin(self) -> None:
        """Save the state at rest, so that a scan that fails at once leaves a complete folder."""
        simulation, study = self._simulation, self._simulation.study

        def save() -> None:
            keep_files(study, self._results.folder, afresh=False)  # if it was cut off before
            self._results.save_trace(**self._trace.arrays())
            if simulation.parts.body is not None or study.stimulus.is_kept_sampled:
                poses = simulation.path.places_mm(), simulation.path.turns_rad()
                self._results.save_stimulator(DistanceGrid.of(simulation.body, *poses))

        on_root(self._comm, save)
        self._save_run("running")

    def __call__(self, seen: Observation) -> None:
        """Save an accepted step, and its fields where they are due."""
        trace, problem = self._trace, self._simulation.problem
        due, order = self._is_due(seen.step), problem.order
        fields = [*self._field_rows, len(trace) - 1] if due else self._field_rows
        if due:
            load = seen.step.load
            forces = load.pressure_N, load.friction_N, load.bound_N
            vectors = [order.gather(problem.u), *map(order.gather_owned, forces)]
            cells = self._cells.gather(contact_area_mm2=load.touching_mm2)

        def write() -> bool:
            assert self._fields is not None
            self._results.append_row(trace)
            if due:
                moved, *loads = map(self._simulation.finger.plane.vectors, vectors)
                of_skin = {**self._contact.fields(moved, *loads), "skin": self._contact.on_skin}
                of_nodes = {"displacement_mm": moved, **of_skin}
                self._fields.write(float(trace.at("time_s", [-1])[0]), of_nodes, cells)
            if seen.step.indenting:
                self._fields.set_times(trace.at("time_s", fields))
            return due or self._checkpoints.is_due

        with common.Timer("tactile: output"):
            save = on_root(self._comm, write)
            self._field_rows = fields
            state = {"rows": np.array(len(trace)), "fields": np.array(fields, dtype=int)}
            spent = {"spent": np.array(json.dumps(self._spent()))}
            self._checkpoints.keep({**state, **spent, **self._simulation.to_save()})
            if save:
                self._checkpoints.save(self._write_checkpoint)

    def _write_checkpoint(self, state: dict[str, Array]) -> None:
        """Write a state that was gathered, and keep it if its fields are kept."""
        self._results.sync_rows()  # or a power cut could leave fewer rows than the checkpoint needs
        saved, rows, kept = self._origin | state, int(state["rows"]), state["fields"].tolist()
        self._results.save_checkpoint(**saved)
        if self._simulation.study.output.restarts and rows - 1 in kept:
            self._results.save_state(len(kept) - 1, **saved)

    def _is_due(self, step: Step) -> bool:
        """Return whether to keep the fields: at ends of pieces of the path and at intervals."""
        if step.ends_piece:
            return True
        rows = [self._field_rows[-1] if self._field_rows else 0, -1]
        ways = (self._trace.at(name, rows) for name in ("displacement_mm", "depth_mm"))
        turn_mm = ARM_MM * angle_rad(*self._trace.at("stimulator_rad", rows))
        increment_mm = max(turn_mm, *(abs(way[1] - way[0]) for way in ways))
        return step.output and increment_mm >= self._simulation.study.output.states_mm - 1e-9

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
        self._earlier = json.loads(str(saved["spent"]))
        self._field_rows = saved["fields"].tolist()
        if self._fields is not None:
            self._fields.set_times(self._trace.at("time_s", self._field_rows))
        self._save_run("running")

    def save(self) -> None:
        """Save the whole trace and the last accepted state."""
        self._checkpoints.save(self._write_checkpoint)
        on_root(self._comm, lambda: self._results.save_trace(**self._trace.arrays()))

    def finish(self, status: str, response: Response) -> None:
        """Save the spikes, and how the scan ended."""
        on_root(self._comm, lambda: self._results.save_spikes(response.spikes, self._trace))
        self._save_run(status)

    def _spent(self) -> dict[str, Any]:
        """Return seconds and memory of the scan, those before an interruption included."""
        seconds, before, earlier = _timers(), self._timers_before, self._earlier["timers_s"]
        memory_MB = self._comm.allreduce(
            resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, MPI.SUM
        )
        return {
            "wall_s": self._earlier["wall_s"] + time.perf_counter() - self._started,
            "peak_memory_MB": max(memory_MB, self._earlier["peak_memory_MB"]),
            "timers_s": {
                name: earlier.get(name, 0.0) + seconds.get(name, 0.0) - before.get(name, 0.0)
                for name in {**earlier, **seconds}
            },
        }

    def _save_run(self, status: str) -> None:
        run = {"status": status, **self._run, **self._spent()}
        on_root(self._comm, lambda: self._results.save_run(run))


def _described(simulation: Simulation) -> dict[str, Any]:
    """Return versions, mesh, options and parts of a scan, for ``run.json``."""
    finger, problem = simulation.finger, simulation.problem
    return {
        "versions": {
            "tactile_fem": this_version(),
            "dolfinx": backend.DOLFINX_VERSION,
            "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
            "python": platform.python_version(),
        },
        "mesh": {
            "hash": finger.hash,
            finger.simplex.plural: len(finger.cells),
            "pad_thickness_mm": finger.pad_thickness_mm,
            "layers_mm": finger.layers_mm,
            "unknowns": problem.unknowns,
        },
        "ranks": simulation.comm.size,
        "compiler": {"flags": simulation.study.solver.compiler_flags, **compiled_by()},
        "petsc_options": problem.solver.options,
        "files": simulation.files,
        "own_parts": simulation.parts.listed(),
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
