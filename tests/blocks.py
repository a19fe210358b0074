"""Small layered blocks with the finger's tags: skin below, held above."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np

from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh
from tactile_fem.finger.simplex import SOLID, quadratic

LAYERS = ["stratum_corneum", "epidermis", "dermis", "subcutaneous"]


def block_mesh(x: np.ndarray, y: np.ndarray, z: np.ndarray, tissue_of_row: list[str]) -> FingerMesh:
    """Return a box of 10-node tetrahedra (six per brick); skin at z[0], cut at z[-1].

    `tissue_of_row` names the tissue of each row of bricks along z.
    """
    shape = len(x), len(y), len(z)
    corners = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)
    index = np.arange(len(corners)).reshape(shape)
    tets, tissue = [], []
    for k, name in enumerate(tissue_of_row):
        for i in range(len(x) - 1):
            for j in range(len(y) - 1):
                for order in permutations(range(3)):
                    step = np.array([i, j, k])
                    path = [index[tuple(step)]]
                    for axis in order:
                        step[axis] += 1
                        path.append(index[tuple(step)])
                    tets.append(path)
                    tissue.append(TISSUES[name])
    linear = np.array(tets)
    edge = corners[linear[:, 1:]] - corners[linear[:, :1]]
    flipped = np.linalg.det(edge) < 0
    linear[flipped] = linear[flipped][:, [0, 2, 1, 3]]
    triangles, surface = [], []
    for face in ([0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]):
        f = linear[:, face]
        for tag, height in (("skin", z[0]), ("cut", z[-1])):
            on = np.all(np.isclose(corners[f, 2], height), axis=1)
            triangles.append(f[on])
            surface.append(np.full(on.sum(), SURFACES[tag]))
    nodes, tets10, triangles6 = quadratic(corners, linear, np.concatenate(triangles))
    return FingerMesh(
        nodes,
        tets10,
        np.array(tissue, dtype=np.int32),
        triangles6,
        np.concatenate(surface).astype(np.int32),
    )


def curved(mesh: FingerMesh, shift_mm: float = 0.1) -> FingerMesh:
    """Return a block of the same shape whose edges are bent within their horizontal planes."""
    nodes, between = mesh.nodes.copy(), np.unique(mesh.cells[:, 4:])
    x, y = nodes[between, :2].T
    half = np.abs(nodes[:, :2]).max(axis=0)
    inside = np.cos(np.pi * x / (2 * half[0])) * np.cos(np.pi * y / (2 * half[1]))
    nodes[between, 0] += shift_mm * inside * np.cos(2 * y)
    nodes[between, 1] += shift_mm * inside * np.sin(3 * x)
    middle = nodes[mesh.cells[:, SOLID.edges]].mean(axis=2)
    assert np.abs(nodes[mesh.cells[:, 4:]] - middle).max() > 0.05
    return replace(mesh, nodes=nodes)
