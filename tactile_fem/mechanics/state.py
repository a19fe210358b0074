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
from dolfinx import fem
from scipy.spatial import cKDTree

from tactile_fem.mechanics.domain import NodeOrder
from tactile_fem.mechanics.rows import Saved, gather_rows

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
        Position of the body (3,), mm, likewise.
    time_step
        Duration of the present step, s; the only constant of it in all forms.
    dt_old_s
        Duration of the last accepted step; 0 if nothing is to be extrapolated from it.
    force_old_N, friction_old
        Contact force (3,) and nodal forces of friction at the last accepted step, N.
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
        self.translation = fem.Constant(msh, origin)
        self.translation_old = fem.Constant(msh, origin)
        self.translation_before = origin.copy()
        self.time_step = fem.Constant(msh, 1.0)
        self.dt_old_s = 0.0
        self.force_old_N = origin.copy()
        self.iterations = 0
        self.histories: Sequence[PointHistory] = ()
        self._is_reopened = False

    @property
    def dt_s(self) -> float:
        """Duration of the present step, s."""
        return float(self.time_step.value)

    def place(self, translation: Array) -> None:
        """Start from the present displacement, with the body at `translation` (3,)."""
        self.u_old.x.array[:] = self.u.x.array
        self.translation.value[:] = translation
        self.translation_old.value[:] = translation

    def reset(self) -> None:
        """Go back to the last accepted step."""
        self.u.x.array[:] = self.u_old.x.array
        self.translation.value[:] = self.translation_old.value

    def accept(self, force_N: Array, friction: Array, iterations: int) -> None:
        """Make the present state the history of the next step; all ranks call.

        Parameters
        ----------
        force_N
            Contact force at the present state, (3,).
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
        self.force_old_N = force_N
        self.friction_old.x.array[: friction.size] = friction.ravel()
        self.dt_old_s = self.dt_s
        self.iterations += iterations
        self.place(self.translation.value)

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
        self.translation_old.value[:] = self.translation_before
        self.time_step.value = self.dt_old_s
        self._is_reopened = True
        try:
            yield
        finally:
            self._is_reopened = False
            for history, values in zip(self.histories, accepted, strict=True):
                history.old.x.array[:] = values
            self.place(self.translation.value)

    def to_save(self, order: NodeOrder) -> Saved:
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
            "dt_old_s": np.array(self.dt_old_s),
            "force_N": self.force_old_N,
            "iterations": np.array(self.iterations),
        }

    def restore(self, saved: dict[str, Array], order: NodeOrder) -> None:
        """Restore what was gathered; all ranks call, with what they got."""
        for name, function in self._nodal().items():
            order.scatter(saved[name], function)
        for history in self.histories:
            history.scatter(saved[history.name], history.old.x.array)
            history.scatter(saved[f"{history.name}_before"], history.before)
        self.place(saved["translation"])
        self.translation_before[:] = saved["translation_before"]
        self.dt_old_s, self.iterations = float(saved["dt_old_s"]), int(saved["iterations"])
        self.force_old_N = np.array(saved["force_N"])

    def _nodal(self) -> dict[str, fem.Function]:
        return {"u": self.u, "u_before": self.u_before, "friction": self.friction_old}
