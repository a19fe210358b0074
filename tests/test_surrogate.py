"""The finger in milliseconds: each part against exact answers, and the shipped one."""

import logging
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scripts import DEMOS, beside

from tactile_fem import Study, StudyError
from tactile_fem.errors import ConvergenceError
from tactile_fem.path import Path as Route
from tactile_fem.stimulus import Sphere, Text
from tactile_fem.study import Hold, Plate, Press, Protocol, Slide, Twist
from tactile_fem.surrogate import FastFinger, HeightMap
from tactile_fem.surrogate.contact import (
    WHOLE,
    ContactPatch,
    NormalResponse,
    Pad,
    TangentialResponse,
)
from tactile_fem.surrogate.heights import Grid, disc
from tactile_fem.surrogate.networks import Network, Overview, View, mirror_of_view
from tactile_fem.surrogate.random_scans import DEEPEST_MM, TEST_KINDS, _drawn, random_scan
from tactile_fem.surrogate.reduce import check_reducible

SHIPPED = Path(__file__).parents[1] / "meshes" / "fast_finger.npz"


def toy_pad() -> Pad:
    """A paraboloid of radius 8 mm on springs that share a little of their load."""
    grid = Grid.over((-4.0, -4.0), (4.0, 4.0), 0.25)
    skin = (grid.points_mm**2).sum(axis=1) / 16
    cells = Grid.over((-3.0, -3.0), (3.0, 3.0), 0.5)
    apart = np.linalg.norm(cells.points_mm[:, None] - cells.points_mm[None], axis=2)
    compliance = (20 * np.exp(-apart) + 2 * np.eye(len(apart))).astype(np.float32)
    response = NormalResponse(cells, np.arange(len(apart)), compliance)
    return Pad(grid, skin, response, TangentialResponse(60.0, 1.0, 1.5))


def network(inputs: int, outputs: int) -> Network:
    random = np.random.default_rng(outputs)
    sizes = (inputs, 8, outputs)
    weights = [random.normal(0, 0.1, pair).astype(np.float32) for pair in pairwise(sizes)]
    return Network(tuple(weights), tuple(np.full(n, 0.2, np.float32) for n in sizes[1:]))


@pytest.fixture(scope="module")
def toy() -> FastFinger:
    pad = toy_pad()
    places = np.array([[0.0, 0.0, 0.8], [1.0, 0.5, 0.9]])
    patch = ContactPatch(pad, [flat()], np.zeros(1), np.zeros((1, 3)))
    seen = View.of(pad, places[:, :2])(patch).shape[-1]
    return FastFinger(
        pad,
        network(seen, 11),
        network(Overview(pad)(patch).shape[-1], 4),
        places,
        np.array([[-10.0], [10.0]]) * np.ones(len(WHOLE) + 1),
        {"study": Study().model_dump(mode="json"), "scans": []},
    )


def flat() -> HeightMap:
    return HeightMap.of_array(np.zeros((41, 41)), 0.5)


def bumps() -> HeightMap:
    return HeightMap.of_array(np.random.default_rng(2).normal(0, 0.1, (41, 61)), 0.5)


# --- bodies ---------------------------------------------------------------------------------------


def test_heights_of_a_ball_are_its_surface():
    found = HeightMap.of(Sphere(radius_mm=3.0).body(), (-2, -2), (2, 2))
    r2 = (found.grid.points_mm**2).sum(axis=1).reshape(found.grid.shape)
    assert np.abs(found.heights_mm - (np.sqrt(9 - r2) - 3)).max() < 5e-3


def test_heights_of_letters_are_those_of_their_tops_and_of_the_plate():
    found = HeightMap.of(Text(text="G").body(), (-5, -5), (5, 5))
    assert found.heights_mm.max() == 0
    assert found.heights_mm.min() == pytest.approx(-0.6, abs=2e-3)


def test_heights_move_with_the_body():
    grid, slope = Grid.over((-1, -2), (1, 2), 0.25), np.array([0.3, -0.2])
    body = HeightMap.of_array(
        Grid.over((-5, -5), (5, 5), 0.5).points_mm.reshape(21, 21, 2) @ slope, 0.5
    )
    place = np.array([0.13, 1.71])
    expected = (grid.points_mm - place) @ slope - 2.5
    assert body.over(grid, place).ravel() == pytest.approx(expected)


@pytest.mark.parametrize(
    ("heights", "spacing", "problem"),
    [
        (np.zeros(4), 0.1, r"shape \(4,\)"),
        (np.full((3, 3), np.nan), 0.1, "finite"),
        (np.zeros((3, 3)), 0.0, "spacing_mm is 0.0"),
    ],
)
def test_bad_heights_are_refused(heights, spacing, problem):
    with pytest.raises(StudyError, match=problem):
        HeightMap.of_array(heights, spacing)


def test_heights_above_the_highest_plane_are_refused():
    with pytest.raises(StudyError, match="heights_mm reach 2; the highest plane of a body is 0"):
        HeightMap(Grid.over((0, 0), (1, 1), 1.0), np.full((2, 2), 2.0))


# --- contact --------------------------------------------------------------------------------------


