"""Meshes a finger that no file has, solid or a section."""

from __future__ import annotations

import logging

import numpy as np

from tactile_fem.finger.anatomy import Anatomy
from tactile_fem.finger.mesh_data import SURFACES, TISSUES, FingerMesh, edges_per_ridge
from tactile_fem.finger.plane import Array
from tactile_fem.finger.section import section_cells
from tactile_fem.finger.settings import Finger
from tactile_fem.finger.simplex import Indices, facets_of, quadratic
from tactile_fem.finger.solid import solid_cells

logger = logging.getLogger(__name__)


def build_finger(finger: Finger) -> FingerMesh:
    """Mesh a finger; the same parameters give the same mesh.

    Raises
    ------
    MeshError
        The lengths do not make a finger, or gmsh is missing or fails.
    """
    anatomy = Anatomy.of(finger)
    make_cells = section_cells if finger.is_section else solid_cells
    nodes, (layers, tissue), fat, marrow = make_cells(finger, anatomy)
    cells = np.concatenate([layers, fat, marrow])
    tags = [np.full(len(fat), TISSUES["subcutaneous"]), np.full(len(marrow), TISSUES["bone"])]
    tissue = np.concatenate([tissue, *tags])
    facets, surface = _tagged_surfaces(nodes, cells, tissue, anatomy.skin.capsule.cut_y)
    nodes, cells, facets = quadratic(nodes, cells, facets)
    mesh = FingerMesh(nodes, cells, tissue, facets, surface)
    mesh.check()
    logger.info("finger of %d %s and %d nodes", len(cells), mesh.simplex.plural, len(nodes))
    if edges := edges_per_ridge(mesh, finger):
        logger.info("%.1f edges to a ridge of %g mm", edges, finger.ridge_pitch_mm)
    return mesh


def _tagged_surfaces(
    nodes: Array, cells: Indices, tissue: Indices, cut_y: float
) -> tuple[Indices, Indices]:
    """Return the tagged facets (k, d) and tags (k,), which follow from the adjacent tissues."""
    facets, first, second = facets_of(cells)
    one = tissue[first]
    other = np.where(second < 0, 0, tissue[second])
    low, high = np.minimum(one, other), np.maximum(one, other)
    on_cut = np.all(np.abs(nodes[facets, 1] - cut_y) < 1e-6, axis=1)
    tag = np.zeros(len(facets), dtype=np.int64)
    tag[(low == 0) & (high == TISSUES["stratum_corneum"])] = SURFACES["skin"]
    tag[(low == TISSUES["epidermis"]) & (high == TISSUES["dermis"])] = SURFACES["interface"]
    tag[(low != high) & (high == TISSUES["bone"])] = SURFACES["bone_surface"]
    tag[(low == 0) & on_cut] = SURFACES["cut"]
    chosen = np.flatnonzero(tag)
    chosen = chosen[np.argsort(tag[chosen], kind="stable")]
    return facets[chosen], tag[chosen]
