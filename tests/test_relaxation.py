"""Tissue that relaxes, against exact solutions, an own integration, and what must always hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tactile_fem.runtime import backend, ranks  # noqa: F401

import ufl  # isort: skip
from mpi4py import MPI  # isort: skip

from blocks import LAYERS, block_mesh
from materials import RELAXING
from sphere_on_block import PRESS_AND_SLIDE, TWO_TISSUES, follow, sphere_on_block
from terms import Bulk

from tactile_fem.assembly.compile import expression
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.study import Tissue
from tactile_fem.tissue.relaxation import Prony

C10, C20, D1 = 0.01, 0.02, 20.0


def skin(g: tuple[float, ...], tau_s: tuple[float, ...], **more: float) -> Tissue:
    """Return one law in all layers, with a series."""
    constants = {"C10_MPa": C10, "C30_MPa": 0.0, "C20_MPa": 0.0, "D1_per_MPa": D1, **more}
    layer = {**constants, "g": g, "tau_s": tau_s}
    return Tissue.model_validate({"viscous_time_s": 0.0, **dict.fromkeys(LAYERS, layer)})


class Piece:
    """A homogeneous piece of tissue whose deformation gradient is prescribed.

    `stored` is its energy at the last one, in MPa.
    """

    def __init__(self, tissue: Tissue) -> None:
        line = np.array([0.0, 1.0])
        mesh = block_mesh(line, line, np.array([0.0, 1.0]), LAYERS[:1])
        domain = create_domain(mesh, MPI.COMM_SELF)
        self._bulk = bulk = Bulk(domain, tissue)
        name = next(iter(bulk.tissues.tags))
        P, W = bulk.stress(name), bulk.energy(name)
        both = ufl.as_vector([*(P[i, j] for i in range(3) for j in range(3)), W])
        self._both, self._mesh = expression(both, np.full((1, 3), 0.25)), domain.mesh

    def stress(self, F: np.ndarray, dt_s: float) -> np.ndarray:
        """Return the first Piola stress at `F`, a time step after what was accepted, in MPa."""
        self._bulk.u.interpolate(lambda x: (F - np.eye(3)) @ x)
        self._bulk.state.time_step.value = dt_s
        self._bulk.begin_step()
        *P, self.stored = self._both.eval(self._mesh, np.array([0], dtype=np.int32)).ravel()
        return np.reshape(P, (3, 3))

    def accept(self) -> None:
        self._bulk.accept()

    def follow(self, path: Callable[[float], np.ndarray], times_s: np.ndarray) -> list[np.ndarray]:
        """Return the stresses along a path of `F` from rest at time 0."""
        found = []
        for before, now in zip([0.0, *times_s[:-1]], times_s, strict=True):
            found.append(self.stress(path(now), now - before))
            self.accept()
        return found


def sheared(gamma: float) -> np.ndarray:
    return np.eye(3) + gamma * np.outer([1, 0, 0], [0, 0, 1])


def stretched(ratio: float) -> np.ndarray:
    return np.diag([ratio, 1.02, 0.9 / ratio])


def elastic(F: np.ndarray, c10: float = C10, c20: float = 0.0) -> np.ndarray:
    """Return the stress of the polynomial law, from its formula."""
    J, to = np.linalg.det(F), np.linalg.inv(F).T
    a = J ** (-2 / 3) * np.sum(F * F) - 3
    shape = 2 * (c10 + 2 * c20 * a) * J ** (-2 / 3) * (F - np.sum(F * F) / 3 * to)
    return shape + 2 * (J - 1) / D1 * J * to


def of_network(F: np.ndarray, A: np.ndarray, c10: float, c20: float) -> np.ndarray:
    """Return the stress of a network of stiffness 1, from the docstring's formulas."""
    J, to = np.linalg.det(F), np.linalg.inv(F).T
    trace = J ** (-2 / 3) * np.trace(F @ A @ F.T)
    a = trace - np.log(np.linalg.det(A)) - 3
    return 2 * (c10 + 2 * c20 * a) * J ** (-2 / 3) * (F @ A - np.sum(F * (F @ A)) / 3 * to)


def metric(F: np.ndarray) -> np.ndarray:
    return np.linalg.det(F) ** (2 / 3) * np.linalg.inv(F.T @ F)


