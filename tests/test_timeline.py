"""Histories at the times of pictures and frames, and states by their places."""

import numpy as np
import pytest

from tactile_fem.errors import StudyError
from tactile_fem.results.histories import at_time, choose_state

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


# Two presses, a slide of 2 mm, a hold and a lift.
SLID_MM, TIMES_S = [0.0, 0.0, 2.0, 2.0, 2.0], [-0.1, 0.0, 0.1, 23.45678, 24.0]


@pytest.mark.parametrize(
    ("at_mm", "at_s", "number"), [(0, None, 1), (None, -0.1, 0), (0, -0.1, 0), (2, 23.4568, 3)]
)
def test_a_state_is_chosen_by_its_displacement_or_its_time(at_mm, at_s, number):
    assert choose_state(SLID_MM, TIMES_S, at_mm, at_s) == number


@pytest.mark.parametrize(
    ("at_mm", "at_s", "sentence"),
    [
        (2, None, r"has several states at 2 mm: choose one by its time, 0\.1, 23\.4568, 24 s\."),
        (1, None, r"has no state at 1 mm: states were kept at 0, 2 mm\."),
        (2, 0.3, r"has no state at 2 mm and 0\.3 s: states were kept at -0\.1, 0, 0\.1, 23"),
    ],
)
def test_a_state_that_cannot_be_chosen(at_mm, at_s, sentence):
    with pytest.raises(StudyError, match=sentence):
        choose_state(SLID_MM, TIMES_S, at_mm, at_s)
