"""The terms of a block's virtual work, without contact."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem

from tactile_fem.mechanics.domain import Domain
from tactile_fem.mechanics.problem import KINDS
from tactile_fem.mechanics.state import State
from tactile_fem.mechanics.terms.contact import sum_of
from tactile_fem.mechanics.tissues import Tissues
from tactile_fem.study import Solver, Tissue


class Bulk:
    """Tissues at a displacement `u`, and the sum of their terms."""

    def __init__(self, domain: Domain, constants: Tissue, solver: Solver | None = None) -> None:
        solver = solver or Solver()
        self.V = fem.functionspace(domain.mesh, ("Lagrange", 2, (domain.mesh.geometry.dim,)))
        self.state = State(self.V)
        self.u = self.state.u
        self.tissues = Tissues(domain, constants, self.state, solver.bulk_degree)
        self.terms = [term for kind in KINDS for term in kind.of(self.tissues, solver)]

    def residual(self, v) -> ufl.Form:
        return sum((term.residual(v) for term in self.terms), ufl.Form([]))

    def tangent(self, v) -> ufl.Form:
        return sum((term.tangent(v) for term in self.terms), ufl.Form([]))

    def stored(self, w) -> ufl.Form:
        return sum((term.stored(w) for term in self.terms), ufl.Form([]))

    def stress(self, tissue: str):
        return sum_of(term.stress(tissue) for term in self.terms)

    def energy(self, tissue: str):
        return sum_of(term.energy(tissue) for term in self.terms)

    def begin_step(self, dt_s: float) -> None:
        self.state.time_step.value = dt_s
        for term in self.terms:
            term.begin_step()

    def accept(self) -> None:
        for term in self.terms:
            for history in term.histories:
                history.accept(history.present())
        self.state.u_old.x.array[:] = np.array(self.u.x.array)
