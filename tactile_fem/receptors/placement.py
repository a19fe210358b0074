"""Receptors on the epidermis-dermis interface or below the skin, and the points they average."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import count, islice
from typing import NamedTuple

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh
from tactile_fem.finger.simplex import closest_points, lowest_facet
from tactile_fem.receptors.settings import TIPS, Receptors, misplaced

_BATCH_SIZE = 1000  # random points that are tried at a time
_FROM_CUT_MM = 1.0  # no receptor lies closer to the cut
_STEEPEST = 0.5  # component along Z of the outward normal, beyond which skin belongs to the back
_PROMINENCE_MM = 0.01  # of a tip: more than the noise of the mesh, far less than a papilla
_PAD_MM = 3.0  # height of the pad above its lowest point


class Samples(NamedTuple):
    """Points whose weighted mean is the reading of a receptor, (samples,) each."""

    receptor: np.ndarray  # index
    cell: np.ndarray  # index in the mesh
    tissue: np.ndarray  # tag
    point: np.ndarray  # (samples, 3) mm
    weight: np.ndarray  # share in the mean of its receptor


class Layout(NamedTuple):
    """Receptors of one or more populations, one population after the other."""

    positions_mm: np.ndarray  # (receptors, 3)
    population: np.ndarray  # population of each receptor
    directions: np.ndarray  # (receptors, 3), unit vectors, tangent to the skin
    samples: Samples

    @classmethod
    def of(cls, receptors: Receptors, finger: FingerMesh, population: str) -> Layout:
        """Place the receptors of a population; raises what `place` and `sample` raise."""
        positions = place(receptors, finger)
        names = np.full(len(positions), population)
        directions = preferred_directions(receptors.seed, positions, finger)
        return cls(positions, names, directions, sample(receptors, positions, finger))

    @classmethod
    def joined(cls, layouts: Sequence[Layout]) -> Layout:
        """Return the receptors of several layouts, numbered on from one to the next."""
        *columns, samples = zip(*layouts, strict=True)
        positions, names, directions = map(np.concatenate, columns)
        first = np.cumsum([0, *(len(layout.positions_mm) for layout in layouts[:-1])])
        pairs = zip(samples, first, strict=True)
        numbered = [own._replace(receptor=own.receptor + start) for own, start in pairs]
        together = Samples(*map(np.concatenate, zip(*numbered, strict=True)))
        return cls(positions, names, directions, together)


def place(receptors: Receptors, finger: FingerMesh) -> np.ndarray:
    """Return the positions of receptors (n, 3) in mm, by default over the pad.

    Raises StudyError if one lies outside the finger, or the placement does not suit the finger.
    """
    if problem := misplaced(receptors, finger.plane):
        raise StudyError(problem)
    half = np.array([receptors.half_width_mm, receptors.half_length_mm])
    if receptors.placement in TIPS:
        found, along = tips(finger, receptors.placement), finger.plane.axes[0]
        return found[np.abs(found[:, along]) <= half[along]]
    facets, random = _sheet(receptors, finger), np.random.default_rng(receptors.seed)
    placed, xy = [], np.empty((0, 2))
    if receptors.placement == "afferents" or receptors.region != "pad":
        over_pad = receptors.region == "pad"
        drawn = _over_pad(half, facets, random) if over_pad else around(receptors, finger, random)
        placed = _apart(receptors, *drawn)
    else:
        xy = _layout(receptors, half, finger, random)
    xy = np.concatenate([xy, np.reshape(receptors.extra_mm, (-1, 2))])
    return np.array([*placed, *(_lift(x, y, facets)[0] for x, y in xy)])


def tips(finger: FingerMesh, placement: str) -> np.ndarray:
    """Return the tips of the interface of a section (n, 3) in mm, from one end of the pad on.

    "intermediate_ridges" are deepest at their tips, "papillae" shallowest. Limiting ridges are left
    out where the skin has ridges: they lie below its grooves or, if the papillae are not aligned
    with the ridges, on one flank of them. Raises StudyError if there are no tips.
    """
    from scipy.signal import find_peaks  # takes 0.3 s, and few studies need it

    along = finger.plane.axes[0]

    def palmar(surface: str) -> np.ndarray:
        facets = finger.facets[finger.surface == SURFACES[surface]]
        points = finger.nodes[np.unique(facets[:, : finger.simplex.dim])]
        points = points[points[:, 2] < points[:, 2].min() + _PAD_MM]
        return points[np.argsort(points[:, along])]

    def peaks(points: np.ndarray, sign: int) -> np.ndarray:
        return points[find_peaks(sign * points[:, 2], prominence=_PROMINENCE_MM)[0]]

    found = peaks(palmar("interface"), -1 if placement == "papillae" else 1)
    if placement != "papillae":
        grooves, crests = (peaks(palmar("skin"), sign)[:, along] for sign in (1, -1))
        if len(grooves) and len(crests):
            to_crest, to_groove = (
                np.abs(found[:, along, None] - places).min(axis=1) for places in (crests, grooves)
            )
            found = found[to_crest <= to_groove + _PROMINENCE_MM]
    if len(found) < 2:  # the pad itself has one lowest point
        raise StudyError(
            f'receptors.placement = "{placement}": the interface has no such tips; set '
            "finger.papilla_depth_mm"
        )
    return found


def _layout(
    receptors: Receptors, half: np.ndarray, finger: FingerMesh, random: np.random.Generator
) -> np.ndarray:
    """Return X, Y of the receptors on a line, on a grid or at random, (n, 2)."""
    if receptors.placement == "random":
        size = receptors.number_on(4 * half[0] * half[1]), 2
        return random.uniform(-1, 1, size) * half
    counts = [int(h / receptors.spacing_mm + 1e-9) for h in half]
    lines = [np.arange(-n, n + 1) * receptors.spacing_mm for n in counts]
    if receptors.placement == "grid":
        return np.stack(np.meshgrid(*lines, indexing="ij"), -1).reshape(-1, 2)
    axes = finger.plane.axes
    at = np.zeros((len(lines[axes[0]]), len(axes)))
    at[:, 0] = lines[axes[0]]
    return finger.plane.vectors(at)[:, :2]


def _over_pad(
    half: np.ndarray, facets: np.ndarray, random: np.random.Generator
) -> tuple[float, Iterator[np.ndarray | None]]:
    """Return the area of a sheet over the pad, mm2, and random points on it, evenly spread."""
    tries = [_lift(x, y, facets) for x, y in random.uniform(-1, 1, (_BATCH_SIZE, 2)) * half]
    area_mm2 = 4 * half[0] * half[1] * np.mean([stretch for _, stretch in tries])
    largest = max(stretch for _, stretch in tries)

    def draw() -> np.ndarray | None:
        (x, y), chance = random.uniform(-1, 1, 2) * half, random.uniform()
        point, stretch = _lift(x, y, facets)
        return point if chance * largest <= stretch else None

    return float(area_mm2), (draw() for _ in count())


def _apart(
    receptors: Receptors, area_mm2: float, points: Iterator[np.ndarray | None]
) -> list[np.ndarray]:
    """Return some of the points; like afferents, none lies close to another."""
    # A point is accepted if it keeps a distance of 0.75/sqrt(density) from all others. Points jam
    # at 0.83/sqrt(density); where they cannot keep it, the distance is shortened.
    wanted = receptors.number_on(area_mm2)
    density = 100 * wanted / area_mm2 if receptors.count else receptors.density_per_cm2
    distance = 7.5 / np.sqrt(density) if receptors.placement == "afferents" else 0.0
    found: list[np.ndarray] = []
    while len(found) < wanted:
        for point in islice(points, _BATCH_SIZE):
            if point is None:
                continue
            if not found or np.linalg.norm(np.array(found) - point, axis=1).min() >= distance:
                found.append(point)
                if len(found) == wanted:
                    break
        distance *= 0.95
    return found


def _lift(x: float, y: float, facets: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the lowest point of the facets over (x, y), and their area per area in X and Y."""
    found = lowest_facet(x, y, facets)
    if found is None:
        raise StudyError(
            f"receptors: the receptor at X {x:g}, Y {y:g} mm lies outside the finger; "
            "choose a smaller extent or another place"
        )
    facet, weights = found
    corners = facets[facet]
    edges = corners[1:] - corners[0]
    # In a section: length per length along the plane.
    stretch = np.sqrt(np.linalg.det(edges @ edges.T) / np.linalg.det(edges[:, :2] @ edges[:, :2].T))
    return np.array([x, y, weights @ corners[:, 2]]), float(stretch)