def test_means_interpolate_and_keep_slopes():
    grid = Grid.over((-3, -3), (3, 3), 0.5)
    places, slope = np.array([[0.2, -1.1], [1.37, 0.61]]), np.array([2.0, -1.0])
    for half in (0.5, 1.0):
        assert grid.means(places, half) @ (grid.points_mm @ slope) == pytest.approx(
            places @ slope, abs=0.15 if half > 0.5 else 1e-5
        )


def test_pressed_skin_lies_on_the_body_and_other_skin_is_clear_of_it():
    response = toy_pad().normal
    overlap = np.random.default_rng(1).normal(0.0, 0.5, (len(response.cells), 3)).astype(np.float32)
    p = response.press(overlap, np.zeros_like(overlap))
    gap = response.compliance_mm_per_MPa @ p - overlap
    assert p.min() == 0 and 0.1 < (p > 0).mean() < 0.9
    assert np.abs(gap[p > 0]).max() < 3e-3
    assert gap[p == 0].min() > -3e-3


def test_pressures_that_are_not_found_are_an_error(monkeypatch):
    response = toy_pad().normal
    overlap = np.full((len(response.cells), 2), [-0.5, 0.3], np.float32)
    monkeypatch.setattr("tactile_fem.surrogate.contact._ITERATIONS", 2)
    with pytest.raises(ConvergenceError, match=r"skin at X .* mm off the body.*less depth"):
        response.press(overlap, np.zeros_like(overlap))


def test_a_body_off_the_cells_is_outside():
    pad = toy_pad()
    body = HeightMap.of(Sphere(radius_mm=1.0).body(), (-5, -5), (5, 5))
    patch = ContactPatch(pad, [body] * 2, np.zeros(2), np.zeros((2, 3)))
    patch.move(np.array([[0.0, 2.0, 1.2], [0.0, 4.0, 1.2]]), 0.1)
    assert patch.is_off.tolist() == [False, True]


def test_sticking_skin_follows_and_sliding_skin_is_dragged_to_its_limit():
    drag = TangentialResponse(2.0, 1.0, 1.5)
    limit = drag.limit_mm(np.array(0.3), np.array(0.5))
    assert limit == pytest.approx(0.3)
    step = np.array([0.0, -1e-4])
    assert drag.of(drag.slid(np.zeros(2), step, limit), limit) == pytest.approx(step, rel=1e-3)
    far = drag.slid(np.zeros(2), np.array([9.0, 0.0]), limit)
    assert drag.of(far, limit) == pytest.approx([0.45, 0.0])
    halves = drag.slid(drag.slid(np.zeros(2), step / 2, limit), step / 2, limit)
    assert halves == pytest.approx(drag.slid(np.zeros(2), step, limit))


def test_skin_dragged_by_friction_meets_what_lies_behind():
    """All sliding, the pad feels the body from where the body is less the drag."""
    pad = toy_pad()
    rough = ContactPatch(pad, [bumps()], np.array([0.5]), np.zeros((1, 3)))
    for y in (0.0, *np.linspace(-1, -4, 31)):
        rough.move(np.array([[0.0, y, 0.5]]), 0.01)
    drag = rough.whole()[0, WHOLE.index("drag_y_mm")]
    smooth = ContactPatch(pad, [bumps()], np.zeros(1), np.zeros((1, 3)))
    smooth.move(np.array([[0.0, -4.0 - drag, 0.5]]), 0.01)
    assert drag < -0.05
    assert smooth.overlap_mm == pytest.approx(rough.overlap_mm, abs=1e-5)


def test_a_mirrored_body_is_seen_mirrored():
    pad, body = toy_pad(), bumps()
    other = HeightMap(body.grid, body.heights_mm[::-1])
    patches = []
    for each, sign in ((body, 1.0), (other, -1.0)):
        patch = ContactPatch(pad, [each], np.array([0.4]), np.zeros((1, 3)))
        for x in (0.0, 0.3, 0.5):
            patch.move(np.array([[sign * x, -2 * x, 0.8]]), 0.01)
        patches.append(patch)
    places = np.array([[0.7, 0.4], [-0.7, 0.4]])
    one, two = (View.of(pad, places)(patch)[0] for patch in patches)
    order, signs = mirror_of_view()
    assert two[1] == pytest.approx(one[0][order] * signs, abs=2e-2)
    one, two = (Overview(pad)(patch)[0] for patch in patches)
    order, signs = Overview(pad).mirror()
    assert two == pytest.approx(one[order] * signs, abs=2e-2)


def test_scales_are_folded_into_a_network():
    random = np.random.default_rng(0)
    w, b = [random.normal(size=(3, 5)), random.normal(size=(5, 2))], [np.ones(5), np.zeros(2)]
    middle, scale, mean, spread = (
        random.normal(size=3),
        np.array([1.0, 2, 3]),
        np.ones(2),
        np.array([4.0, 5]),
    )
    x = random.normal(size=(6, 3))
    expected = mean + spread * (np.maximum((x - middle) / scale @ w[0] + 1, 0) @ w[1])
    network = Network.scaled(w, b, (middle, scale), (mean, spread))
    assert network(x.astype(np.float32)) == pytest.approx(expected, rel=1e-4, abs=1e-4)


