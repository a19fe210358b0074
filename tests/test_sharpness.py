"""What is too steep and sharp for the skin's facets is told, whatever body it is."""

import logging
from dataclasses import dataclass

import numpy as np
import pytest
from needs import needs_gmsh

from tactile_fem.cli.app import main
from tactile_fem.simulation.checks import warn_if_sharp
from tactile_fem.stimulus.check import too_fine, too_sharp
from tactile_fem.stimulus.relief import Relief
from tactile_fem.study import (
    Braille,
    Cylinder,
    Dots,
    Drawing,
    Edge,
    Finger,
    Grating,
    Plate,
    Protocol,
    Sphere,
    Surface,
    Text,
)

STEP_MM = 0.02
AT = STEP_MM * (np.arange(300) - 149.5)
BOX = np.array([-6.0, -20.0]), np.array([6.0, 10.0])


@pytest.fixture(scope="module")
def plus(tmp_path_factory):
    """A map of a plus of 1 and a plate of 0, its middle 1 mm along X."""
    x, y = np.meshgrid(AT - 1, AT, indexing="ij")
    raised = np.minimum(abs(x), abs(y)) < 0.5
    file = tmp_path_factory.mktemp("maps") / "plus.npy"
    np.save(file, (raised & (np.maximum(abs(x), abs(y)) < 1.5)).astype(float))
    return file


def surface(file, **keys):
    return Surface(file=file, spacing_mm=STEP_MM, **{"unit_mm": 0.5, **keys})


@dataclass(frozen=True)
class Own:
    """A script's body: ripples 2 mm long and 0.4 mm high."""

    def distance(self, points):
        waves = Relief.of(0.2 * np.cos(np.pi * AT)[None, :] + 0 * AT[:, None], [STEP_MM] * 2)
        return waves.distance(points)


def radius_in(sentence):
    return float(sentence.split("radius of ")[1].split()[0])


def test_the_radius_of_curvature_is_that_of_the_surface_in_space():
    height, k, x = 0.31, 2 * np.pi / 3, STEP_MM * np.arange(301)

    def waves(height):  # of 3 mm along X
        return Relief.of(height * np.cos(k * x)[:, None] + 0 * x, [STEP_MM] * 2)

    slope = 0.5  # from which on a place is steep; the wave is more sharply curved where it is less
    bend = height * k**2 * np.sqrt(1 - (slope / (height * k)) ** 2)
    found = radius_in(too_sharp(waves(height), *BOX, facet_mm=900.0))
    assert found == pytest.approx((1 + slope**2) ** 1.5 / bend, rel=0.02)
    assert too_sharp(waves(0.2), *BOX, facet_mm=900.0) is None  # nowhere steep


@pytest.mark.parametrize(
    ("facet_mm", "sharp", "smooth"), [(0.25, 0.25, 0.4), (1.0, 0.35, 0.5), (3.0, 0.6, 0.8)]
)
def test_an_edge_needs_a_radius_by_the_size_of_the_facets(plus, facet_mm, sharp, smooth):
    assert too_sharp(surface(plus, low_pass_mm=sharp).body(), *BOX, facet_mm)
    assert too_sharp(surface(plus, low_pass_mm=smooth).body(), *BOX, facet_mm) is None


def test_low_walls_are_harmless(plus):
    for unit_mm, is_warned in ((0.5, True), (0.1, False)):
        low = surface(plus, unit_mm=unit_mm).body()
        assert bool(too_sharp(low, *BOX, 1.0)) == is_warned
    assert too_sharp(low, *BOX, 0.5)


