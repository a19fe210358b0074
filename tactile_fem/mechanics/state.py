"""The state of finger and body that one accepted step passes to the next.

Nothing else in the mechanics stores a history. A quantity at points, of the contact, of the tissue
or of its motion, is a `PointHistory` in the list of the state's histories; it is then accepted,
saved and restored with everything else.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from scipy.spatial import cKDTree

from tactile_fem.mechanics.domain import NodeOrder
from tactile_fem.mechanics.step_control import StepControl

Array = np.ndarray
_SAME_POINT_MM = 1e-6


class PointHistory(ABC):
    """A quantity at quadrature points or nodes that the next step needs.

    Parameters
    ----------
    name
        Of the quantity, with its unit.
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

    def gather(self, values: Array) -> Array:
        """Return points and values (n, dimension + components), on every rank, where not zero.

        A point is left out where all its components are zero.
        """
        points = self.points_mm()
        rows = values.reshape(len(points), -1) if len(points) else np.empty((0, 1))
        nonzero = np.any(rows != 0, axis=1)
        parts = self._comm.allgather(np.hstack([points[nonzero], rows[nonzero]]))
        return np.concatenate([part for part in parts if len(part)] or parts[:1])

    def scatter(self, saved: Array) -> None:
        """Set `old` to what `gather` returned, on any number of ranks."""
        self.old.x.array[:] = 0.0
        points = self.points_mm()
        if len(points) and len(saved):
            rows = self.old.x.array.reshape(len(points), -1)
            dim = points.shape[1]
            distance, place = cKDTree(points).query(saved[:, :dim])
            own = distance < _SAME_POINT_MM
            rows[place[own]] = saved[own, dim:]


@dataclass
class Progress:
    """How far the path is gone; plain numbers.

    Attributes
    ----------
    piece
        Index of the piece of the path.
    start_mm
        Where the body was when the piece began.
    start_s, slid_mm
        Time and length of the path across the finger when it began.
    indenting
        Whether the steps so far belong to the indentation.
    index
        Number of accepted steps.
    control
        Control of the steps along the piece.
    stiffness_N_mm
        Normal force over depth, as last seen; 0 if not known.
    """

    piece: int
    start_mm: tuple[float, float, float]
    start_s: float
    slid_mm: float
    indenting: bool
    index: int
    control: StepControl
    stiffness_N_mm: float = 0.0

    def to_json(self) -> str:
        """Return it as text; the outputs are the path's to know."""
        values = asdict(self)
        del values["control"]["outputs_s"]
        return json.dumps(values)

    @classmethod
    def from_json(cls, text: str) -> Progress:
        """Return what `to_json` wrote."""
        values = json.loads(text)
        control, start = StepControl(**values.pop("control")), tuple(values.pop("start_mm"))
        return cls(**values, start_mm=start, control=control)


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
        Place of the body (3,), mm, likewise.
    dt_s, dt_old_s
        Duration of the present and of the last accepted step; 0 before the first.
    force_old_N, friction_old
        Contact force (3,) and nodal forces of friction at the last accepted step, N.
    iterations
        Newton's, that led to the accepted states so far; without any there is no tangent yet.
    histories
        Quantities at quadrature points or nodes.
    progress
        How far the path is gone; None where nobody steps along one.
    """

    def __init__(self, V: fem.FunctionSpace) -> None:
        msh = V.mesh
        self.u = fem.Function(V, name="displacement")
        self.u_old, self.u_before, self.friction_old = (fem.Function(V) for _ in range(3))
        origin = np.zeros(msh.geometry.dim)
        self.translation = fem.Constant(msh, origin)
        self.translation_old = fem.Constant(msh, origin)
        self.translation_before = origin.copy()
        self.dt_s = self.dt_old_s = 0.0
        self.force_old_N = origin.copy()
        self.iterations = 0
        self.histories: list[PointHistory] = []
        self.progress: Progress | None = None

    def place(self, translation: Array) -> None:
        """Take the present displacement, with the body at `translation` (3,), as a start."""
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
            Newton's, to the present state.
        """
        present = [history.present() for history in self.histories]  # none of them has moved on
        for history, values in zip(self.histories, present, strict=True):
            history.accept(values)
        self.u_before.x.array[:] = self.u_old.x.array
        self.translation_before[:] = self.translation_old.value
        self.force_old_N = force_N
        self.friction_old.x.array[: friction.size] = friction.ravel()
        self.dt_old_s = self.dt_s
        self.iterations += iterations
        self.place(self.translation.value)

    def gather(self, order: NodeOrder) -> dict[str, Array]:
        """Return the accepted state by name, independent of the number of ranks, on every rank.

        Functions as (nodes, components) in the mesh file's order.
        """
        functions = {name: order.gather(function) for name, function in self._nodal().items()}
        points = {}
        for history in self.histories:
            points[history.name] = history.gather(history.old.x.array)
            points[f"{history.name}_before"] = history.gather(history.before)
        return {
            **functions,
            **points,
            "translation": self.translation_old.value.copy(),
            "translation_before": self.translation_before.copy(),
            "dt_old_s": np.array(self.dt_old_s),
            "force_N": self.force_old_N,
            "iterations": np.array(self.iterations),
            "progress": np.array(self.progress.to_json() if self.progress else ""),
        }

    def restore(
        self, saved: dict[str, Array], order: NodeOrder, prepare: Callable[[Array, float], None]
    ) -> None:
        """Restore what `gather` returned.

        Parameters
        ----------
        saved, order
            What it returned, and the node order.
        prepare
            Called with the body's place and the last step's duration, all but `u` being as
            before that step; not if no step took an iteration.
        """
        place = saved["translation"]
        order.scatter(saved["u_before"], self.u)
        self.u_before.x.array[:] = self.u.x.array
        self.translation_before[:] = saved["translation_before"]
        self.place(self.translation_before)
        for history in self.histories:
            history.scatter(saved[f"{history.name}_before"])
            history.before[:] = history.old.x.array
        self.dt_old_s, self.iterations = float(saved["dt_old_s"]), int(saved["iterations"])
        order.scatter(saved["u"], self.u)
        if self.iterations:
            prepare(place, self.dt_old_s)
        self.place(place)
        for history in self.histories:
            history.scatter(saved[history.name])
        order.scatter(saved["friction"], self.friction_old)
        self.force_old_N = np.array(saved["force_N"])
        progress = str(saved["progress"])
        self.progress = Progress.from_json(progress) if progress else None

    def _nodal(self) -> dict[str, fem.Function]:
        return {
            "u": self.u,
            "u_before": self.u_before,
            "friction": self.friction_old,
        }