# --- a finger -------------------------------------------------------------------------------------


def route(*pieces) -> Route:
    return Protocol(path=pieces).route(2.0)


PRESS_AND_SLIDE = (Press(depth_mm=0.5), Slide(by_mm=(0.0, -1.0)))


def test_a_trace_has_the_names_of_a_scan(toy, finished):
    trace = toy.scan(flat(), route(*PRESS_AND_SLIDE))
    own, full = trace.arrays(), finished.trace.arrays()
    assert set(own) - set(full) == {"is_outside"}
    assert {name for name in full if name not in own} <= {"wall_s"}
    for name in set(own) & set(full):
        assert own[name].shape[2:] == full[name].shape[2:], name
    assert own["phase"][0] == "rest" and own["phase"][-1] == "slide"
    assert own["displacement_mm"][-1] == pytest.approx(1.0)
    assert own["time_s"][own["phase"] == "press"][-1] == pytest.approx(0.0)
    assert np.isnan(own["stored_mJ"][1:]).all()
    assert own["force_N"][0] == pytest.approx(np.zeros(3)) and own["force_N"][-1, 2] > 0
    assert len(toy.respond(trace).spikes) == 2


def test_bodies_side_by_side_are_felt_as_each_alone(toy):
    together = toy.scan_all([flat(), bumps()], route(*PRESS_AND_SLIDE), friction=[0.1, 0.5])
    for body, friction, trace in zip((flat(), bumps()), (0.1, 0.5), together, strict=True):
        alone = toy.scan(body, route(*PRESS_AND_SLIDE), friction=friction)
        assert trace.sed_kPa == pytest.approx(alone.sed_kPa, rel=1e-3, abs=1e-6)


def test_a_finger_is_what_its_file_says(toy, tmp_path):
    toy.write(tmp_path / "finger.npz")
    again = FastFinger.read(tmp_path / "finger.npz")
    path = route(*PRESS_AND_SLIDE)
    assert np.array_equal(again.scan(bumps(), path).sed_kPa, toy.scan(bumps(), path).sed_kPa)
    assert again.study == Study()


def test_nothing_is_felt_without_contact(toy):
    loop = toy.loop(flat())
    state = loop.step((0.0, 0.0, -0.5), 0.001)
    assert not state.force_N.any() and not state.felt["sed_kPa"].any()
    assert np.array_equal(state.felt["stretches"], np.ones((1, 2, 3)))
    assert loop.step((0.0, 0.0, 0.5), 0.001).force_N[0, 2] > 0
    assert not loop.step((0.0, 0.0, -0.5), 0.001).force_N.any()


def test_it_says_when_it_answers_beyond_what_it_was_made_from(toy):
    ranges = toy.ranges.copy()
    ranges[:, WHOLE.index("depth_mm")] = 0.0, 0.4
    trace = replace(toy, ranges=ranges).scan(flat(), route(Press(depth_mm=0.6)))
    assert trace.is_outside[-1] == 1
    assert not trace.is_outside[trace.depth_mm < 0.4].any()


def test_a_press_to_a_force_ends_there(toy):
    deep = toy.scan(flat(), route(Press(depth_mm=1.0)))
    wanted = float(deep.force_N[-1, 2]) / 2
    trace = toy.scan(flat(), route(Press(force_N=wanted), Hold(time_s=0.1)))
    reached = trace.force_N[trace.phase == "press", 2]
    assert reached[-1] >= wanted > reached[-2]
    assert trace.depth_mm[-1] == trace.depth_mm[trace.phase == "press"][-1] < 1.0


def test_each_of_many_bodies_meets_its_force(toy):
    bodies, wanted = [flat(), bumps()], 0.006
    path = route(Press(force_N=wanted), Slide(by_mm=(0.0, -0.2)))
    traces = toy.scan_all(bodies, path, friction=[0.1, 0.5])
    for body, friction, trace in zip(bodies, (0.1, 0.5), traces, strict=True):
        assert trace.force_N[trace.phase == "press", 2][-1] == pytest.approx(wanted, rel=1e-3)
        assert np.array_equal(trace.force_N, toy.scan(body, path, friction=friction).force_N)
    assert traces[0].depth_mm[-1] != traces[1].depth_mm[-1]


@pytest.mark.parametrize("after", [(), (Slide(by_mm=(0.0, -0.2)),)])
def test_a_force_that_is_not_reached_is_an_error(toy, after):
    path = Protocol(path=(Press(force_N=5.0), *after)).route(0.4)
    reason = r"press stopped at a depth of 0.4000 mm .*force is not reached: .* of 5 N at the deep"
    for bodies in ([flat()], [flat(), bumps()]):
        with pytest.raises(ConvergenceError, match=reason) as failure:
            toy.scan_all(bodies, path)
        assert failure.value.stimulator_mm == (0.0, 0.0, 0.4)


def test_a_force_that_is_already_exceeded_ends_a_press_at_once(toy):
    trace = toy.scan(flat(), route(Press(depth_mm=0.8), Press(force_N=1e-4), Hold(time_s=0.1)))
    assert trace.depth_mm[-1] == pytest.approx(0.8)


