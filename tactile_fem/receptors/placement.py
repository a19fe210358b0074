"""Receptors on the epidermis-dermis interface or below the skin, and the points they average."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import TISSUES, FingerMesh, lowest_facet
from tactile_fem.receptors.settings import TIPS, Receptors, misplaced
from tactile_fem.receptors.tips import tips

if TYPE_CHECKING:
    from tactile_fem.study import Study
    from tactile_fem.study.afferents import Afferents

_TRIES = 1000


@dataclass(frozen=True)
class Samples:
    """Points whose weighted mean is a receptor's reading.

    Attributes
    ----------
    receptor, cell
        Index of the receptor and of the cell in the mesh, (samples,).
    tissue
        Tag of the tissue that is felt, (samples,).
    point
        Position, (samples, 3) mm.
    weight
        Share in the receptor's mean, (samples,).
    """

    receptor: np.ndarray
    cell: np.ndarray
    tissue: np.ndarray
    point: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class Layout:
    """The receptors of a study, one population after the other.

    Attributes
    ----------
    positions_mm
        (receptors, 3).
    population
        Name of each receptor's population, (receptors,).
    samples
        Points to be averaged.
    """

    positions_mm: np.ndarray
    population: np.ndarray
    samples: Samples


def lay_out(study: Study, finger: FingerMesh) -> Layout:
    """Place the receptors of all populations and find the points that they average.

    Raises
    ------
    StudyError
        As `place` and `sample`, with the name of the population if the study names any.
    """
    names: list[str] = []
    placed, found = [], []
    for afferents in study.populations:
        with _naming(afferents, study):
            positions = place(afferents.receptors, finger)
            own = sample(afferents.receptors, positions, finger)
        placed.append(positions)
        found.append(replace(own, receptor=own.receptor + len(names)))
        names += [afferents.name] * len(positions)
    columns = zip(*(vars(samples).values() for samples in found), strict=True)
    together = Samples(*map(np.concatenate, columns))
    return Layout(np.concatenate(placed), np.array(names), together)


@contextmanager
def _naming(afferents: Afferents, study: Study) -> Iterator[None]:
    """Name the population in errors, if the study names any."""
    try:
        yield
    except StudyError as error:
        prefix = f"afferents.{afferents.name}." if study.afferents else ""
        raise StudyError(f"{prefix}{error}") from None


def place(receptors: Receptors, finger: FingerMesh) -> np.ndarray:
    """Return the receptors' positions (n, 3) in mm, over the pad.

    Raises
    ------
    StudyError
        If a receptor's X, Y lies outside the finger, or they are not laid out in the plane of a
        section.
    """
    problem = misplaced(receptors, is_section=not finger.plane.is_space)
    if problem:
        raise StudyError(problem)
    facets = _sheet(receptors, finger)
    if not finger.plane.is_space:
        return _along_section(receptors, finger, facets)
    if receptors.placement == "afferents":
        spread, extra = _spread(receptors, facets), receptors.extra_mm
        return np.array([*spread, *(_lift(x, y, facets)[0] for x, y in extra)])
    return np.array([_lift(x, y, facets)[0] for x, y in _layout(receptors)])


def _along_section(receptors: Receptors, finger: FingerMesh, facets: np.ndarray) -> np.ndarray:
    """Return the receptors' positions in a section."""
    plane = finger.plane
    along, reach = plane.axes[0], (receptors.half_width_mm, receptors.half_length_mm)
    if receptors.placement in TIPS:
        found = tips(finger, receptors.placement)
        return found[np.abs(found[:, along]) <= reach[along]]
    line = _symmetric(reach[along], receptors.spacing_mm)[:, None]
    xy = np.concatenate([plane.points(np.hstack([line, 0 * line]))[:, :2], _extra(receptors)])
    return np.array([_lift(x, y, facets)[0] for x, y in xy])


def _extra(receptors: Receptors) -> np.ndarray:
    """Return X, Y of the receptors that are given one by one, (n, 2)."""
    return np.reshape(receptors.extra_mm, (-1, 2))


