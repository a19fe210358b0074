"""Nitsche contact on small blocks against exact statements."""

from __future__ import annotations

import gc
import weakref
from functools import cache

import numpy as np
import pytest
import ufl
from scipy.optimize import fsolve

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip
from petsc4py import PETSc  # isort: skip

from blocks import LAYERS, block_mesh, curved
from dolfinx import fem
from materials import ELASTIC
from sphere_on_block import DEPTHS, follow

from tactile_fem.mechanics.contact_law import ZERO_BELOW, smooth_positive
from tactile_fem.mechanics.domain import create_domain, roller
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Plate, Solver, Sphere

EXACT = {"snes_atol": 1e-11}


@cache
def block(width: float = 3.0, count: int = 3, bent: bool = False):
    line = np.linspace(-width, width, count + 1)
    mesh = block_mesh(line, line, DEPTHS, LAYERS)
    return create_domain(curved(mesh) if bent else mesh, MPI.COMM_WORLD, ("cut",))


def problem(body, *, constraints=lambda V: [], domain=None, **solver):
    if solver.get("nitsche_theta"):  # these forms take minutes to optimize
        solver["compiler_flags"] = ("-O0",)
    settings = Solver(held=("cut",), linear="direct", petsc=EXACT, **solver)
    return FingerProblem(
        domain or block(), ELASTIC, body.body(), body.friction, settings, constraints
    )


def rollers(V):
    """Keep the block's sides in their planes."""
    return [roller(V, axis, lambda x, i=axis: np.isclose(np.abs(x[i]), 3.0)) for axis in range(2)]


def layer_stress(c, stretch: float) -> float:
    """P33 of a neo-Hookean or second-order layer compressed with its sides held."""
    I1 = (2 + stretch**2) * stretch ** (-2 / 3)
    dI1 = 2 * stretch ** (1 / 3) - 2 / 3 * I1 / stretch
    return (c.C10_MPa + 2 * c.C20_MPa * (I1 - 3)) * dI1 + 2 / c.D1_per_MPa * (stretch - 1)


@pytest.mark.ranks
@pytest.mark.parametrize(
    ("theta", "bent"),
    [(0, False), (1, False), pytest.param(-1, False, marks=pytest.mark.slow), (0, True)],
)
def test_patch_of_four_layers_is_exact(theta, bent):
    """A flat press with held sides: one stretch and one pressure per layer, exactly."""
    depth = 0.3
    thickness = np.diff(DEPTHS)
    constants = [getattr(ELASTIC, name) for name in LAYERS]

    def balance(stretch):
        P = [layer_stress(c, s) for c, s in zip(constants, stretch, strict=True)]
        return [*(np.diff(P) * 100), thickness @ stretch - (DEPTHS[-1] - depth)]

    stretch, _, ok, _ = fsolve(balance, np.full(4, 0.9), xtol=1e-13, full_output=True)
    assert ok == 1
    contact = problem(
        Plate(friction=0.0),
        constraints=rollers,
        domain=block(bent=bent),
        nitsche_theta=theta,
        contact_width_MPa=0,
    )
    load = follow(contact, (0, 0, depth / 2), (0, 0, depth))
    heights = np.interp(
        contact.u.function_space.tabulate_dof_coordinates()[:, 2],
        DEPTHS,
        np.concatenate([[0.0], np.cumsum(thickness * (stretch - 1))]) + depth,
    )
    u = contact.u.x.array.reshape(-1, 3)
    np.testing.assert_allclose(u[:, 2], heights, atol=1e-7)
    np.testing.assert_allclose(u[:, :2], 0, atol=1e-7)
    force = -layer_stress(constants[0], stretch[0]) * 36
    assert load.force_N[2] == pytest.approx(force, rel=1e-6)


