"""Contact pressure, friction, and stick or slip at the nodes of the skin.

The virtual work of the contact gives forces at quadratic nodes, which are no pressures: those of
corners nearly vanish. The hat function of a corner is its quadratic shape function and half of
those on the edges that meet there, so its force is known without another integral, and divided
by the area of the hat it is the mean traction around the corner. The sum of traction times area
over all corners is exactly the force on the finger.
"""

from __future__ import annotations

from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_fem.finger.mesh_data import SURFACES, FingerMesh

Array = NDArray[np.float64]

ON_SKIN = ("contact_pressure_kPa", "friction_kPa", "contact")
_KPA_PER_MPA = 1000.0
# Share of the bound of friction from which skin slips: the law is rounded up to it.
_SLIP_SHARE = 0.95
# Share of the largest pressure below which skin is not in contact: the pressure sets in smoothly.
_CONTACT_SHARE = 0.01


class Contact(IntEnum):
    """What the skin does at a node."""

    NONE, STICKS, SLIPS = range(3)


class SkinContact:
    """Turns forces at the nodes of a finger into tractions; for the first rank.

    Parameters
    ----------
    finger
        The mesh.
    """

    def __init__(self, finger: FingerMesh) -> None:
        self._nodes = finger.nodes
        shape = finger.simplex
        skin = finger.facets[finger.surface == SURFACES["skin"]]
        sides = skin[:, shape.facet_edges].reshape(-1, 2)
        middles = skin[:, shape.dim :].ravel()
        self._corners = skin[:, : shape.dim]
        self._middles, first = np.unique(middles, return_index=True)
        self._sides = sides[first]

    @cached_property
    def on_skin(self) -> NDArray[np.bool_]:
        """Whether each node of the finger is one of the skin, (n,)."""
        own = np.concatenate([self._corners.ravel(), self._middles])
        return np.isin(np.arange(len(self._nodes)), own)

    def fields(
        self, moved_mm: Array, pressure_N: Array, friction_N: Array, bound_N: Array
    ) -> dict[str, Array]:
        """Return the fields of all nodes; they vanish off the skin.

        Parameters
        ----------
        moved_mm
            Displacement, (n, 3).
        pressure_N, friction_N, bound_N
            Forces of contact pressure, of friction, and of pressure times the coefficient of
            friction on the nodes, (n, 3); of a section per width.

        Returns
        -------
        ``contact_pressure_kPa`` (n,) and ``friction_kPa`` (n, 3), per deformed area, and
        ``contact`` (n,), see `Contact`.
        """
        area = vertex_areas(self._nodes + moved_mm, self._corners)
        per_mm2 = _KPA_PER_MPA / np.where(area > 0, area, np.inf)[:, None]
        forces = pressure_N, friction_N, bound_N
        pressure, friction, bound = (per_mm2 * self._hats(force) for force in forces)
        pressure, bound = (np.linalg.norm(values, axis=1) for values in (pressure, bound))
        for values in (pressure, friction, bound):
            # A middle has the mean of its edge's ends, as fields between corners are linear.
            values[self._middles] = values[self._sides].mean(axis=1)
        slips = np.linalg.norm(friction, axis=1) >= _SLIP_SHARE * bound
        contact = np.where(slips, Contact.SLIPS, Contact.STICKS)
        touches = pressure > _CONTACT_SHARE * pressure.max()
        contact = np.where(touches, contact, Contact.NONE)
        return dict(zip(ON_SKIN, (pressure, friction, contact), strict=True))

    def _hats(self, force_N: Array) -> Array:
        """Return the forces that act on the hat functions of corners, (n, 3)."""
        hats = force_N.copy()
        hats[self._middles] = 0.0
        for ends in self._sides.T:
            np.add.at(hats, ends, force_N[self._middles] / 2)
        return hats


def vertex_areas(nodes: Array, corners: NDArray[np.int64]) -> Array:
    """Return the area of the hat function of each node, (n,); of a section the length.

    `corners` are those of triangles (k, 3) or of lines (k, 2).
    """
    edges = nodes[corners[:, 1:]] - nodes[corners[:, :1]]
    if edges.shape[1] == 2:
        sizes = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    else:
        sizes = np.linalg.norm(edges[:, 0], axis=1)
    shares = np.repeat(sizes / corners.shape[1], corners.shape[1])
    return np.bincount(corners.ravel(), shares, minlength=len(nodes))