def _spread(receptors: Receptors, facets: np.ndarray) -> list[np.ndarray]:
    """Return places on the interface by density, none close to another (Poisson-disc).

    Darts are thrown evenly over the interface's area, and stay where they keep their distance. It
    is 0.75/sqrt(density), which darts can fill (they jam at 0.83), and less where they cannot.
    """
    half = receptors.half_width_mm, receptors.half_length_mm
    random = np.random.default_rng(receptors.seed)
    tries = [_lift(x, y, facets) for x, y in random.uniform(-1, 1, (_TRIES, 2)) * half]
    area_mm2 = 4 * half[0] * half[1] * np.mean([stretch for _, stretch in tries])
    count = max(1, round(receptors.density_per_cm2 * area_mm2 / 100))
    distance = 7.5 / np.sqrt(receptors.density_per_cm2)
    steepest = max(stretch for _, stretch in tries)
    found: list[np.ndarray] = []
    while len(found) < count:
        for _ in range(_TRIES):
            (x, y), chance = random.uniform(-1, 1, 2) * half, random.uniform()
            place, stretch = _lift(x, y, facets)
            if chance * steepest > stretch:
                continue
            if not found or np.linalg.norm(np.array(found) - place, axis=1).min() >= distance:
                found.append(place)
                if len(found) == count:
                    break
        distance *= 0.95
    return found


def _layout(receptors: Receptors) -> np.ndarray:
    """Return X, Y of the receptors, (n, 2)."""
    half = receptors.half_width_mm, receptors.half_length_mm
    lines = [_symmetric(h, receptors.spacing_mm) for h in half]
    if receptors.placement == "line":
        xy = np.column_stack([lines[0], np.zeros_like(lines[0])])
    elif receptors.placement == "grid":
        xy = np.stack(np.meshgrid(*lines, indexing="ij"), -1).reshape(-1, 2)
    else:
        area_cm2 = 4 * half[0] * half[1] / 100
        count = max(1, round(receptors.density_per_cm2 * area_cm2))
        random = np.random.default_rng(receptors.seed)
        xy = random.uniform(-1, 1, (count, 2)) * half
    return np.concatenate([xy, _extra(receptors)])


def _symmetric(half: float, spacing: float) -> np.ndarray:
    count = int(half / spacing + 1e-9)
    return np.arange(-count, count + 1) * spacing


def _lift(x: float, y: float, facets: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the lowest point of the interface over (x, y), and its area per area in X and Y."""
    found = lowest_facet(x, y, facets)
    if found is None:
        raise StudyError(
            f"receptors: the receptor at X {x:g}, Y {y:g} mm lies outside the finger; "
            "choose a smaller extent or another place"
        )
    facet, weights = found
    corners = facets[facet]
    edges = corners[1:] - corners[0]
    # Of a section's line it is the length per length along the plane.
    stretch = np.sqrt(np.linalg.det(edges @ edges.T) / np.linalg.det(edges[:, :2] @ edges[:, :2].T))
    return np.array([x, y, weights @ corners[:, 2]]), float(stretch)


def sample(receptors: Receptors, positions: np.ndarray, finger: FingerMesh) -> Samples:
    """Return the points of one tissue within the receptors' balls, and their cells.

    Points lie on a cubic lattice of a third of the radius, in a section on a square one; with
    radius 0 the receptor itself is the only point. Where cells meet, the one with the lowest index
    counts, so that the answer does not depend on the partition.
    """
    tag = TISSUES[receptors.side]
    cells = np.flatnonzero(finger.tissue == tag)
    plane = finger.plane
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
        least = _least_barycentric(points, corners[near])
        inside = least >= -1e-6
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
        found.append((number * ones, cells[first], tag * ones, plane.points(points[hit]), weight))
    return Samples(*map(np.concatenate, zip(*found, strict=True)))


def _end_organs(
    receptors: Receptors, positions: np.ndarray, finger: FingerMesh
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the receptor's number and the place of each end organ."""
    angle = np.linspace(0, 2 * np.pi, receptors.end_organs - 1, endpoint=False)
    around = receptors.end_organs_radius_mm * np.column_stack([np.cos(angle), np.sin(angle)])
    facets = _sheet(receptors, finger)
    for number, position in enumerate(positions):
        yield number, position
        for x, y in position[:2] + around:
            yield number, _lift(x, y, facets)[0]


def _sheet(receptors: Receptors, finger: FingerMesh) -> np.ndarray:
    """Return the corners (m, 3, 3) or (m, 2, 3) of the facets on which receptors lie.

    They are those of the epidermis-dermis interface, or the skin's, moved by the depth.
    """
    name = "interface" if receptors.below_skin_mm is None else "skin"
    depth = receptors.below_skin_mm or 0.0
    return finger.corners_of(name) + np.array([0.0, 0.0, depth])


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
