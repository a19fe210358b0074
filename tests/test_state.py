"""What an accepted step leaves: kept, saved and restored whole, on any number of ranks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import ufl

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip

from mpi4py import MPI

import basix
import basix.ufl
from blocks import LAYERS, block_mesh
from dolfinx import fem

from tactile_fem.assembly.compile import expression
from tactile_fem.mechanics.domain import NodeOrder, create_domain
from tactile_fem.mechanics.rows import gathered
from tactile_fem.mechanics.state import PointHistory, State
from tactile_fem.path.rotations import matrix

DEGREE = 2
LINE, DEPTHS = np.linspace(-3, 3, 4), np.array([0.0, 0.17, 0.82, 1.62, 3.0])


class Squeezed(PointHistory):
    """What is lost of the volume and how far Z went, at the points of the bulk; else zero."""

    def __init__(self, u: fem.Function) -> None:
        msh = u.function_space.mesh
        element = basix.ufl.quadrature_element("tetrahedron", value_shape=(2,), degree=DEGREE)
        V = fem.functionspace(msh, element)
        super().__init__("squeezed", fem.Function(V), msh.comm)
        points, _ = basix.make_quadrature(basix.CellType.tetrahedron, DEGREE)
        J = ufl.det(ufl.Identity(3) + ufl.grad(u))
        values = ufl.as_vector([ufl.max_value(1 - J, 0.0), ufl.max_value(u[2], 0.0)])
        self._msh, self._dofs = msh, V.dofmap.list.ravel()
        self._cells = np.arange(len(V.dofmap.list), dtype=np.int32)
        self._place = expression(ufl.SpatialCoordinate(msh), points)
        self._values = expression(values, points)

    def _by_dof(self, of_cells):
        by_dof = np.empty((len(self._dofs), of_cells.shape[-1]))
        by_dof[self._dofs] = of_cells
        return by_dof

    def points_mm(self):
        return self._by_dof(self._place.eval(self._msh, self._cells).reshape(-1, 3))

    def present(self):
        return self._by_dof(self._values.eval(self._msh, self._cells).reshape(-1, 2)).ravel()


@dataclass
class Made:
    """A state with a history, on a block."""

    state: State
    order: NodeOrder
    squeezed: Squeezed

    @classmethod
    def on(cls, comm: MPI.Comm) -> Made:
        mesh = block_mesh(LINE, LINE, DEPTHS, LAYERS) if comm.rank == 0 else None
        domain = create_domain(mesh, comm, ("cut",))
        V = fem.functionspace(domain.mesh, ("Lagrange", 2, (3,)))
        state = State(V)
        squeezed = Squeezed(state.u)
        state.histories = [squeezed]
        return cls(state, NodeOrder(domain, V), squeezed)

    def go(self, k: int) -> None:
        """Take a made-up step, in which only half of the block is squeezed."""
        state = self.state
        state.u.interpolate(lambda x: 1e-2 * k * np.array([x[1], x[0] ** 2, np.maximum(x[0], 0)]))
        place, swing = np.array([0.0, -0.1 * k, 0.5]), np.full((3, 4), 0.01 * k)
        state.move(place, matrix([0.1 * k, 0.0, 0.0]), swing)
        state.time_step.value = 0.01 * k
        owned = state.u.function_space.dofmap.index_map.size_local
        friction = 2 * state.u.x.array.reshape(-1, 3)[:owned]
        state.accept(np.array([0.0, 0.0, 0.3 * k]), np.full(3, 0.1 * k), friction, 3 * k)

    def gathered(self) -> dict[str, np.ndarray]:
        return gathered(self.state.to_save(self.order))

    @classmethod
    def alone(cls) -> dict[str, np.ndarray]:
        """Return what one rank gathers after two steps; others have no rows of it."""
        made = cls.on(MPI.COMM_SELF)
        for k in (1, 2):
            made.go(k)
        rows = slice(0 if MPI.COMM_WORLD.rank else None)
        return {name: a[rows] if a.ndim == 2 else a for name, a in made.gathered().items()}


@pytest.fixture
def gone() -> Made:
    """Two steps on all ranks."""
    made = Made.on(MPI.COMM_WORLD)
    for k in (1, 2):
        made.go(k)
    return made


def by_place(rows: np.ndarray) -> np.ndarray:
    """Return points and values in the order of the points, ghosts' points once."""
    _, first = np.unique(np.round(rows[:, :3], 6) + 0.0, axis=0, return_index=True)
    return rows[first]


def assert_close(values, expected, name="") -> None:
    """Another rank may round otherwise."""
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-14, err_msg=name)


def assert_same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
    assert one.keys() == other.keys()
    for name in one:
        of_points = name.startswith("squeezed")
        pair = (by_place(s[name]) if of_points else s[name] for s in (one, other))
        assert_close(*pair, name)