@pytest.mark.parametrize(
    ("smooth", "sharp"),
    [
        (Text(), Text(fillet_radius_mm=0.02)),
        (Grating(), Grating(fillet_radius_mm=0.01, along="y")),
        (Dots(), Edge()),
        (Braille(), Edge(along="y")),
        (Sphere(), Text(text="E", fillet_radius_mm=0.02)),
    ],
)
@pytest.mark.parametrize("across", [1.0, 0.0])  # of a section: along a line
def test_every_body_is_judged(smooth, sharp, across):
    low, high = BOX[0] * [across, 1], BOX[1] * [across, 1]
    assert too_sharp(smooth.body(), low, high, facet_mm=1.0) is None
    if across or getattr(sharp, "along", "x") == "x":
        assert radius_in(too_sharp(sharp.body(), low, high, facet_mm=1.0)) < 0.03


@pytest.mark.parametrize(
    ("body", "share"),
    [
        (Braille().body(), 87),
        (Dots().body(), 92),
        (Grating().body(), 85),
        (Text(text="FGH").body(), 81),
        (Sphere(radius_mm=1.0).body(), 77),
        (Drawing(polygons=[[(-1, -1), (1, -1), (1, 1), (-1, 1)]], relief_mm=0.5).body(), 73),
        (Own(), 99),
    ],
)
def test_what_is_shorter_than_two_facets_is_said_of_every_body(body, share):
    assert too_fine(body, *BOX, 1.0) is None
    said = too_fine(body, *BOX, 3.0)
    assert f"shorter than 6 mm make up {share} %" in said
    finer = float(said.split("at most ")[1].split()[0])
    assert 1 <= finer < 3 and too_fine(body, *BOX, 0.9 * finer) is None


@pytest.mark.parametrize(
    "body", [Plate(), Sphere(), Cylinder(), Edge(), Grating(ridge_mm=6.0, groove_mm=6.0)]
)
def test_wide_bodies_suit_any_facets(body):
    for across in (1.0, 0.0):
        assert too_fine(body.body(), BOX[0] * [across, 1], BOX[1] * [across, 1], 3.0) is None


def test_one_warning_is_logged(caplog):
    finger, path = Finger(pad_size_mm=3.0, far_size_mm=6.0).mesh(), Protocol().route(2.0)
    with caplog.at_level(logging.WARNING):
        warn_if_sharp(Braille().body(), path, finger)
        warn_if_sharp(Text(text="E", fillet_radius_mm=0.02).body(), path, finger)
    fine, sharp = caplog.messages
    assert "facets of 3 mm cannot follow it" in fine and "choose a finer mesh" in fine
    assert "is steep at" in sharp


def test_the_warning_says_where_and_what_helps(plus, caplog):
    finger, path = Finger().mesh(), Protocol().route(2.0)

    def judged(**keys):
        body = surface(plus, turn_deg=90.0, repeat="periodic", **keys).body()
        warn_if_sharp(body, path, finger)

    with caplog.at_level(logging.WARNING):
        judged(shift_mm=(0.0, 3.0))
    (said,) = caplog.messages
    x, y = (float(said.split(f"{axis} ")[1].split()[0].rstrip(",")) for axis in "XY")
    # The middle of the plus, at X 1, is turned to Y 1 and shifted to Y 4; it repeats every 6 mm.
    aside = np.abs([(x + 3) % 6 - 3, (y - 1) % 6 - 3])
    assert aside.max() < 1.6 and np.abs(aside[:, None] - [0.5, 1.5]).min() < 0.06
    assert "facets of 0.97 mm need 0.098 mm" in said
    assert "choose a finer mesh or a smoother surface" in said
    caplog.clear()
    judged(low_pass_mm=0.7)
    assert not caplog.messages


@needs_gmsh
def test_a_preview_warns(plus, tmp_path, capsys):
    keys = {"kind": "surface", "file": plus, "spacing_mm": STEP_MM, "unit_mm": 0.5}
    options = ["finger.kind=section", *(f"stimulus.{key}={value}" for key, value in keys.items())]
    words = [word for option in options for word in ("--set", option)]
    assert main(["preview", *words, "-o", str(tmp_path / "p.png")]) == 0
    assert "stimulus: the surface is steep at X" in capsys.readouterr().err
