"""The skin all around the finger: places below it, and directions tangent to it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh
from tactile_fem.finger.simplex import closest_points
from tactile_fem.receptors.settings import Receptors

_BATCH_SIZE = 1000  # random points that are drawn at a time
_FROM_CUT_MM = 1.0  # no receptor lies closer to the cut
_STEEPEST = 0.5  # component along Z of the outward normal, beyond which skin belongs to the back


def around(
    receptors: Receptors, finger: FingerMesh, random: np.random.Generator
) -> tuple[float, Iterator[np.ndarray | None]]:
    """Return the area of a region of the skin, mm2, and random points below it, evenly spread.

    "phalanx" is the skin of pad, sides and end, without that of the back; "nail_border" is what
    lies within `nail_border_mm` of the nail. A point that falls beside the region is None. Raises
    StudyError if there is no such region.
    """
    from scipy.spatial.distance import cdist  # takes 0.3 s

    facets = finger.corners_of("skin")
    doubled = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
    sizes = np.linalg.norm(doubled, axis=1)
    # A finger is about convex.
    outwards = np.sum(doubled * (facets.mean(axis=1) - finger.nodes.mean(axis=0)), axis=1)
    inwards = -np.sign(outwards)[:, None] * doubled / sizes[:, None]
    rim = _nail_rim(finger) if receptors.region == "nail_border" else None
    first_y = finger.nodes[:, 1].min() + _FROM_CUT_MM

    def batch() -> tuple[np.ndarray, np.ndarray]:
        """Return points below the skin, and which of them belong to the region."""
        facet = random.choice(len(facets), _BATCH_SIZE, p=sizes / sizes.sum())
        weights = random.dirichlet(np.ones(3), _BATCH_SIZE)
        on_skin = np.einsum("nc,nci->ni", weights, facets[facet])
        if receptors.below_skin_mm is None:
            points = closest_points(on_skin, finger.corners_of("interface"))
        else:
            points = on_skin + receptors.below_skin_mm * inwards[facet]
        belongs = points[:, 1] > first_y
        if rim is None:
            belongs &= inwards[facet, 2] >= -_STEEPEST
        else:
            belongs &= cdist(on_skin, rim).min(axis=1) <= receptors.nail_border_mm
        return points, belongs

    def points() -> Iterator[np.ndarray | None]:
        while True:
            for point, belongs in zip(*batch(), strict=True):
                yield point if belongs else None

    share = batch()[1].mean()
    if not share:
        raise StudyError(
            f"receptors.nail_border_mm = {receptors.nail_border_mm:g}: no skin lies so close to "
            "the nail"
        )
    return float(sizes.sum() / 2 * share), points()


def _nail_rim(finger: FingerMesh) -> np.ndarray:
    """Return nodes (n, 3) where skin and nail meet; StudyError if there is no nail."""
    of_nail = np.unique(finger.cells[finger.tissue == TISSUES["nail"]])
    of_skin = np.unique(finger.facets[finger.surface == SURFACES["skin"]])
    rim = finger.nodes[np.intersect1d(of_nail, of_skin)]
    if not len(rim):
        raise StudyError('receptors.region = "nail_border": the finger has no nail')
    return rim


def preferred_directions(seed: int, positions: np.ndarray, finger: FingerMesh) -> np.ndarray:
    """Return unit vectors (n, 3), at random in the plane tangent to the skin over each position.

    In a section they lie in its plane. Those of the first positions do not depend on the number of
    the others.
    """
    from scipy.spatial import cKDTree  # takes 0.3 s

    facets = finger.corners_of("skin")
    _, nearest = cKDTree(facets.mean(axis=1)).query(positions)
    edges = facets[nearest, 1:] - facets[nearest, :1]
    # Of any direction in space, the part along the facet.
    anywhere = np.random.default_rng([seed, 1]).standard_normal((len(positions), 3, 1))
    along = (np.linalg.pinv(edges) @ edges @ anywhere)[..., 0]
    return along / np.linalg.norm(along, axis=1, keepdims=True)
