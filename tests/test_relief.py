"""Measured surfaces: levelling, filter, distance, and what they repeat."""

import numpy as np
import pytest

from tactile_fem.stimulus.body import EXCESS_MM
from tactile_fem.stimulus.relief import Relief, levelled
from tactile_fem.stimulus.sampled import height_map
from tactile_fem.study import Surface


def sampled(function, shape=(81, 121), spacing=(0.05, 0.05)):
    """Return heights on a grid around the origin, without their mean."""
    x, y = (step * (np.arange(n) - (n - 1) / 2) for n, step in zip(shape, spacing, strict=True))
    heights = function(x[:, None], y[None, :])
    return heights - heights.mean()


def relief_of(function, shape=(81, 121), spacing=(0.05, 0.05), **keys):
    return Relief.of(sampled(function, shape, spacing), spacing, **keys)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_levelling_takes_polynomials_away_and_nothing_else(degree):
    x, y = np.linspace(0, 3, 40)[:, None], np.linspace(0, 5, 70)[None, :]
    form = [0 * x + 2.0, 0.3 * x - 0.1 * y, x * y - 0.2 * y**2][: degree + 1]
    wave = np.cos(2 * np.pi * x / 3 * 39 / 40 * 4) * np.cos(2 * np.pi * y / 5 * 69 / 70 * 7)
    assert levelled(wave + sum(form), degree) == pytest.approx(levelled(wave, degree), abs=1e-12)
    assert levelled(wave, degree) == pytest.approx(wave, abs=0.05)
    assert levelled(wave + x**3, degree) != pytest.approx(wave, abs=0.1)


@pytest.mark.parametrize(("wavelength", "share"), [(1.0, 0.5), (2.0, 0.5**0.25), (0.5, 0.5**4)])
def test_the_filter_halves_its_wavelength(wavelength, share):
    relief = relief_of(
        lambda x, y: np.sin(2 * np.pi * x / wavelength) + 0 * y,
        (160, 40),
        low_pass_mm=1.0,
        beyond="grid-wrap",
    )
    x = np.linspace(-4, 4, 4001)
    h = relief.heights.derivatives(np.column_stack([x, 0 * x]), 0)[0]
    assert np.ptp(h) == pytest.approx(2 * share, rel=2e-3)
    assert h.max() == pytest.approx(0, abs=1e-4)


def test_a_paraboloid_has_its_height_normal_and_curvature():
    body = relief_of(lambda x, y: -(x**2) / 8 - y**2 / 12)
    at = body.distance(np.array([[0.0, 0, 0], [0, 0, 0.3], [1.0, 0, -1 / 8], [0, 0, 4]]))
    assert at.gap == pytest.approx([0, 0.3, 0, 4], abs=1e-6)
    assert at.normal[:3] == pytest.approx(
        np.array([[0, 0, 1], [0, 0, 1], np.array([0.25, 0, 1]) / np.hypot(0.25, 1)]), abs=1e-5
    )
    assert np.diag(at.hessian[0]) == pytest.approx([1 / 4, 1 / 6, 0], abs=1e-4)


def test_derivatives_are_those_of_the_gap():
    rng = np.random.default_rng(5)
    k = 2 * np.pi / np.array([[0.9, 1.3], [1.7, -0.8], [2.2, 0.6]])
    body = relief_of(lambda x, y: sum(0.1 * np.sin(a * x + b * y) for a, b in k))
    xy = rng.uniform(-1.8, 1.8, (500, 2))
    z = body.heights.derivatives(xy, 0)[0] + rng.uniform(-0.05, 0.2, 500)
    points, eps = np.column_stack([xy, z]), 1e-6
    at = body.distance(points)
    for axis in range(3):
        step = eps * np.eye(3)[axis]
        ahead, behind = body.distance(points + step), body.distance(points - step)
        slope = (ahead.gap - behind.gap) / (2 * eps)
        bend = (ahead.normal - behind.normal) / (2 * eps)
        assert slope == pytest.approx(at.normal[:, axis], abs=1e-7)
        assert bend == pytest.approx(at.hessian[:, axis], abs=1e-4)
    on = body.distance(np.column_stack([xy, body.heights.derivatives(xy, 0)[0]]))
    assert on.gap == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(on.normal, axis=1) == pytest.approx(1)


