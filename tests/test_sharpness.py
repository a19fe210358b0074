"""What is steep and sharp in heights is found, with the filter and the unit that help."""

import logging
import math

import numpy as np
import pytest
from needs import needs_gmsh

from tactile_fem.cli.app import main
from tactile_fem.simulation.checks import judge_surface
from tactile_fem.stimulus.relief import Relief
from tactile_fem.stimulus.sharpness import (
    Limits,
    factor_that_helps,
    low_pass_that_helps,
    sharpest_edge,
    two_digits,
)
from tactile_fem.study import Finger, Surface

STEP_MM = 0.02
AT = STEP_MM * (np.arange(300) - 149.5)


@pytest.fixture(scope="module")
def plus(tmp_path_factory):
    """A map of a plus of 1 and a plate of 0, its middle 1 mm along X."""
    x, y = np.meshgrid(AT - 1, AT, indexing="ij")
    raised = np.minimum(abs(x), abs(y)) < 0.5
    file = tmp_path_factory.mktemp("maps") / "plus.npy"
    np.save(file, (raised & (np.maximum(abs(x), abs(y)) < 1.5)).astype(float))
    return file


def surface(file, **keys):
    return Surface(file=file, spacing_mm=STEP_MM, unit_mm=0.5, **keys)


def surface_of_waves(height):
    """Waves of 3 mm along X."""
    x = STEP_MM * np.arange(301)
    return Relief.of(height * np.cos(2 * np.pi / 3 * x)[:, None] + 0 * x, [STEP_MM] * 2)


def test_the_radius_of_curvature_is_that_of_the_surface_in_space():
    height, k = 0.3, 2 * np.pi / 3
    edge = sharpest_edge(surface_of_waves(height), Limits(9.0, 0.0))
    slope = 0.5  # from which on a place is steep; the wave is more sharply curved where it is less
    bend = height * k**2 * np.sqrt(1 - (slope / (height * k)) ** 2)
    assert edge.radius_mm == pytest.approx((1 + slope**2) ** 1.5 / bend, rel=0.02)
    assert edge.slope == pytest.approx(height * k, rel=1e-3)
    assert not edge.is_flat
    assert sharpest_edge(surface_of_waves(0.2), Limits(9.0, 0.0)) is None  # nowhere steep


@pytest.mark.parametrize("facet_mm", [0.25, 1.0, 3.0])
def test_what_is_proposed_leaves_no_sharp_place_and_less_does(plus, facet_mm):
    relief, limits = surface(plus).relief(), Limits.of_facets(facet_mm)
    wave_mm = low_pass_that_helps(relief, 0.1, limits)
    assert sharpest_edge(surface(plus, low_pass_mm=wave_mm).relief(), limits) is None
    assert sharpest_edge(surface(plus, low_pass_mm=0.8 * wave_mm).relief(), limits)
    factor = factor_that_helps(relief, limits)
    assert sharpest_edge(relief.scaled(factor), limits) is None
    assert sharpest_edge(relief.scaled(1.2 * factor), limits)


def test_low_walls_are_harmless(plus):
    for unit_mm, is_warned in ((0.5, True), (0.1, False)):
        low = Surface(file=plus, spacing_mm=STEP_MM, unit_mm=unit_mm)
        assert bool(low.hindrance(1.0)) == is_warned
    assert low.hindrance(0.5)


def test_rounding_to_two_digits():
    assert two_digits(0.4567) == pytest.approx(0.45)
    assert two_digits(0.4567, math.ceil) == pytest.approx(0.46)
    assert two_digits(12.3) == pytest.approx(12)


def test_the_warning_says_where_how_steep_and_what_helps(plus, caplog):
    finger = Finger().mesh()
    with caplog.at_level(logging.WARNING):
        judge_surface(surface(plus, turn_deg=90.0, shift_mm=(0.0, 3.0)), finger)
    (said,) = caplog.messages
    x, y = (float(said.split(f"{axis} ")[1].split()[0].rstrip(",")) for axis in "XY")
    # The middle of the plus, at X 1, is turned to Y 1 and shifted to Y 4.
    assert min(abs(abs(x) - 0.5), abs(abs(x) - 1.5)) < 0.06 or abs(abs(y - 4) - 1.5) < 0.06
    assert abs(x) < 1.6 and abs(y - 4) < 1.6
    assert "84 degrees" in said and "facets of 0.97 mm need 0.097 mm" in said
    assert "choose stimulus.low_pass_mm = 0.4" in said and "(now 0.1)" in said
    assert 'for flat shapes stimulus.kind = "drawing", or, which helps less, unit_mm = 0.1' in said
    caplog.clear()
    judge_surface(surface(plus, low_pass_mm=0.7), finger)
    assert not caplog.messages


def test_a_negative_unit_stays_one_and_rough_maps_are_no_drawing(tmp_path):
    file = tmp_path / "rough.npy"
    np.save(file, np.random.default_rng(0).normal(size=(200, 200)))
    said = Surface(file=file, spacing_mm=0.02, unit_mm=-0.1).hindrance(1.0)
    assert "unit_mm = -0.0" in said and "(now -0.1)" in said and "drawing" not in said


@needs_gmsh
def test_a_preview_warns(plus, tmp_path, capsys):
    keys = {"kind": "surface", "file": plus, "spacing_mm": STEP_MM, "unit_mm": 0.5}
    options = ["finger.kind=section", *(f"stimulus.{key}={value}" for key, value in keys.items())]
    words = [word for option in options for word in ("--set", option)]
    assert main(["preview", *words, "-o", str(tmp_path / "p.png")]) == 0
    assert "stimulus: the surface is steep at X" in capsys.readouterr().err
