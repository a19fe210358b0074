"""The body's path needs no finite element: where it is, when output is wanted, what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest
from pydantic import ValidationError

from tactile_fem.errors import StudyError
from tactile_fem.path import HeldLoads, Motion, Path, Vibration
from tactile_fem.simulation.checks import LARGEST_DEPTH_SHARE, check
from tactile_fem.study import Finger, Follow, Hold, Lift, Press, Protocol, Slide, Study
from tactile_fem.study.file import dump_study, load_study

REST = np.zeros(3)
STAY = Hold(time_s=1.0, output_s=1.0)
HEADING = "time_s,x_mm,y_mm,z_mm\n"


def circle(radius_mm: float, lasts_s: float) -> Motion:
    """Return a turn around a centre at X = `radius_mm`."""

    def place(t):
        angle = 2 * math.pi * t / lasts_s
        return radius_mm * np.array([1 - math.cos(angle), math.sin(angle), 0.0])

    return Motion("circle", lasts_s, place)


def follow(folder: FilePath, times_s, places_mm, output_s: float) -> Follow:
    """Return a piece that follows places."""
    rows = np.column_stack([times_s, places_mm])
    np.savetxt(folder / "follow.csv", rows, delimiter=",", header=HEADING.strip(), comments="")
    return Follow(file=folder / "follow.csv", output_s=output_s)


def refused(path: Path) -> str:
    with pytest.raises(StudyError) as caught:
        path.check()
    assert "\n" not in str(caught.value)
    return str(caught.value)


# --- pieces --------------------------------------------------------------------------------------


def test_a_press_goes_straight_in_from_where_the_body_is():
    motion = Press(depth_mm=1.5, speed_mm_s=2.0)(np.array([0.3, -0.2, 0.5]))
    assert motion.duration_s == pytest.approx(0.5)
    np.testing.assert_allclose(motion.place(0.25), [0.3, -0.2, 1.0])
    np.testing.assert_array_equal(motion.place(motion.duration_s), [0.3, -0.2, 1.5])
    assert motion.phase == "press" and motion.indents
    assert motion.fastest_mm_s == pytest.approx(2.0)
    assert (motion.slid_mm(0.5), motion.least_steps(1.0, 0.1)) == pytest.approx((0.0, 10.0))


def test_a_slide_hits_its_outputs_and_keeps_its_depth():
    motion = Slide(by_mm=(0.3, -0.4), speed_mm_s=5.0, output_mm=0.2)(np.array([0.0, 0.0, 1.0]))
    assert motion.duration_s == pytest.approx(0.1)
    assert motion.outputs_s == pytest.approx([0.04, 0.08])
    assert [motion.slid_mm(t) for t in motion.outputs_s] == pytest.approx([0.2, 0.4])
    np.testing.assert_allclose(motion.place(0.1), [0.3, -0.4, 1.0])
    assert not motion.indents


@pytest.mark.parametrize(("output_mm", "outputs"), [(0.1, 3), (0.3, 1), (0.31, 0)])
def test_rounding_loses_no_output(output_mm, outputs):
    motion = Slide(by_mm=(0.0, -0.3), output_mm=output_mm)(REST)
    assert len(motion.outputs_s) == outputs
    Path((Slide(by_mm=(0.0, -0.3), output_mm=output_mm),)).check()


def test_a_hold_stays_and_a_lift_leaves():
    at = np.array([0.0, -1.0, 0.8])
    held, lifted = Hold(time_s=2.0, output_s=0.5)(at), Lift(depth_mm=-0.2, speed_mm_s=10.0)(at)
    np.testing.assert_array_equal(held.places_mm, [at, at])
    assert held.outputs_s == pytest.approx([0.5, 1.0, 1.5, 2.0])
    assert held.fastest_mm_s == held.slid_mm(2.0) == 0
    assert lifted.duration_s == pytest.approx(0.1)
    np.testing.assert_allclose(lifted.place(0.05), [0.0, -1.0, 0.3])
    assert not held.indents and not lifted.indents


def test_following_starts_where_the_body_is(tmp_path):
    places = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.5], [1.0, 0.0, 0.5]])
    motion = follow(tmp_path, [10.0, 10.1, 10.3], places, 0.1)(np.array([0.0, 0.0, 1.0]))
    assert motion.duration_s == pytest.approx(0.3)
    np.testing.assert_allclose(motion.place(0.05), [0.0, 0.0, 1.25])
    np.testing.assert_allclose(motion.place(0.2), [0.0, -0.5, 1.5])
    assert motion.slid_mm(0.2) == pytest.approx(0.5)
    assert motion.fastest_mm_s == pytest.approx(5.0)
    assert motion.outputs_s == pytest.approx([0.1, 0.2, 0.3])
    assert not motion.indents
    assert follow(tmp_path, [0.0, 1.0], places[:2], 1.0)(REST).indents


@pytest.mark.parametrize("force_N", [None, 0.5])
def test_a_held_force_indents_nothing(force_N):
    held = None if force_N is None else HeldLoads.normal(force_N)
    motion = replace(Press(depth_mm=1.0, speed_mm_s=1.0)(REST), held=held)
    assert motion.indents == (force_N is None)


# --- how far in which time -----------------------------------------------------------------------


def test_time_within_on_a_circle():
    motion = circle(1.0, 2 * math.pi)  # 1 mm/s
    assert motion.slid_mm(2 * math.pi) == pytest.approx(2 * math.pi, rel=1e-5)
    for start in (0.0, 1.0, 4.0):
        assert motion.time_within(start, 0.25, 9.0) == pytest.approx(0.25, rel=1e-5)
    assert motion.time_within(6.0, 1.0, 9.0) == pytest.approx(2 * math.pi - 6.0)
    assert motion.least_steps(0.1, 9.0) == pytest.approx(20 * math.pi, rel=1e-5)


def test_time_within_on_a_path_with_a_pause(tmp_path):
    """1 mm in 1 s, a pause of 2 s, 1 mm deeper in 4 s."""
    places = np.array([[0, 0, 0], [0, -1, 0], [0, -1, 0], [0, -1, 1]], dtype=float)
    motion = follow(tmp_path, [0.0, 1.0, 3.0, 7.0], places, 1.0)(REST)
    assert motion.time_within(0.5, 0.25, 9.0) == pytest.approx(0.25)
    assert motion.time_within(0.5, 0.6, 0.25) == pytest.approx(3.5)  # over the pause
    assert motion.time_within(2.0, 0.1, 0.5) == pytest.approx(3.0)
    assert motion.time_within(3.0, 0.1, 2.0) == pytest.approx(4.0)  # to its end


# --- the whole path ------------------------------------------------------------------------------


def test_a_protocol_is_a_press_and_a_slide():
    path = Protocol(depth_mm=1.0, distance_mm=2.0, output_mm=0.5).route(4.0)
    (start, pressed), (middle, slid) = path.plan()
    np.testing.assert_array_equal([start, middle], [REST, (0.0, 0.0, 1.0)])
    assert [pressed.phase, slid.phase] == ["press", "slide"]
    assert slid.outputs_s == pytest.approx(np.arange(1, 5) * 0.5 / 20)
    np.testing.assert_allclose(path.places_mm()[-1], [0.0, -2.0, 1.0])
    assert [m.phase for _, m in Protocol(distance_mm=0.0).route(4.0).plan()] == ["press"]


def test_a_press_to_a_force_goes_as_deep_as_it_may_and_the_slide_may_hold_it():
    (_, pressed), (at, slid) = Protocol(force_N=0.5, hold="force").route(4.0).plan()
    assert (pressed.until_N, pressed.held, slid.held_at_end()) == (0.5, None, [0.5])
    assert pressed.place(pressed.duration_s)[2] == 4.0 > at[2] > 3.0
    assert Protocol(force_N=0.5).route(4.0).pieces[1](REST).held is None


def test_pieces_follow_each_other():
    pieces = (
        Press(depth_mm=1.0),
        Hold(time_s=0.5),
        Slide(by_mm=(1.0, 0.0), force_N=0.2),
        Lift(depth_mm=-0.5),
    )
    plan = list(Protocol(path=pieces).route(4.0).plan())
    assert [motion.phase for _, motion in plan] == ["press", "hold", "slide", "lift"]
    starts = [start.tolist() for start, _ in plan]
    assert starts == [[0, 0, 0], [0, 0, 1], [0, 0, 1], [1, 0, 1]]
    assert plan[1][1].outputs_s == pytest.approx(0.05 * np.arange(1, 11))
    assert plan[2][1].held_at_end() == [0.2]
    np.testing.assert_allclose(plan[3][1].place(plan[3][1].duration_s), [1, 0, -0.5])


@pytest.fixture
def places_file(tmp_path) -> FilePath:
    file = tmp_path / "places.csv"
    file.write_text(HEADING + "2,0.5,0,-0.1\n\n3, 0.5, 0, 1.0\n5,0.5,-1,1.0\n")
    return file


def test_a_file_that_comes_first_says_where_the_body_starts(places_file):
    path = Protocol(path=(Follow(file=places_file),)).route(4.0)
    np.testing.assert_array_equal(path.start_mm, [0.5, 0.0, -0.1])
    ((_, motion),) = path.plan()
    assert len(motion.outputs_s) == 100
    np.testing.assert_allclose(motion.place(2.0), [0.5, -0.5, 1.0])
    later = Protocol(path=(Press(depth_mm=0.4), Follow(file=places_file))).route(4.0)
    (_, (start, motion)) = later.plan()
    np.testing.assert_array_equal([later.start_mm, start], [REST, (0.0, 0.0, 0.4)])
    np.testing.assert_allclose(motion.place(3.0), [0.0, -1.0, 1.5])


def test_a_study_keeps_its_path(tmp_path, places_file):
    pieces = Press(force_N=0.5), Slide(by_mm=(0.0, 3.0)), Follow(file=places_file, output_s=0.5)
    study = Study(protocol=Protocol(path=pieces))
    (tmp_path / "s.toml").write_text(dump_study(study))
    assert load_study(tmp_path / "s.toml") == study


# --- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("piece", "sentence"),
    [
        (Lift(depth_mm=0.0), "piece 1 of its path (lift) takes 0 s but must take a finite time"),
        (
            lambda _: replace(STAY(REST), duration_s=math.inf),
            "takes inf s but must take a finite time",
        ),
        (
            Hold(time_s=1.0, output_s=1e-9),
            "has an output every 1e-09 s, more than 100,000 in all: raise output_mm",
        ),
        (Hold(time_s=1e6, output_s=1e5), "its path lasts 1e+06 s but may last 100,000 s at most"),
        (lambda _: Motion("x", 1.0, lambda t: np.full(3, np.nan)), "(x) is not three finite"),
        (lambda _: Motion("x", 1.0, lambda t: np.zeros(2)), "(x) is not three finite numbers"),
        (lambda _: replace(STAY(REST), outputs_s=(0.0, 1.0)), "outputs_s must increase"),
        (lambda _: replace(STAY(REST), outputs_s=(0.5, 0.5)), "outputs_s must increase"),
        (lambda _: replace(STAY(REST), outputs_s=(1.1,)), "to at most 1 s"),
        (
            lambda _: replace(STAY(REST), knots_s=[0.0, 0.5]),
            "knots_s must increase from 0",
        ),
        (lambda _: STAY(np.array([0, 0, 0.5])), "begins 0.5 mm from where the body is"),
    ],
)
def test_a_path_that_nobody_can_go_along(piece, sentence):
    assert sentence in refused(Path((piece,)))


@pytest.mark.parametrize("piece", [Hold(time_s=1.0, force_N=0.5), Slide(force_N=0.5)])
def test_a_held_force_does_not_vibrate_along_z(piece):
    """The held force moves the body in Z, whatever the vibration."""
    wave = {"frequency_Hz": 50.0, "amplitude_mm": 0.01}
    for direction in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.5)):
        vibration = Vibration(**wave, direction=direction)
        vibrating = piece.model_copy(update={"vibration": vibration})
        study = Study(protocol=Protocol(path=(Press(force_N=0.5), vibrating)))
        with pytest.raises(StudyError, match=r"holds a force of 0\.5 .* let it vibrate in X and Y"):
            check(study)
    across = Vibration(**wave, direction=(1.0, 0.0, 0.0))
    sideways = piece.model_copy(update={"vibration": across})
    check(Study(protocol=Protocol(path=(Press(force_N=0.5), sideways))))


def test_the_piece_that_is_wrong_is_named():
    def beside(start):
        return replace(STAY(start + np.array([0.1, 0.0, 0.0])), phase="turn")

    told = refused(Path((Press(depth_mm=1.0, speed_mm_s=1.0), beside)))
    assert "piece 2 of its path (turn) begins 0.1 mm from where the body is then" in told
    assert told.endswith("its first place must be X 0, Y 0, Z 1 mm.")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", r"the first line of .* is empty but must be time_s and some of x_mm, y_mm"),
        ("t,x,y,z\n0,0,0,0\n1,0,0,1\n", r"the first line of .* is t,x,y,z but must be time_s"),
        (HEADING, r"must have at least two rows of numbers but has 0\."),
        (HEADING + "0,0,0,0\n", r"must have at least two rows of numbers but has 1\."),
        (HEADING + "0,0,0,0\n1,0,0\n", r"line 3 of .* is 1,0,0 but must be 4 finite numbers\."),
        (HEADING + "0,0,0,0\n1,0,0,deep\n", r"line 3 of .* is 1,0,0,deep but must be 4 finite"),
        (HEADING + "0,0,0,0\n\n1,0,0,nan\n", r"line 4 of .* is 1,0,0,nan but must be 4 finite"),
        (HEADING + '0,0,"0,\n0\n', r"line 3 of .* is 0,0,0, 0 but must be 4 finite numbers\."),
        (HEADING + f"0,0,0,{'9' * 99}x\n", r"is 0,0,0,9{51}\.\.\. but must be 4 finite numbers\."),
        (HEADING + "0,0,0,0\n1,0,0,1\n\n0.5,0,0,1\n", r"but 0\.5 follows 1 in line 5\."),
        (HEADING + "0,0,0,0\n0,0,0,1\n", r"time_s in .* must increase, but 0 follows 0 in line 3"),
        (HEADING + "0,0,0,0\n1e6,0,0,1\n", r"its path lasts 1e\+06 s but may last"),
        (b"\xff\xfe\x00", r"cannot be read: it is no CSV file\."),
        (None, r"cannot be read: No such file or directory\."),
        (HEADING + "0,0,0,0\n1,0,0,5.4\n", r"path \(entry 1\) goes 5\.4 mm deep but must be less"),
        (HEADING + "0,0,0,1\n1,0,0,2\n", r"starts .* mm inside the finger, .* plane, Z = 1$"),
    ],
)
def test_a_file_that_cannot_be_followed(tmp_path, text, sentence):
    file = tmp_path / "places.csv"
    if text is not None:
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(StudyError, match=sentence) as caught:
        check(Study(protocol=Protocol(path=(Follow(file=file),))))
    assert "\n" not in str(caught.value)


THICKNESS = Finger().pad_thickness_mm


@pytest.mark.parametrize(
    ("pieces", "sentence"),
    [
        ((Press(depth_mm=9.0),), r"protocol\.path \(entry 1\) goes 9 mm deep but must be less"),
        ((Press(force_N=1.0), Press(depth_mm=6.0)), r"path \(entry 2\) goes 6 mm deep"),
    ],
)
def test_pieces_that_cannot_be(pieces, sentence):
    with pytest.raises(StudyError, match=sentence):
        check(Study(protocol=Protocol(path=pieces)))


def test_a_press_to_a_force_may_go_on_until_the_bone_is_near():
    check(Study(protocol=Protocol(path=(Press(force_N=1.0), Slide(force_N=1.0)))))
    (_, motion) = next(Protocol(force_N=1.0).route(LARGEST_DEPTH_SHARE * THICKNESS).plan())
    assert motion.place(motion.duration_s)[2] == pytest.approx(0.8 * THICKNESS)


@pytest.mark.parametrize(
    ("piece", "sentence"),
    [
        ({"kind": "press"}, "a press needs depth_mm or force_N"),
        ({"kind": "press", "depth_mm": 1.0, "force_N": 1.0}, "a press needs depth_mm or force_N"),
        ({"kind": "slide", "by_mm": [0.0, 0.0]}, r"by_mm = \[0, 0\] is no slide: use a hold"),
        ({"kind": "hold", "time_s": 1.0, "force_N": 0.0}, "greater than 0"),
        ({"kind": "push", "time_s": 1.0}, "a push needs normal_N, tangential_N or torque_Nmm"),
        ({"kind": "twist", "angle_deg": 400.0}, "less than or equal to 360"),
        ({"kind": "roll", "angle_deg": 0.0}, "angle_deg = 0 is no turn: use a hold"),
        ({"kind": "press", "depth_mm": 1.0, "direction": [1.0, 0.0, 0.0]}, "greater than 0"),
        ({"kind": "roll", "angle_deg": 5.0, "axis": "z"}, "Input should be 'x' or 'y'"),
    ],
)
def test_a_piece_that_makes_no_sense(piece, sentence):
    with pytest.raises(ValidationError, match=sentence):
        Protocol.model_validate({"path": [piece]})


@pytest.mark.parametrize(
    ("protocol", "sentence"),
    [
        ({"hold": "force"}, 'hold = "force" needs force_N'),
        ({"path": []}, "at least 1 item"),
        ({"path": [{"kind": "lift"}], "depth_mm": 1.0}, "depth_mm = 1.0 would have no effect"),
    ],
)
def test_a_protocol_that_makes_no_sense(protocol, sentence):
    with pytest.raises(ValidationError, match=sentence):
        Protocol.model_validate(protocol)
