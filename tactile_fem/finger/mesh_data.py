"""The mesh of a finger as plain arrays, the tags of its parts, and its measures."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import MeshError, StudyError
from tactile_fem.finger.plane import PLANES, SPACE, Array, Plane
from tactile_fem.finger.settings import FingerSettings
from tactile_fem.finger.simplex import (
    SOLID,
    Indices,
    Simplex,
    distances,
    facets_of,
    gammas,
    jacobians,
    lowest_facet,
    lowest_height,
    simplex_of,
    volumes,
)
from tactile_fem.runtime.text import aligned

TISSUES = {
    "stratum_corneum": 1,
    "epidermis": 2,
    "dermis": 3,
    "subcutaneous": 4,
    "bone": 5,
    "nail": 6,
}
SURFACES = {"skin": 11, "interface": 12, "bone_surface": 13, "cut": 14}
LAYERS = ("stratum_corneum", "epidermis", "dermis")

_LENGTH_MM = 1.0, 1000.0  # of a mesh in mm
_IN_PLANE_MM = 1e-6
# Half width and half length of the pad, whose layers are measured; its lower side is as high
# as it is wide. Half the width of the contact patch, whose facets are measured.
_PAD_MM, _PATCH_MM = (6.0, 9.0), 3.0


@dataclass(frozen=True)
class FingerMesh:
    """Quadratic cells of a finger with tags: tetrahedra, or triangles of a plane section.

    Parameters
    ----------
    nodes
        (n, 3) coordinates in mm.
    cells
        (m, 10) nodes of each tetrahedron, or (m, 6) of each triangle, in gmsh's order.
    tissue
        (m,) tags from `TISSUES`.
    facets
        (k, 6) or (k, 3) nodes of the tagged facets, in gmsh's order.
    surface
        (k,) tags from `SURFACES`. "skin" is the outer skin without nail and cut, "interface"
        lies between epidermis and dermis, "bone_surface" is that of the bone without the cut.
    fields
        Values in each cell, (m, ...), by name, that laws of the tissues may need, such as
        directions of fibres, (m, 3) in the finger's axes.
    """

    nodes: Array
    cells: Indices
    tissue: Indices
    facets: Indices
    surface: Indices
    fields: Mapping[str, Array] = field(default_factory=dict)

    def with_field(self, name: str, values: Array | Callable[[Array], Array]) -> FingerMesh:
        """Return the mesh with a further field: its values, or a function of the cells' centres.

        The function takes the mean of the corners of each cell, (m, 3) in mm.
        """
        if callable(values):
            values = values(self.nodes[self.cells[:, : self.simplex.corners]].mean(axis=1))
        return replace(self, fields={**self.fields, name: np.asarray(values, dtype=float)})

    @property
    def simplex(self) -> Simplex:
        """The shape of its cells."""
        return simplex_of(self.cells)

    @cached_property
    def plane(self) -> Plane:
        """The plane in which it deforms; space, if it is no section."""
        if self.simplex is SOLID:
            return SPACE
        return min(PLANES.values(), key=lambda plane: plane.distance_mm(self.nodes))

    def corners_of(self, surface: str) -> Array:
        """Return the corners of the facets of a surface, (k, 3, 3) or (k, 2, 3) in mm."""
        return self.nodes[self.facets[self.surface == SURFACES[surface], : self.simplex.dim]]

    @property
    def missing(self) -> list[str]:
        """Names of the tissues and surfaces that it lacks, but for nail and, in a section, cut."""
        tags = {*np.unique(self.tissue).tolist(), *np.unique(self.surface).tolist()}
        optional = {"nail"} if self.simplex is SOLID else {"nail", "cut"}
        parts = {**TISSUES, **SURFACES}
        return [name for name, tag in parts.items() if tag not in tags and name not in optional]

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the content, in hexadecimal digits."""
        digest = hashlib.sha256(np.ascontiguousarray(self.nodes, dtype="<f8").tobytes())
        for array in (self.cells, self.tissue, self.facets, self.surface):
            digest.update(np.ascontiguousarray(array, dtype="<i8").tobytes())
        for name, values in sorted(self.fields.items()):
            digest.update(f"{name} {values.shape}".encode())
            digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
        return digest.hexdigest()

    @cached_property
    def pad_thickness_mm(self) -> float:
        """Height from skin to bone above the contact point; MeshError if it lacks either."""
        heights = []
        for name in ("skin", "bone_surface"):
            height = lowest_height(0.0, 0.0, self.corners_of(name))
            if height is None:
                raise MeshError(f"the mesh has no {name} above the contact point, X = Y = 0")
            heights.append(height)
        return heights[1] - heights[0]

    @cached_property
    def facet_size_mm(self) -> float:
        """Mean edge length of the facets of the skin under the contact patch."""
        facets = self.corners_of("skin")
        middle = facets.mean(axis=1)
        near = np.all(np.abs(middle[:, :2]) < _PATCH_MM, axis=1) & (middle[:, 2] < _PATCH_MM)
        if not near.any():
            near[np.argmin(np.linalg.norm(middle, axis=1))] = True
        edges = facets[near] - np.roll(facets[near], 1, axis=1)
        return float(np.linalg.norm(edges, axis=2).mean())

    @cached_property
    def layer_thickness_mm(self) -> dict[str, Array]:
        """Thickness (facets,) of each layer that the pad has, the stratum corneum first.

        It is the distance from the centre of each facet of the outer boundary to the inner one.
        """
        facets, first, second = facets_of(self.cells)
        inner = second >= 0
        pair = np.sort([self.tissue[first[inner]], self.tissue[second[inner]]], axis=0).T
        limits = [self.corners_of("skin")]
        for depth in range(1, len(LAYERS) + 1):
            limits.append(self.nodes[facets[inner][np.all(pair == [depth, depth + 1], axis=1)]])
        thickness = {}
        for name, above, below in zip(LAYERS, limits[:-1], limits[1:], strict=True):
            middle = above.mean(axis=1)
            in_pad = np.all(np.abs(middle[:, :2]) < _PAD_MM, axis=1) & (middle[:, 2] < _PAD_MM[0])
            if in_pad.any() and len(below):
                thickness[name] = distances(middle[in_pad], below)
        return thickness

    @property
    def layers_mm(self) -> dict[str, float]:
        """Mean thickness of each layer of the pad."""
        return {name: float(found.mean()) for name, found in self.layer_thickness_mm.items()}

    def check(self) -> None:
        """Check that the mesh can be used for computations.

        Raises
        ------
        MeshError
            Cells are inverted or lack a field's value, a facet belongs to more than two of them, a
            tissue or a surface is missing, coordinates are not finite or not in mm, a section lies
            in no plane across or along the finger, or there is no skin or bone above the contact
            point.
        """
        for name, values in self.fields.items():
            if len(values) != len(self.cells) or not np.all(np.isfinite(values)):
                raise MeshError(f"the field {name} of the mesh needs a finite value for each cell")
        if self.missing:
            raise MeshError(f"the mesh lacks the part {', '.join(self.missing)}")
        if not np.all(np.isfinite(self.nodes)):
            raise MeshError("the mesh has nodes whose coordinates are no finite numbers")
        length = float(np.ptp(self.nodes, axis=0).max())
        if not _LENGTH_MM[0] < length < _LENGTH_MM[1]:
            raise MeshError(f"the mesh is {length:g} mm long, which is no finger: is it in mm?")
        if self.plane.distance_mm(self.nodes) > _IN_PLANE_MM:
            raise MeshError("the mesh of triangles lies in no plane X = 0 or Y = 0")
        found = jacobians(self.plane.within(self.nodes), self.cells)
        bad = np.flatnonzero(found.min(axis=1) <= 0.0)
        if len(bad):
            x, y, z = self.nodes[self.cells[bad[0], : self.simplex.corners]].mean(axis=0)
            raise MeshError(
                f"{len(bad)} {self.simplex.plural} have a non-positive Jacobian, the first at "
                f"({x:.2f}, {y:.2f}, {z:.2f}) mm"
            )
        try:
            facets_of(self.cells)
        except ValueError as error:
            raise MeshError(f"the mesh is not conforming: {error}") from error
        _ = self.pad_thickness_mm


