"""A body that turns is drawn, sampled and seen from beneath where the scan has it."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from needs import needs_gmsh, needs_graphics
from synthetic import make_fields, make_results, make_trace

from tactile_fem.errors import StudyError
from tactile_fem.finger import read_mesh
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.cross_section import CrossSectionMap
from tactile_fem.output.film import Film
from tactile_fem.output.section import SectionScene, gap_of
from tactile_fem.path.rotations import angle_rad, between, matrix, swept, to_body, to_space
from tactile_fem.stimulus.sampled import DistanceGrid
from tactile_fem.study import Cylinder, Dots, Edge, Finger, Plate, Study
from tactile_fem.vibration import Modes

POINTS = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, -1.0], [0.3, -0.2, 0.5]])


def twisted(degrees: float):
    """Return a made-up trace whose body twists evenly after the press, and does not slide."""
    trace = make_trace()
    share = trace["displacement_mm"] / trace["displacement_mm"][-1]
    trace["stimulator_mm"][:, 1] = 0.0
    turns = np.radians(degrees) * share
    vectors = np.column_stack([0 * turns, 0 * turns, turns])
    trace["stimulator_rad"] = np.array([_shortest(v) for v in vectors])
    return trace


def _shortest(vector):
    """Return the vector of the same rotation whose angle is at most pi, as a scan has it."""
    angle = np.linalg.norm(vector)
    return vector * (angle - 2 * np.pi) / angle if angle > np.pi else vector


def test_to_space_and_to_body_are_inverse():
    place, turn = np.array([1.0, 2.0, 3.0]), np.array([0.3, -0.2, 2.5])
    there = to_space(POINTS, place, turn)
    assert there == pytest.approx(np.array([matrix(turn) @ p + place for p in POINTS]))
    assert to_body(there, place, turn) == pytest.approx(POINTS)
    assert to_space(POINTS, place).tolist() == (POINTS + place).tolist()
    assert to_body(POINTS, place, np.zeros(3)).tolist() == (POINTS - place).tolist()


def test_turns_between_others_go_on_through_half_a_turn():
    turns = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, -3.0]])  # 0.28 rad apart
    assert angle_rad(*turns) == pytest.approx(2 * np.pi - 6)
    found = between(turns, np.array([1.0, 2.0]), [0.0, 1.25, 1.5, 3.0])
    assert angle_rad(turns[0], found) == pytest.approx(
        np.array([0, 0.25, 0.5, 1]) * 0.28319, abs=1e-5
    )
    assert not between(np.zeros((2, 3)), np.array([1.0, 2.0]), [1.5]).any()


def test_a_box_seen_by_a_body_that_turns():
    turns = np.radians([[0.0, 0.0, 0.0], [0.0, 0.0, 90.0]])
    low, high = swept((-1.0, -2.0, 0.0), (1.0, 2.0, 0.0), np.zeros((2, 3)), turns)
    assert low == pytest.approx([-2, -2, 0]) and high == pytest.approx([2, 2, 0])
    low, high = swept((-1, -2, 0), (1, 2, 0), np.array([[0, 0, 0], [0, -3, 1.0]]))
    assert low.tolist() == [-1, -2, -1] and high.tolist() == [1, 5, 0]


def test_frames_have_the_turn_of_their_time(tmp_path):
    results = make_results(tmp_path / "r", trace=twisted(300.0))
    make_fields(results, (0.0, 2.5, 5.0))
    film = Film.of_scan(results)
    angles = 300.0 * film.slid_mm / 10.0
    for k in range(len(film)):
        R = matrix(np.radians([0.0, 0.0, angles[k]]))
        expected = POINTS @ R.T + film.stimulator_mm[k]
        assert film.in_space(POINTS, k) == pytest.approx(expected, abs=1e-6)
    assert film.titles[4].endswith("depth 1.97 mm, turned 75.0°")
    assert Film.of_scan(_with_fields(tmp_path / "still")).turn_rad(0) is None


def _with_fields(folder):
    results = make_results(folder)
    make_fields(results)
    return results


def test_shapes_of_a_vibration_kept_before_bodies_turned(tmp_path):
    arrays = {one.name: np.zeros(3) for one in fields(Modes) if one.name != "stimulator_rad"}
    np.savez(tmp_path / "modes.npz", **arrays)
    assert Modes.load(tmp_path / "modes.npz").stimulator_rad.tolist() == [0, 0, 0]
    del arrays["body"]
    np.savez(tmp_path / "modes.npz", **arrays)
    with pytest.raises(StudyError, match="cannot be read as a vibration"):
        Modes.load(tmp_path / "modes.npz")


@needs_graphics
def test_the_drawn_body_and_its_light_turn(tmp_path):
    from tactile_fem.output.scene import CLOSE, Scene, body_surface

    results = make_results(tmp_path / "r", trace=twisted(90.0))
    make_fields(results, (0.0, 2.5, 5.0))
    film, trace = Film.of_scan(results), results.trace
    surface = body_surface(Edge().body(), trace["stimulator_mm"], trace["stimulator_rad"])
    scene = Scene(film, surface, CLOSE)
    scene.show(8)
    R, drawn = matrix([0.0, 0.0, np.pi / 4]), scene.plotter.actors["stimulator"].mapper.dataset
    assert drawn.points == pytest.approx(surface.points @ R.T + film.stimulator_mm[8], abs=1e-5)
    normals = surface.point_data.active_normals @ R.T
    assert drawn.point_data.active_normals == pytest.approx(normals, abs=1e-6)


@pytest.mark.parametrize(
    ("stimulus", "turns_deg"),
    [
        (Edge(), [[0.0, 0.0, 0.0], [0.0, 0.0, 40.0]]),
        (Cylinder(radius_mm=5.0), [[0.0, 0.0, 0.0], [60.0, 0.0, 0.0]]),
        (Plate(), [[0.0, 0.0, 0.0], [0.0, -20.0, 0.0]]),
    ],
    ids=["edge twists", "cylinder rolls", "plate rolls"],
)
def test_a_sampled_copy_has_the_gap_of_a_turned_body_at_the_skin(stimulus, turns_deg, small_finger):
    skin = read_mesh(small_finger).corners_of("skin").reshape(-1, 3)
    places, turns = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 1.0]]), np.radians(turns_deg)
    body = stimulus.body()
    grid = DistanceGrid.of(body, places, turns)
    there = to_body(skin, places[1], turns[1])
    found = body.distance(there)
    surface = (there - found.gap[:, None] * found.normal)[np.abs(found.gap) < 0.5]
    assert len(surface) > 5
    assert grid.gap(surface) == pytest.approx(np.zeros(len(surface)), abs=0.02)
    if turns[1][2]:  # it reaches farther than that of a body that does not turn
        assert grid.gap_mm.size > DistanceGrid.of(body, places).gap_mm.size


def test_dots_pass_beneath_a_receptor_as_the_body_twists(tmp_path):
    trace = twisted(90.0)
    beneath = CrossSectionMap.of(make_results(tmp_path / "r", Study(stimulus=Dots()), trace=trace))
    times, points = np.array([0.0, 0.25, 0.5]), np.array([[3.0, 1.0], [-2.0, 0.5]])
    still = replace(beneath, turns_rad=None)
    turned = beneath.under(points, times)
    for k, angle in enumerate((0.0, 45.0, 90.0)):
        own = points @ matrix(np.radians([0.0, 0.0, angle]))[:2, :2]
        assert turned[:, k] == pytest.approx(still.under(own, times[:1])[:, 0], abs=1e-3)
    assert not Abscissa.of(trace).is_to_scale


@needs_gmsh
def test_a_section_cuts_the_plate_where_it_is_turned():
    mesh = Finger(kind="section", pad_size_mm=3.0, far_size_mm=6.0).mesh()
    film = Film.at_rest(mesh, (0.0, 0.5, -1.0), np.radians([20.0, 0.0, 0.0]))
    figure = SectionScene(film, gap_of(Plate().body())).figure(0)
    axes = figure.axes[0]
    (surface,) = (one for one in axes.collections if one.get_zorder() == 4)
    y, z = np.vstack([path.vertices for path in surface.get_paths()]).T
    assert z == pytest.approx(-1.0 + np.tan(np.radians(20.0)) * (y - 0.5), abs=1e-6)
    assert z.min() <= axes.get_ylim()[0] and y.max() >= axes.get_xlim()[1]
