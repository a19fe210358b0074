"""Splines on a grid: exact for cubic polynomials, smooth, mirrored or repeated beyond the grid."""

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from tactile_fem.stimulus.spline import GridSpline


def sampled(function, *axes):
    return function(*np.meshgrid(*axes, indexing="ij"))


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_waves_are_met_with_their_derivatives(dimension):
    count, k = 64, 2 * np.pi / 3.2
    axes = [0.05 * np.arange(count) + 0.4] * dimension
    spline = GridSpline.through(
        sampled(lambda *x: np.prod([np.sin(k * c) for c in x], axis=0), *axes),
        [0.4] * dimension,
        [0.05] * dimension,
        "grid-wrap",
    )
    points = np.random.default_rng(1).uniform(-9, 9, (300, dimension))
    value, gradient, hessian, third = spline.derivatives(points, 3)
    s, c = np.sin(k * points), np.cos(k * points)
    assert value == pytest.approx(s.prod(axis=1), abs=1e-5)
    for a in range(dimension):
        rest = np.delete(s, a, axis=1).prod(axis=1)
        assert gradient[:, a] == pytest.approx(k * c[:, a] * rest, abs=1e-4)
        assert hessian[:, a, a] == pytest.approx(-(k**2) * s[:, a] * rest, abs=2e-2)
        assert third[:, a, a, a] == pytest.approx(-(k**3) * c[:, a] * rest, abs=0.5)
    assert hessian == pytest.approx(hessian.swapaxes(1, 2))


def test_derivatives_are_those_of_the_values():
    rng = np.random.default_rng(2)
    spline = GridSpline.through(rng.normal(size=(9, 7)), [1.0, -2.0], [0.3, 0.5])
    points, eps = rng.uniform(-5, 5, (200, 2)), 1e-6
    at = spline.derivatives(points, 2)
    for axis in range(2):
        step = eps * np.eye(2)[axis]
        ahead, behind = (spline.derivatives(points + sign * step, 1) for sign in (1, -1))
        for order in range(2):
            slope = (ahead[order] - behind[order]) / (2 * eps)
            assert slope == pytest.approx(at[order + 1][..., axis], rel=1e-3, abs=1e-3)


def test_inside_the_grid_it_is_the_same_as_fitpack():
    rng = np.random.default_rng(3)
    x, y = np.arange(60.0), np.arange(50.0)
    values = rng.normal(size=(60, 50))
    points = rng.uniform([20, 20], [40, 30], (100, 2))
    ours = GridSpline.through(values, [0, 0], [1, 1]).derivatives(points, 1)
    theirs = RectBivariateSpline(x, y, values)
    # End conditions differ; their influence falls by 3.7 with each point.
    assert ours[0] == pytest.approx(theirs.ev(*points.T), abs=1e-9)
    assert ours[1][:, 0] == pytest.approx(theirs.ev(*points.T, dx=1), abs=1e-9)


def test_values_are_met_mirrored_and_repeated():
    values = np.random.default_rng(4).normal(size=(5, 6))
    i, j = np.meshgrid(np.arange(-7, 12), np.arange(-8, 14), indexing="ij")
    points = np.column_stack([i.ravel(), j.ravel()]).astype(float)
    repeated = GridSpline.through(values, [0, 0], [1, 1], "grid-wrap").derivatives(points, 0)[0]
    assert repeated == pytest.approx(values[i.ravel() % 5, j.ravel() % 6])
    mirrored = GridSpline.through(values, [0, 0], [1, 1]).derivatives(points, 0)[0]
    padded = np.pad(values, ((7, 7), (8, 8)), mode="reflect")
    assert mirrored == pytest.approx(padded.ravel())
