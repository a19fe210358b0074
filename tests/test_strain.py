"""Strain of the layers against a block whose deformation is known."""

import numpy as np
from blocks import block_mesh
from needs import needs_gmsh
from strains import deformation_gradients, principal_strains, under_contact

from tactile_fem.study import Finger


def test_a_quadratic_displacement_is_exact_at_the_centres():
    grid = np.linspace(-1, 1, 3)
    block = block_mesh(grid, grid, np.array([0.0, 0.5, 1.0]), ["epidermis", "dermis"])
    x, y, z = block.nodes.T
    moved = np.column_stack([0.1 * x**2, 0 * y, -0.2 * z])
    centre = block.nodes[block.cells[block.tissue == 2, :4]].mean(axis=1)
    found = principal_strains(block, moved, "epidermis")
    wanted = np.sort(
        np.column_stack([0.2 * centre[:, 0], 0 * x[: len(centre)], -0.2 + 0 * centre[:, 0]])
    )
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    near = under_contact(block, "epidermis", 0.5)
    assert 0 < near.sum() < len(near) and np.abs(centre[near, :2]).max() < 0.5


@needs_gmsh
def test_in_a_section_it_is_that_of_the_plane():
    finger = Finger(kind="section", pad_size_mm=0.6, far_size_mm=3.0).mesh()
    _, z = finger.plane.within(finger.nodes).T
    moved = np.column_stack([0.2 * z, -0.1 * z])  # shear, and a tenth less high
    F = deformation_gradients(finger, moved, "epidermis")
    np.testing.assert_allclose(F, np.broadcast_to([[1, 0.2], [0, 0.9]], F.shape), atol=1e-9)
    strains = principal_strains(finger, moved, "epidermis")
    np.testing.assert_allclose((strains + 1).prod(axis=1), 0.9, rtol=1e-9)
