"""The contact's forms over the skin that the body is near.

Skin farther away carries exactly no traction (see `smooth_positive`), so leaving it out changes no
digit of the forms, and about half of the skin is far from the body at any moment.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import ufl
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
        By the tag of each tissue: cell and local facet in turn, of the facets that may touch and of
        those that are near.
    """

    def __init__(self, contact: Contact) -> None:
        self.obstacle = obstacle = contact.obstacle
        topology = obstacle.u.function_space.mesh.topology
        row = {tuple(pair): i for i, pair in enumerate(obstacle.entities.tolist())}
        self.all: dict[int, np.ndarray] = {}
        self._rows: dict[int, np.ndarray] = {}  # of the obstacle's facets
        for part in contact.parts:
            tag = part.ds.subdomain_id()
            pairs = fem.compute_integration_domains(
                fem.IntegralType.exterior_facet, topology, contact.facets.find(tag)
            ).reshape(-1, 2)
            self.all[tag] = pairs.ravel()
            self._rows[tag] = np.array(
                [row[tuple(pair)] for pair in pairs.tolist()], dtype=np.int64
            )
        self._reach = contact.at_points(lambda part: part.reach)
        self._reach_mm: np.ndarray | None = None
        self._is_chosen = np.zeros(len(obstacle.entities), dtype=bool)
        self.chosen: dict[int, np.ndarray] = {}

    def begin_solve(self) -> None:
        """Choose anew at the next `update`: stiffness or regularization may have changed."""
        self._reach_mm = None
        self._is_chosen[:] = False
        self.obstacle.evaluate_everywhere()

    def update(self) -> None:
        """Evaluate the gap at the present displacement, and choose facets that are near now."""
        self.obstacle.refresh()
        gap_mm = self.obstacle.gap_mm
        begins = self._reach_mm is None
        if self._reach_mm is None:
            self._reach_mm = self._reach.read().reshape(gap_mm.shape)
            self.obstacle.skip_distant(self._reach_mm.max(axis=1, initial=0.0))
        near = np.any(gap_mm < self._reach_mm, axis=1)
        if begins or np.any(near & ~self._is_chosen):
            self._is_chosen |= np.any(gap_mm < _REACH_FACTOR * self._reach_mm, axis=1)
            self.chosen = {
                tag: pairs.reshape(-1, 2)[self._is_chosen[self._rows[tag]]].ravel()
                for tag, pairs in self.all.items()
            }


class NearForm:
    """A form over the skin that is near.

    Parameters
    ----------
    form
        Over the parts of the skin.
    near
        Which facets are near.
    jit_options
        Options of the compiler.
    """

    def __init__(self, form: ufl.Form, near: NearSkin, jit_options: Mapping[str, Any]) -> None:
        self._form, self._near = form, near
        self._mesh = form.arguments()[0].ufl_function_space().mesh
        self._compiled = fem.compile_form(self._mesh.comm, form, jit_options=jit_options)
        self._made_for: dict[int, np.ndarray] | None = None

    def __call__(self) -> fem.Form:
        """Return the form over the facets that are near now."""
        if self._made_for is not self._near.chosen:
            self._made_for = self._near.chosen
            self._made = self._over(self._made_for)
        return self._made

    def over_all_skin(self) -> fem.Form:
        """Return the form over all facets that may touch."""
        return self._over(self._near.all)

    def _over(self, facets: Mapping[int, np.ndarray]) -> fem.Form:
        return fem.create_form(
            self._compiled,
            [argument.ufl_function_space() for argument in self._form.arguments()],
            self._mesh,
            {fem.IntegralType.exterior_facet: list(facets.items())},
            {w: w for w in self._form.coefficients()},
            {c: c for c in self._form.constants()},
            self._near.obstacle.entity_maps,
        )