@pytest.mark.ranks
@pytest.mark.parametrize("theta", [0, 1, pytest.param(-1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("state", ["open", "sticking", "slipping"])
def test_tangent_is_the_derivative_of_the_residual(state, theta):
    contact = problem(Sphere(radius_mm=4.0), nitsche_theta=theta, tangent_iterations=1)
    snes = contact.solver.snes
    slip = {"open": 0.0, "sticking": 1e-7, "slipping": 0.1}[state]
    contact.state.place((0, -slip, -1.0 if state == "open" else 0.4))
    contact.state.translation_old.value[1] += slip
    random = np.random.default_rng(0)

    def displacement(scale):
        """Return random displacements of the file's nodes, the same on any number of ranks."""
        values = scale * random.normal(size=contact.domain.nodes.shape)
        values[contact.domain.held] = 0.0
        u = fem.Function(contact.u.function_space)
        contact.order.scatter(values, u)
        vector = snes.getFunction()[0].duplicate()
        vector.array = u.x.array[: vector.getLocalSize()]
        return u, vector

    before, x = displacement(1e-3)
    contact.state.u_old.x.array[:] = before.x.array
    _, direction = displacement(1.0)
    product, plus, minus, there = (x.duplicate() for _ in range(4))
    A = snes.getJacobian()[0]
    snes.computeJacobian(x, A)
    A.mult(direction, product)
    eps = 1e-8
    for sign, result in ((1, plus), (-1, minus)):
        there.waxpy(sign * eps, direction, x)
        snes.computeFunction(there, result)
    error = (plus - minus) / (2 * eps) - product
    assert error.norm() < 1e-6 * product.norm()


@pytest.mark.parametrize("theta", [0, 1])
def test_without_friction_the_symmetric_variant_has_a_symmetric_tangent(theta):
    """On a flat body it is the derivative of ``(s_n^2 - |t|^2)/(2 gamma_h)`` on the skin."""
    contact = problem(Plate(friction=0.0), nitsche_theta=theta, tangent_iterations=1)
    contact.state.place((0, 0, 0.4))
    snes = contact.solver.snes
    A, nothing = snes.getJacobian()[0], snes.getFunction()[0].duplicate()
    snes.computeJacobian(nothing, A)
    K = A.convert("dense").getDenseArray()
    assert (np.abs(K - K.T).max() < 1e-9 * np.abs(K).max()) == (theta == 1)


@pytest.mark.ranks
def test_newton_converges_quadratically_on_a_fixed_contact_set():
    """A large ball over the whole face: the contact set cannot change."""
    newton = {"contact_width_MPa": 0, "nitsche_gamma": 0.6, "tangent_iterations": 1}
    contact = problem(Sphere(radius_mm=60.0, friction=0.0), **newton)
    follow(contact, *((0, 0, depth) for depth in (0.1, 0.2, 0.3, 0.4, 0.5)))
    contact.solver.snes.setConvergenceHistory()
    follow(contact, (0, 0, 0.8))
    norms = contact.solver.snes.getConvergenceHistory()[0]
    norms = norms[norms > 1e-12]  # rounding
    order = np.log(norms[-1] / norms[-2]) / np.log(norms[-2] / norms[-3])
    assert order > 1.8, norms


@pytest.mark.ranks
@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_sliding_block_feels_mu_times_the_normal_force(friction):
    contact = problem(Plate(friction=friction))
    follow(contact, (0, 0, 0.1))
    force = follow(contact, *((0, -y, 0.1) for y in (0.05, 0.2, 0.5, 0.9, 1.3, 1.8, 2.5))).force_N
    assert abs(force[0]) < 1e-3 * force[2]
    assert -force[1] / force[2] == pytest.approx(friction, rel=1e-3)


@pytest.mark.ranks
def test_what_sticks_does_not_creep():
    """Steps without motion change nothing, however many."""
    contact = problem(Plate(friction=0.6))
    before = follow(contact, (0, 0, 0.1), (0, -0.05, 0.1)).force_N
    after = follow(contact, *([(0, -0.05, 0.1)] * 5)).force_N
    assert -before[1] > 0.02 * before[2]
    assert after[1] == pytest.approx(before[1], rel=3e-4)


@pytest.mark.ranks
def test_a_sticking_block_follows_the_plate():
    contact = problem(Plate(friction=1.0))
    follow(contact, (0, 0, 0.05), (0, 0, 0.1), *((0, -y, 0.1) for y in (0.01, 0.02)))
    u = contact.domain.comm.bcast(contact.order.gather(contact.u))
    u = u[np.isclose(contact.domain.nodes[:, 2], 0)]
    middle = np.abs(u[:, 1] + 0.02) < 1e-3
    assert middle.mean() > 0.7


@pytest.mark.ranks
def test_contact_force_balances_the_held_reaction():
    contact = problem(Sphere(radius_mm=4.0, friction=0.3))
    load = follow(contact, (0, 0, 0.2), (0, 0, 0.4), (0, -0.01, 0.4))
    assert load.force_N[2] > 1e-3
    assert load.imbalance_N < 1e-7


@pytest.mark.ranks
def test_force_does_not_depend_on_gamma():
    forces = []
    for gamma in (0.6, 6.0):
        contact = problem(Sphere(radius_mm=4.0, friction=0.0), nitsche_gamma=gamma)
        forces.append(follow(contact, (0, 0, 0.2), (0, 0, 0.4)).force_N[2])
    assert forces[0] == pytest.approx(forces[1], rel=0.01)


def test_a_problem_no_longer_used_is_gone():
    used = problem(Plate())
    follow(used, (0, 0, 0.1))
    trace = weakref.ref(used)
    del used
    gc.collect()
    assert trace() is None


@pytest.mark.parametrize("linear", ["direct", "multigrid"])
@pytest.mark.parametrize("outer", ["ngmres", "anderson"])
def test_a_solver_around_newton_finds_the_same(outer, linear):
    newton = {"npc_snes_type": "newtonls", "npc_snes_max_it": 1, "npc_pc_type": "lu"}
    body, forces = Sphere(radius_mm=4.0), []
    for solve, petsc in (("direct", {}), (linear, {"snes_type": outer, **newton})):
        settings = Solver(held=("cut",), linear=solve, petsc={**EXACT, **petsc})
        contact = FingerProblem(block(), ELASTIC, body.body(), body.friction, settings)
        forces.append(follow(contact, (0, 0, 0.05), (0, -0.01, 0.08)).force_N)
    assert forces[0][2] > 1e-3
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-6)


@pytest.mark.ranks
def test_no_contact_no_force():
    contact = problem(Sphere(radius_mm=4.0))
    assert np.all(follow(contact, (0, 0, -0.5)).force_N == 0)
    assert np.all(contact.u.x.array == 0)


@pytest.mark.parametrize("x", [-30.0, -1.0, -0.1, 0.0, 0.03, 0.1, 0.5])
def test_contact_sets_in_smoothly_and_not_far_away(x):
    width, step = 0.1, 1e-6

    def value(at):
        return smooth_positive(ufl.as_ufl(at), width)(())

    exact = (x + np.hypot(x, width)) / 2 - width / 1000
    assert value(x) == pytest.approx(max(exact, 0.0), abs=1e-12)
    assert abs(value(x) - max(x, 0.0)) <= width / 2
    assert -1e-9 <= (value(x + step) - value(x)) / step <= 1 + 1e-6
    assert value(-ZERO_BELOW * width) == 0.0 < value(-0.9 * ZERO_BELOW * width)


@pytest.mark.ranks
def test_the_width_of_contact_hardly_changes_the_force():
    forces = []
    for width in (0.0, Solver().contact_width_MPa):
        contact = problem(Sphere(radius_mm=4.0, friction=0.3), contact_width_MPa=width)
        forces.append(follow(contact, (0, 0, 0.2), (0, 0, 0.4), (0, -0.1, 0.4)).force_N)
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-3, atol=1e-6)


@pytest.mark.ranks
@pytest.mark.parametrize("failures", [1, 2])
def test_where_newton_fails_contact_is_regularized_first(monkeypatch, failures):
    contact = problem(Plate(friction=0.3), tangent_iterations=1)
    snes, regularized, tried = contact.solver.snes, contact.contact.regularized, [None]

    def watched(*law):
        tried.append(law)
        return regularized(*law)

    def fails_at_first(snes, iteration, norms):
        reasons = PETSc.SNES.ConvergedReason
        if len(tried) <= failures:
            return reasons.DIVERGED_LINE_SEARCH
        return reasons.CONVERGED_FNORM_ABS if norms[-1] < 1e-11 else reasons.ITERATING

    monkeypatch.setattr(contact.contact, "regularized", watched)
    snes.setConvergenceTest(fails_at_first)
    report = contact.solve(np.array([0, 0, 0.1]), 0.01)
    assert report.converged
    assert tried == [None, (1.0, 0.3), (4.0, 0.3)][: failures + 1]
    assert report.iterations > snes.getIterationNumber() > 0
    plain = follow(problem(Plate(friction=0.3)), (0, 0, 0.1))
    np.testing.assert_allclose(contact.load().force_N, plain.force_N, rtol=1e-7, atol=1e-9)