@pytest.mark.parametrize("c20", [0.0, C20])
def test_at_once_and_in_the_long_run_it_is_elastic_to_rounding(c20):
    ratio = Prony((0.3, 0.2), (1.0, 1.0)).ratios
    for F in (sheared(0.8), stretched(1.4)):
        # Nothing breaks in a step that is short against all times; all has broken in a long one.
        piece = Piece(skin((0.3, 0.2), (1e12, 1e13), C20_MPa=c20))
        volume = elastic(F, 0.0)
        instantaneous = (1 + sum(ratio)) * (elastic(F, C10, c20) - volume) + volume
        np.testing.assert_allclose(piece.stress(F, 1.0), instantaneous, rtol=0, atol=1e-12)
        piece = Piece(skin((0.3, 0.2), (1e-14, 1e-15), C20_MPa=c20))
        np.testing.assert_allclose(piece.stress(F, 1.0), elastic(F, C10, c20), rtol=0, atol=1e-12)


@pytest.mark.parametrize("c20", [0.0, C20])
def test_a_held_shape_relaxes_exactly_over_steps_of_any_length(c20):
    series = Prony((0.3, 0.2), (0.05, 0.7))
    piece, F = Piece(skin(series.g, series.tau_s, C20_MPa=c20)), stretched(1.3)
    piece.stress(F, 1e-12)
    piece.accept()
    time_s = 0.0
    for dt_s in (0.01, 0.3, 0.002, 5.0):
        time_s += dt_s
        found = piece.stress(F, dt_s)
        piece.accept()
        expected = elastic(F, C10, c20)
        for ratio, tau_s in zip(series.ratios, series.tau_s, strict=True):
            A = metric(F) + (np.eye(3) - metric(F)) * np.exp(-time_s / tau_s)
            expected = expected + ratio * of_network(F, A, C10, c20)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_an_independent_integration_gives_the_same_with_the_second_order_of_the_step():
    series, period = Prony((0.35, 0.25), (0.02, 0.3)), 0.2
    end_s = 0.25

    def path(time_s: float) -> np.ndarray:
        shear = sheared(0.6 * np.sin(2 * np.pi * time_s / period))
        return shear @ np.diag([1 + time_s, 1 + 0.1 * time_s, 1 - 0.4 * time_s])

    expected = elastic(path(end_s), C10, C20)
    for ratio, tau_s in zip(series.ratios, series.tau_s, strict=True):
        rate = lambda t, A, tau=tau_s: (metric(path(t)).ravel() - A) / tau  # noqa: E731
        A = solve_ivp(rate, (0, end_s), np.eye(3).ravel(), rtol=1e-10, atol=1e-12).y[:, -1]
        expected = expected + ratio * of_network(path(end_s), A.reshape(3, 3), C10, C20)
    errors = []
    for steps in (50, 100, 200):
        piece = Piece(skin(series.g, series.tau_s, C20_MPa=C20))
        found = piece.follow(path, np.linspace(0, end_s, steps + 1)[1:])[-1]
        errors.append(np.abs(found - expected).max())
    assert errors[-1] < 2e-4 * np.abs(expected).max()
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.15)


def test_small_shear_is_the_convolution_with_the_series():
    series, rate, end_s = Prony((0.4, 0.3), (0.02, 0.5)), 1e-5, 0.4
    piece = Piece(skin(series.g, series.tau_s))
    times = np.linspace(0, end_s, 9)[1:]  # the strain is linear: any step is exact
    found = [P[0, 2] for P in piece.follow(lambda t: sheared(rate * t), times)]
    G = 2 * C10
    convolution = G * rate * times
    for ratio, tau_s in zip(series.ratios, series.tau_s, strict=True):
        convolution += ratio * G * rate * tau_s * (1 - np.exp(-times / tau_s))
    np.testing.assert_allclose(found, convolution, rtol=1e-6)


def test_creep_under_a_constant_stress_follows_the_standard_solid():
    g, tau_s, G = 0.6, 0.1, 2 * C10
    stress = 1e-5 * G / (1 - g)
    errors = []
    for steps in (10, 20, 40):
        piece = Piece(skin((g,), (tau_s,)))
        dt_s, last = 0.5 / steps, 0.0

        def excess(gamma: float, over_s: float, piece: Piece = piece) -> float:
            return piece.stress(sheared(gamma), over_s)[0, 2] / stress - 1

        for over_s in (1e-12, *[dt_s] * steps):
            last = brentq(excess, 0.9 * last, 4e-5, args=(over_s,), xtol=1e-16, rtol=1e-12)
            excess(last, over_s)
            piece.accept()
        exact = stress / G * (1 - g * np.exp(-0.5 * (1 - g) / tau_s))
        errors.append(abs(last / exact - 1))
    assert errors[-1] < 1e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2, atol=0.3)


