"""Derivatives from the tangent, against scans of a block with changed constants."""

from math import exp

import numpy as np
import pytest
from materials import PROPOSED, RELAXING
from sphere_on_block import PRESS_AND_SLIDE, TWO_TISSUES, follow, sphere_on_block

from tactile_fem.calibration.sensitivity import Sensitivities
from tactile_fem.study import Tissue

# Modulus and inverse of a bulk modulus; a law's own terms and viscosity's modulus change with them.
CHANGES = (
    {("subcutaneous", "C20_MPa"): 1.0, ("subcutaneous", "D1_per_MPa"): -1.0},
    {("stratum_corneum", "C10_MPa"): 1.0},
)
STEP = 1e-3


def changed(tissue: Tissue, change: dict[tuple[str, str], float], x: float) -> Tissue:
    data = tissue.model_dump(exclude_none=True)
    for (layer, name), power in change.items():
        data[layer][name] *= exp(power * x)
    return Tissue.model_validate(data)


def run(tissue: Tissue, changes=()) -> tuple[np.ndarray, np.ndarray]:
    """Return force and stored energy after each step, and their derivatives."""
    values, derivatives = [], []
    # Steps of half the skin's thickness, in which the contact zone takes long to be found.
    problem = sphere_on_block(tissue, layers=TWO_TISSUES, petsc={"snes_max_it": 60})
    sensitivities = Sensitivities(problem, changes)

    def read() -> np.ndarray:
        load = problem.load()
        return np.append(load.force_N, load.stored_mJ)

    for place in PRESS_AND_SLIDE:
        follow(problem, place)
        sensitivities.follow()
        with problem.reopened():
            values.append(read())
        derivatives.append(sensitivities.derivative(read))
    return np.array(values), np.array(derivatives)


@pytest.mark.ranks
@pytest.mark.parametrize("tissue", [PROPOSED, RELAXING], ids=["viscous", "relaxing"])
def test_press_and_slide_with_friction(tissue):
    """Histories pass the derivatives from step to step: where the skin stuck, how it relaxes."""
    values, found = run(tissue, CHANGES)
    np.testing.assert_allclose(run(tissue)[0], values, rtol=1e-6, atol=1e-8)
    for i, change in enumerate(CHANGES):
        more, less = (run(changed(tissue, change, x))[0] for x in (STEP, -STEP))
        wanted = (more - less) / (2 * STEP)
        scale = np.abs(wanted).max(axis=0)
        large = scale > 1e-5  # the force across the slide is not
        assert large[1:].all(), scale
        found_i, wanted = (x[:, large] / scale[large] for x in (found[:, i], wanted))
        np.testing.assert_allclose(found_i, wanted, atol=2e-3)
