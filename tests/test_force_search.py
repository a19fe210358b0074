"""The search for a force needs no finite element."""

from __future__ import annotations

import math
import re

import pytest

from tactile_fem.simulation.control import TOLERANCE, ForceSearch


def sought(law, force_N=0.4, z_mm=0.3, stiffness_N_mm=0.5) -> ForceSearch:
    search = ForceSearch(force_N, z_mm, stiffness_N_mm, most_mm=0.1)
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
    ((width, at),) = re.findall(r"jumps within (\S+) mm at a depth of (\S+) mm", search.reason)
    assert float(at) == pytest.approx(where, abs=float(width) + 1e-4) and float(width) < 0.01


def test_a_steep_force_is_no_jump():
    """Nearly met at first: the other end of the bracket is far from it."""
    search = sought(lambda z: 0.3999 + 0.2 * z - 0.1 + 200 * max(z - 0.5, 0.0), z_mm=0.499)
    assert not search.has_failed and search.solves < 8


@pytest.mark.parametrize(("force", "side"), [(0.1, "less"), (0.9, "more")])
def test_a_force_that_does_not_change_is_given_up(force, side):
    search = sought(lambda z: force)
    assert search.solves == 12
    assert f"it is still {side} at a depth of" in search.reason