def test_a_rotation_turns_the_stress():
    angle = 0.7
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    path = lambda t: sheared(5 * t) @ stretched(1 + 3 * t)  # noqa: E731
    times = np.array([0.02, 0.05, 0.1])
    made = skin((0.3, 0.2), (0.05, 0.7), C20_MPa=C20)
    plain = Piece(made).follow(path, times)
    turned = Piece(made).follow(lambda t: R @ path(t), times)
    for P, RP in zip(plain, turned, strict=True):
        np.testing.assert_allclose(RP, R @ P, rtol=0, atol=1e-13)


def test_work_is_stored_or_lost_and_never_gained():
    rng = np.random.default_rng(5)
    piece = Piece(skin((0.4, 0.3), (0.01, 0.2), C20_MPa=C20))
    F, P, stored, lost = np.eye(3), np.zeros((3, 3)), 0.0, []
    for _ in range(5):
        goal = np.eye(3) + 0.35 * rng.uniform(-1, 1, (3, 3))
        start = F
        for share in np.linspace(0, 1, 41)[1:]:
            there = start + share * (goal - start)
            new = piece.stress(there, 0.002)
            work = np.sum((P + new) / 2 * (there - F))
            lost.append(work - (piece.stored - stored))
            F, P, stored = there, new, piece.stored
            piece.accept()
    assert min(lost) > -1e-3 * max(lost)  # the trapezoid's error
    assert sum(lost) > 0.1 * stored
    piece.stress(np.eye(3), 1e3)
    assert piece.stored < 1e-6 * stored  # at rest again, all of it is lost


@pytest.mark.ranks
def test_contact_holds_relaxing_skin_and_a_checkpoint_goes_on():
    first, last = PRESS_AND_SLIDE[0], PRESS_AND_SLIDE[-1]
    made = sphere_on_block(RELAXING, layers=TWO_TISSUES)
    loads = [follow(made, place) for place in PRESS_AND_SLIDE] + [follow(made, last, dt_s=0.1)]
    assert max(load.imbalance_N for load in loads) < 1e-9
    assert max(load.gap_error_mm for load in loads) < 0.01
    assert loads[-1].force_N[2] < 0.95 * loads[-2].force_N[2]  # the skin relaxes
    other = sphere_on_block(RELAXING, layers=TWO_TISSUES)
    other.restore(made.gather())
    for problem in (made, other):
        follow(problem, last, dt_s=1.0)
    np.testing.assert_allclose(other.u.x.array, made.u.x.array, rtol=0, atol=1e-9)
    long = sphere_on_block(RELAXING, layers=TWO_TISSUES)
    elastic_one = sphere_on_block(layers=TWO_TISSUES)
    for problem in (long, elastic_one):
        follow(problem, first, dt_s=1e3)
    np.testing.assert_allclose(long.u.x.array, elastic_one.u.x.array, rtol=0, atol=2e-5)


@pytest.mark.parametrize(
    ("series", "told"),
    [
        ({"g": [0.5], "tau_s": [0.0]}, "tau_s"),
        ({"g": [0.5], "tau_s": [-1.0]}, "tau_s"),
        ({"g": [0.5, 0.5], "tau_s": [0.1, 1.0]}, "below 1"),
        ({"g": [0.5], "tau_s": []}, "own time"),
        ({"g": [-0.1], "tau_s": [1.0]}, "g"),
    ],
)
def test_bad_series_are_refused(series, told):
    with pytest.raises(ValueError, match=told):
        Tissue.model_validate({"dermis": series})


def test_a_finger_pads_series_takes_the_place_of_the_short_viscosity():
    relaxing = Tissue(relaxation="fingerpad")
    assert relaxing.viscous_time_s == 0 and relaxing.dermis.tau_s[0] == Tissue().viscous_time_s
    assert Tissue(relaxation="fingerpad", viscous_time_s=0.001).viscous_time_s == 0.001
    own = Tissue.model_validate({"relaxation": "fingerpad", "dermis": {"g": (), "tau_s": ()}})
    assert not own.dermis.g and own.epidermis.g == relaxing.epidermis.g
    assert not relaxing.bone.g and not relaxing.nail.g
