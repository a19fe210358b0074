"""A study's finger, body and path, ready to be stepped."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI

import numpy as np
from dolfinx import jit
from numpy.typing import ArrayLike

from tactile_fem.assembly.compile import clean_cache
from tactile_fem.errors import StudyError
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.faults import compilation_errors
from tactile_fem.mechanics.load import Load
from tactile_fem.mechanics.problem import Problem
from tactile_fem.mechanics.rows import Snapshot
from tactile_fem.mechanics.state import State
from tactile_fem.mechanics.terms.inertia import moment_of_inertia
from tactile_fem.neuron import fields_of, replaced
from tactile_fem.receptors import Layout
from tactile_fem.runtime.files import check_unchanged, hashes
from tactile_fem.runtime.ranks import on_root
from tactile_fem.simulation.bone import Bone
from tactile_fem.simulation.checks import checked_mesh, path_of, warn_if_sharp
from tactile_fem.simulation.parts import NO_PARTS, Parts
from tactile_fem.simulation.probe import Probe, ReceptorState
from tactile_fem.simulation.step import Step
from tactile_fem.simulation.stepper import Stepper, stopped
from tactile_fem.solvers.fast import FastSolver
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.solvers.report import StepSolver
from tactile_fem.stimulus.body import in_plane
from tactile_fem.study import Study

logger = logging.getLogger(__name__)

Array = np.ndarray


class Simulation:
    """The mechanics of a study, one accepted step after the other.

    Bad input is refused when it is made, within seconds; the mechanics is compiled with the first
    step. Between two steps a script may look at everything::

        with closing(Simulation(Study())) as simulation:
            for step in simulation.steps():
                print(step, simulation.load().contact_area_mm2, simulation.receptors.read().sed_kPa)

    Parameters
    ----------
    study
        The input.
    parts
        Own parts in place of the study's.
    comm
        Communicator; all its ranks must call everything. Default: all ranks.
    make_solver
        Makes the solver of the steps; `tactile_fem.solvers.plain.PlainSolver` is the alternative.

    Attributes
    ----------
    finger
        The mesh, on the first rank; None on the others.
    body, path
        The stimulator and its motion.
    layout
        The receptors' positions.
    populations
        The afferents.
    files
        SHA-256 of each file that the parts were read from, by its key.

    Raises
    ------
    StudyError
        Bad input.
    """

    def __init__(
        self,
        study: Study,
        parts: Parts = NO_PARTS,
        comm: MPI.Comm | None = None,
        make_solver: Callable[[Problem], StepSolver] = FastSolver,
    ) -> None:
        self.study, self.parts, self._make_solver = study, parts, make_solver
        self.comm = comm = comm or MPI.COMM_WORLD
        of_study = [afferents.population() for afferents in study.populations]
        self.populations = replaced(of_study, parts.populations)
        self.finger: Any = None  # a FingerMesh on the first rank, which alone uses it

        def on_first_rank() -> tuple[dict[str, str], float, Layout]:
            files = hashes(study.files())
            self.finger = checked_mesh(study, parts)
            return files, self.finger.pad_thickness_mm, study.lay_out(self.finger)

        self.files, thickness_mm, self.layout = on_root(comm, on_first_rank)
        self.body = parts.body or study.stimulus.body()
        self.path = path_of(study, thickness_mm, parts)
        check_unchanged(study.files(), self.files)  # the hashes are those of what each rank read

    # --- the mechanics ---------------------------------------------------------------------------

    @cached_property
    def problem(self) -> FingerProblem:
        """State, terms, conditions and solver."""
        study = self.study
        on_root(self.comm, lambda: clean_cache(jit.get_options()["cache_dir"]))
        with compilation_errors():
            domain = create_domain(self.finger, self.comm, study.solver.held)
            return FingerProblem(
                domain,
                study.tissue,
                in_plane(self.body, domain.plane),
                study.stimulus.law(),
                study.solver,
                laws=self.parts.laws,
                terms=self.parts.terms,
                make_solver=self._make_solver,
            )

    @cached_property
    def receptors(self) -> Probe:
        """Evaluates the tissue at the receptors."""
        with compilation_errors():
            count = len(self.layout.positions_mm)
            return Probe(self.problem, self.layout.samples, count, fields_of(self.populations))

    @cached_property
    def _stepper(self) -> Stepper:
        study = self.study
        on_root(self.comm, lambda: warn_if_sharp(self.body, self.path, self.finger))
        on_root(self.comm, self.path.announce)
        problem = self.problem
        with compilation_errors():
            _ = problem.load_cell, self.receptors  # compiled here, not in the first step
        logger.info(
            "%d deformable cells, %d unknowns, %d receptors, %d ranks",
            len(problem.domain.file_cells),
            problem.unknowns,
            len(self.layout.positions_mm),
            self.comm.size,
        )
        plane = problem.domain.plane
        return Stepper(problem, self.path, study.solver, plane, self._bone())

    def _bone(self) -> Bone | None:
        """Return the bone at rest on its joint; None if it is clamped."""
        joint, density = self.study.joint, self.study.tissue.density_kg_m3
        if joint is None or not self.study.solver.inertia:
            return Bone(joint) if joint else None
        of_tissue = moment_of_inertia(self.problem.tissues, density, joint.centre_mm)
        return Bone(joint, joint.inertia_beyond(of_tissue))

    @property
    def state(self) -> State:
        """Displacement and everything else that an accepted step leaves for the next; read only."""
        return self.problem.state

    def load(self) -> Load:
        """Return forces in space, contact area and energies after the last accepted step."""
        return self._stepper.load()

    @property
    def bone_rad(self) -> float:
        """Angle of the bone about its joint at the end of the last accepted step."""
        return self._stepper.bone_rad

    # --- stepping --------------------------------------------------------------------------------

    def steps(self) -> Iterator[Step]:
        """Yield each accepted step until the path ends.

        Raises
        ------
        ConvergenceError
            The mechanics diverged at the smallest step.
        TactileError
            The forms cannot be compiled.
        """
        yield from self._stepper

    def observed(self, observers: Iterable[Observer] = ()) -> Iterator[Observation]:
        """Yield each accepted step after the receptors and then each observer have seen it."""
        for step in self.steps():
            seen = Observation(step, self)
            for observer in (self._feel, *observers):
                found = observer(seen.copied()) or {}
                for name in sorted(seen.columns.keys() & found.keys()):
                    raise StudyError(f"observers: two of them return {name}: choose another name.")
                seen.columns.update(deepcopy(dict(found)))
            yield seen

    def _feel(self, seen: Observation) -> Mapping[str, Array]:
        """Return what the receptors feel; raise ConvergenceError where that is no number.

        A cell is turned inside out there, although its quadrature points may still be right.
        """
        step, felt = seen.step, self.receptors.read()
        lost = ~np.isfinite(felt.sed_kPa + felt.von_mises_kPa + felt.stretches.sum(axis=1))
        if lost.any():
            x, y, _ = self.layout.positions_mm[lost][0]
            raise stopped(
                step.phase,
                step.stimulator_mm,
                step.displacement_mm,
                f"there the tissue at the receptor at X {x:.1f}, Y {y:.1f} mm is turned inside out",
                "less depth, stiffer tissue or a finer mesh",
            )
        return felt.columns

    # --- restart ---------------------------------------------------------------------------------

    def to_save(self) -> Snapshot:
        """Return all that the next step needs, independent of the number of ranks.

        It stays as it is here; see `tactile_fem.mechanics.rows.gathered`.
        """
        return self._stepper.to_save()

    def restore(self, saved: dict[str, Array]) -> None:
        """Go on from where `to_save` was called: the next steps take the same iterations.

        All ranks call, with what `gathered` returned.
        """
        self._stepper.restore(saved)

    def close(self) -> None:
        """Free the solver; all ranks must call it."""
        if "problem" in vars(self):
            self.problem.close()


@dataclass(frozen=True)
class Observation:
    """An accepted step as an observer sees it.

    Attributes
    ----------
    step
        Position of the body, forces, cost.
    simulation
        Displacement (`simulation.state.u`), contact, and everything else; read only.
    columns
        What the receptors feel, and what earlier observers have returned, by name. These and the
        step's arrays are the observer's own: it may work on them in place.
    """

    step: Step
    simulation: Simulation
    columns: dict[str, Any] = field(default_factory=dict)

    def copied(self) -> Observation:
        """Return the same with step and columns of its own."""
        return replace(self, step=deepcopy(self.step), columns=deepcopy(self.columns))

    @property
    def receptors(self) -> ReceptorState:
        """What the receptors feel."""
        names = [field.name for field in self.simulation.receptors.fields]
        return ReceptorState({name: self.columns[name] for name in names})

    @property
    def state(self) -> State:
        """The state of finger and body; read only."""
        return self.simulation.state


# Called on every rank after each accepted step; what it returns joins the trace, a column by each
# name.
Observer = Callable[[Observation], Mapping[str, ArrayLike] | None]
