"""Pieces of a path that turn the body or hold loads: where it is, what is refused, what is kept."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest

from tactile_fem.errors import StudyError
from tactile_fem.path.loads import COMPONENTS
from tactile_fem.path.rotations import matrix, to_space, vector
from tactile_fem.simulation.checks import check
from tactile_fem.study import Finger, Follow, Press, Protocol, Push, Roll, Study, Twist
from tactile_fem.study.file import dump_study, load_study

REST, AT = np.zeros(3), np.array([0.5, -1.0, 1.2])
SIX = "time_s,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n"


def written(folder: FilePath, text: str) -> FilePath:
    file = folder / "recorded.csv"
    file.write_text(text)
    return file


# --- directions and turns ------------------------------------------------------------------------


def test_a_press_goes_along_its_direction_to_its_depth():
    motion = Press(depth_mm=1.0, direction=(3.0, 0.0, 4.0), speed_mm_s=1.25)(REST)
    assert motion.places_mm[-1] == pytest.approx([0.75, 0.0, 1.0])
    assert motion.duration_s == pytest.approx(1.0)
    assert not motion.indents and motion.slid_mm(1.0) == pytest.approx(0.75)
    longer = Press(depth_mm=1.0, direction=(6.0, 0.0, 8.0), speed_mm_s=1.25)(REST)
    assert longer.places_mm.tolist() == motion.places_mm.tolist()


@pytest.mark.parametrize(
    ("piece", "axis"),
    [
        (Twist(angle_deg=30.0, about_mm=(1.0, 2.0, 0.0)), 2),
        (Roll(angle_deg=-20.0, about_mm=(0.0, 1.0, -5.0)), 0),
        (Roll(axis="y", angle_deg=20.0, about_mm=(2.0, 0.0, -5.0)), 1),
    ],
    ids=["twist", "roll about x", "roll about y"],
)
def test_a_turn_leaves_the_points_on_its_axis(piece, axis):
    motion = piece(AT)
    assert motion.phase == piece.kind and motion.duration_s == pytest.approx(
        abs(piece.angle_deg) / 20
    )
    assert motion.place(0.0) == pytest.approx(AT) and not motion.turn(0.0).any()
    end = motion.duration_s
    assert motion.turn(end) == pytest.approx(np.radians(piece.angle_deg) * np.eye(3)[axis])
    about = piece.about_mm + AT * [0.0, 0.0, 1.0]
    on_axis = np.array([about, about + 3.0 * np.eye(3)[axis]])
    for t in (0.3 * end, end):
        there = to_space(on_axis - AT, motion.place(t), motion.turn(t))
        assert there == pytest.approx(on_axis, abs=1e-12)
    assert len(motion.outputs_s) == abs(piece.angle_deg) and not motion.indents


def test_turns_add_up_over_the_pieces_of_a_path():
    path = Protocol(
        path=(Press(depth_mm=1.0), Twist(angle_deg=90.0), Roll(angle_deg=90.0, axis="x"))
    ).route(4.0)
    path.check()
    quarter = np.pi / 2
    expected = matrix([quarter, 0, 0]) @ matrix([0, 0, quarter])
    assert matrix(path.turns_rad()[-1]) == pytest.approx(expected)
    assert path.turns_rad().shape == path.places_mm().shape


# --- followed turns and loads --------------------------------------------------------------------


def test_followed_turns_are_relative_to_the_first_row(tmp_path):
    file = written(tmp_path, SIX + "0,0,0,0,0,0,30\n1,0,0,1,0,0,30\n3,0,0,1,20,0,30\n")
    path = Protocol(path=(Follow(file=file),)).route(4.0)
    assert path.start_rad == pytest.approx(np.radians([0, 0, 30.0]))
    ((_, motion),) = path.plan()
    first, last = (matrix(np.radians(row)) for row in ([0, 0, 30.0], [20.0, 0, 30.0]))
    assert not motion.turn(0.5).any()
    assert motion.turn(3.0) == pytest.approx(vector(last @ first.T))
    assert motion.turn(2.0) == pytest.approx(motion.turn(3.0) / 2)
    assert matrix(path.turns_rad()[-1]) == pytest.approx(last)
    later = Protocol(path=(Press(depth_mm=0.4), Follow(file=file))).route(4.0)
    assert not later.start_rad.any()
    assert later.turns_rad()[-1] == pytest.approx(vector(last @ first.T))


def test_followed_turns_go_on_beyond_half_a_round(tmp_path):
    rows = "".join(f"{t},0,0,0,0,0,{30 + 80 * t}\n" for t in range(6))
    motion = Follow(file=written(tmp_path, SIX + rows))(REST)
    assert np.degrees(motion.turn(2.5)) == pytest.approx([0, 0, 200])
    assert np.degrees(motion.turn(5.0)) == pytest.approx([0, 0, 400])


def test_followed_loads_begin_with_those_at_the_start(tmp_path):
    file = written(tmp_path, "time_s,fx_N,fz_N\n0,0.1,0.3\n2,0.3,0.5\n4,0,0.5\n")
    motion = Follow(file=file, hold=("fx_N", "fz_N"))(REST)
    assert [COMPONENTS[k] for k in motion.held.components] == ["X", "Z"]
    start = np.array([0.0, 0.05, 0.2, 0.0])
    assert motion.held.at(0.0, start)[[0, 2]] == pytest.approx([0.0, 0.2])
    assert motion.held.at(1.0, start)[[0, 2]] == pytest.approx([0.15, 0.35])
    assert motion.held_at_end() == pytest.approx([0.0, 0.5])


def test_a_push_brings_its_loads_from_those_at_the_start():
    start = np.array([0.1, 0.0, 0.4, 1.0])
    ramp = Push(time_s=2.0, normal_N=1.0, tangential_N=(0.3, 0.0), torque_Nmm=2.0)(AT)
    assert ramp.held.components == (0, 1, 2, 3)
    assert ramp.held.at(1.0, start) == pytest.approx([0.2, 0.0, 0.7, 1.5])
    slow = Push(time_s=2.0, normal_N=1.0, course="half_sine")(AT)
    assert slow.held.components == (2,)
    forces = [slow.held.at(t, start)[2] for t in (0.0, 0.5, 1.0, 2.0)]
    assert forces == pytest.approx([0.4, 0.4 + 0.6 * (1 - np.sqrt(0.5)) / 2, 0.7, 1.0])
    assert ramp.place(1.0).tolist() == AT.tolist() and not ramp.indents


# --- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "hold", "sentence"),
    [
        (
            SIX + "0,0,0,0,0,0,0\n1,0,0,0,0,0,95\n",
            (),
            r"turns by 95 degrees from 0 to 1 s but may turn by 90 between two rows\.$",
        ),
        (
            "time_s,fz_N\n0,0\n1,1\n",
            ("fz_N", "fx_N"),
            r"recorded\.csv has no column fx_N, named in hold\.$",
        ),
        (
            "time_s,rz\n0,0\n1,1\n",
            (),
            r"is time_s,rz but must be time_s and some of x_mm, .*rz_deg",
        ),
    ],
)
def test_a_recording_that_cannot_be_followed(tmp_path, text, hold, sentence):
    piece = Follow(file=written(tmp_path, text), hold=hold)
    with pytest.raises(StudyError, match=sentence) as caught:
        check(Study(protocol=Protocol(path=(piece,))))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("piece", "sentence"),
    [
        (
            Twist(angle_deg=5.0),
            "turns the body by 5 degrees out of the section's plane, X = 0; let",
        ),
        (Roll(angle_deg=5.0, axis="y"), "turns the body by 5 degrees out of .* about X only"),
        (Push(time_s=1.0, torque_Nmm=1.0), "holds a load along torque, which is not in"),
        (Push(time_s=1.0, tangential_N=(0.1, 0.1)), "holds a load along X, which is not in"),
    ],
)
def test_a_section_is_not_turned_out_of_its_plane(piece, sentence):
    finger, press = Finger(kind="section"), Press(depth_mm=0.5)
    with pytest.raises(StudyError, match=sentence):
        check(Study(finger=finger, protocol=Protocol(path=(press, piece))))


# --- kept ----------------------------------------------------------------------------------------


def test_a_study_keeps_pieces_that_turn_and_hold_loads(tmp_path):
    file = written(tmp_path, SIX + "0,0,0,0,0,0,0\n1,0,0,1,0,0,5\n")
    pieces = (
        Press(depth_mm=1.0, direction=(0.2, 0.0, 1.0)),
        Push(
            time_s=0.1, normal_N=0.5, tangential_N=(0.1, -0.1), torque_Nmm=0.2, course="half_sine"
        ),
        Twist(angle_deg=30.0, about_mm=(1.0, 0.0, 0.0), force_N=0.5),
        Roll(axis="y", angle_deg=-5.0, speed_deg_s=2.0, output_deg=0.5),
        Follow(file=file, hold=("fz_N",)),
    )
    study = Study(protocol=Protocol(path=pieces))
    (tmp_path / "s.toml").write_text(dump_study(study))
    assert load_study(tmp_path / "s.toml") == study
