"""The half-space against Hertz's theory; letters over half-spaces, coarsely."""

import numpy as np
import pytest
from boussinesq import HalfSpace
from half_space import Hertz, Scan, ShiftedLoad, drawn, half_spaces, table
from hamasaki2020_readings import CURVATURES, Finger

from tactile_fem import load_study
from tactile_fem.study import Cylinder

MODULUS_MPA, RADIUS_MM, DEPTH_MM = 0.06, 10.0, 0.5
CELL_MM = 0.5
STUDY = load_study("hamasaki2020")


def under_a_ball() -> tuple[HalfSpace, np.ndarray]:
    space = HalfSpace(MODULUS_MPA, (8.0, 6.0), 0.2)
    x, y = space.places_mm
    gap_mm = (x[:, None] ** 2 + y**2) / (2 * RADIUS_MM)
    return space, space.pressures_MPa(gap_mm, DEPTH_MM)


def test_under_a_ball_it_is_as_hertz_says():
    space, pressure = under_a_ball()
    plane, reach = MODULUS_MPA / 0.75, np.sqrt(RADIUS_MM * DEPTH_MM)
    force = 4 / 3 * plane * np.sqrt(RADIUS_MM) * DEPTH_MM**1.5
    assert space.force_N(pressure) == pytest.approx(force, rel=2e-3)
    largest = 2 * plane * reach / (np.pi * RADIUS_MM)
    assert pressure.max() == pytest.approx(largest, rel=2e-3)
    assert pressure.min() == 0
    x, y = space.places_mm
    assert (np.hypot(x[:, None], y)[pressure > 0]).max() == pytest.approx(reach, abs=0.2)


def test_strains_in_depth_are_those_of_the_theory():
    """On the axis, Johnson 1985, eq. 3.45, for Poisson's ratio 0.5."""
    space, pressure = under_a_ball()
    reach = np.sqrt(RADIUS_MM * DEPTH_MM)
    largest = 2 * MODULUS_MPA / 0.75 * reach / (np.pi * RADIUS_MM)
    middle = tuple(len(line) // 2 for line in space.places_mm)
    for depth in (0.5, 0.82, 2.0):
        z = depth / reach
        across = -1.5 * (1 - z * np.arctan(1 / z)) + 0.5 / (1 + z**2)
        difference = largest * (-1 / (1 + z**2) - across)
        exact = 1e3 * difference**2 / (2 * MODULUS_MPA)
        assert space.sed_kPa(pressure, depth)[middle] == pytest.approx(exact, rel=0.015)


def test_deflections_meet_the_relief_where_pressures_push():
    space, pressure = under_a_ball()
    x, y = space.places_mm
    left = DEPTH_MM - (x[:, None] ** 2 + y**2) / (2 * RADIUS_MM) - space.deflection_mm(pressure)
    assert abs(left[pressure > 1e-5]).max() < 1e-3
    assert left.max() < 1e-3


def test_on_flat_skin_the_middle_letter_carries_the_force_and_it_moves_along():
    trace = {
        "depth_mm": np.array([0.985, 1.97, 1.97]),
        "displacement_mm": np.array([0.0, 0.0, 5.0]),
        "receptors_mm": np.array([[-1.0, 0.0, 0.0], [1.5, 0.0, 0.0]]),
    }
    felt = ShiftedLoad(STUDY, MODULUS_MPA, 0.25).felt(trace)
    np.testing.assert_allclose(felt[0], felt[1] / 4)
    moved = STUDY.stimulus.model_copy(update={"shift_mm": (0.0, -5.0)})
    there = ShiftedLoad(STUDY.model_copy(update={"stimulus": moved}), MODULUS_MPA, 0.25)
    assert felt[2] == pytest.approx(there.felt(trace)[1], rel=0.25)  # other neighbours are cut off
    softer = ShiftedLoad(STUDY, MODULUS_MPA / 2, 0.25).felt(trace)
    np.testing.assert_allclose(softer, 2 * felt, rtol=1e-3)  # the force is given


def test_a_longer_pad_carries_more():
    finger = STUDY.finger.model_copy(update={"pad_radius_mm": 36.0})
    longer = STUDY.model_copy(update={"finger": finger})
    forces = [Hertz(one, MODULUS_MPA, CELL_MM).force_N(1.0) for one in (STUDY, longer)]
    assert forces[1] > 1.1 * forces[0]


def schedule(slid_mm: float) -> dict[str, np.ndarray]:
    slide = np.arange(0.0, slid_mm + 1e-9, 1.0)[1:]
    x = np.linspace(-4.0, 4.0, 9)
    return {
        "time_s": np.concatenate([[-0.0985, 0.0], slide / 20 if slid_mm else [0.5, 1.0]]),
        "depth_mm": np.concatenate([[0.0, 1.97], np.full(max(len(slide), 2), 1.97)]),
        "displacement_mm": np.concatenate([[0.0, 0.0], slide if slid_mm else [0.0, 0.0]]),
        "receptors_mm": np.column_stack([x, 0 * x, 0 * x]) if slid_mm else np.zeros((1, 3)),
        "population": np.full(len(x) if slid_mm else 1, "SA1"),
    }


def test_every_row_is_said_of_each_model_and_drawn():
    letters = schedule(10.0)
    bodies = {"letters": {}, "H": {}, "Q": {}, "letters+2": {"shift_mm": (2.0, 0.0)}}
    scans = {
        name: Scan(
            STUDY.model_copy(update={"stimulus": STUDY.stimulus.model_copy(update=values)}), letters
        )
        for name, values in bodies.items()
    }
    for curvature in CURVATURES:
        body = STUDY.model_copy(update={"stimulus": Cylinder(radius_mm=25.4 / curvature)})
        scans[f"cylinder-{curvature}"] = Scan(body, schedule(0.0))
    models = half_spaces(STUDY, scans, MODULUS_MPA, CELL_MM)
    finger = Finger(STUDY, dict(models["Hertz"].scans))
    finger.scans["friction_0.6"] = finger.scans["letters"]
    models = {"finger": finger, **models}
    rows = {row[""]: row for row in table(models)}
    assert all(row[name] for row in rows.values() for name in models)
    assert rows["friction 0.6"]["Hertz"] == "as with 0.3"
    assert rows["friction 0.6"]["finger"].endswith(
        rows["G, population: r with its outline"]["finger"]
    )
    assert rows["raster, r with the finger"]["Hertz"] == "1.00"
    assert len(drawn(models).axes) == 11
