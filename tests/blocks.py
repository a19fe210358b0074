"""Small layered blocks with the finger's tags: skin below, held above."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh


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
    return _with_midpoints(
        corners,
        linear,
        np.array(tissue, dtype=np.int32),
        np.concatenate(triangles),
        np.concatenate(surface).astype(np.int32),
    )


def _with_midpoints(
    corners: np.ndarray,
    tets: np.ndarray,
    tissue: np.ndarray,
    triangles: np.ndarray,
    surface: np.ndarray,
) -> FingerMesh:
    tet_edges = [(0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)]
    triangle_edges = [(0, 1), (1, 2), (0, 2)]
    number: dict[tuple[int, int], int] = {}
    points = list(corners)

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in number:
            number[key] = len(points)
            points.append((corners[a] + corners[b]) / 2)
        return number[key]

    tets10 = np.array([[*t, *(middle(t[a], t[b]) for a, b in tet_edges)] for t in tets])
    triangles6 = np.array(
        [[*t, *(middle(t[a], t[b]) for a, b in triangle_edges)] for t in triangles]
    )
    return FingerMesh(np.array(points), tets10, tissue, triangles6, surface)
