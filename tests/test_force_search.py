"""The search for a force needs no finite element."""

from __future__ import annotations

import math

import pytest

from tactile_fem.mechanics.force_search import TOLERANCE, ForceSearch


def sought(law, force_N=0.4, z_mm=0.3, stiffness_N_mm=0.5) -> ForceSearch:
    search = ForceSearch(force_N, z_mm, stiffness_N_mm, most_mm=0.1, least_mm=5e-4)
    while not (search.is_met(law(search.z_mm)) or search.has_failed):
        pass
    return search


@pytest.mark.parametrize("stiffness_N_mm", [0.05, 0.5, 5.0, 500.0])
@pytest.mark.parametrize(
    "law", [lambda z: z, lambda z: max(z, 0.0) ** 1.5, lambda z: math.expm1(5 * z) / 10]
)
def test_a_force_that_grows_with_the_depth_is_met(law, stiffness_N_mm):
    search = sought(law, stiffness_N_mm=stiffness_N_mm)
    assert law(search.z_mm) == pytest.approx(0.4, rel=TOLERANCE)
    assert search.solves <= 12


def test_a_force_that_jumps_is_known_to(where=0.337):
    search = sought(lambda z: 0.1 if z < where else 0.9)
    assert search.has_failed
    assert search.below_mm < where <= search.above_mm
    assert search.above_mm - search.below_mm < 5e-4
    assert "it jumps between depths of 0.336" in search.reason


@pytest.mark.parametrize(("force", "side"), [(0.1, "less"), (0.9, "more")])
def test_a_force_that_does_not_change_is_given_up(force, side):
    search = sought(lambda z: force)
    assert search.solves == 12
    assert f"it is still {side} at a depth of" in search.reason
