"""Points, weights and normals of quadrature in the reference cell or on its facets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import basix
import numpy as np

Array = np.ndarray


class Rule(NamedTuple):
    """A rule of quadrature: degree, and scheme as Basix calls it."""

    degree: int
    scheme: str


def quadrature(
    rules: Sequence[Rule], cell: basix.CellType, facet: int | None
) -> tuple[Array, Array, Array]:
    """Return points of the reference cell, weights, and the number of the rule of each point.

    Parameters
    ----------
    facet
        The points lie on this facet; None: within the cell.
    """
    on = cell if facet is None else basix.cell.subentity_types(cell)[-2][facet]
    parts = [
        basix.make_quadrature(on, degree, rule=basix.quadrature.string_to_type(scheme))
        for degree, scheme in rules
    ]
    points, weights = (np.concatenate(each) for each in zip(*parts, strict=True))
    if facet is not None:
        corners = basix.geometry(cell)[basix.topology(cell)[-2][facet]]
        points = corners[0] + points @ (corners[1 : 1 + points.shape[1]] - corners[0])
    numbers = [len(own) for _, own in parts]
    return points, weights, np.repeat(np.arange(len(parts), dtype=np.int32), numbers)


def reference_normal(cell: basix.CellType, facet: int | None) -> Array:
    """Return the outward normal of a reference facet, as long as its map from its own cell scales.

    Without a facet it is zero.
    """
    if facet is None:
        return np.zeros(len(basix.geometry(cell)[0]))
    jacobian = basix.cell.facet_jacobians(cell)[facet]
    size = np.sqrt(np.linalg.det(jacobian.T @ jacobian))
    return size * basix.cell.facet_outward_normals(cell)[facet]