class SkinSurface:
    """Points on the undeformed skin of the pad, and the interpolation of nodal vectors to them.

    Parameters
    ----------
    xy_mm
        (k, 2) places X, Y of the points; StudyError is raised if there is no skin.

    Attributes
    ----------
    rest_mm
        (k, 3) undeformed points.
    """

    def __init__(self, finger: FingerMesh, xy_mm: ArrayLike) -> None:
        facets = finger.facets[finger.surface == SURFACES["skin"]]
        corners = finger.corners_of("skin")
        nodes, weights = [], []
        for x, y in np.asarray(xy_mm, float):
            found = lowest_facet(x, y, corners)
            if found is None:
                raise StudyError(f"there is no skin at X {x:.2f}, Y {y:.2f} mm")
            nodes.append(facets[found[0]])
            weights.append(found[1])
        self._nodes, at = np.array(nodes), np.array(weights)
        one, other = finger.simplex.facet_edges.T
        # The quadratic functions of the corners, then of the mid-nodes.
        self._basis = np.hstack([at * (2 * at - 1), 4 * at[:, one] * at[:, other]])
        self.rest_mm = self.at(finger.nodes)

    def at(self, nodal: ArrayLike) -> Array:
        """Return values (k, c) at the points from nodal values (n, c), in the order of the file."""
        return np.einsum("kn,knc->kc", self._basis, np.asarray(nodal)[self._nodes])

    def deformed_mm(self, displacement_mm: ArrayLike) -> Array:
        """Return the deformed points (k, 3) for nodal displacements (n, 3)."""
        return self.rest_mm + self.at(displacement_mm)


