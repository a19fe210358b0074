"""Receptors lie on the interface and average what is there."""

from __future__ import annotations

from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
import ufl
from scipy.spatial.distance import pdist
from trimesh.triangles import closest_point

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from blocks import block_mesh, curved

from tactile_fem.assembly.compile import expression
from tactile_fem.errors import StudyError
from tactile_fem.finger import SURFACES
from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.finger.simplex import facets_of
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.neuron import (
    DRIVES,
    Drive,
    Field,
    Population,
    fields_of,
    fire_all,
)
from tactile_fem.receptors import place, sample
from tactile_fem.results.trace import Trace
from tactile_fem.simulation.cell_fields import CellFields
from tactile_fem.simulation.probe import Probe
from tactile_fem.simulation.simulation import Simulation
from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Finger, Plate, Receptors, Solver, Study, Tissue

DEPTHS = np.array([0.0, 0.5, 1.0, 2.0])


def layered_block() -> FingerMesh:
    """A block whose interface, at z = 1, is tagged."""
    line = np.linspace(-2, 2, 5)
    finger = block_mesh(line, line, DEPTHS, ["stratum_corneum", "epidermis", "dermis"])
    facets, _, _ = facets_of(finger.cells)
    face = facets[np.all(np.isclose(finger.nodes[facets][..., 2], 1.0), axis=1)]
    triangles = np.concatenate([finger.facets, np.hstack([face, face])])
    surface = np.concatenate([finger.surface, np.full(len(face), SURFACES["interface"])])
    return FingerMesh(finger.nodes, finger.cells, finger.tissue, triangles, surface)


def problem_of(finger: FingerMesh, comm: MPI.Comm = MPI.COMM_WORLD) -> FingerProblem:
    domain = create_domain(finger, comm, ("cut",))
    tissue, settings = Tissue.model_validate({}), Solver(held=("cut",))
    return FingerProblem(domain, tissue, Plate().body(), 0.3, settings)


def test_line_lies_on_the_fingers_interface():
    finger = Finger().mesh()
    positions = place(Receptors(), finger)
    assert len(positions) == 51
    np.testing.assert_allclose(positions[:, 0], np.linspace(-5, 5, 51), atol=1e-12)
    facets = finger.corners_of("interface")
    for point in positions:
        nearest = closest_point(facets, np.tile(point, (len(facets), 1)))
        assert np.linalg.norm(nearest - point, axis=1).min() < 1e-6
    # The nominal depth of stratum corneum and epidermis.
    assert positions[25, 2] == pytest.approx(0.82, rel=0.05)


@pytest.mark.parametrize("placement", ["grid", "random"])
def test_placements_are_reproducible_and_within_their_extent(placement):
    finger = Finger().mesh()
    wanted = Receptors(placement=placement, half_width_mm=3, half_length_mm=2, spacing_mm=1)
    positions = place(wanted, finger)
    np.testing.assert_array_equal(positions, place(wanted, finger))
    assert np.all(np.abs(positions[:, :2]) <= [3, 2])
    assert len(positions) == (35 if placement == "grid" else round(70 * 0.24))


def test_afferents_have_their_density_on_the_interface_and_keep_apart():
    finger = Finger().mesh()
    wanted = Receptors(placement="afferents", half_width_mm=5, half_length_mm=4, seed=3)
    positions = place(wanted, finger)
    np.testing.assert_array_equal(positions, place(wanted, finger))
    assert np.all(np.abs(positions[:, :2]) <= [5, 4])
    # Across, the interface has a radius of about 7.2 mm: the arc over 10 mm is 11.0 mm long.
    assert len(positions) == pytest.approx(0.70 * 8 * 2 * 7.2 * np.arcsin(5 / 7.2), rel=0.03)
    # Beside the apex the interface is steep: there are more receptors per mm of X.
    beside = np.abs(positions[:, 0]) > 2.5
    assert beside.sum() > (~beside).sum()
    assert pdist(positions).min() >= 0.95 * 7.5 / np.sqrt(70)
    other = place(wanted.model_copy(update={"seed": 4}), finger)
    assert not np.array_equal(other[0], positions[0])
    more = place(wanted.model_copy(update={"extra_mm": ((0.0, 0.0),)}), finger)
    assert len(more) == len(positions) + 1 and np.all(more[-1, :2] == 0)


@pytest.mark.ranks
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="runs on several ranks")
def test_several_ranks_place_the_same_afferents():
    """Where an afferent lies is drawn by chance."""
    study = Study(
        finger=Finger(pad_size_mm=3.0, far_size_mm=6.0),
        stimulus=Plate(),
        receptors=Receptors(placement="afferents"),
    )
    several, one = (Simulation(study, comm=comm) for comm in (MPI.COMM_WORLD, MPI.COMM_SELF))
    placed = [simulation.layout.positions_mm for simulation in (several, one)]
    np.testing.assert_array_equal(*placed)
    with closing(several):
        next(several.steps())
        felt = several.receptors.read().sed_kPa
    assert len(felt) == len(placed[0]) and felt.max() > 0