def test_a_cylinder_has_its_distance_near_it():
    radius = 2.0
    body = relief_of(lambda x, y: np.sqrt(radius**2 - x**2) - radius + 0 * y, (61, 5))
    angle = np.linspace(-0.5, 0.5, 21)
    for off in (0.01, 0.1):
        points = (radius + off) * np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
        gap = body.distance(points - [0, 0, radius]).gap
        # The error is of second order: off^2 times slope and curvature.
        assert np.abs(gap / off - 1).max() < 0.2 * off + 2e-4


@pytest.mark.parametrize("way_mm", [0.02, 0.3, 2.0])
@pytest.mark.parametrize("beyond", ["mirror", "grid-wrap"])
def test_a_rough_surface_is_never_farther_than_the_way_to_it(way_mm, beyond):
    rng = np.random.default_rng(5)
    body = relief_of(
        lambda x, y: rng.normal(0, 0.1, (x + y).shape), low_pass_mm=0.15, beyond=beyond
    )
    points = rng.uniform([-3, -4, -1], [3, 4, 4], (20_000, 3))
    ways = rng.normal(size=points.shape)
    ways *= way_mm / np.linalg.norm(ways, axis=1)[:, None]
    here, there = body.distance(points), body.distance(points + ways)
    outside = (here.gap > 0) & (there.gap > 0)
    assert np.abs(here.gap - there.gap)[outside].max() <= way_mm + EXCESS_MM
    assert np.all((here.gap > 0) == (points[:, 2] > body.heights.derivatives(points[:, :2], 0)[0]))
    assert np.linalg.norm(here.normal, axis=1).min() > 0.01


def test_beyond_its_edges_it_is_mirrored_or_repeated():
    def ramp(**keys):
        return relief_of(lambda x, y: 0.1 * x + 0.02 * y, (41, 61), **keys).heights

    x = np.linspace(-5, 5, 101)
    points = np.column_stack([x, 0 * x])
    mirrored = ramp().derivatives(points, 1)
    folded = 2 - np.abs(np.mod(x + 1, 4) - 2) - 1
    inside = np.abs(np.mod(x, 2) - 1) > 0.2
    assert mirrored[0][inside] - mirrored[0].max() == pytest.approx(
        (0.1 * folded - 0.1)[inside], abs=2e-3
    )
    assert np.abs(np.diff(mirrored[0])).max() < 0.0101
    repeated = ramp(beyond="grid-wrap")
    period = np.array([41, 61]) * 0.05
    here, there = (repeated.derivatives(points + n * period, 2) for n in (0, 3))
    assert np.ptp(here[0]) > 0.19
    assert there[0] == pytest.approx(here[0])
    assert there[2] == pytest.approx(here[2], abs=1e-9)


def test_it_is_turned_from_x_towards_y(tmp_path):
    rng = np.random.default_rng(0)
    heights = rng.normal(size=(30, 40))
    file = tmp_path / "rough.npy"
    np.save(file, heights)
    keys = {"file": file, "spacing_mm": 0.2, "unit_mm": 0.01, "low_pass_mm": 0.6}
    straight, turned = Surface(**keys).body(), Surface(**keys, turn_deg=90.0).body()
    points = rng.uniform([-2, -2, -0.05], [2, 2, 0.05], (50, 3))
    x, y, z = points.T
    there = np.column_stack([-y, x, z])  # where a quarter of a turn takes them
    one, other = straight.distance(points), turned.distance(there)
    assert other.gap == pytest.approx(one.gap)
    nx, ny, nz = one.normal.T
    assert other.normal == pytest.approx(np.column_stack([-ny, nx, nz]))
    assert other.hessian[:, 1, 1] == pytest.approx(one.hessian[:, 0, 0])


def test_the_highest_point_is_zero(tmp_path):
    file = tmp_path / "rough.npy"
    np.save(file, np.random.default_rng(1).normal(size=(60, 80)))
    body = Surface(file=file, spacing_mm=0.1, unit_mm=0.03, low_pass_mm=0.4).body()
    heights = height_map(body, np.linspace(-3, 3, 241), np.linspace(-4, 4, 321))
    assert heights.max() == pytest.approx(0, abs=2e-4)
    assert heights.max() <= 1e-5
