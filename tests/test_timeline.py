"""Histories at the times of pictures and frames."""

import numpy as np
import pytest

from tactile_fem.output.timeline import at_time

TRACE = {
    "time_s": np.array([0.0, 1.0, 3.0]),
    "displacement_mm": np.array([0.0, 2.0, 6.0]),
    "stimulator_mm": np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [6.0, 4.0, 1.0]]),
}


@pytest.mark.parametrize("times", [2.0, [0.5, 2.0, 3.0], np.array([[0.0], [1.0]])])
@pytest.mark.parametrize("name", ["displacement_mm", "stimulator_mm"])
def test_histories_are_linear_between_their_times(name, times):
    exact = {"displacement_mm": 2 * np.asarray(times)}
    across = np.maximum(0, np.asarray(times) - 1) * 2
    exact["stimulator_mm"] = np.array(
        [exact["displacement_mm"], across, np.ones_like(across, dtype=float)]
    )
    found = at_time(TRACE, name, times)
    assert found.shape == exact[name].shape
    np.testing.assert_allclose(found, exact[name], atol=1e-14)
