"""What the finger carries: forces, contact area, energies, and how exact the contact is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

from tactile_fem.mechanics.elasticity import deformation_gradient

if TYPE_CHECKING:
    from tactile_fem.mechanics.problem import FingerProblem

# Skin that is nearer to the body than this touches it, as ink on the finger would. Less would
# show the noise of the gap on coarse meshes, one or two micrometres.
_TOUCHING_MM = 0.01


@dataclass(frozen=True)
class Load:
    """Forces and energies at the end of a step.

    Attributes
    ----------
    force_N, moment_Nmm
        Of the contact traction on the finger, (3,); the moment about the origin.
    imbalance_N
        Distance between the contact force and the reaction at the held boundary.
    contact_area_mm2
        Skin within a hundredth of a millimetre of the body, as it is deformed.
    gap_error_mm
        How far the skin is off the body's surface where it presses: the modulus of the gap,
        weighted with the pressure.
    traction_error
        Normal traction of the tissue less that of the contact, integrated over the skin that
        touches, as a share of the pressure's integral. It vanishes with the mesh size.
    work_mJ, friction_mJ
        Since the last accepted step, by the trapezoidal rule: work of the body on the finger,
        and the part of it that friction turns into heat.
    stored_mJ
        Strain energy of the tissues.
    volume_change
        Of the deformable tissue, relative.
    """

    force_N: np.ndarray
    moment_Nmm: np.ndarray
    imbalance_N: float
    contact_area_mm2: float
    gap_error_mm: float
    traction_error: float
    work_mJ: float
    friction_mJ: float
    stored_mJ: float
    volume_change: float


class LoadCell:
    """Reads the load of a problem; remembers that of the last accepted step.

    Parameters
    ----------
    problem
        The finger and the body.

    Attributes
    ----------
    force_old_N, friction_old
        At the last accepted step: contact force (3,) and nodal forces of friction, in N.
    """

    def __init__(self, problem: FingerProblem) -> None:
        self._problem = problem
        V = problem.u.function_space
        v = ufl.TestFunction(V)
        pressure = friction = 0
        for part in problem.skin:
            s_n, s_t = part.contact.tractions(part.t, problem.u, problem.u_old)
            pressure += s_n * ufl.dot(problem.obstacle.normal, v) * part.ds
            friction += ufl.dot(s_t, v) * part.ds
        self._pressure_form = problem.compile(pressure)
        self._friction_form = problem.compile(friction)
        self._integrals_form = problem.compile(_integrals(problem))
        self._force_N = self.force_old_N = np.zeros(3)
        self._friction = fem.Function(V)
        self.friction_old = fem.Function(V)

    def read(self) -> Load:
        """Return the load at the present displacement."""
        problem = self._problem
        with common.Timer("tactile: load"):
            problem.obstacle.refresh()
            pressure, friction, residual = (
                _nodal(form)
                for form in (self._pressure_form, self._friction_form, problem.residual_form)
            )
            integrals = _nodal(self._integrals_form).sum(axis=0)
        advance = problem.obstacle.translation.value - problem.obstacle.translation_old.value
        here = [
            self._forces(pressure + friction, residual),
            [self._heat(friction, advance)],
            integrals,
        ]
        whole = problem.domain.comm.allreduce(np.concatenate(here))
        force, moment, reaction = whole[:9].reshape(3, 3)
        heat, area, normal, off, traction, stored, volume, rest = whole[9:].tolist()
        some = normal if normal > 0 else 1.0
        self._force_N = force
        return Load(
            force,
            moment,
            float(np.linalg.norm(force + reaction)),
            area,
            off / some,
            (traction - normal) / some,
            float((force + self.force_old_N) @ advance / 2),
            heat,
            stored,
            volume / rest - 1,
        )

    def _forces(self, contact: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """Return this rank's contact force, its moment and the held reaction, (9,)."""
        problem = self._problem
        owned = len(contact)
        place = problem.u.function_space.tabulate_dof_coordinates()[:owned]
        moment = np.cross(place + _owned(problem.u, owned), contact)
        held = problem.held[problem.held < owned]
        reaction = (residual + contact)[held]
        return np.concatenate([part.sum(axis=0) for part in (contact, moment, reaction)])

    def _heat(self, friction: np.ndarray, advance: np.ndarray) -> float:
        """Return this rank's heat of friction since the last accepted step, in mJ."""
        owned = len(friction)
        mean = (friction + _owned(self.friction_old, owned)) / 2
        _owned(self._friction, owned)[:] = friction
        u, u_old = (_owned(u, owned) for u in (self._problem.u, self._problem.u_old))
        return float(np.sum(mean * (advance - (u - u_old))))

    def keep(self) -> None:
        """Make the load that was read last that of the last accepted step."""
        self.force_old_N = self._force_N
        self.friction_old.x.array[:] = self._friction.x.array


_COUNT = 7


def _integrals(problem: FingerProblem) -> ufl.Form:
    """Return the integrals over skin and tissue, one for each component of a DG0 test function.

    So one kernel computes them all, cell by cell: contact area, pressure, pressure times
    gap, traction of the tissue; strain energy, volume now and at rest.
    """
    msh = problem.domain.mesh
    w = ufl.TestFunction(fem.functionspace(msh, ("DG", 0, (_COUNT,))))
    F = deformation_gradient(problem.u)
    J = ufl.det(F)
    N = ufl.FacetNormal(msh)
    stretch = J * ufl.sqrt(ufl.dot(ufl.inv(F).T * N, ufl.inv(F).T * N))
    gap, normal = problem.obstacle.gap, problem.obstacle.normal
    touching = ufl.conditional(ufl.lt(gap, _TOUCHING_MM), 1.0, 0.0)
    form = 0
    for part in problem.skin:
        s_n, _ = part.contact.tractions(part.t, problem.u, problem.u_old)
        off = s_n * abs(gap)
        values = touching * stretch, s_n, off, touching * ufl.dot(part.t, normal)
        form += sum(value * w[i] for i, value in enumerate(values)) * part.ds
    dx = ufl.Measure("dx", msh, metadata={"quadrature_degree": problem.bulk_degree})
    form += problem.elasticity.stored(problem.domain, w[4], problem.bulk_degree)
    return form + (J * w[5] + w[6]) * dx


def _nodal(form: fem.Form) -> np.ndarray:
    """Return the owned part of an assembled vector, (nodes or cells, components)."""
    vector = fem_petsc.assemble_vector(form)
    vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    values = vector.array.reshape(-1, form.function_spaces[0].dofmap.index_map_bs).copy()
    vector.destroy()
    return values


def _owned(u: fem.Function, owned: int) -> np.ndarray:
    """Return a view of the first `owned` nodal vectors."""
    return u.x.array.reshape(-1, 3)[:owned]
