"""Load on the finger: forces, contact area, energies, and the errors of the contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import ufl
from dolfinx import common, fem, la
from ufl.core.expr import Expr

from tactile_fem.assembly import VirtualWork
from tactile_fem.mechanics.terms.contact import Contact
from tactile_fem.mechanics.terms.term import Term

# Skin that is nearer to the body than this touches it, as ink on the finger would. Less would
# show the noise of the gap on coarse meshes, one or two micrometres.
_CONTACT_GAP_MM = 0.01


@dataclass(frozen=True)
class Load:
    """Forces and energies at the end of a step.

    Attributes
    ----------
    force_N, moment_Nmm
        Force and moment of the contact on the finger, (3,); the moment is about the origin.
    bone_N, bone_Nmm
        Force of the tissue on fixed parts, (3,), and its moment about the origin: those of the
        contact, apart from inertia.
    imbalance_N
        Sum of the residual, that of the contact and all other terms, where nodes may move.
    contact_area_mm2
        Skin within a hundredth of a millimetre of the body, as it is deformed.
    gap_error_mm
        Mean distance of pressed skin from the body's surface: the modulus of the gap, weighted
        with the pressure.
    traction_error
        Normal traction of the tissue less that of the contact, integrated over the skin that
        touches, as a share of the pressure's integral. It vanishes with the mesh size.
    work_mJ, friction_mJ
        Since the last accepted step, by the trapezoidal rule: work of the body on the finger,
        and the part of it that friction turns into heat.
    stored_mJ
        Strain energy of the tissues.
    volume_change
        Relative change of the volume of the deformable tissue.
    pressure_N, friction_N, bound_N
        Nodal forces of contact pressure, of friction, and of pressure times the coefficient of
        friction on this rank's nodes, (nodes, components).
    touching_mm2
        Parts of `contact_area_mm2` in this rank's own cells, (cells,).
    """

    force_N: np.ndarray
    moment_Nmm: np.ndarray
    bone_N: np.ndarray
    bone_Nmm: np.ndarray
    imbalance_N: float
    contact_area_mm2: float
    gap_error_mm: float
    traction_error: float
    work_mJ: float
    friction_mJ: float
    stored_mJ: float
    volume_change: float
    pressure_N: np.ndarray = field(repr=False)
    friction_N: np.ndarray = field(repr=False)
    bound_N: np.ndarray = field(repr=False)
    touching_mm2: np.ndarray = field(repr=False, default_factory=lambda: np.zeros(0))

    def rejection(self, balance_N: float) -> str:
        """Return why a state with this load must not be accepted; empty if it may.

        Parameters
        ----------
        balance_N
            Up to which the imbalance is one of rounding, or of the tolerance of a solver.
        """
        local = "pressure_N", "friction_N", "bound_N", "touching_mm2"
        integrals = [value for name, value in vars(self).items() if name not in local]
        if not np.isfinite(np.hstack(integrals)).all():
            return "the load is not finite"
        if self.imbalance_N > balance_N:
            return (
                f"the step is not in equilibrium: contact force and held reaction differ by "
                f"{self.imbalance_N:.1e} N"
            )
        return ""


class LoadCell:
    """Evaluates the load on the finger.

    Parameters
    ----------
    bulk, contact
        The terms of the virtual work.
    held
        This rank's dofs (blocks) of the nodes that do not move.
    bcs
        All conditions on the displacement, also those on some components of a node.
    of_bulk
        The work of `bulk`, compiled.
    compiled
        Compiles a work that has no tangent.
    """

    def __init__(
        self,
        bulk: Term,
        contact: Contact,
        held: np.ndarray,
        bcs: Sequence[fem.DirichletBC],
        of_bulk: VirtualWork,
        compiled: Callable[[ufl.Form], VirtualWork],
    ) -> None:
        tissues = bulk.tissues
        self._obstacle, self._comm = contact.obstacle, tissues.domain.comm
        self._state = state = tissues.state
        dim = len(state.u)
        # Of the moment; a section has the one out of its plane.
        self._planes = ((1, 2), (2, 0), (0, 1)) if dim == 3 else ((0, 1),)
        self._splits = np.cumsum(2 * [dim, len(self._planes)])
        nodes = state.u.function_space.dofmap.index_map
        self._vector = la.vector(nodes, dim)
        owned = nodes.size_local
        self._is_free = np.ones(owned, dtype=bool)
        self._is_free[held[held < owned]] = False
        self._may_move = np.ones(owned * dim, dtype=bool)
        for bc in bcs:
            dofs, own = bc.dof_indices()
            self._may_move[dofs[:own]] = False
        v = ufl.TestFunction(state.u.function_space)
        pressure, friction, bound = (ufl.Form([]) for _ in range(3))
        for part in contact.parts:
            s_n, across = part.law.s_n, ufl.dot(self._obstacle.normal, v)
            pressure += s_n * across * part.ds
            friction += ufl.dot(part.law.s_t, v) * part.ds
            bound += part.law.coefficient(s_n) * s_n * across * part.ds
        self._coefficient = contact.friction.uniform
        forms = [pressure, friction] + ([bound] if self._coefficient is None else [])
        self._of_contact = [compiled(form) for form in forms]
        self._of_bulk = of_bulk
        # Tested with a vector's components, as the nodes' basis functions add up to one.
        volumes = (ufl.det(tissues.F) * v[0] + v[1]) * tissues.dx
        self._energy, self._volumes = compiled(bulk.stored(v[0])), compiled(volumes)
        W = fem.functionspace(tissues.domain.mesh, ("DG", 0, (4,)))
        self._cell_rows, self._own_cells = W.dofmap.list[:, 0], W.dofmap.index_map.size_local
        form = _of_skin(contact, tissues.area_stretch(), ufl.TestFunction(W))
        self._skin_form = self._obstacle.compile(form)

    def read(self) -> Load:
        """Return the load at the present displacement, of all skin."""
        with common.Timer("tactile: load"):
            self._obstacle.evaluate_everywhere()
            self._obstacle.refresh()
            pressure, friction, *bounds = map(self._nodal, self._of_contact)
            bulk = self._nodal(self._of_bulk)
            bound = bounds[0] if bounds else float(self._coefficient.value) * pressure
            of_cells = fem.assemble_vector(self._skin_form).array.reshape(-1, 4)[: self._own_cells]
            of_bulk = self._integrals(self._energy)[:1], self._integrals(self._volumes)[:2]
        integrals = [self._heat(friction)], of_cells.sum(axis=0), *of_bulk
        here = [self._forces(pressure + friction, bulk), *integrals]
        whole = self._comm.allreduce(np.concatenate(here))
        force, moment, on_bone, moment_on_bone, residual = np.split(whole[:-8], self._splits)
        heat, area, normal, distance, traction, stored, volume, rest = whole[-8:].tolist()
        pressed = normal if normal > 0 else 1.0
        return Load(
            force,
            moment,
            on_bone,
            moment_on_bone,
            float(np.linalg.norm(residual)),
            area,
            distance / pressed,
            (traction - normal) / pressed,
            self._work(force, moment),
            heat,
            stored,
            volume / rest - 1,
            pressure,
            friction,
            bound,
            of_cells[self._cell_rows[: self._own_cells], 0],
        )

    def _nodal(self, work: VirtualWork) -> np.ndarray:
        """Return a work's nodal forces on this rank's nodes, (nodes, components)."""
        forces = self._assembled(work)
        self._vector.scatter_reverse(la.InsertMode.add)
        return forces[: len(self._is_free)].copy()

    def _integrals(self, work: VirtualWork) -> np.ndarray:
        """Return this rank's part of the integral of the factor of each component."""
        return self._assembled(work).sum(axis=0)

    def _assembled(self, work: VirtualWork) -> np.ndarray:
        """Return what this rank's cells add, ghosts included; overwritten by the next call."""
        self._vector.array[:] = 0.0
        work.add_residual(self._vector.array)
        return self._vector.array.reshape(-1, self._vector.block_size)

    def _forces(self, contact: np.ndarray, bulk: np.ndarray) -> np.ndarray:
        """Return this rank's part of forces and moments.

        Those of the contact, those on what is held, and what is left on what moves.
        """
        places = self._places(self._state.u, len(contact))
        found = []
        for forces in (contact, np.where(self._is_free[:, None], 0.0, contact - bulk)):
            found += [forces.sum(axis=0), self._moment(places, forces).sum(axis=0)]
        residual = np.where(self._may_move.reshape(bulk.shape), contact - bulk, 0.0)
        return np.concatenate([*found, residual.sum(axis=0)])

    def _places(self, u: fem.Function, owned: int) -> np.ndarray:
        """Return where the first `owned` nodes of this rank are, (owned, components)."""
        return u.function_space.tabulate_dof_coordinates()[:owned, : len(u)] + _owned(u, owned)

    def _moment(self, places: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Return the moments of forces (..., components) about the origin."""
        x, f = places.T, forces.T
        return np.array([x[i] * f[j] - x[j] * f[i] for i, j in self._planes]).T

    def _work(self, force: np.ndarray, moment: np.ndarray) -> float:
        """Return the work of the body since the last accepted step, in mJ."""
        state, force_old = self._state, self._state.force_old_N
        b, b_old = state.translation.value, state.translation_old.value
        # About the body's origin, which moves by b - b_old while the body turns.
        torque = moment - self._moment(b, force)
        torque_old = state.moment_old_Nmm - self._moment(b_old, force_old)
        angles = self._angles(np.eye(len(force)) + state.turn.value)
        return float((force + force_old) @ (b - b_old) + (torque + torque_old) @ angles) / 2

    def _angles(self, Q: np.ndarray) -> np.ndarray:
        """Return the rotation vector of a rotation, rad, as `_moment` returns moments."""
        sines = np.array([Q[j, i] - Q[i, j] for i, j in self._planes]) / 2
        sine, cosine = np.linalg.norm(sines), (np.trace(Q) - (len(Q) - 2)) / 2
        return sines * (np.arctan2(sine, cosine) / sine if sine else 1.0)

    def _heat(self, friction: np.ndarray) -> float:
        """Return this rank's heat of friction since the last accepted step, in mJ."""
        owned, state = len(friction), self._state
        W, b_old = state.turn.value, state.translation_old.value
        old, x_old = _owned(state.friction_old, owned), self._places(state.u_old, owned)
        mean = (friction + old + old @ W.T) / 2
        advance = (state.translation.value - b_old) + (x_old - b_old) @ W.T
        slid = advance - (_owned(state.u, owned) - _owned(state.u_old, owned))
        return float(np.sum(mean * slid))


def _of_skin(contact: Contact, stretch: Expr, w: ufl.Argument) -> ufl.Form:
    """Return integrals over the skin, one for each component of a DG0 test function `w`.

    So one kernel computes them all, cell by cell: contact area, pressure, pressure times gap,
    traction of the tissue.
    """
    gap, normal = contact.obstacle.gap, contact.obstacle.normal
    touching = ufl.conditional(ufl.lt(gap, _CONTACT_GAP_MM), 1.0, 0.0)
    form = ufl.Form([])
    for part in contact.parts:
        law = part.law
        values = (
            touching * stretch,
            law.s_n,
            law.s_n * abs(gap),
            touching * ufl.dot(law.t, normal),
        )
        form += sum(value * w[i] for i, value in enumerate(values)) * part.ds
    return form


def _owned(u: fem.Function, owned: int) -> np.ndarray:
    """Return a view of the first `owned` nodal vectors."""
    return u.x.array.reshape(-1, len(u))[:owned]