def sample(receptors: Receptors, positions: np.ndarray, finger: FingerMesh) -> Samples:
    """Return the points of one tissue within the balls of receptors, and their cells.

    Points lie on a cubic lattice (in a section a square one) with a spacing of a third of the
    radius; with radius 0 the receptor itself is the only point. A point on the boundary of several
    cells belongs to the one with the lowest index, whatever the partition. Raises StudyError if a
    receptor is too far from the tissue.
    """
    tag, plane = TISSUES[receptors.side], finger.plane
    cells = np.flatnonzero(finger.tissue == tag)
    corners = plane.within(finger.nodes[finger.cells[cells, : finger.simplex.corners]])
    low, high = corners.min(axis=1), corners.max(axis=1)
    radius = receptors.average_radius_mm
    offsets = _lattice(radius, len(plane.axes))
    found = []
    for number, position in _end_organs(receptors, positions, finger):
        at = plane.within(position)
        near = np.flatnonzero(
            np.all((low <= at + radius + 1e-6) & (high >= at - radius - 1e-6), axis=1)
        )
        points = at + offsets
        inside = _least_barycentric(points, corners[near]) >= -1e-6
        hit = inside.any(axis=1)
        if not hit.any():
            x, y = position[:2]
            raise StudyError(
                f"receptors.average_radius_mm = {radius:g}: no {receptors.side} within reach of "
                f"the receptor at X {x:g}, Y {y:g} mm"
            )
        first = near[inside[hit].argmax(axis=1)]
        ones = np.ones(len(first), dtype=int)
        weight = ones / (len(first) * receptors.end_organs)
        found.append((number * ones, cells[first], tag * ones, plane.vectors(points[hit]), weight))
    return Samples(*map(np.concatenate, zip(*found, strict=True)))


