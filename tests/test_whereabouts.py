"""Bodies that the finger misses are told before anything is computed or drawn."""

import logging
import re

import numpy as np
import pytest
from blocks import LAYERS, block_mesh
from needs import needs_gmsh, needs_graphics
from PIL import Image
from synthetic import make_fields, make_results

from tactile_fem.cli import app as cli
from tactile_fem.finger import read_mesh
from tactile_fem.output import pictures
from tactile_fem.output.film import Film
from tactile_fem.output.preview import preview_figure
from tactile_fem.simulation.checks import warn_if_missed
from tactile_fem.stimulus.check import miss
from tactile_fem.study import (
    Cylinder,
    Edge,
    Finger,
    Plate,
    Protocol,
    Sphere,
    Study,
    Text,
)

LINE = np.linspace(-3.0, 3.0, 4)
BLOCK = block_mesh(LINE, LINE, np.array([0.0, 0.17, 0.82, 1.62, 3.0]), list(LAYERS))
SKIN = BLOCK.corners_of("skin")
PRESS = Protocol(depth_mm=0.3, distance_mm=0.0)


def missed(stimulus, protocol=PRESS):
    return miss(stimulus.body(), protocol.route(0.0).places_mm(), SKIN)


@pytest.mark.parametrize(
    ("stimulus", "words"),
    [
        (
            Sphere(shift_mm=(60, 0)),
            r"lies 57 mm from the contact point, \+57 mm across and \+0 mm",
        ),
        (Sphere(shift_mm=(0, -40)), r"lies 37 mm from the contact point, \+0 mm across and -37 mm"),
        (Sphere(shift_mm=(0, 500)), r"lies 500 mm .* \+500 mm along"),
        (Sphere(shift_mm=(0, 2000)), "it is more than 1000 mm away, or deeper than 3 mm"),
        (Sphere(radius_mm=0.3, shift_mm=(9, 0)), "lies 9 mm"),
        (Cylinder(shift_mm=(0, 30)), r"\+0 mm across and \+28.5 mm along"),
        (Edge(along="y", shift_mm=(-30, 0)), "-28.5 mm across"),
        (Text(relief_mm=3.5, shift_mm=(60, 0)), r"lies 5\d(.\d)? mm from the contact point"),
    ],
)
def test_where_a_body_lies_that_the_finger_misses(stimulus, words):
    found = missed(stimulus)
    assert found.startswith("the stimulator does not touch the finger on its way: it")
    assert re.search(words, found), found


def test_a_path_that_ends_below_the_skin_is_told():
    assert missed(Plate()) is None
    path = PRESS.route(0.0).places_mm() - [0, 0, 2.0]
    found = miss(Plate().body(), path, SKIN)
    assert found.endswith("whose deepest place is -1.7 mm, 1.7 mm below the skin")


def test_a_body_that_passes_between_the_ends_of_its_way_is_not_missed():
    ends = np.array([[0.0, -20.0, 0.2], [0.0, 20.0, 0.2]])
    assert miss(Sphere(radius_mm=1.0).body(), ends, SKIN) is None
    assert miss(Sphere(radius_mm=1.0, shift_mm=(9, 0)).body(), ends, SKIN) is not None


def test_a_body_may_touch_only_because_it_turns():
    """A ball 9 mm beside the contact point comes to it by half a twist, and a plate by a roll."""
    ball = Sphere(radius_mm=1.0, shift_mm=(9.0, 0.0)).body()
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]])  # rad
    places = np.array([[9.0, 0.0, 0.2]] * 2)
    assert miss(ball, places, SKIN, np.zeros((2, 3))) is not None
    assert miss(ball, places, SKIN, ends) is None
    below = np.array([[0.0, 0.0, -0.5]])
    assert miss(Plate().body(), below, SKIN) is not None
    assert miss(Plate().body(), below, SKIN, np.radians([[20.0, 0.0, 0.0]])) is None


def test_a_stimulator_beside_the_finger_is_warned_of(small_finger, caplog):
    finger, path = read_mesh(small_finger), PRESS.route(0.0)
    with caplog.at_level(logging.WARNING):
        warn_if_missed(Sphere().body(), path, finger)
        assert not caplog.records
        warn_if_missed(Sphere(shift_mm=(60, 0)).body(), path, finger)
    assert caplog.messages[0].endswith("finger: correct stimulus.shift_mm or the protocol.")


@needs_gmsh
@pytest.mark.filterwarnings("error")
def test_a_section_is_drawn_without_a_body_far_away(tmp_path):
    mesh = Finger(kind="section", pad_size_mm=3.0, far_size_mm=6.0).mesh()
    figures = [
        preview_figure(mesh, Sphere(shift_mm=shift).body(), PRESS.route(0.0))
        for shift in ((0.0, 0.0), (60.0, 0.0))
    ]
    near, far = (len(figure.axes[0].collections) for figure in figures)
    assert far < near


@needs_graphics
def test_a_preview_shows_the_finger_alone(tmp_path, capsys):
    far = ["--set", "stimulus.kind=sphere", "--set", "stimulus.shift_mm=[60, 0]"]
    small = ["--set", "finger.pad_size_mm=3", "--set", "finger.far_size_mm=6"]
    file = tmp_path / "preview.png"
    assert cli.main(["preview", *small, *far, "-o", str(file)]) == 0
    told = capsys.readouterr()
    assert told.out == f"Written to {file}\n"
    assert told.err.count("WARNING") == 1 and "lies 57 mm from the contact point" in told.err
    with Image.open(file) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    assert np.sum(np.all(pixels == (242, 223, 167), axis=1)) > 10_000  # the fat


@pytest.mark.slow
@needs_graphics
def test_pictures_and_films_of_a_scan_show_the_finger_alone(tmp_path):
    results = make_results(tmp_path / "r", Study(stimulus=Sphere(shift_mm=(60, 0))))
    make_fields(results)
    assert len(pictures.draw_pictures(results)) == 3
    scene = pictures.frames_of(results, Film.of_scan(results), "receptors")
    assert "stimulator" not in scene.plotter.actors and "epidermis shell" in scene.plotter.actors
