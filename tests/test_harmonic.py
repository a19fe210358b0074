"""Vibration about a state: exact dynamics of blocks, reciprocity, and the static limit."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import block_mesh
from dolfinx import fem
from materials import NO_VISCOSITY_S, relaxing, uniform
from sphere_on_block import TWO_TISSUES, follow, sphere_on_block

from tactile_fem.finger.joint import Joint
from tactile_fem.mechanics.domain import create_domain, roller
from tactile_fem.simulation.bone import Bone
from tactile_fem.simulation.pose import Pose, moment_about
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Plate, Solver, Tissue
from tactile_fem.vibration.harmonic import Harmonic

C10, D1, HEIGHT, DENSITY = 0.01, 20.0, 2.0, 1000.0
G, K = 2 * C10, 2 / D1
SERIES = {"g": (0.3, 0.2), "tau_s": (0.002, 0.05)}
KELVIN = 0.001
FREQUENCIES = [1.0, 100.0, 900.0]


def tissue(*, relaxes: bool) -> Tissue:
    if relaxes:
        return relaxing(uniform(C10, D1), **SERIES)
    return uniform(C10, D1, viscous_time_s=KELVIN)


def modulus(frequency_Hz: float, *, relaxes: bool) -> complex:
    """Return the complex shear modulus by the formulas of Prony and of Kelvin and Voigt, MPa."""
    iw = 2j * np.pi * frequency_Hz
    if not relaxes:
        return G * (1 + iw * KELVIN)
    at_once = G / (1 - sum(SERIES["g"]))
    pairs = zip(SERIES["g"], SERIES["tau_s"], strict=True)
    return at_once * (1 - sum(g / (1 + iw * tau_s) for g, tau_s in pairs))


def block(made: Tissue, *axes: int, sides: bool = False, layers: int = 12) -> FingerProblem:
    """Return a plate that touches a column, whose nodes may not move along the axes."""
    line = np.array([-0.5, 0.5])
    depths = np.linspace(0, HEIGHT, layers + 1)
    names = [TWO_TISSUES[4 * k // layers] for k in range(layers)]
    domain = create_domain(block_mesh(line, line, depths, names), MPI.COMM_WORLD, ("cut",))

    def at(axis: int):
        return lambda x: np.isclose(abs(x[axis]), 0.5) if sides else np.full(x.shape[1], True)

    settings = Solver(
        held=("cut",),
        linear="direct",
        petsc={"snes_atol": 1e-13},
        contact_width_MPa=1e-8,
    )
    body = Plate(friction=0.5)
    return FingerProblem(
        domain,
        made,
        body.body(),
        body.friction,
        settings,
        lambda V: [roller(V, axis, at(axis)) for axis in axes],
    )


def touched(problem: FingerProblem, depth_mm: float = 1e-4) -> FingerProblem:
    follow(problem, (0, 0, depth_mm), dt_s=1e3)
    return problem


def nodal(problem: FingerProblem, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return heights of this rank's nodes and the amplitudes there, (nodes, 3)."""
    z = problem.u.function_space.tabulate_dof_coordinates()[:, 2]
    return z, u.reshape(-1, 3)[: len(z)]


@pytest.mark.ranks
@pytest.mark.parametrize("relaxes", [True, False])
def test_a_column_carries_the_exact_pressure_waves(relaxes):
    problem = touched(block(tissue(relaxes=relaxes), 0, 1, sides=True))
    vibrating = Harmonic(problem, DENSITY)
    for frequency in FREQUENCIES:
        shear = modulus(frequency, relaxes=relaxes)
        M = K + (4 / 3 * shear if relaxes else 4 / 3 * G + 2 * (shear - G))
        w = 2 * np.pi * frequency
        k = w * np.sqrt(DENSITY * 1e-12 / M)
        found = vibrating.respond(frequency, [0.0, 0.0, 1.0])
        z, u = nodal(problem, found.u)
        exact = np.sin(k * (HEIGHT - z)) / np.sin(k * HEIGHT)
        np.testing.assert_allclose(u[:, 2], exact, atol=2e-4)
        force = M * k / np.tan(k * HEIGHT)
        np.testing.assert_allclose(found.force_N, [0, 0, force], atol=2e-3 * abs(force))


@pytest.mark.ranks
@pytest.mark.parametrize("relaxes", [True, False])
def test_a_plate_that_sticks_sends_the_exact_shear_waves(relaxes):
    problem = touched(block(tissue(relaxes=relaxes), 1, 2))
    vibrating = Harmonic(problem, DENSITY)
    for frequency in FREQUENCIES:
        shear = modulus(frequency, relaxes=relaxes)
        k = 2 * np.pi * frequency * np.sqrt(DENSITY * 1e-12 / shear)
        found = vibrating.respond(frequency, [1.0, 0.0, 0.0])
        z, u = nodal(problem, found.u)
        exact = np.sin(k * (HEIGHT - z)) / np.sin(k * HEIGHT)
        np.testing.assert_allclose(u[:, 0], exact, atol=1e-3)
        force = shear * k / np.tan(k * HEIGHT)
        np.testing.assert_allclose(found.force_N[0], force, atol=5e-3 * abs(force))


