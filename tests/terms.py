"""The terms of a block's virtual work, without contact."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from tactile_fem.mechanics.domain import Domain
from tactile_fem.mechanics.problem import KINDS
from tactile_fem.mechanics.state import State
from tactile_fem.mechanics.terms.term import Sum
from tactile_fem.mechanics.tissues import Tissues
from tactile_fem.study import Solver, Tissue


class Bulk(Sum):
    """Tissues at a displacement `u`, and the sum of their terms."""

    def __init__(self, domain: Domain, constants: Tissue, solver: Solver | None = None) -> None:
        solver = solver or Solver()
        self.V = fem.functionspace(domain.mesh, ("Lagrange", 2, (domain.mesh.geometry.dim,)))
        self.state = State(self.V)
        self.u = self.state.u
        tissues = Tissues(domain, constants, self.state, solver.bulk_degree)
        super().__init__(tissues, [term for kind in KINDS for term in kind.of(tissues, solver)])

    def accept(self) -> None:
        for history in self.histories:
            history.accept(history.present())
        self.state.u_old.x.array[:] = np.array(self.u.x.array)