def test_a_path_that_is_not_one_is_refused(toy):
    path = route(*PRESS_AND_SLIDE)
    with pytest.raises(StudyError, match=r"piece 2 of its path \(slide\) begins"):
        toy.scan(flat(), Route((path.pieces[0], lambda _: path.pieces[1](np.full(3, 3.5)))))


def test_what_would_be_felt_changes_nothing(toy):
    loop, other = toy.loop(bumps()), toy.loop(bumps())
    for place in ((0.0, 0.0, 0.4), (0.0, -0.3, 0.5)):
        ahead = loop.ahead((0.0, 0.1, 0.9), 0.01)
        one, two = loop.step(place, 0.01), other.step(place, 0.01)
        assert np.array_equal(one.felt["sed_kPa"], two.felt["sed_kPa"])
        assert ahead.force_N[0, 2] > one.force_N[0, 2]


def mirrored(trace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces, SED and motion of a trace of receptors +X, -X, mirrored in X."""
    return (
        trace.force_N * [-1, 1, 1],
        trace.sed_kPa[:, ::-1],
        trace.arrays()["moved_mm"][:, ::-1] * [-1, 1, 1],
    )


def both_ways(finger: FastFinger) -> tuple:
    """Scans of a body, and of its mirror image the other way."""
    body, places = bumps(), [(1.5, 0.4), (-1.5, 0.4)]
    other = HeightMap(body.grid, body.heights_mm[::-1])
    return tuple(
        finger.scan(
            each,
            route(Press(depth_mm=0.6), Slide(by_mm=(x, -0.3))),
            receptors_mm=places,
        )
        for each, x in ((body, 0.4), (other, -0.4))
    )


def test_a_symmetric_finger_feels_mirror_images_alike(toy):
    one, two = both_ways(toy)
    for expected, name in zip(mirrored(one), ("force_N", "sed_kPa", "moved_mm"), strict=True):
        assert two.arrays()[name] == pytest.approx(expected, rel=1e-3, abs=1e-6), name
    assert np.array_equal(one.is_outside, two.is_outside)


@pytest.mark.parametrize("name", ["mesh_file", "skin_file", "bone_file"])
def test_a_finger_from_a_file_is_no_mirror_image_of_itself(toy, name):
    tables = Study().model_dump(mode="json")
    tables["finger"][name] = "finger.msh"
    own = replace(toy, made_from={"study": tables, "scans": []})
    assert not own.is_symmetric
    assert np.array_equal(own.pad.skin_mm, toy.pad.skin_mm)
    one, two = both_ways(own)
    assert two.force_N[-1] != pytest.approx(mirrored(one)[0][-1], rel=0.01)


@pytest.mark.parametrize("symmetric", [True, False])
def test_only_a_symmetric_finger_is_taught_mirror_images(toy, monkeypatch, symmetric):
    from tactile_fem.surrogate import reduce as learning

    seen, overview = toy.felt.weights[0].shape[0], toy.whole.weights[0].shape[0]
    shapes = (2, 3, seen), (2, 3, 11), (2, overview), (2, 4), (2, len(WHOLE) + 1)
    scanned = learning.TrainingScan(*map(np.ones, shapes))
    monkeypatch.setattr(learning, "_learnt", lambda name, x, y, scale: (x, y))
    x, y = learning.learn_felt([scanned], is_symmetric=symmetric)
    assert (len(x), y[:, 8].min()) == ((12, -1.0) if symmetric else (6, 1.0))
    x, y = learning.learn_whole(toy.pad, [scanned], is_symmetric=symmetric)
    assert (len(x), y[:, 0].min()) == ((4, -1.0) if symmetric else (2, 1.0))


@pytest.mark.parametrize(
    ("by_mm", "outside"), [((0.5, 0.0), 1), ((-0.5, 0.3), 1), ((0.3, -0.5), 0), ((0.0, 0.5), 0)]
)
def test_slides_across_are_outside(toy, by_mm, outside):
    trace = toy.scan(flat(), route(Press(depth_mm=0.5), Slide(by_mm=by_mm)))
    assert not trace.is_outside[trace.phase == "press"].any()
    assert (trace.is_outside[trace.phase == "slide"] == outside).all()


@pytest.mark.parametrize(
    ("piece", "name"), [(Twist(angle_deg=5.0), "twist"), (Hold(time_s=1.0, force_N=0.1), "hold")]
)
def test_turns_and_held_forces_are_refused(toy, piece, name):
    with pytest.raises(StudyError, match=name):
        toy.scan(flat(), route(Press(depth_mm=0.5), piece))


def test_a_path_that_begins_turned_is_refused(toy):
    path = route(*PRESS_AND_SLIDE)
    with pytest.raises(StudyError, match="begins turned"):
        toy.scan(flat(), Route(path.pieces, path.start_mm, np.array([0.0, 0.0, 0.1])))


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ({"friction": -0.1}, "friction is -0.1"),
        ({"friction": [0.1, 0.2, 0.3]}, "all 1 bodies"),
        ({"friction": "rough"}, "friction and start_mm must be"),
        ({"start_mm": (0.0, np.nan, 0.0)}, "finite start_mm"),
        ({"receptors_mm": [1.0, 2.0]}, "receptors_mm has the shape"),
        ({"receptors_mm": [[0.0, np.inf]]}, "all finite"),
        ({"receptors_mm": [[1.0, 2.0], [3.0]]}, "receptors_mm must be numbers"),
        ({"receptors_mm": [[0, 0], [7.5, 0]]}, "receptor 1 is at X 7.5, Y 0 mm;.* X -5.5 to 5.5"),
        ({"receptors_mm": [[0, -50, 1.0]]}, "receptor 0 is at X 0, Y -50 mm;.* Y -6 to 6 mm"),
    ],
)
def test_a_bad_loop_is_refused(toy, keys, problem):
    with pytest.raises(StudyError, match=problem):
        toy.loop(flat(), **keys)


@pytest.mark.parametrize(
    ("place", "dt_s", "problem"),
    [((0, 0, 0), 0.0, "dt_s is 0.0"), ((0, np.nan, 0), 0.1, "finite"), ((0, 0), 0.1, "place_mm")],
)
def test_a_bad_step_is_refused(toy, place, dt_s, problem):
    with pytest.raises(StudyError, match=problem):
        toy.loop(flat()).step(place, dt_s)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(StudyError, match="cannot be read"):
        FastFinger.read(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", x=1)
    with pytest.raises(StudyError, match="no reduced finger"):
        FastFinger.read(tmp_path / "other.npz")
    (tmp_path / "text.npz").write_text("text")
    with pytest.raises(StudyError, match="no reduced finger"):
        FastFinger.read(tmp_path / "text.npz")


def _without(arrays, *names):
    return {name: array for name, array in arrays.items() if name not in names}


@pytest.mark.parametrize(
    "change",
    [
        *(lambda data, n=n: data[:n] for n in (0, 1, 1000, -1)),
        lambda data: data[: len(data) // 2],
        lambda data: data[:2000] + bytes([data[2000] ^ 1]) + data[2001:],
        lambda data: bytes(len(data)),
    ],
)
def test_damaged_files_are_refused(toy, tmp_path, change):
    toy.write(tmp_path / "finger.npz")
    (tmp_path / "cut.npz").write_bytes(change((tmp_path / "finger.npz").read_bytes()))
    with pytest.raises(StudyError, match=r"cut\.npz holds no reduced finger"):
        FastFinger.read(tmp_path / "cut.npz")


@pytest.mark.parametrize("name", ["about", "cells", "ranges", "skin_mm", "felt_w1", "whole_b0"])
def test_files_of_other_arrays_are_refused(toy, tmp_path, name):
    toy.write(tmp_path / "finger.npz")
    with np.load(tmp_path / "finger.npz") as saved:
        arrays = dict(saved)
    own = arrays.pop(name)
    others = [{}] if name == "about" else [{}, {name: own[:-1]}, {name: own * np.nan}]
    for other in others:
        np.savez(tmp_path / "other.npz", **arrays, **other)
        with pytest.raises(StudyError, match="holds no reduced finger"):
            FastFinger.read(tmp_path / "other.npz")


# --- its errors -----------------------------------------------------------------------------------

ERRORS = {
    "normal_force": 0.05,
    "sed_rms": 0.03,
    "rate_letters": 0.1,
    "mean_rate_letters": 0.02,
    "rate_dots": 0.2,
    "mean_rate_dots": 0.01,
}


@pytest.fixture(scope="module")
def firing(toy, study) -> FastFinger:
    """The toy with afferents that a toy makes fire, and known errors."""
    return replace(toy, made_from={"study": study.model_dump(mode="json")}, errors=ERRORS)


def test_a_trace_states_the_errors_of_its_finger(firing):
    trace = firing.scan(bumps(), route(*PRESS_AND_SLIDE)).arrays()
    assert trace["force_error_N"] == pytest.approx(0.05 * trace["force_N"][:, 2])
    assert trace["sed_error_kPa"][1:] == pytest.approx(0.03 * trace["sed_kPa"].max())
    assert trace["rate_error"][1:] == pytest.approx(0.2)  # that of the worst kind
    assert trace["mean_rate_error"][1:] == pytest.approx(0.02)


def test_no_error_is_known_beyond_what_a_finger_was_made_from(firing):
    trace = firing.scan(flat(), route(Press(depth_mm=0.5), Slide(by_mm=(0.5, 0.0)))).arrays()
    for name in ("force_error_N", "sed_error_kPa", "rate_error", "mean_rate_error"):
        assert np.array_equal(np.isnan(trace[name]), trace["is_outside"] == 1), name


def stroked(finger: FastFinger, **frictions: float) -> dict:
    """Traces of a bumpy surface, by name."""
    path = route(*PRESS_AND_SLIDE)
    return {name: finger.scan(bumps(), path, friction=mu) for name, mu in frictions.items()}


def test_rates_that_differ_by_less_than_their_error_are_named(firing, caplog):
    traces = stroked(firing, one=0.3, same=0.3)
    corner = np.full((41, 41), -2.0)
    corner[0, 0] = 0.0  # 14 mm off
    silent = firing.scan(HeightMap.of_array(corner, 0.5), route(*PRESS_AND_SLIDE))
    with caplog.at_level(logging.WARNING):
        rates = firing.rates({**traces, "silent": silent})
    (said,) = caplog.messages
    mean = rates.rate_Hz.mean(axis=1)
    assert mean[0] == mean[1] > mean[2] == 0
    assert rates.error_Hz() == pytest.approx(0.02 * mean)
    assert rates.error_Hz("rate_error")[0] == pytest.approx(0.2 * mean[0])
    limit = np.sqrt(2) * 0.02 * mean[0]
    assert said == (
        "means over all afferents differ by less than their error: "
        f"one and same (0.0 of {limit:.1f} spikes/s)."
    )
    caplog.clear()
    firing.rates({"one": traces["one"], "silent": silent})
    assert not caplog.messages


def test_errors_of_rates_that_are_not_known_are_said(firing, caplog):
    older = replace(firing, errors={"normal_force": 0.05})
    with caplog.at_level(logging.WARNING):
        older.rates(stroked(older, one=0.3))
    assert "must be made anew" in caplog.text


def test_a_figure_has_the_errors_as_bands(firing):
    rates = firing.rates(stroked(firing, rough=0.5, smooth=0.0))
    figure = rates.figure()
    (axes,), (legend,) = figure.axes, figure.legends
    mean, error = rates.rate_Hz.mean(axis=1), rates.error_Hz()
    assert [text.get_text() for text in legend.get_texts()] == [
        f"{name}: {mean[k]:.1f} ± {error[k]:.1f} spikes/s" for k, name in enumerate(rates.traces)
    ]
    band = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert band.max() == pytest.approx(rates.rate_Hz[0].max() + rates.error_Hz("rate_error")[0])


def test_a_scan_beside_itself_has_no_errors(firing, finished, tmp_path, monkeypatch):
    from tactile_fem import Results, Trace
    from tactile_fem.surrogate.reduce import errors_of

    (tmp_path / "dots-0001").symlink_to(finished.folder)
    scan = Results(tmp_path / "dots-0001")
    monkeypatch.setattr(FastFinger, "scan", lambda *given, **keys: Trace.read(scan.trace))
    same = {"normal_force": 0.0, "sed_rms": 0.0, "rate_dots": 0.0, "mean_rate_dots": 0.0}
    assert errors_of(firing, [scan]) == {**same, "sed_correlation": 1.0}
    stronger = {**scan.trace, "sed_kPa": 1.2 * scan.trace["sed_kPa"]}
    monkeypatch.setattr(FastFinger, "scan", lambda *given, **keys: Trace.read(stronger))
    found = errors_of(firing, [scan, scan])
    assert found["sed_rms"] > 0.02 and found["mean_rate_dots"] > 0.05
    assert found["rate_dots"] >= found["mean_rate_dots"] and found["sed_correlation"] == 1


# --- making one -----------------------------------------------------------------------------------


def test_one_scan_in_eight_tests_one_of_the_kinds(monkeypatch):
    pytest.importorskip("sklearn")
    from tactile_fem.surrogate import reduce as learning

    monkeypatch.setattr(learning, "random_scan", lambda study, *drawn: drawn)
    drawn = learning.wanted_scans(Study(), 40)
    assert drawn[::8] == [*enumerate(TEST_KINDS), (4, "letters")]
    assert [one for k, one in enumerate(drawn) if k % 8] == [(k,) for k in range(40) if k % 8]


def test_what_tests_a_finger_is_what_people_scan():
    studies = {kind: _drawn(Study(), 3, kind) for kind in TEST_KINDS}
    kinds = {name: study.stimulus.kind for name, study in studies.items()}
    assert kinds == {
        "letters": "text",
        "dots": "dots",
        "gratings": "grating",
        "textures": "drawing",
    }
    assert studies["dots"] == _drawn(Study(), 3, "dots") != _drawn(Study(), 4, "dots")
    for study in studies.values():
        assert 1 <= study.protocol.depth_mm <= 2 and study.protocol.distance_mm == 10


def test_random_scans_are_drawn_by_number():
    one, again, other = (random_scan(Study(), number) for number in (3, 3, 4))
    assert one.study == again.study and one.name == "lesson-0003"
    assert other.study.stimulus != one.study.stimulus
    for member in (one, other):
        depths = [p.depth_mm for p in member.study.protocol.pieces if hasattr(p, "depth_mm")]
        assert max(depths) <= DEEPEST_MM
        assert 0 <= member.study.stimulus.friction <= 0.7


def test_the_networks_learn_what_they_are_taught():
    pytest.importorskip("sklearn")
    from tactile_fem.surrogate.reduce import _learnt

    x = np.random.default_rng(0).normal(5.0, 2.0, (4000, 3)).astype(np.float32)
    y = np.column_stack([x[:, 0] - 2 * x[:, 1], 100 + np.abs(x[:, 2] - 5)])
    network = _learnt("whole", x, y, x.std(axis=0))
    assert np.abs(network(x) - y).max(axis=0) == pytest.approx([0, 0], abs=0.8)
    assert np.sqrt(((network(x) - y) ** 2).mean(axis=0)).max() < 0.1


@pytest.mark.parametrize(
    ("changes", "scans", "problem"),
    [
        ({}, 15, "scans is 15"),
        ({"finger": {"kind": "section"}}, 50, "section"),
        ({"joint": {}}, 50, "joint"),
    ],
)
def test_what_cannot_be_reduced_is_refused(changes, scans, problem):
    with pytest.raises(StudyError, match=problem):
        check_reducible(Study.model_validate(changes), scans)


def test_receptors_beyond_the_training_scans_are_refused_before_they_are_scanned(tmp_path):
    from tactile_fem.surrogate.reduce import reduce_finger

    study = Study.model_validate({"receptors": {"half_width_mm": 6.0}})
    with pytest.raises(StudyError, match="receptor 0 is at X -6, Y 0 mm"):
        reduce_finger(study, tmp_path / "scans", scans=16)
    assert not (tmp_path / "scans").exists()


def test_a_scan_teaches_what_its_receptors_felt(finished):
    """What a network should give for a scanned is what the scan has."""
    from tactile_fem import Results
    from tactile_fem.surrogate.fast_finger import columns_of
    from tactile_fem.surrogate.reduce import TrainingScan

    scan = Results(finished.folder)
    scanned = TrainingScan.of(toy_pad(), scan)
    rows = len(scanned.felt)
    assert 3 < rows <= len(scan.trace["time_s"]) - 1
    felt = columns_of(scanned.felt)
    assert felt["sed_kPa"] == pytest.approx(scan.trace["sed_kPa"][-rows:], rel=1e-4, abs=1e-6)
    assert felt["moved_mm"] == pytest.approx(scan.trace["moved_mm"][-rows:], rel=1e-4, abs=1e-6)
    normal = scanned.measures[:, WHOLE.index("normal_N")]
    assert scanned.whole[:, 2] * normal == pytest.approx(scan.trace["force_N"][-rows:, 2], rel=1e-4)


def test_the_drag_of_scans_is_found():
    from tactile_fem.surrogate.reduce import _missed

    random, drag = np.random.default_rng(4), TangentialResponse(5.0, 1.2, 1.7)
    places = np.cumsum(random.normal(0, 0.1, (50, 2)), axis=0)
    normal, friction = random.uniform(0.1, 0.5, 50), np.array(0.4)
    slip, moved = np.zeros(2), [np.zeros(2)]
    for k in range(1, 50):
        limit = drag.limit_mm(friction, normal[k])
        slip = drag.slid(slip, places[k] - places[k - 1], limit)
        moved.append(drag.of(slip, limit) + normal[k] * np.array([0.0, 0.2]))
    missed = _missed(np.array([5.0, 1.2, 1.7, 0.0, 0.2]), friction, normal, places, np.array(moved))
    assert np.abs(missed).max() < 1e-12


def test_a_body_that_cannot_be_rounded_is_drawn_again():
    """The tenth drawing has shapes of which one needs a radius that another does not allow."""
    with pytest.raises(StudyError, match=r"cannot be rounded by 0\.\d+ mm, which others need"):
        _drawn(Study(), 10).stimulus.body()
    assert random_scan(Study(), 10).study.receptors.seed == 1010


@pytest.mark.parametrize("there", [True, False])
def test_the_command_refuses_before_it_scans(there, tmp_path, capsys):
    from tactile_fem.cli.app import main

    file = tmp_path / "finger.npz"
    if there:
        file.touch()
    assert main(["reduce", "--scans", "15", "-o", str(file)]) == 2
    assert ("exists" if there else "scans is 15") in capsys.readouterr().err
    assert [*tmp_path.iterdir()] == ([file] if there else [])


@pytest.mark.slow
def test_the_compliance_of_a_pressed_finger_is_that_of_its_tangent(study):
    """Symmetric, positive definite, softer where skin is pressed than far from it."""
    from tactile_fem.surrogate.compliance import pad_of

    pad = pad_of(study, DEEPEST_MM)
    C = pad.normal.compliance_mm_per_MPa
    assert np.linalg.eigvalsh(C.astype(float)).min() > 0
    at = pad.normal.grid.points_mm[pad.normal.cells]
    middle = int(np.linalg.norm(at, axis=1).argmin())
    assert 3 < C[middle, middle] < 20
    assert C[middle, np.linalg.norm(at - at[middle], axis=1) > 6].max() < C[middle, middle] / 5
    # The lowest node, at 0, need not be a place of the grid; facets of 3 mm rise by 0.14 mm.
    assert -1e-6 < pad.skin_mm.min() < 0.15


# --- demos ----------------------------------------------------------------------------------------


def test_a_scan_beside_itself_has_no_error(toy, finished, monkeypatch):
    from tactile_fem import Results

    with beside(DEMOS / "validation" / "fast_finger.py"):
        import fast_finger
    scan = Results(finished.folder)
    full = {**scan.trace, "is_outside": np.zeros(len(scan.trace["time_s"]))}
    monkeypatch.setattr(fast_finger, "fast_trace", lambda *given: (full, 0.0, 0.0))
    found = fast_finger.errors(toy, scan)
    assert found["r of histories"] == pytest.approx(1) and found["r of image"] == pytest.approx(1)
    for name in ("normal force, %", "SED rms, % of largest", "maxima, mm"):
        assert found[name] == pytest.approx(0, abs=1e-9), name
    louder = {**full, "sed_kPa": 2 * full["sed_kPa"]}
    monkeypatch.setattr(fast_finger, "fast_trace", lambda *given: (louder, 0.0, 0.0))
    assert fast_finger.errors(toy, scan)["SED rms, % of largest"] > 10


def test_the_designed_cell_is_the_one_that_is_scanned():
    with beside(DEMOS / "validation" / "cell_design.py"):
        import cell_design as demo
    heights = np.linspace(0.2, 0.9, 9)
    fast = demo.cell(heights)
    full = HeightMap.of(demo.drawing(heights).body(), (-5, -5), (5, 5))
    own = fast.over(full.grid, np.zeros(2)) + demo.LARGEST_MM - heights.max()
    away = np.abs(own - full.heights_mm)
    assert np.median(away) < 2e-3 and (away > 0.05).mean() < 0.05


def test_rates_have_their_energy_density():
    from tactile_fem.neuron import respond

    with beside(DEMOS / "validation" / "cell_design.py"):
        import cell_design as demo
    sed = demo.sed_of_rates(np.array([10.0, 40.0]))
    held = respond([0.0, 0.05, 0.55], np.array([[0.0], [1.0], [1.0]]) * sed)
    assert held.mean_rate(0.05, 0.55) == pytest.approx([10, 40], abs=2.1)


# --- the shipped one ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def shipped() -> FastFinger:
    return FastFinger.read(SHIPPED)


def test_the_shipped_finger_presses_a_plate_as_the_finite_elements_do(shipped):
    """Forces of the coarse finger under a plate pressed at 20 mm/s, and how it feels."""
    plate = HeightMap.of_array(np.zeros((61, 81)), 0.5)
    trace = shipped.scan(plate, route(Press(depth_mm=1.5)))
    depths, forces = np.array([0.5, 1.0, 1.5]), np.array([0.037, 0.123, 0.319])
    found = np.interp(depths, trace.depth_mm, trace.force_N[:, 2])
    assert found == pytest.approx(forces, rel=0.2)
    assert not trace.is_outside.any()


def test_the_shipped_finger_feels_a_letter_as_a_full_scan_did(shipped):
    """Forces and SED of the scan of a G, after its first millimetre."""
    study = Study(stimulus=Text(text="G"))
    trace = shipped.scan(study.stimulus.body(), study.protocol.route(2.0), friction=0.3)
    slide = trace.displacement_mm > 1
    assert trace.force_N[slide, 2].mean() == pytest.approx(0.389, rel=0.05)
    assert -trace.force_N[slide, 1].mean() == pytest.approx(0.133, rel=0.1)
    assert trace.sed_kPa[slide].mean() == pytest.approx(0.535, rel=0.1)
    assert np.percentile(trace.sed_kPa[slide], 90) == pytest.approx(1.31, rel=0.1)
    middle = int(np.abs(trace.receptors_mm[:, 0]).argmin())
    assert trace.displacement_mm[trace.sed_kPa[:, middle].argmax()] == pytest.approx(6.5, abs=0.4)
    assert sum(map(len, shipped.respond(trace).spikes)) == pytest.approx(1372, rel=0.1)


def test_the_shipped_finger_knows_its_errors(shipped):
    """Of rates of one afferent and of the mean of all, on each kind of surface."""
    for kind in TEST_KINDS:
        assert 0.01 < shipped.errors[f"mean_rate_{kind}"] < shipped.errors[f"rate_{kind}"] < 0.3


@pytest.mark.parametrize("force_N", [0.03, 0.1, 0.5])
def test_the_shipped_finger_is_pressed_to_a_force(shipped, force_N):
    plate = HeightMap.of_array(np.zeros((61, 81)), 0.5)
    trace = shipped.scan(plate, Protocol(path=(Press(force_N=force_N),)).route(2.0))
    assert trace.force_N[-1, 2] == pytest.approx(force_N, rel=1e-3)
    with pytest.raises(ConvergenceError, match="of 2 N at the deepest position"):
        shipped.scan(plate, Protocol(path=(Press(force_N=2.0), Slide())).route(2.0))


def test_the_shipped_finger_is_its_own_mirror_image(shipped):
    """Across a plate both ways and, without friction, straight along it."""
    plate, places = Plate().body(), [(3.0, 1.0), (0.0, 1.0), (-3.0, 1.0)]

    def scan(x: float, y: float, friction: float):
        path = route(Press(depth_mm=1.5), Slide(by_mm=(x, y)))
        return shipped.scan(plate, path, friction=friction, receptors_mm=places)

    one, two, along = scan(0.6, 0.0, 0.3), scan(-0.6, 0.0, 0.3), scan(0.0, -0.6, 0.0)
    for expected, name in zip(mirrored(one), ("force_N", "sed_kPa", "moved_mm"), strict=True):
        assert two.arrays()[name] == pytest.approx(expected, rel=1e-4, abs=1e-5), name
    assert np.abs(along.force_N[:, 0]).max() < 1e-6
    assert one.is_outside[-1] == two.is_outside[-1] == 1 and not along.is_outside.any()


def test_disc_is_round():
    assert len(disc(1.0, 1.0)) == 5 and len(disc(1.0, 2.0, 1.0)) == 8