def test_a_receptor_outside_the_finger_is_named():
    with pytest.raises(StudyError, match=r"X 30, Y 0 mm lies outside"):
        place(Receptors(extra_mm=((30.0, 0.0),)), Finger().mesh())


def test_samples_lie_in_the_wanted_tissue_within_the_ball():
    finger = layered_block()
    wanted = Receptors(half_width_mm=1, spacing_mm=1, average_radius_mm=0.25)
    positions = place(wanted, finger)
    samples = sample(wanted, positions, finger)
    assert np.all(finger.tissue[samples.cell] == 2)
    assert np.all(samples.point[:, 2] <= 1.0)
    reach = np.linalg.norm(samples.point - positions[samples.receptor], axis=1)
    assert reach.max() <= 0.25
    np.testing.assert_allclose(np.bincount(samples.receptor, samples.weight), 1.0)


def test_end_organs_share_a_receptors_mean():
    finger = layered_block()
    wanted = Receptors(half_width_mm=0, average_radius_mm=0, end_organs=5, end_organs_radius_mm=0.5)
    samples = sample(wanted, place(wanted, finger), finger)
    expected = [(0, 0), (0.5, 0), (0, 0.5), (-0.5, 0), (0, -0.5)]
    np.testing.assert_allclose(samples.point[:, :2], expected, atol=1e-12)
    np.testing.assert_allclose(samples.point[:, 2], 1.0)
    np.testing.assert_allclose(samples.weight, 0.2)
    balls = wanted.model_copy(update={"average_radius_mm": 0.25})
    samples = sample(balls, place(balls, finger), finger)
    np.testing.assert_allclose(samples.weight @ samples.point[:, :2], [0, 0], atol=1e-12)
    np.testing.assert_allclose(samples.weight.sum(), 1.0)
    far = wanted.model_copy(update={"end_organs_radius_mm": 9.0})
    with pytest.raises(StudyError, match="lies outside the finger"):
        sample(far, place(far, finger), finger)


@pytest.mark.ranks
@pytest.mark.parametrize("radius", [0.0, 0.25])
def test_probe_reads_a_homogeneous_state_exactly(radius):
    finger = layered_block()
    problem = problem_of(finger)
    wanted = Receptors(half_width_mm=1, spacing_mm=1, average_radius_mm=radius)
    positions = place(wanted, finger)
    tissue = Tissue.model_validate({})
    stretch, before = np.array([0.8, 1.1, 1.05]), np.array([0.9, 1.05, 1.0])
    for u, now in ((problem.u, stretch), (problem.state.u_before, before)):
        u.interpolate(lambda x, now=now: (now - 1)[:, None] * x)
    problem.state.time_step.value = 0.005
    probe = Probe(problem, sample(wanted, positions, finger), len(positions))
    felt = probe.read()
    J = stretch.prod()
    c = tissue.epidermis
    a = J ** (-2 / 3) * (stretch**2).sum() - 3
    energy = c.C10_MPa * a + c.C30_MPa * a**3 + (J - 1) ** 2 / c.D1_per_MPa
    np.testing.assert_allclose(felt.sed_kPa, 1000 * energy, rtol=1e-9)
    np.testing.assert_allclose(felt.stretches, np.tile(np.sort(stretch), (3, 1)), rtol=1e-9)
    slope = c.C10_MPa + 3 * c.C30_MPa * a**2
    elastic = 2 * slope * J ** (-5 / 3) * stretch**2
    # Kelvin and Voigt's: F S F^T / J with S = 2 G tau dE/dt.
    viscous = 2 * c.C10_MPa * tissue.viscous_time_s * (stretch**2 - before**2) / 0.005
    cauchy = elastic + stretch**2 * viscous / J
    von_mises = 1000 * np.sqrt(1.5 * ((cauchy - cauchy.mean()) ** 2).sum())
    np.testing.assert_allclose(felt.von_mises_kPa, von_mises, rtol=1e-9)
    # The volume's part of the energy gives 2 (J - 1) / D1, which no deviator has.
    mean = 2 * (J - 1) / c.D1_per_MPa + viscous @ stretch**2 / J / 3
    stresses = 1000 * (elastic - elastic.mean() + stretch**2 * viscous / J)
    stresses += 1000 * mean - stresses.mean()
    np.testing.assert_allclose(felt.stresses_kPa, np.tile(np.sort(stresses), (3, 1)), rtol=1e-8)
    cells = problem.domain.comm.bcast(CellFields(problem).gather())
    cells = {name: of[finger.tissue == 2] for name, of in cells.items()}
    np.testing.assert_allclose(cells["sed_kPa"], 1000 * energy, rtol=1e-9)
    expected = np.tile([*stresses, 0.0, 0.0, 0.0], (len(cells["sed_kPa"]), 1))
    np.testing.assert_allclose(cells["stress_kPa"], expected, atol=1e-8 * np.abs(stresses).max())