def held_parts(
    mesh: FingerMesh, names: Sequence[str]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which cells (m,) and nodes (n,) belong to the named tissues and surfaces."""
    cells = np.isin(mesh.tissue, [tag for name, tag in TISSUES.items() if name in names])
    facets = np.isin(mesh.surface, [tag for name, tag in SURFACES.items() if name in names])
    nodes = np.zeros(len(mesh.nodes), dtype=bool)
    nodes[mesh.cells[cells]] = True
    nodes[mesh.facets[facets]] = True
    return cells, nodes


def edges_per_ridge(mesh: FingerMesh, finger: FingerSettings) -> float | None:
    """Return how many edges of the skin a ridge of the fingerprint has; None for smooth skin."""
    return finger.ridge_pitch_mm / mesh.facet_size_mm if finger.is_ridged else None


def describe(mesh: FingerMesh, finger: FingerSettings) -> str:
    """Return a table to print: tissues, surfaces and layers, measured and in the study."""
    shape, nodes = mesh.simplex, mesh.plane.within(mesh.nodes)
    volume, gamma = volumes(nodes, mesh.cells), gammas(nodes, mesh.cells)
    count, unit = len(nodes), f"mm^{shape.dim}"
    lines: list[list[str]] = [
        [
            f"{len(mesh.cells)} {shape.plural}, {count} nodes, {shape.dim * count} displacements, "
            f"{shape.measure} {volume.sum():.1f} {unit}"
        ],
        ["tissue", "cells", unit, "min gamma", "mean"],
    ]
    for name, tag in TISSUES.items():
        part = mesh.tissue == tag
        if part.any():
            quality = f"{gamma[part].min():.3f}", f"{gamma[part].mean():.3f}"
            lines.append([name, str(part.sum()), f"{volume[part].sum():.1f}", *quality])
    lines.append(["surface", "facets"])
    lines += [[name, str(np.sum(mesh.surface == tag))] for name, tag in SURFACES.items()]
    from_study = finger.mesh_file is None
    lines.append(["layer of the pad, mm", *(["study"] if from_study else []), "min", "mean", "max"])
    for name, found in mesh.layer_thickness_mm.items():
        row = [getattr(finger, f"{name}_mm")] if from_study else []
        row += [found.min(), found.mean(), found.max()]
        lines.append([name, *(f"{value:.3f}" for value in row)])
    lines.append([f"skin to bone over the contact point {mesh.pad_thickness_mm:.3f} mm"])
    if edges := edges_per_ridge(mesh, finger):
        lines.append([f"{edges:.1f} edges to a ridge of {finger.ridge_pitch_mm:g} mm"])
    return "\n".join([*aligned(lines), f"sha256 {mesh.hash}"])