@pytest.mark.ranks
def test_a_step_accepted_is_the_history_of_the_next(gone):
    state, squeezed = gone.state, gone.squeezed
    u, old, before = state.u.x.array.copy(), squeezed.old.x.array.copy(), squeezed.before.copy()
    np.testing.assert_array_equal(state.u_old.x.array, u)
    np.testing.assert_allclose(state.u_before.x.array, u / 2, atol=1e-15)
    owned = 3 * state.u.function_space.dofmap.index_map.size_local
    np.testing.assert_array_equal(state.friction_old.x.array[:owned], 2 * u[:owned])
    np.testing.assert_array_equal(old, squeezed.present())
    z = old.reshape(-1, 2)[:, 1]
    np.testing.assert_allclose(before.reshape(-1, 2)[:, 1], z / 2, atol=1e-15)
    assert (state.dt_old_s, state.iterations) == (0.02, 9)
    np.testing.assert_allclose(state.translation_old.value, [0, -0.2, 0.5])
    np.testing.assert_allclose(state.translation_before, [0, -0.1, 0.5])
    np.testing.assert_allclose(state.rotation_old, matrix([0.2, 0.0, 0.0]))
    np.testing.assert_allclose(state.rotation_before, matrix([0.1, 0.0, 0.0]))
    np.testing.assert_array_equal(state.turn.value, 0.0)


@pytest.mark.ranks
def test_a_step_that_fails_is_undone(gone):
    state, accepted = gone.state, gone.gathered()
    state.u.x.array[:] = 7.0
    state.move(np.full(3, 7.0), np.eye(3))
    state.reset()
    assert_same(gone.gathered(), accepted)
    np.testing.assert_array_equal(state.translation.value, state.translation_old.value)
    np.testing.assert_allclose(state.rotation, matrix([0.2, 0.0, 0.0]))
    np.testing.assert_allclose(state.turn.value, 0.0, atol=1e-15)
    np.testing.assert_array_equal(state.swing.value, 0.0)


@pytest.mark.ranks
def test_what_is_gathered_does_not_depend_on_the_ranks(gone):
    saved = gone.gathered()
    assert_same(saved, Made.alone())
    rows, points = by_place(saved["squeezed"]), Made.on(MPI.COMM_SELF).squeezed.points_mm()
    assert rows.shape[1] == 5
    assert MPI.COMM_WORLD.rank or 0 < len(rows) < len(by_place(points))  # zeros are left out


@pytest.mark.ranks
def test_what_is_restored_is_what_was_saved(gone):
    saved, made = gone.gathered(), Made.on(MPI.COMM_WORLD)
    made.go(5)  # of which nothing may be left
    state = made.state
    state.restore(saved, made.order)
    assert_same(made.gathered(), saved)
    assert_close(state.u_old.x.array, gone.state.u_old.x.array)
    assert_close(made.squeezed.old.x.array, gone.squeezed.old.x.array)
    for each in (gone, made):
        each.go(3)
    assert_same(made.gathered(), gone.gathered())


@pytest.mark.ranks
def test_the_last_step_is_reopened_and_closed_again(gone):
    state, accepted = gone.state, gone.gathered()
    with state.reopened():
        assert_close(gone.order.gather(state.u), accepted["u"])
        assert_close(gone.order.gather(state.u_old), accepted["u_before"])
        assert_close(gone.squeezed.old.x.array, gone.squeezed.before)
        np.testing.assert_allclose(state.translation_old.value, accepted["translation_before"])
        np.testing.assert_allclose(state.translation.value, accepted["translation"])
        np.testing.assert_allclose(
            state.turn.value, matrix([0.1, 0.0, 0.0]) - np.eye(3), atol=1e-15
        )
        np.testing.assert_array_equal(state.swing.value, 0.02)
        assert state.dt_s == 0.02
        with state.reopened():  # already is
            pass
        assert_close(gone.order.gather(state.u_old), accepted["u_before"])
    assert_same(gone.gathered(), accepted)
    np.testing.assert_array_equal(state.u_old.x.array, state.u.x.array)


@pytest.mark.ranks
def test_what_one_rank_saved_is_restored_on_all(gone):
    made = Made.on(MPI.COMM_WORLD)
    made.state.restore(Made.alone(), made.order)
    assert_close(made.squeezed.old.x.array, gone.squeezed.old.x.array)
    assert_close(made.squeezed.before, gone.squeezed.before)
    assert_close(made.state.u.x.array, gone.state.u.x.array)


def test_a_state_at_rest_is_restored():
    made, other = Made.on(MPI.COMM_SELF), Made.on(MPI.COMM_SELF)
    saved = made.gathered()
    assert saved["squeezed"].shape == (0, 5)
    other.go(1)
    other.state.restore(saved, other.order)
    assert not other.state.u.x.array.any() and not other.squeezed.old.x.array.any()
    assert other.state.iterations == 0


def test_no_history_sees_another_one_moved_on():
    made = Made.on(MPI.COMM_SELF)

    class Behind(Squeezed):
        """What the other one had."""

        def present(self):
            return made.squeezed.old.x.array.copy()

    behind = Behind(made.state.u)
    made.state.histories = [made.squeezed, behind]
    made.go(1)
    first = made.squeezed.old.x.array.copy()
    made.go(2)
    np.testing.assert_array_equal(behind.old.x.array, first)
