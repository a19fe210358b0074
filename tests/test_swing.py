"""Inertia on a joint: bone and tissue swing as one body in space, in time as in a vibration."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from dolfinx import fem
from materials import uniform
from sphere_on_block import TWO_TISSUES, sphere_on_block

from tactile_fem.finger.joint import Joint
from tactile_fem.mechanics.rows import gathered
from tactile_fem.mechanics.terms.inertia import GeneralizedAlpha, Inertia, moment_of_inertia
from tactile_fem.path import Hold, Path, Press
from tactile_fem.path.pieces import Vibration
from tactile_fem.path.rotations import matrix
from tactile_fem.simulation.bone import Bone
from tactile_fem.simulation.stepper import Stepper
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.stimulus.body import HalfSpace
from tactile_fem.study import Solver
from tactile_fem.vibration.harmonic import Harmonic

DENSITY, AWAY = 1000.0, np.array([0.0, 0.0, -2.0])
SOLVER = Solver(held=("cut",))
# Of the block, 6 x 6 x 3 mm, about the joint of `hinge`, N mm s2.
OF_BLOCK = 108e-12 * DENSITY * ((5.0**2 + 6**2 / 12) + (0.5**2 + 3**2 / 12))
RELEASED_RAD, STEPS = 0.02, 32


def hinge(mass_g: float = 0.0) -> Joint:
    return Joint(
        stiffness_Nmm_rad=0.5, damping_Nmms_rad=0.0, mass_g=mass_g, length_mm=5.0, height_mm=1.0
    )


def block(C10_MPa: float, place: np.ndarray = AWAY) -> FingerProblem:
    """Return a block that a smooth plate, by default, does not touch."""
    made = uniform(C10_MPa, 0.2 / C10_MPa, density_kg_m3=DENSITY)
    problem = sphere_on_block(made, body=HalfSpace(), layers=TWO_TISSUES, count=2, inertia=True)
    problem.contact.friction.coefficient.value = 0.0
    problem.state.place(place)
    return problem


def bone_of(problem: FingerProblem, joint: Joint, **motion: float) -> Bone:
    of_tissue = moment_of_inertia(problem.tissues, DENSITY, joint.centre_mm)
    return Bone(joint, joint.inertia_beyond(of_tissue), **motion)


def released(joint: Joint) -> tuple[Stepper, FingerProblem]:
    """Return a stiff block that is let go."""
    problem = block(1.0)
    bone = bone_of(problem, joint, angle_rad=RELEASED_RAD, before_rad=RELEASED_RAD)
    whole = max(OF_BLOCK, joint.inertia_Nmms2)
    period_s = 2 * np.pi * np.sqrt(whole / joint.stiffness_Nmm_rad)
    hold = Hold(time_s=0.8 * period_s, output_s=period_s / STEPS)
    return Stepper(problem, Path((hold,), AWAY), SOLVER, bone=bone), problem


def test_the_tissue_is_counted_once():
    problem = block(1.0)
    assert bone_of(problem, hinge()).inertia_Nmms2 == 0.0
    left = bone_of(problem, hinge(0.6)).inertia_Nmms2
    assert left == pytest.approx(0.6e-6 * 5.0**2 / 3 - OF_BLOCK, rel=1e-9)


@pytest.mark.ranks
@pytest.mark.parametrize("mass_g", [0.0, 0.6])
def test_bone_and_block_swing_as_one_body(mass_g):
    """With a mass of the joint that is less than the block's, and with more."""
    joint = hinge(mass_g)
    whole = max(OF_BLOCK, joint.inertia_Nmms2)
    stepper, problem = released(joint)
    owned = 3 * problem.u.function_space.dofmap.index_map.size_local
    places = problem.u.function_space.tabulate_dof_coordinates()
    load = 1e-3 * (np.arange(owned) % 3 == 2)
    moment = problem.domain.comm.allreduce(joint.arms(places).ravel()[:owned] @ load)
    w = np.sqrt(0.25 * joint.stiffness_Nmm_rad / whole)
    found = Harmonic(problem, DENSITY, joint).respond(w / (2 * np.pi), np.zeros(3), load=load)
    assert moment / found.turn_rad == pytest.approx(0.75 * joint.stiffness_Nmm_rad, rel=1e-3)

    alone, found = Bone(joint, whole, angle_rad=RELEASED_RAD), []
    for step in stepper:
        none = step.dt_s, np.zeros(3), np.zeros(3)
        at_0, at_1 = (alone.moments_N(angle, *none).sum() for angle in (0.0, 1.0))
        alone = alone.moved(at_0 / (at_0 - at_1), step.dt_s)
        assert step.bone_rad == pytest.approx(alone.angle_rad, abs=1e-3 * RELEASED_RAD)
        found.append([step.clock_s, step.bone_rad])
    times, angles = np.array(found).T
    first, last = np.flatnonzero(np.diff(np.sign(angles)))
    zeros = [np.interp(0.0, angles[k], times[k]) for k in ([first + 1, first], [last, last + 1])]
    period_s = 2 * np.pi * np.sqrt(whole / joint.stiffness_Nmm_rad)
    assert 2 * (zeros[1] - zeros[0]) == pytest.approx(period_s, rel=1e-2)


