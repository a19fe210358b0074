"""The skin's points against a block whose displacement is known."""

import numpy as np
import pytest
from blocks import block_mesh

from tactile_fem.errors import StudyError
from tactile_fem.finger import SkinSurface

GRID = np.linspace(-1, 1, 4)
PLACES = [(0.1, 0.2), (-0.9, 0.4), (1.0, -1.0), (1 / 3, 1 / 3)]


@pytest.fixture(scope="module")
def block():
    return block_mesh(GRID, GRID, np.array([0.5, 1.0, 2.0]), ["epidermis", "dermis"])


def test_points_lie_on_the_lower_side(block):
    points = SkinSurface(block, PLACES)
    np.testing.assert_allclose(points.rest_mm[:, :2], PLACES, atol=1e-14)
    np.testing.assert_allclose(points.rest_mm[:, 2], 0.5, atol=1e-14)


def test_a_quadratic_displacement_is_exact(block):
    def field(p):
        x, y, _ = p.T
        return np.column_stack([x * y, 1 + x**2, y**2 - 0.3 * x * y])

    points = SkinSurface(block, PLACES)
    moved = points.deformed_mm(field(block.nodes))
    np.testing.assert_allclose(moved - points.rest_mm, field(points.rest_mm), atol=1e-13)


def test_a_place_without_skin_is_an_error(block):
    with pytest.raises(StudyError, match=r"no skin at X 1\.50"):
        SkinSurface(block, [(0, 0), (1.5, 0)])
