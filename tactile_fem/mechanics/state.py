"""The state of finger and body that one accepted step passes to the next.

Nothing else in the mechanics stores a history. A quantity at quadrature points or nodes, of the
contact, of the tissue or of its motion, is a `PointHistory` of the term that needs it; it is
accepted, saved and restored with everything else.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from scipy.spatial import cKDTree
from ufl.core.expr import Expr

from tactile_fem.assembly.compile import Constant
from tactile_fem.mechanics.domain import NodeOrder
from tactile_fem.mechanics.rows import Snapshot, gather_rows

Array = np.ndarray
_POINT_TOLERANCE_MM = 1e-6


class PointHistory(ABC):
    """A quantity at quadrature points or nodes that the next step needs.

    Parameters
    ----------
    name
        Its name and unit.
    old
        Function with its values there (shape, also of no more than one component) at the last
        accepted step; for use in forms.
    comm
        Communicator of the mesh.

    Attributes
    ----------
    before
        Values at the accepted step before the last one.
    """

    def __init__(self, name: str, old: fem.Function, comm: MPI.Comm) -> None:
        self.name, self.old, self._comm = name, old, comm
        self.before = old.x.array.copy()

    @abstractmethod
    def points_mm(self) -> Array:
        """Return the undeformed points of this rank, (points, dimension)."""

    @abstractmethod
    def present(self) -> Array:
        """Return the values at the present state, as `old` holds them; all ranks call."""

    def accept(self, present: Array) -> None:
        """Make the present values the old ones."""
        self.before[:] = self.old.x.array
        self.old.x.array[:] = present

    def to_save(self) -> dict[str, Callable[[], Array]]:
        """Return functions that gather the values at the last two accepted steps, by name.

        They return points and values (n, dimension + components) on the first rank, none on others.
        A point is left out where all its components are zero; ghosts' points occur several times.
        """
        found: dict[str, Callable[[], Array]] = {}
        points = self.points_mm()
        for name, values in ((self.name, self.old.x.array), (f"{self.name}_before", self.before)):
            rows = values.reshape(-1, self.old.function_space.dofmap.index_map_bs)
            nonzero = np.any(rows != 0, axis=1)
            own = np.hstack([points[nonzero], rows[nonzero]])
            found[name] = partial(gather_rows, self._comm, own)
        return found

    def scatter(self, saved: Array, values: Array) -> None:
        """Set an array like that of `old` to what was gathered, on any number of ranks."""
        values[:] = 0.0
        points, saved = self.points_mm(), self._comm.bcast(saved)
        if len(points) and len(saved):
            rows = values.reshape(len(points), -1)
            dim = points.shape[1]
            distance, place = cKDTree(points).query(saved[:, :dim])
            own = distance < _POINT_TOLERANCE_MM
            rows[place[own]] = saved[own, dim:]


class State:
    """The state of finger and body, now and at the last accepted steps.

    Parameters
    ----------
    V
        Space of the displacement.

    Attributes
    ----------
    u, u_old, u_before
        Displacement (mm): now, at the last accepted step and at the one before.
    translation, translation_old, translation_before
        Position of the body's origin (3,), mm, likewise.
    rotation, rotation_old, rotation_before
        Rotation of the body about its origin, (3, 3), likewise.
    turn
        ``Q - I``, with the rotation `Q` of the body since the last accepted step.
    swing
        How the bone has swung since the last accepted step, ``[Q - I, t]``, (dimension,
        dimension + 1): a place `y` seen from it is ``Q y + t`` seen from the bone of then.
    swing_before
        Swing at the last accepted step.
    time_step
        Duration of the present step, s; the only constant of it in all forms.
    dt_old_s
        Duration of the last accepted step; 0 if nothing is to be extrapolated from it.
    force_old_N, moment_old_Nmm, friction_old
        Contact force (3,), its moment about the origin (3,) and nodal forces of friction at the
        last accepted step, N.
    iterations
        Newton iterations of all accepted steps; without any there is no tangent to restart from.
    histories
        Quantities at quadrature points or nodes.
    """

    def __init__(self, V: fem.FunctionSpace) -> None:
        msh = V.mesh
        self.u = fem.Function(V, name="displacement")
        self.u_old, self.u_before, self.friction_old = (fem.Function(V) for _ in range(3))
        origin = np.zeros(msh.geometry.dim)
        self.translation = Constant(msh, origin)
        self.translation_old = Constant(msh, origin)
        self.translation_before = origin.copy()
        self.rotation, self.rotation_old, self.rotation_before = (np.eye(len(origin)),) * 3
        self.turn = Constant(msh, np.zeros((len(origin), len(origin))))
        self.swing = Constant(msh, np.zeros((len(origin), len(origin) + 1)))
        self.swing_before = self.swing.value.copy()
        self.time_step = Constant(msh, 1.0)
        self.dt_old_s = 0.0
        self.force_old_N = origin.copy()
        self.moment_old_Nmm = np.zeros(3 if len(origin) == 3 else 1)
        self.iterations = 0
        self.histories: Sequence[PointHistory] = ()
        self._is_reopened = False

    @property
    def dt_s(self) -> float:
        """Duration of the present step, s."""
        return float(self.time_step.value)

    def move(
        self, translation: Array, rotation: Array | None = None, swing: Array | None = None
    ) -> None:
        """Move the body to `translation` (3,) and `rotation` (3, 3), by default that of before.

        The bone has swung by `swing`; by default it has not.
        """
        self.translation.value[:] = translation
        self.rotation = self.rotation_old if rotation is None else np.array(rotation)
        self.turn.value[:] = (self.rotation - self.rotation_old) @ self.rotation_old.T
        self.swing.value[:] = 0.0 if swing is None else swing

    def place(self, translation: Array, rotation: Array | None = None) -> None:
        """Start from the present displacement, with the body at that place, as in `move`."""
        self.move(translation, rotation)
        self.u_old.x.array[:] = self.u.x.array
        self._since(self.translation.value, self.rotation)

    def _since(self, translation: Array, rotation: Array) -> None:
        """Make a place of the body that at the last accepted step."""
        self.translation_old.value[:], self.rotation_old = translation, rotation
        self.move(self.translation.value.copy(), self.rotation)

    def reset(self) -> None:
        """Go back to the last accepted step."""
        self.u.x.array[:] = self.u_old.x.array
        self.move(self.translation_old.value)

    def advance(self, points: Expr) -> Expr:
        """Return how far the body has carried `points` since the last accepted step, mm.

        The points are places of then; together with `turned` it makes sticking objective.
        """
        return self.translation - self.translation_old + self.turn * (points - self.translation_old)

    def turned(self, vector: Expr) -> Expr:
        """Return a vector of the last accepted step, turned with the body since."""
        return vector + self.turn * vector

    def swung(self, points: Expr) -> Expr:
        """Return how far the bone has carried `points` since the last accepted step, mm.

        The points are places of now; the way is seen from the bone of then.
        """
        return self.swing * ufl.as_vector([*points, 1.0])

    def seen_from_bone(self, vector: Expr) -> Expr:
        """Return a vector seen from the bone of now that is given as seen from that of then."""
        turned = ufl.transpose(self.swing) * vector
        return vector + ufl.as_vector([turned[i] for i in range(len(self.u))])

    def accept(self, force_N: Array, moment_Nmm: Array, friction: Array, iterations: int) -> None:
        """Make the present state the history of the next step; all ranks call.

        Parameters
        ----------
        force_N, moment_Nmm
            Contact force at the present state, (3,), and its moment about the origin, (3,).
        friction
            Nodal forces of friction there, (owned nodes, components), N.
        iterations
            Newton iterations of the step.
        """
        present = [history.present() for history in self.histories]  # before any of them moves on
        for history, values in zip(self.histories, present, strict=True):
            history.accept(values)
        self.u_before.x.array[:] = self.u_old.x.array
        self.translation_before[:] = self.translation_old.value
        self.rotation_before = self.rotation_old
        self.swing_before[:] = self.swing.value
        self.force_old_N, self.moment_old_Nmm = force_N, moment_Nmm
        self.friction_old.x.array[: friction.size] = friction.ravel()
        self.dt_old_s = self.dt_s
        self.iterations += iterations
        self.place(self.translation.value, self.rotation)

    @contextmanager
    def reopened(self) -> Iterator[None]:
        """Return to the end of the last accepted step, before it was accepted, within the context.

        Displacement and body are those that were accepted; all old values are those with which the
        step began. Within another such context nothing changes.
        """
        if self._is_reopened:
            yield
            return
        accepted = [history.old.x.array.copy() for history in self.histories]
        for history in self.histories:
            history.old.x.array[:] = history.before
        self.u_old.x.array[:] = self.u_before.x.array
        self._since(self.translation_before, self.rotation_before)
        self.swing.value[:] = self.swing_before
        self.time_step.value = self.dt_old_s
        self._is_reopened = True
        try:
            yield
        finally:
            self._is_reopened = False
            for history, values in zip(self.histories, accepted, strict=True):
                history.old.x.array[:] = values
            self.place(self.translation.value, self.rotation)

    def to_save(self, order: NodeOrder) -> Snapshot:
        """Return the accepted state by name, independent of the number of ranks.

        Functions as (nodes, components) in the mesh file's order. They and the histories are
        copied here and gathered later, see `tactile_fem.mechanics.rows.gathered`.
        """
        functions = {name: order.keep(function) for name, function in self._nodal().items()}
        points = {name: f for h in self.histories for name, f in h.to_save().items()}
        return {
            **functions,
            **points,
            "translation": self.translation_old.value.copy(),
            "translation_before": self.translation_before.copy(),
            "rotation": self.rotation_old.ravel(),
            "rotation_before": self.rotation_before.ravel(),
            "swing_before": self.swing_before.flatten(),
            "dt_old_s": np.array(self.dt_old_s),
            "force_N": self.force_old_N,
            "moment_Nmm": self.moment_old_Nmm,
            "iterations": np.array(self.iterations),
        }

    def restore(self, saved: dict[str, Array], order: NodeOrder) -> None:
        """Restore what was gathered; all ranks call, with what they got."""
        for name, function in self._nodal().items():
            order.scatter(saved[name], function)
        for history in self.histories:
            history.scatter(saved[history.name], history.old.x.array)
            history.scatter(saved[f"{history.name}_before"], history.before)
        shape = self.rotation.shape
        self.place(saved["translation"], np.reshape(saved["rotation"], shape))
        self.translation_before[:] = saved["translation_before"]
        self.rotation_before = np.reshape(saved["rotation_before"], shape)
        self.swing_before.flat = saved["swing_before"]
        self.dt_old_s, self.iterations = float(saved["dt_old_s"]), int(saved["iterations"])
        self.force_old_N = np.array(saved["force_N"])
        self.moment_old_Nmm = np.array(saved["moment_Nmm"])

    def _nodal(self) -> dict[str, fem.Function]:
        return {"u": self.u, "u_before": self.u_before, "friction": self.friction_old}
