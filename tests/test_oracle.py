"""What short scans of all kinds compute, beside what they computed before: see `oracle.py`."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import oracle
import pytest

# Other processors and ranks round otherwise: by 1e-10 of the largest value (-O1 beside -O3).
SHARE = 1e-9
BEFORE = oracle.stored(Path(__file__).parent / "oracle.npz")

pytestmark = pytest.mark.slow
computed = cache(oracle.computed)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=pytest.mark.needs_gmsh) if case in oracle.NEED_GMSH else case
        for case in oracle.CASES
    ],
)
def test_what_a_scan_computes_stays(case):
    assert oracle.differing(computed(case), BEFORE[case], SHARE) == []


# Not those that seek loads: rounding changes their iterations, and these the length of steps.
@pytest.mark.ranks
@pytest.mark.parametrize("case", ["slide", "relaxation", "friction"])
def test_two_ranks_compute_what_one_does(case):
    assert oracle.differing(computed(case), BEFORE[case], SHARE) == []


@pytest.mark.parametrize("case", ["slide", "push", "inertia", "relaxation"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_a_scan_that_goes_on_after_any_step_is_the_same_in_every_bit(case, share):
    steps = len(BEFORE[case]["time_s"]) - 1
    whole, continued = computed(case), computed(case, max(1, int(share * steps)))
    assert oracle.differing(continued, whole, 0.0) == []


def test_a_difference_is_said():
    then = {"force_N": np.ones(3), "phase": np.array(["press"]), "sed_kPa": np.ones(2)}
    now = {"force_N": np.array([1, 1, 1 + 1e-6]), "phase": np.array(["slide"])}
    assert oracle.differing(now, then, 1e-7) == [
        "sed_kPa is there only once",
        "force_N: differs by 1e-06, largest 1",
        "phase differs",
    ]
