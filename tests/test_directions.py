"""SA2 afferents feel stretch along directions of their own; half of them fire at rest."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from needs import needs_gmsh
from test_receptors import layered_block, problem_of

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import TISSUES
from tactile_fem.finger.simplex import distances
from tactile_fem.neuron import Population, drive_of, fields_of, fire_all, respond
from tactile_fem.neuron.fields import RIGHT_CAUCHY_GREEN
from tactile_fem.receptors import Layout, place, sample
from tactile_fem.receptors.placement import preferred_directions
from tactile_fem.results.trace import Trace
from tactile_fem.simulation.probe import Probe
from tactile_fem.study import Finger, Receptors, Study

STRETCH = drive_of("directed_stretch")


def afferents(**neuron: float) -> Population:
    kind = {"name": "SA2", "kind": "SA2", "neuron": neuron}
    return Study.model_validate({"afferents": [kind]}).populations[0].population()


def histories(*rows: list[float], count: int = 1) -> dict[str, np.ndarray]:
    """Return the histories of receptors that are stretched along X, in turn, for a second each."""
    C = np.tile(RIGHT_CAUCHY_GREEN.at_rest(count), (len(rows), 1, 1))
    C[..., 0] = np.square(rows)
    return {
        "time_s": np.arange(len(rows), dtype=float),
        "right_cauchy_green": C,
        "directions": np.tile([1.0, 0.0, 0.0], (count, 1)),
    }


@pytest.mark.ranks
def test_a_block_is_stretched_along_directions_whatever_turns_it():
    finger = layered_block()
    problem = problem_of(finger)
    wanted = Receptors(half_width_mm=1, spacing_mm=0.5)
    layout = Layout.of(wanted, finger, "SA2")
    fields = fields_of([afferents()])
    probe = Probe(problem, layout.samples, len(layout.positions_mm), fields)
    directions = np.array([[1, 0, 0], [0, 1, 0], [0.6, 0.8, 0], [0, 0, 1], [-0.6, -0.8, 0]])
    stretch = np.diag([0.8, 1.1, 1.05])
    shear = np.array([[1.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    turned = Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix()
    for F in (stretch, turned @ stretch, shear @ stretch, turned @ shear @ stretch):
        problem.u.interpolate(lambda x, F=F: (F - np.eye(3)) @ x)
        felt = probe.read().right_cauchy_green
        trace = {"time_s": np.arange(2.0), "directions": directions}
        _, value = STRETCH.of(trace | {"right_cauchy_green": np.array([felt, felt])})
        expected = np.linalg.norm(directions @ F.T, axis=1) - 1
        np.testing.assert_allclose(value, [expected, expected], atol=1e-12)
    assert expected[0] < 0 < expected[1]


def test_directions_are_drawn_evenly_and_do_not_depend_on_the_others():
    finger = Finger().mesh()
    positions = place(Receptors(placement="random", region="phalanx", count=3000), finger)
    found = preferred_directions(1, positions, finger)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    np.testing.assert_array_equal(found[:10], preferred_directions(1, positions[:10], finger))
    assert not np.any(np.all(np.isclose(found, preferred_directions(2, positions, finger)), 1))
    below = np.abs(positions[:, :2]).max(axis=1) < 2  # and from above, also about level
    assert np.abs(found[below, 2]).max() < 0.5
    angle = np.arctan2(found[below, 1], found[below, 0])
    counts, _ = np.histogram(angle, bins=4, range=(-np.pi, np.pi))
    assert counts.min() > 0.7 * counts.mean()


@needs_gmsh
@pytest.mark.parametrize("plane", ["sagittal", "transverse"])
def test_in_a_section_directions_lie_in_its_plane(plane):
    study = Study.model_validate({"finger": {"kind": "section", "plane": plane}})
    found = study.lay_out(study.finger.mesh()).directions
    across = 0 if plane == "sagittal" else 1
    np.testing.assert_allclose(found[:, across], 0.0, atol=1e-12)
    both = found[:, 1 - across]
    assert both.min() < -0.5 and both.max() > 0.5


def test_a_trace_keeps_directions_and_fires_again_from_what_is_saved():
    finger, population = layered_block(), afferents()
    receptors = Receptors(half_width_mm=1.5, spacing_mm=0.5)
    one = Layout.of(receptors, finger, "SA2")
    other = Layout.of(receptors.model_copy(update={"seed": 2}), finger, "SA1")
    layout = Layout.joined([other, one])
    np.testing.assert_array_equal(layout.directions, [*other.directions, *one.directions])
    fields = fields_of([population])
    trace = Trace(
        layout.positions_mm, layout.population, fields=fields, directions=layout.directions
    )
    saved = trace.arrays()
    np.testing.assert_array_equal(Trace.read(saved).directions, layout.directions)
    still = {name: np.repeat(saved[name], 2, axis=0) for name in ("sed_kPa", "right_cauchy_green")}
    fixed = {name: saved[name] for name in ("population", "directions")}
    fired = fire_all(
        [population, Population("SA1")], {"time_s": np.array([0.0, 2.0])} | still | fixed
    )
    alone = {name: values[..., 7:, :] for name, values in still.items() if name != "sed_kPa"}
    own = population.fire({"time_s": np.array([0.0, 2.0]), "directions": one.directions} | alone)
    assert fired.counts()[:7].tolist() == [0] * 7 and own.counts().sum() > 0
    np.testing.assert_array_equal(fired.counts()[7:], own.counts())
    with pytest.raises(StudyError, match="Directed stretch - 1: the histories have no directions"):
        population.fire({name: saved[name] for name in ("time_s", "right_cauchy_green")})


def test_half_of_them_fire_without_a_load_and_steadily():
    population = afferents(threshold_noise=0.0)
    at_rest = histories([1.0], [1.0], [1.0], [1.0], count=1000)
    found = [one.fire(at_rest) for one in (population, population.held(60.0))]
    found.append(respond(at_rest["time_s"], np.zeros((4, 1000)), population.neuron))
    for fired in found:
        firing = fired.counts() > 0
        assert firing.mean() == pytest.approx(0.5, abs=0.04)
        assert max(np.ptp(np.diff(each)) for each in fired.spikes if len(each) > 1) < 1e-9
        rates = fired.mean_rate(1.0, 3.0)[firing]
        assert 5 < np.median(rates) < 20 and rates.max() < 40
    assert afferents().fire(at_rest).counts().tolist() != found[0].counts().tolist()
    some = population.fire(histories([1.0], [1.0], [1.0], [1.0], count=3), units=[5, 7, 2])
    np.testing.assert_array_equal(some.counts(), found[0].counts()[[5, 7, 2]])


def test_stretch_excites_and_shortening_silences():
    population = afferents(resting_spread_pA=0.0, resting_pA=22.0, threshold_noise=0.0)
    changing = histories([1.0], [1.0], [1.1], [1.1], [0.9], [0.9])
    counts = population.fire(changing).psth(1.0)[1][:, 0]
    assert counts[2] > 1.5 * counts[0] > 0 and counts[4] == 0


def test_the_nails_border_lies_around_the_nail():
    finger = Finger().mesh()
    wanted = {"placement": "afferents", "region": "nail_border", "below_skin_mm": 1.2}
    receptors = Receptors.model_validate(wanted | {"side": "dermis", "density_per_cm2": 40.0})
    positions = place(receptors, finger)
    np.testing.assert_array_equal(positions, place(receptors, finger))
    nail = finger.nodes[np.unique(finger.cells[finger.tissue == TISSUES["nail"]])]
    from_nail = np.linalg.norm(positions[:, None] - nail, axis=2).min(axis=1)
    assert from_nail.max() < np.hypot(3.0, 1.2) + 0.2
    assert distances(positions, finger.corners_of("skin")) == pytest.approx(1.2, abs=0.3)
    # Of the border on both sides, before the nail and behind it.
    assert positions[:, 0].min() < -5 and positions[:, 0].max() > 5
    assert positions[:, 1].min() < -2 and positions[:, 1].max() > 9
    assert len(sample(receptors, positions, finger).weight) > len(positions)
    with pytest.raises(StudyError, match='"nail_border": the finger has no nail'):
        place(receptors, layered_block())
    narrow = receptors.model_copy(update={"nail_border_mm": 1e-6})
    with pytest.raises(StudyError, match="nail_border_mm = 1e-06: no skin lies so close"):
        place(narrow, finger)


def test_a_phalanx_has_as_many_receptors_as_wanted_on_all_its_sides():
    finger = Finger().mesh()
    wanted = Receptors(placement="random", region="phalanx", count=2000)
    positions = place(wanted, finger)
    assert len(positions) == 2000
    on_interface = distances(positions, finger.corners_of("interface"))
    assert on_interface.max() < 1e-6
    low, high = positions.min(axis=0), positions.max(axis=0)
    assert np.all(low < [-6.5, -13, 1]) and np.all(high > [6.5, 10.5, 8])
    assert high[2] < 13  # none on the back
    dense = wanted.model_copy(update={"count": None, "density_per_cm2": 20.0})
    edges = np.diff(finger.corners_of("skin"), axis=1)
    doubled = np.cross(edges[:, 0], edges[:, 1])
    size = np.linalg.norm(doubled, axis=1)
    area_cm2 = size[doubled[:, 2] < 0.5 * size].sum() / 200
    assert len(place(dense, finger)) == pytest.approx(20 * area_cm2, rel=0.1)


@pytest.mark.ranks
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="runs on several ranks")
def test_several_ranks_draw_the_same_directions():
    from tactile_fem.simulation.simulation import Simulation

    study = Study.model_validate(
        {
            "finger": {"pad_size_mm": 3.0, "far_size_mm": 6.0},
            "stimulus": {"kind": "plate"},
            "afferents": [{"name": "SA2", "kind": "SA2"}],
        }
    )
    several, one = (Simulation(study, comm=comm).layout for comm in (MPI.COMM_WORLD, MPI.COMM_SELF))
    np.testing.assert_array_equal(several.directions, one.directions)