@pytest.mark.slow
def test_a_soft_block_on_a_plate_that_vibrates_turns_as_the_harmonic_response():
    joint = Joint(stiffness_Nmm_rad=20.0, damping_Nmms_rad=0.02, mass_g=0.0, height_mm=1.0)
    frequency, found = 60.0, []
    for up in (1.0, -1.0):  # their difference does not drift
        vibration = Vibration(frequency_Hz=frequency, amplitude_mm=0.02, direction=(0.0, 0.0, up))
        hold = Hold(time_s=3 / frequency, vibration=vibration)
        path, problem = Path((Press(depth_mm=0.1, speed_mm_s=0.1), hold)), block(1e-3, np.zeros(3))
        steps = list(Stepper(problem, path, SOLVER, bone=bone_of(problem, joint)))
        last = [step for step in steps if step.clock_s > steps[-1].clock_s - 1 / frequency]
        angles = 2 * np.pi * frequency * np.array([step.clock_s for step in last])
        waves = np.column_stack([np.sin(angles), np.cos(angles), np.ones_like(angles)])
        seen = [[step.bone_rad, step.stimulator_mm[2]] for step in last]
        turn, way = np.array([1.0, 1j, 0.0]) @ np.linalg.lstsq(waves, np.array(seen))[0]
        found.append(turn / way)
    along = matrix([-steps[-1].bone_rad, 0.0, 0.0])[:, 2]
    exact, massless = (
        Harmonic(problem, density, joint).respond(frequency, along).turn_rad
        for density in (DENSITY, 1e-6)
    )
    assert abs(exact / massless) > 1.2  # mass counts
    np.testing.assert_allclose(np.mean(found), exact, rtol=0.02)


def test_only_motion_in_space_has_inertia():
    """However far the bone turns; a block that turns with it resists by its moment of inertia."""
    problem, joint, turn_rad, dt_s = block(1.0), hinge(), 1e-4, 1e-3
    (inertia,) = (term for term in problem.bulk.terms if isinstance(term, Inertia))
    form, centre = fem.form(inertia.residual(problem.test)), joint.centre_mm[:, None]
    problem.begin_step(AWAY, dt_s, swing=Bone(joint).swing(turn_rad))
    arms = joint.arms(problem.u.function_space.tabulate_dof_coordinates()).ravel()
    method = GeneralizedAlpha()
    expected = method.averaged(method.acceleration(turn_rad, 0.0, 0.0, dt_s), 0.0) * OF_BLOCK
    assert arms @ fem.assemble_vector(form).array == pytest.approx(expected, rel=1e-6)
    back = matrix([-0.7, 0.0, 0.0])
    problem.begin_step(AWAY, dt_s, swing=Bone(joint).swing(0.7))
    problem.u.interpolate(lambda x: back @ (x - centre) + centre - x)
    np.testing.assert_allclose(fem.assemble_vector(form).array, 0.0, atol=1e-14)


@pytest.mark.ranks
def test_what_is_saved_while_the_bone_swings_goes_on_with_the_same_steps():
    whole = list(islice(released(hinge())[0], 9))
    first, again = (released(hinge())[0] for _ in range(2))
    list(islice(first, 6))
    saved = gathered(first.to_save())
    again.restore({**MPI.COMM_WORLD.bcast(saved), **saved})
    rest = list(islice(again, 3))
    for name in ("bone_rad", "newton_iterations"):
        found, expected = ([getattr(step, name) for step in of] for of in (rest, whole[6:]))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
