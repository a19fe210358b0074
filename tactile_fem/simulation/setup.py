"""Makes the objects of a scan: those that the study states, or a user's own in their place."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from mpi4py import MPI

from dolfinx import jit

from tactile_fem.finger import FingerMesh, load_finger
from tactile_fem.finger.load import check_kind
from tactile_fem.finger.report import check_mesh, pad_thickness_mm
from tactile_fem.mechanics.compile import clean_cache
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.faults import compilation_errors
from tactile_fem.mechanics.petsc_options import check_options
from tactile_fem.mechanics.problem import FingerProblem
from tactile_fem.mechanics.stepper import Stepper
from tactile_fem.neuron import Population, fields_of, replaced
from tactile_fem.path import Path
from tactile_fem.receptors import Layout
from tactile_fem.receptors.probe import Probe
from tactile_fem.runtime.files import check_unchanged, hashes
from tactile_fem.runtime.parallel import on_root
from tactile_fem.simulation.checks import (
    DEEPEST,
    check_apart,
    check_depth,
    check_section,
    tell_resolution,
)
from tactile_fem.simulation.parts import Parts, check_parts
from tactile_fem.stimulus import RigidBody, make_body
from tactile_fem.stimulus.check import check_body
from tactile_fem.stimulus.cut import in_plane
from tactile_fem.study import Study, Surface

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Setup:
    """The parts of a scan, checked.

    Attributes
    ----------
    study, parts
        The input.
    finger
        The mesh, on the first rank; None on the others.
    body, path
        The stimulator and its way.
    layout
        The receptors.
    populations
        The afferents.
    files
        SHA-256 of each file that the parts were read from, by its key.
    """

    study: Study
    parts: Parts
    finger: FingerMesh | None
    body: RigidBody
    path: Path
    layout: Layout
    populations: tuple[Population, ...]
    files: dict[str, str]

    @classmethod
    def of(cls, study: Study, parts: Parts, comm: MPI.Comm) -> Setup:
        """Make all parts that can fail on bad input; all ranks call."""
        check_options(study.solver)
        check_parts(parts, study.tissue)
        of_study = [afferents.population() for afferents in study.populations]
        populations = replaced(of_study, parts.populations)
        files = on_root(comm, lambda: hashes(study.files()))
        finger = on_root(comm, lambda: _finger(study, parts), share=False)
        thickness = on_root(comm, lambda: pad_thickness_mm(finger))
        body = parts.body or make_body(study.stimulus)
        if parts.body is None:  # an own one has been tried
            check_body(body, "stimulus")
        path = parts.path or study.protocol.route(DEEPEST * thickness)
        on_root(
            comm,
            lambda: check_section(study, path, finger.plane, own_body=parts.body is not None),
        )
        check_depth(None if parts.path else study.protocol, path, thickness)
        check_unchanged(study.files(), files)  # the hashes are those of what each rank has read
        layout = on_root(comm, lambda: study.lay_out(finger))
        on_root(comm, lambda: check_apart(body, path, finger))
        return cls(study, parts, finger, body, path, layout, populations, files)

    def instruments(self, comm: MPI.Comm) -> Instruments:
        """Compile and distribute the mechanics and the probe."""
        study = self.study
        on_root(comm, lambda: clean_cache(jit.get_options()["cache_dir"]))
        with compilation_errors():
            domain = create_domain(self.finger, comm, study.solver.held)
            problem = FingerProblem(
                domain,
                study.tissue,
                in_plane(self.body, domain.plane),
                study.stimulus.friction,
                study.solver,
                laws=self.parts.laws,
            )
            _ = problem.load_cell  # compiled here, not in the first step
            probe = Probe(
                problem,
                self.layout.samples,
                len(self.layout.positions_mm),
                fields_of(self.populations),
            )
            stepper = Stepper(problem, self.path, study.solver, domain.plane)
        logger.info(
            "%d cells that deform, %d unknowns, %d receptors, %d ranks",
            len(domain.file_cells),
            problem.unknowns,
            len(self.layout.positions_mm),
            comm.size,
        )
        if isinstance(study.stimulus, Surface) and not self.parts.body:
            on_root(comm, lambda: tell_resolution(study.stimulus, self.finger))
        return Instruments(problem, stepper, probe)


@dataclass(frozen=True)
class Instruments:
    """The mechanics and the probe."""

    problem: FingerProblem
    stepper: Stepper
    probe: Probe


def _finger(study: Study, parts: Parts) -> FingerMesh:
    if parts.finger is None:
        return load_finger(study.finger)
    check_mesh(parts.finger)
    check_kind(parts.finger, study.finger)
    return parts.finger