@pytest.mark.parametrize("joint", [None, Joint(stiffness_Nmm_rad=1e-3, damping_Nmms_rad=1e-5)])
def test_what_one_place_does_to_another_it_does_in_return(joint):
    problem = block(tissue(relaxes=True), 1)
    problem.state.place(np.array([0.0, 0.0, -1.0]))  # far from the plate
    vibrating = Harmonic(problem, DENSITY, joint)
    count = len(problem.u.x.array)
    places = [3 * (count // 9), 3 * (count // 5) + 2]
    matrix = []
    for place in places:
        found = vibrating.respond(300.0, np.zeros(3), load=1e-3 * np.eye(1, count, place)[0])
        matrix.append(found.u[places])
    assert abs(matrix[0][1]) > 1e-6
    np.testing.assert_allclose(matrix[0][1], matrix[1][0], rtol=1e-6)


@pytest.mark.ranks
def test_a_block_that_nothing_touches_swings_about_its_joint():
    """Slowly, as the rigid body that the joint's mass describes."""
    joint = Joint(stiffness_Nmm_rad=2e-6, damping_Nmms_rad=1e-6, length_mm=5.0, mass_g=0.02)
    problem = block(tissue(relaxes=True), layers=4)
    problem.state.place(np.array([0.0, 0.0, -1.0]))
    places = problem.u.function_space.tabulate_dof_coordinates()
    owned = problem.u.function_space.dofmap.index_map.size_local
    count = problem.domain.comm.allreduce(owned)
    load = np.tile([0.0, 0.0, 1e-9 / count], owned)
    moment = problem.domain.comm.allreduce(load @ joint.arms(places[:owned]).ravel())
    for frequency in (1.0, 3.0):
        w = 2 * np.pi * frequency
        found = Harmonic(problem, DENSITY, joint).respond(frequency, np.zeros(3), load=load)
        rigid = moment / (joint.moment_per_angle(frequency) - w**2 * joint.inertia_Nmms2)
        np.testing.assert_allclose(found.turn_rad, rigid, rtol=1e-3)
        u = found.u.reshape(-1, 3)
        np.testing.assert_allclose(u, rigid * joint.arms(places), atol=2e-3 * abs(u).max())


@pytest.mark.ranks
def test_a_bone_that_turns_sees_a_ball_turn_the_other_way():
    """Without friction a ball feels no turn of its own: clamped answers give those on the joint."""
    problem = sphere_on_block(relaxing(viscous_time_s=NO_VISCOSITY_S), layers=TWO_TISSUES)
    problem.contact.friction.coefficient.value = 0.0
    for depth in np.linspace(0, 0.6, 13)[1:]:  # twice as long, one step needs up to 94 iterations
        force = follow(problem, (0, 0, depth)).force_N
    centre = np.array([0.0, 0.0, 0.6 - 3.0])  # the apex of the ball is its origin
    joint = Joint(
        stiffness_Nmm_rad=0.5, damping_Nmms_rad=0.01, mass_g=0.0, length_mm=4.0, height_mm=2.0
    )
    axis, arm, frequency = np.array([1.0, 0.0, 0.0]), joint.arms(centre), 5.0
    clamped, hinged = Harmonic(problem, 1e-9), Harmonic(problem, 1e-9, joint)
    K = np.column_stack([clamped.respond(frequency, unit).force_N for unit in np.eye(3)])
    for body in np.eye(3):

        def moment(moved: np.ndarray) -> complex:
            """Return the change of the moment on the bone, seen from it."""
            return arm @ K @ moved + axis @ np.cross(moved, force)

        turn = moment(body) / (joint.moment_per_angle(frequency) + moment(arm))
        exact = K @ (body - turn * arm) + turn * np.cross(axis, force)
        found = hinged.respond(frequency, body)
        np.testing.assert_allclose(found.turn_rad, turn, rtol=0, atol=2e-3)
        np.testing.assert_allclose(found.force_N, exact, rtol=0, atol=1e-2 * abs(K).max())


@pytest.mark.ranks
@pytest.mark.parametrize("sticks", [False, True])
def test_slowly_it_is_the_difference_of_steps_with_the_body_a_little_off(sticks):
    """Also of a body that turns against the bone: the contact's linearization is exact."""
    problem = sphere_on_block(uniform(C10, D1), layers=TWO_TISSUES)
    friction, place = problem.contact.friction.coefficient, np.array([0.0, 0.0, 0.6])
    friction.value = 0.0
    follow(problem, *np.linspace(0, place, 7)[1:])
    if sticks:
        friction.value = 1e6
        place = place - [0.0, 0.01, 0.0]
        follow(problem, place)
    joint = Joint(
        stiffness_Nmm_rad=0.5, damping_Nmms_rad=0.0, mass_g=0.0, length_mm=4.0, height_mm=2.0
    )
    bone, accepted, rest = Bone(joint), problem.gather(), problem.state.force_old_N.copy()

    def loads(way: np.ndarray) -> np.ndarray:
        """Return force and moment on the joint, (4,), at a way of the body, mm, and a turn."""
        problem.restore(accepted)
        pose = bone.seen_from(Pose(place + way[:3], np.eye(3)), way[3])
        assert problem.solve(pose.translation, 0.01, pose.rotation).converged
        load = problem.load()
        moment = moment_about(joint.centre_mm, load.force_N, load.moment_Nmm)
        return np.append(load.force_N, moment[0])

    ways = 1e-6 * np.eye(4)
    K = np.column_stack([(loads(way) - loads(-way)) / 2e-6 for way in ways])
    problem.restore(accepted)
    K[:3, 3] += np.cross([1.0, 0.0, 0.0], rest)  # in space
    clamped, hinged = Harmonic(problem, 1e-9), Harmonic(problem, 1e-9, joint)
    for k, body in enumerate(np.eye(3)):
        found = clamped.respond(1e-4, body).force_N
        np.testing.assert_allclose(found, K[:3, k], rtol=0, atol=1e-5)
        turn = K[3, k] / (joint.stiffness_Nmm_rad - K[3, 3])
        answer = hinged.respond(1e-4, body)
        np.testing.assert_allclose(answer.turn_rad, turn, rtol=0, atol=1e-5)
        np.testing.assert_allclose(answer.force_N, K[:3] @ [*body, turn], rtol=0, atol=1e-5)


@pytest.mark.ranks
def test_a_stiff_joint_is_a_clamp_and_a_far_one_a_spring_in_series():
    problem = touched(block(tissue(relaxes=False), 0, layers=4))
    clamped = Harmonic(problem, DENSITY).respond(30.0, [0.0, 0.0, 1.0])
    stiff = Harmonic(problem, DENSITY, Joint(stiffness_Nmm_rad=1e9))
    np.testing.assert_allclose(stiff.respond(30.0, [0, 0, 1.0]).force_N, clamped.force_N, rtol=1e-6)
    far = Joint(stiffness_Nmm_rad=1e6, damping_Nmms_rad=0.0, length_mm=1e4, mass_g=0.0)
    found = Harmonic(problem, 1e-9, far).respond(1e-3, [0.0, 0.0, 1.0]).force_N[2]
    alone = Harmonic(problem, 1e-9).respond(1e-3, [0.0, 0.0, 1.0]).force_N[2]
    spring = far.stiffness_Nmm_rad / far.length_mm**2
    np.testing.assert_allclose(found, 1 / (1 / alone + 1 / spring), rtol=1e-3)


def test_whatever_breaks_in_a_vibration_the_state_stays_that_of_the_scan():
    """Also where cells are so distorted that strains linear in them are none."""
    problem = sphere_on_block(relaxing(viscous_time_s=NO_VISCOSITY_S), layers=TWO_TISSUES)
    tissues_form = problem.contact.obstacle.compile(problem.bulk.residual(problem.test))
    for depth in np.linspace(0, 1.2, 25)[1:]:
        assert problem.solve(np.array([0.0, 0.0, depth]), 0.01).converged
        tissues = fem.assemble_vector(tissues_form).array.copy()
        problem.accept()
    vibrating = Harmonic(problem, DENSITY)
    largest = np.abs(tissues).max()
    for delay in (None, *vibrating.delays):
        vibrating.freeze(delay)
        found = fem.assemble_vector(tissues_form).array
        np.testing.assert_allclose(found, tissues, rtol=0, atol=1e-9 * largest)
    assert np.isfinite(vibrating.respond(100.0, [0.0, 0.0, 1.0]).force_N).all()


@pytest.mark.parametrize(
    ("axis", "friction"), [(0, 0.5), pytest.param(2, 0.0, marks=pytest.mark.slow)]
)
def test_a_slow_and_small_motion_of_a_body_in_time_gives_the_same(axis, friction):
    steps, period_s = 32, 0.1
    short = {"g": (0.2, 0.2), "tau_s": (0.01, 0.004)}
    made = relaxing(viscous_time_s=NO_VISCOSITY_S, **short)
    problem = sphere_on_block(made, layers=TWO_TISSUES)

    def force(place: np.ndarray) -> float:
        return follow(problem, place, dt_s=period_s / steps).force_N[axis]

    def set_friction(value: float) -> None:
        problem.contact.friction.coefficient.value = value

    place, along = np.array([0.0, 0.0, 0.3]), np.eye(3)[axis]
    set_friction(0.0)  # at first: all of the skin then sticks
    for share in np.linspace(0, 1, 7)[1:]:  # in one step Newton's method may get lost
        force(share * place)
    set_friction(friction)
    for _ in range(29):
        force(place)
    phases = 2 * np.pi * np.arange(1, 2 * steps + 1) / steps
    held, found = problem.gather(), []
    for amplitude in (1e-4, -1e-4):  # their difference does not drift
        problem.restore(held)
        forces = [force(place + amplitude * np.sin(phase) * along) for phase in phases]
        found.append(2j / steps * (np.exp(-1j * phases) * forces)[-steps:].sum() / amplitude)
    problem.restore(held)
    in_space = Harmonic(problem, 1e-6).respond(1 / period_s, along)
    np.testing.assert_allclose(np.mean(found), in_space.force_N[axis], rtol=0.02)
