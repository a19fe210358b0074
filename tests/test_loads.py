"""Loads that a step holds: the search, the joint, and what a block answers."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from tactile_fem.runtime import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip

from sphere_on_block import TWO_TISSUES, sphere_on_block

from tactile_fem.errors import ConvergenceError
from tactile_fem.finger.joint import Joint
from tactile_fem.mechanics.rows import gathered
from tactile_fem.output.film import _seen_from_bone
from tactile_fem.path import Hold, Lift, Path, Press, Push, Twist
from tactile_fem.path.rotations import matrix, vector
from tactile_fem.simulation.bone import Bone
from tactile_fem.simulation.load_search import TOLERANCE, LoadSearch
from tactile_fem.simulation.pose import Pose
from tactile_fem.simulation.stepper import Stepper
from tactile_fem.stimulus.body import HalfSpace
from tactile_fem.study import Solver

COUPLED = np.array([[0.8, 0.1, 0.2], [0.0, 0.5, -0.1], [0.2, 0.1, 1.5]])


def searched(loads, wanted, first, max_increment_mm=0.5) -> LoadSearch:
    search = LoadSearch(np.zeros(len(wanted)), first, max_increment_mm)
    while not search.is_met(loads(search.x) - wanted, np.linalg.norm(wanted)):
        assert not search.has_failed
    return search


@pytest.mark.parametrize("share", [0.3, 1.0, 3.0])
def test_coupled_loads_are_met_whatever_is_known_of_their_stiffness(share):
    wanted = np.array([0.05, -0.02, 0.4])
    search = searched(lambda x: COUPLED @ x + 0.1 * x**2, wanted, share * np.eye(3))
    np.testing.assert_allclose(COUPLED @ search.x + 0.1 * search.x**2, wanted, atol=5e-4)
    again = searched(lambda x: COUPLED @ x, wanted, COUPLED)
    assert again.solves == 2 < search.solves


def test_two_places_are_no_farther_apart_than_allowed():
    search = LoadSearch(np.zeros(2), np.eye(2), max_increment_mm=0.1)
    assert not search.is_met(np.array([-3.0, -4.0]), 5.0)
    np.testing.assert_allclose(search.x, [0.06, 0.08])


def test_a_load_that_does_not_follow_the_body_is_given_up():
    search = LoadSearch(np.zeros(2), np.eye(2), max_increment_mm=0.2)
    while not search.is_met(np.clip(search.x, -0.3, 0.3) - [0.5, 0.2], 0.6):
        if search.has_failed:
            break
    assert search.solves < 10
    assert search.x[0] < 2.0


def of_force(law, z_mm=0.3, stiffness_N_mm=0.5) -> LoadSearch:
    search = LoadSearch(np.array([z_mm]), np.array([[stiffness_N_mm]]), max_increment_mm=0.1)
    while not (search.is_met(law(search.x) - 0.4, 0.4) or search.has_failed):
        pass
    return search


@pytest.mark.parametrize("stiffness_N_mm", [0.05, 0.5, 5.0, 500.0])
@pytest.mark.parametrize(
    "law", [lambda z: z, lambda z: np.maximum(z, 0.0) ** 1.5, lambda z: np.expm1(5 * z) / 10]
)
def test_a_force_that_grows_with_the_depth_is_met(law, stiffness_N_mm):
    search = of_force(law, stiffness_N_mm=stiffness_N_mm)
    assert law(search.x[0]) == pytest.approx(0.4, rel=TOLERANCE)
    assert search.solves <= 9


@pytest.mark.parametrize("sign", [1, -1])
def test_a_force_that_jumps_is_known_to(sign, where=0.337):
    """Also one that grows the other way."""
    search = of_force(lambda z: np.where(sign * z < where, 0.1, 0.9), sign * 0.3, sign * 0.5)
    assert search.has_failed
    low, high = (sign * z for z in search.jump_mm)
    assert low < where <= high < low + 0.001


@pytest.mark.parametrize("z_mm", [0.45, 0.49, 0.503, 0.6])
def test_a_steep_force_is_no_jump(z_mm):
    """Nearly met at first: the other end of the bracket is far from it."""
    search = of_force(lambda z: 0.2999 + 0.2 * z + 200 * np.maximum(z - 0.5, 0.0), z_mm)
    assert not search.has_failed


@pytest.mark.parametrize("force", [0.1, 0.9])
def test_a_force_that_does_not_change_is_given_up(force):
    search = of_force(lambda z: np.full(1, force))
    assert search.solves == 12 and search.jump_mm is None
    assert abs(search.x[0] - 0.3) < 1.3


# --- a block -------------------------------------------------------------------------------------

PLATE = HalfSpace()
SOLVER = Solver(held=("cut",))
PUSHED = (
    Press(depth_mm=0.1, speed_mm_s=10.0),
    Push(normal_N=0.02, tangential_N=(0.001, -0.002), time_s=0.02, output_s=0.01),
    Push(normal_N=0.02, torque_Nmm=0.002, time_s=0.02, output_s=0.02),
)


def plate_below_block():
    return sphere_on_block(body=PLATE, layers=TWO_TISSUES, count=2)


@pytest.mark.ranks
def test_held_loads_end_where_the_body_that_is_moved_so_ends():
    steps = list(Stepper(plate_below_block(), Path(PUSHED), SOLVER))
    np.testing.assert_allclose(
        [step for step in steps if step.phase == "push"][-1].load.force_N[2], 0.02, rtol=2e-3
    )
    ends = [step for step in steps if step.ends_piece]
    np.testing.assert_allclose(ends[1].load.force_N, [0.001, -0.002, 0.02], atol=3e-5)
    last = Pose(ends[2].stimulator_mm, matrix(ends[2].stimulator_rad))
    assert last.load(ends[2].load.force_N, ends[2].load.moment_Nmm)[3] == pytest.approx(
        0.002, abs=1.5e-4
    )
    np.testing.assert_array_equal(ends[2].stimulator_mm[:2], ends[1].stimulator_mm[:2])
    assert ends[2].stimulator_rad[2] > 1e-5
    moved = plate_below_block()
    for step in steps[: ends[1].index]:
        assert moved.solve(step.stimulator_mm, step.dt_s).converged
        load = moved.accept()
        np.testing.assert_allclose(load.force_N, step.load.force_N, atol=1e-6)
        np.testing.assert_allclose(load.moment_Nmm, step.load.moment_Nmm, atol=1e-5)


@pytest.mark.ranks
def test_a_force_beyond_friction_ends_in_a_sentence_with_what_was_reached():
    beyond = Push(normal_N=0.02, tangential_N=(0.0, 0.01), time_s=0.02, output_s=0.01)
    stepper = Stepper(plate_below_block(), Path((PUSHED[0], beyond)), SOLVER)
    reached = 0.0
    with pytest.raises(ConvergenceError, match=r"Y 0\.00\d+ of 0\.00\d+ N.* skin slips") as error:
        for step in stepper:
            reached = step.load.force_N[1] / step.load.force_N[2]
    assert 0.25 < reached < 0.3 + 1e-6
    assert error.value.stimulator_mm[2] > 0.1


@pytest.mark.ranks
def test_what_is_saved_in_a_push_or_a_twist_goes_on_with_the_same_steps():
    bone = Bone(Joint())
    twist = Twist(angle_deg=4.0, speed_deg_s=200.0, about_mm=(0.5, 0.0, 0.0), force_N=0.02)
    path = Path((*PUSHED[:2], twist))
    whole = list(Stepper(plate_below_block(), path, SOLVER, bone=bone))
    for count in (len(whole) // 2, len(whole) - 2):
        first = Stepper(plate_below_block(), path, SOLVER, bone=bone)
        list(islice(first, count))
        saved = gathered(first.to_save())
        progress = MPI.COMM_WORLD.bcast(saved)
        again = Stepper(plate_below_block(), path, SOLVER, bone=bone)
        again.restore({**progress, **saved})
        rest = list(again)
        assert [step.newton_iterations for step in rest] == [
            step.newton_iterations for step in whole[count:]
        ]
        for name in ("stimulator_mm", "stimulator_rad", "bone_rad"):
            np.testing.assert_allclose(
                [getattr(step, name) for step in rest],
                [getattr(step, name) for step in whole[count:]],
                atol=1e-9,
            )
        for step, expected in zip(rest, whole[count:], strict=True):
            np.testing.assert_allclose(step.load.force_N, expected.load.force_N, atol=1e-9)
            np.testing.assert_allclose(step.load.moment_Nmm, expected.load.moment_Nmm, atol=1e-9)


# --- the joint -----------------------------------------------------------------------------------


def test_the_bone_and_the_block_are_springs_in_series():
    """Slowly, the joint carries the moment of the contact; a stiff one is a clamp."""
    slow = Path((Press(depth_mm=0.2, speed_mm_s=1e-3),))
    joint = Joint(stiffness_Nmm_rad=60.0)
    step = list(Stepper(plate_below_block(), slow, SOLVER, bone=Bone(joint)))[-1]
    moment = step.load.moment_Nmm - np.cross(joint.centre_mm, step.load.force_N)
    assert step.bone_rad * 60.0 == pytest.approx(moment[0], rel=3e-3)
    assert step.bone_rad > 5e-4
    clamped = list(Stepper(plate_below_block(), slow, SOLVER))[-1]
    assert step.load.force_N[2] < 0.9 * clamped.load.force_N[2]
    stiff = Bone(Joint(stiffness_Nmm_rad=1e9))
    held = list(Stepper(plate_below_block(), slow, SOLVER, bone=stiff))[-1]
    np.testing.assert_allclose(held.load.force_N, clamped.load.force_N, atol=1e-4)


def test_a_bone_from_which_the_body_is_lifted_swings_back():
    path = Path((Press(depth_mm=0.2, speed_mm_s=1.0), Lift(depth_mm=-0.2), Hold(time_s=0.3)))
    joint = Joint(stiffness_Nmm_rad=60.0, damping_Nmms_rad=1.2)
    *_, last = Stepper(plate_below_block(), path, SOLVER, bone=Bone(joint))
    assert last.load.force_N[2] == 0.0
    assert abs(last.bone_rad) < 1e-6


def test_the_bone_swings_at_seventy_hertz():
    joint, dt, angles = Joint(damping_Nmms_rad=0.0), 1e-4, []
    bone = Bone(joint, joint.inertia_Nmms2, angle_rad=0.01)
    bone = bone.moved(0.01, 1e9)  # at rest
    still = np.zeros(3)
    for _ in range(400):
        low, high = (bone.moments_N(angle, dt, still, still).sum() for angle in (0.0, 1.0))
        bone = bone.moved(low / (low - high), dt)
        angles.append(bone.angle_rad)
    crossings = np.flatnonzero(np.diff(np.sign(angles)))
    period_s = 2 * dt * np.diff(crossings).mean()
    expected = 2 * np.pi * np.sqrt(joint.inertia_Nmms2 / joint.stiffness_Nmm_rad)
    assert 1 / expected == pytest.approx(70, abs=1)
    assert period_s == pytest.approx(expected, rel=0.02)


def test_seen_from_the_bone_and_in_space_are_inverse():
    bone = Bone(Joint())
    pose = Pose(np.array([0.3, -2.0, 1.5]), matrix([0.1, 0.2, -0.3]))
    back = bone.in_space(bone.seen_from(pose, 0.2), 0.2)
    np.testing.assert_allclose(back.translation, pose.translation, atol=1e-14)
    np.testing.assert_allclose(vector(back.rotation), [0.1, 0.2, -0.3], atol=1e-14)
    angle = np.array([0.2, -0.1])
    places = np.tile(pose.translation, (2, 1))
    drawn, turns = _seen_from_bone(bone.joint, places, np.tile([0.1, 0.2, -0.3], (2, 1)), angle)
    for k in range(2):
        seen = bone.seen_from(pose, angle[k])
        np.testing.assert_allclose(drawn[k], seen.translation, atol=1e-14)
        np.testing.assert_allclose(turns[k], vector(seen.rotation), atol=1e-14)
    force, moment = np.array([0.1, -0.2, 1.0]), np.array([0.5, 0.2, -0.1])
    turned, about = bone.load_in_space(force, moment, 0.2)
    centre = bone.joint.centre_mm
    np.testing.assert_allclose(turned, matrix([0.2, 0, 0]) @ force)
    about_centre = matrix([0.2, 0, 0]) @ (moment - np.cross(centre, force))
    np.testing.assert_allclose(about - np.cross(centre, turned), about_centre, atol=1e-14)
