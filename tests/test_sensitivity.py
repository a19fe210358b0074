"""Derivatives from the tangent, against scans with changed constants."""

from contextlib import closing
from math import exp

import numpy as np
import pytest

from tactile_fem.calibration.sensitivity import Sensitivities
from tactile_fem.simulation.simulation import Simulation
from tactile_fem.study import Finger, Protocol, Receptors, Solver, Sphere, Study, Tissue

# Modulus and inverse of a bulk modulus; a law's own terms and viscosity's modulus change with them.
CHANGES = (
    {("subcutaneous", "C20_MPa"): 1.0, ("subcutaneous", "D1_per_MPa"): -1.0},
    {("dermis", "C10_MPa"): 1.0},
)
STEP = 1e-3


def pressed_and_slid(relaxation: str) -> Study:
    return Study(
        tissue=Tissue.model_validate({"relaxation": relaxation}),
        finger=Finger(pad_size_mm=3.0, far_size_mm=6.0),
        stimulus=Sphere(radius_mm=4.0),
        protocol=Protocol(depth_mm=0.5, distance_mm=0.1),
        receptors=Receptors(half_width_mm=0.0),
        solver=Solver(
            first_step_mm=0.25,
            max_press_step_mm=0.25,
            first_slide_step_mm=0.05,
            petsc={"snes_atol": 1e-11},  # differences of scans are taken
        ),
    )


def changed(study: Study, change: dict[tuple[str, str], float], x: float) -> Study:
    data = study.model_dump(exclude_none=True)
    for (tissue, name), power in change.items():
        data["tissue"][tissue][name] *= exp(power * x)
    return Study.model_validate(data)


def run(study: Study, changes=()) -> tuple[np.ndarray, np.ndarray]:
    """Return force and SED after each step, and their derivatives."""
    values, derivatives = [], []
    with closing(Simulation(study)) as simulation:
        sensitivities = Sensitivities(simulation.problem, changes)

        def read():
            return np.append(simulation.load().force_N, simulation.receptors.read().sed_kPa)

        for _ in simulation.steps():
            sensitivities.follow()
            derivatives.append(sensitivities.derivative(read))
            values.append(read())
    return np.array(values), np.array(derivatives)


@pytest.mark.ranks
@pytest.mark.parametrize("relaxation", [pytest.param("none", marks=pytest.mark.slow), "fingerpad"])
def test_press_and_slide_with_friction(relaxation):
    """Memories pass the derivatives from step to step: where the skin stuck, how it relaxes."""
    study = pressed_and_slid(relaxation)
    values, found = run(study, CHANGES)
    np.testing.assert_allclose(run(study)[0], values, rtol=1e-6, atol=1e-8)
    for i, change in enumerate(CHANGES):
        more, less = (run(changed(study, change, x))[0] for x in (STEP, -STEP))
        wanted = (more - less) / (2 * STEP)
        scale = np.abs(wanted).max(axis=0)
        np.testing.assert_allclose(found[:, i] / scale, wanted / scale, atol=2e-3)
        assert scale[2] > 2e-4 and scale[1] > 1e-4  # both forces do depend on them