def _end_organs(
    receptors: Receptors, positions: np.ndarray, finger: FingerMesh
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the number of the receptor and the place of each end organ."""
    angle = np.linspace(0, 2 * np.pi, receptors.end_organs - 1, endpoint=False)
    around = receptors.end_organs_radius_mm * np.column_stack([np.cos(angle), np.sin(angle)])
    facets = _sheet(receptors, finger)
    for number, position in enumerate(positions):
        yield number, position
        for x, y in position[:2] + around:
            yield number, _lift(x, y, facets)[0]


def _sheet(receptors: Receptors, finger: FingerMesh) -> np.ndarray:
    """Return the corners (m, 3, 3) or (m, 2, 3) of the interface, or of the skin moved inwards."""
    name = "interface" if receptors.below_skin_mm is None else "skin"
    return finger.corners_of(name) + np.array([0.0, 0.0, receptors.below_skin_mm or 0.0])


def _lattice(radius: float, dim: int) -> np.ndarray:
    """Return the lattice points of a ball of `radius` about the origin, (n, dim)."""
    if radius == 0:
        return np.zeros((1, dim))
    line = (np.arange(6) - 2.5) / 3 * radius
    points = np.stack(np.meshgrid(*[line] * dim, indexing="ij"), -1).reshape(-1, dim)
    return points[np.linalg.norm(points, axis=1) <= radius]


def _least_barycentric(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the least barycentric coordinate of each point in each cell, (points, cells)."""
    edges = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    delta = points[:, None, :] - corners[None, :, 0]
    local = np.einsum("tij,ptj->pti", np.linalg.inv(edges), delta)
    return np.minimum(local.min(axis=2), 1 - local.sum(axis=2))


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
    rim = None
    if receptors.region == "nail_border":
        of_nail = np.unique(finger.cells[finger.tissue == TISSUES["nail"]])
        of_skin = np.unique(finger.facets[finger.surface == SURFACES["skin"]])
        rim = finger.nodes[np.intersect1d(of_nail, of_skin)]
        if not len(rim):
            raise StudyError('receptors.region = "nail_border": the finger has no nail')
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
