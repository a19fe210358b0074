"""The skin that the body is near.

Skin farther away carries exactly no traction (see `smooth_positive`), so leaving it out changes no
digit of the contact's work, and about half of the skin is far from the body at any moment.
"""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from tactile_fem.mechanics.terms.contact import Contact

# Skin within this multiple of its reach is included, so that the forms do not change at each
# iterate.
_REACH_FACTOR = 1.5


class NearSkin:
    """Which facets the body is near.

    Attributes
    ----------
    obstacle
        The body.
    all, chosen
        Facets by the tag of each tissue, cell and local facet in turn: those that may touch and
        those that are near.
    """

    def __init__(self, contact: Contact) -> None:
        self.obstacle = obstacle = contact.obstacle
        topology = obstacle.u.function_space.mesh.topology
        self.all: dict[int, np.ndarray] = {}
        self._rows: dict[int, np.ndarray] = {}  # of the obstacle's facets
        for part in contact.parts:
            tag = part.ds.subdomain_id()
            pairs = fem.compute_integration_domains(
                fem.IntegralType.exterior_facet, topology, contact.facets.find(tag)
            ).reshape(-1, 2)
            self.all[tag] = pairs.ravel()
            self._rows[tag] = obstacle.facet_points.rows(pairs)
        self._reach = contact.at_points(lambda part: part.reach)
        self._reach_mm: np.ndarray | None = None
        self._is_chosen = np.zeros(len(obstacle.gap_mm), dtype=bool)
        self.chosen: dict[int, np.ndarray] = {}

    def begin_solve(self) -> None:
        """Choose anew at the next `update`: stiffness or regularization may have changed."""
        self._reach_mm = None
        self._is_chosen[:] = False
        self.obstacle.evaluate_everywhere()

    def update(self) -> bool:
        """Evaluate the gap at the present displacement, and choose facets that are near now.

        Returns
        -------
        bool
            Whether others are chosen than before.
        """
        self.obstacle.refresh()
        gap_mm = self.obstacle.gap_mm
        begins = self._reach_mm is None
        if self._reach_mm is None:
            self._reach_mm = self._reach.read().reshape(gap_mm.shape)
            self.obstacle.skip_distant(self._reach_mm.max(axis=1, initial=0.0))
        near = np.any(gap_mm < self._reach_mm, axis=1)
        is_new = begins or bool(np.any(near & ~self._is_chosen))
        if is_new:
            self._is_chosen |= np.any(gap_mm < _REACH_FACTOR * self._reach_mm, axis=1)
            self.chosen = {
                tag: pairs.reshape(-1, 2)[self._is_chosen[self._rows[tag]]].ravel()
                for tag, pairs in self.all.items()
            }
        return is_new
