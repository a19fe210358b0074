"""Load on the finger: forces, contact area, energies, and the errors of the contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc

from tactile_fem.mechanics.contact import SkinPart
from tactile_fem.mechanics.elasticity import Elasticity, deformation_gradient
from tactile_fem.mechanics.inertia import Inertia
from tactile_fem.mechanics.obstacle import Obstacle
from tactile_fem.mechanics.state import State

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
        What the contact force, the reaction at the held boundary and inertia differ by.
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
    friction_N
        Nodal forces of friction on the nodes of this rank, (nodes, components).
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
    friction_N: np.ndarray = field(repr=False)

    @property
    def is_finite(self) -> bool:
        """Whether all its integrals are numbers."""
        integrals = [value for name, value in vars(self).items() if name != "friction_N"]
        return bool(np.isfinite(np.hstack(integrals)).all())


class LoadCell:
    """Evaluates the load on the finger.

    Parameters
    ----------
    state
        Displacement and body, and the load at the last accepted step.
    elasticity
        The tissues.
    obstacle
        The rigid body.
    skin
        The parts of the skin that may touch.
    tissues
        The compiled residual of the tissues, without boundary conditions.
    held
        This rank's dofs (blocks) of the nodes that do not move.
    compile_
        Compiles a form that may use the obstacle.
    inertia
        Of the tissues; None if the residual has none.
    """

    def __init__(
        self,
        state: State,
        elasticity: Elasticity,
        obstacle: Obstacle,
        skin: Sequence[SkinPart],
        tissues: fem.Form,
        held: np.ndarray,
        compile_: Callable[[ufl.Form], fem.Form],
        inertia: Inertia | None = None,
    ) -> None:
        self._obstacle, self._tissues_form, self._held = obstacle, tissues, held
        self._state = state
        self._comm = elasticity.domain.comm
        dim = len(state.u)
        # Of the moment; a section has the one out of its plane.
        self._planes = ((1, 2), (2, 0), (0, 1)) if dim == 3 else ((0, 1),)
        self._splits = dim, dim + len(self._planes)
        V = state.u.function_space
        v = ufl.TestFunction(V)
        pressure = friction = 0
        for part in skin:
            s_n, s_t = part.contact.tractions(part.t, state.u, state.u_old)
            pressure += s_n * ufl.dot(obstacle.normal, v) * part.ds
            friction += ufl.dot(s_t, v) * part.ds
        self._pressure_form = compile_(pressure)
        self._friction_form = compile_(friction)
        self._inertia_form = compile_(inertia.residual(v)) if inertia else None
        self._integrals_form = compile_(_integrals(elasticity, obstacle, skin))

    def read(self) -> Load:
        """Return the load at the present displacement, of all skin."""
        with common.Timer("tactile: load"):
            self._obstacle.look_everywhere()
            self._obstacle.refresh()
            pressure, friction, tissues = (
                _nodal(form)
                for form in (self._pressure_form, self._friction_form, self._tissues_form)
            )
            integrals = _nodal(self._integrals_form).sum(axis=0)
        state = self._state
        advance = state.translation.value - state.translation_old.value
        here = [
            self._forces(pressure + friction, tissues),
            [self._heat(friction, advance)],
            integrals,
        ]
        whole = self._comm.allreduce(np.concatenate(here))
        force, moment, reaction = np.split(whole[:-8], self._splits)
        heat, area, normal, distance, traction, stored, volume, rest = whole[-8:].tolist()
        pressed = normal if normal > 0 else 1.0
        return Load(
            force,
            moment,
            float(np.linalg.norm(force + reaction)),
            area,
            distance / pressed,
            (traction - normal) / pressed,
            float((force + state.force_old_N) @ advance / 2),
            heat,
            stored,
            volume / rest - 1,
            friction,
        )

    def _forces(self, contact: np.ndarray, tissues: np.ndarray) -> np.ndarray:
        """Return this rank's contact force, its moment, and the reaction less inertia."""
        owned = len(contact)
        u = self._state.u
        place = u.function_space.tabulate_dof_coordinates()[:owned, : len(u)] + _owned(u, owned)
        moment = np.column_stack(
            [place[:, i] * contact[:, j] - place[:, j] * contact[:, i] for i, j in self._planes]
        )
        held = self._held[self._held < owned]
        reaction = tissues[held].sum(axis=0)
        if self._inertia_form:  # inertia force, subtracted from the reaction
            reaction -= _nodal(self._inertia_form).sum(axis=0)
        return np.concatenate([contact.sum(axis=0), moment.sum(axis=0), reaction])

    def _heat(self, friction: np.ndarray, advance: np.ndarray) -> float:
        """Return this rank's heat of friction since the last accepted step, in mJ."""
        owned, state = len(friction), self._state
        mean = (friction + _owned(state.friction_old, owned)) / 2
        u, u_old = (_owned(u, owned) for u in (state.u, state.u_old))
        return float(np.sum(mean * (advance - (u - u_old))))


_COUNT = 7


def _integrals(elasticity: Elasticity, obstacle: Obstacle, skin: Sequence[SkinPart]) -> ufl.Form:
    """Return the integrals over skin and tissue, one for each component of a DG0 test function.

    So one kernel computes them all, cell by cell: contact area, pressure, pressure times
    gap, traction of the tissue; strain energy, volume now and at rest.
    """
    msh = elasticity.domain.mesh
    w = ufl.TestFunction(fem.functionspace(msh, ("DG", 0, (_COUNT,))))
    F = deformation_gradient(elasticity.u)
    J = ufl.det(F)
    stretch = elasticity.area_stretch()
    touching = ufl.conditional(ufl.lt(obstacle.gap, _TOUCHING_MM), 1.0, 0.0)
    form = 0
    for part in skin:
        s_n, _ = part.contact.tractions(part.t, elasticity.u, elasticity.u_old)
        distance = s_n * abs(obstacle.gap)
        values = touching * stretch, s_n, distance, touching * ufl.dot(part.t, obstacle.normal)
        form += sum(value * w[i] for i, value in enumerate(values)) * part.ds
    return form + elasticity.stored(w[4]) + (J * w[5] + w[6]) * elasticity.measure()


def _nodal(form: fem.Form) -> np.ndarray:
    """Return the owned part of an assembled vector, (nodes or cells, components)."""
    vector = fem_petsc.assemble_vector(form)
    vector.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
    values = vector.array.reshape(-1, form.function_spaces[0].dofmap.index_map_bs).copy()
    vector.destroy()
    return values


def _owned(u: fem.Function, owned: int) -> np.ndarray:
    """Return a view of the first `owned` nodal vectors."""
    return u.x.array.reshape(-1, len(u))[:owned]