def test_a_drive_with_a_field_of_its_own_is_one_file(monkeypatch):
    """Named in a study, it reaches probe, trace and spikes with no other edit."""

    def strain(point):
        F = point.deformation_gradient
        return (F.T * F - ufl.Identity(3)) / 2

    def largest_shear(E):
        low, _, high = np.linalg.eigvalsh(E).T
        return (high - low) / 2

    shear = Field("shear_strain", strain, of_mean=largest_shear)
    tension = Field("mean_stress_kPa", lambda point: 1000 * ufl.tr(point.cauchy_MPa) / 3)
    for field, unit in ((shear, "1"), (tension, "kPa")):
        name = field.name
        drive = Drive(name, unit, lambda h, name=name: h[name], fields=(field,))
        monkeypatch.setitem(DRIVES, name, drive)
    gain = {"static_gain_pA_per_kPa": 1e4}
    study = Study(
        afferents=(
            {"name": "RA", "feels": "shear_strain_rate", "neuron": gain},
            {"name": "SA1", "feels": "mean_stress_kPa"},
        )
    )
    populations = [afferents.population() for afferents in study.populations]
    finger = layered_block()
    problem = problem_of(finger)
    positions = place(Receptors(half_width_mm=1, spacing_mm=1), finger)
    samples = sample(Receptors(), positions, finger)
    probe = Probe(problem, samples, len(positions), fields_of(populations))
    names = np.array(["RA", "RA", "SA1"])
    trace = Trace(positions, names, fields=probe.fields)
    step = {name: column[0] for name, column in trace.arrays().items()} | {"indenting": True}
    for number, amount in enumerate((0.05, 0.15), 1):
        problem.u.interpolate(lambda x, a=amount: np.array([a * x[2], 0 * x[0], 0 * x[0]]))
        pressed = SimpleNamespace(**step | {"clock_s": 0.1 * number})
        trace(SimpleNamespace(step=pressed, columns=probe.read().columns))
    # The principal strains of simple shear, (a^2 ± a sqrt(a^2 + 4))/4.
    a = np.array([0.0, 0.05, 0.15])[:, None] * np.ones(3)
    np.testing.assert_allclose(trace.shear_strain, a * np.sqrt(a**2 + 4) / 4, atol=1e-12)
    assert trace.mean_stress_kPa.shape == trace.sed_kPa.shape == (3, 3)
    np.testing.assert_allclose(trace.mean_stress_kPa, trace.stresses_kPa.mean(axis=2), atol=1e-9)
    counts = fire_all(populations, trace.arrays()).counts()
    assert counts[0] == counts[1] > 0

    saved = trace.arrays()
    again = Trace(positions, names, fields=probe.fields)
    again.restore(saved, 2)
    np.testing.assert_array_equal(again.shear_strain, saved["shear_strain"][:2])
    del saved["shear_strain"]
    with pytest.raises(StudyError, match=r"it lacks columns shear_strain\."):
        again.restore(saved, 2)


def test_fields_have_names_of_their_own():
    felt = [Field("x", lambda point: point.energy_MPa) for _ in range(2)]
    drives = [Drive("Touch", "1", lambda h: h["x"], fields=(field,)) for field in felt]
    with pytest.raises(StudyError, match="Touch: there is another field x: choose another name"):
        fields_of([Population(feels=drive) for drive in drives])
    force = Field("force_N", lambda point: point.energy_MPa)
    with pytest.raises(StudyError, match="has a column force_N: choose another name for the"):
        Trace(np.zeros((1, 3)), np.array(["SA1"]), fields=(force,))


def test_probe_finds_its_points_in_a_curved_mesh():
    finger = curved(layered_block())
    wanted = Receptors(half_width_mm=1.2, spacing_mm=0.3, average_radius_mm=0.0)
    positions = place(wanted, finger)
    problem = problem_of(finger, MPI.COMM_SELF)
    probe = Probe(problem, sample(wanted, positions, finger), len(positions))
    # A field that is cubic in each cell is read exactly: so is the place itself.
    mesh = problem.domain.mesh
    place_of = expression(ufl.SpatialCoordinate(mesh), probe.nodes)
    places = place_of.eval(mesh, probe.cells).reshape(-1, 3)
    np.testing.assert_allclose(probe.weights @ places, positions, atol=1e-9)


def test_a_step_accepted_leaves_what_its_viscous_stress_needs():
    problem = problem_of(layered_block(), MPI.COMM_SELF)
    accepted = [problem.u.x.array.copy()]
    for depth in (0.05, 0.1):
        assert problem.solve(np.array([0.0, 0.0, depth]), 0.01).converged
        problem.accept()
        np.testing.assert_array_equal(problem.state.u_before.x.array, accepted[-1])
        accepted.append(problem.u.x.array.copy())
    assert np.abs(accepted[2] - accepted[1]).max() > 0.03
