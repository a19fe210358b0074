"""How far the transient networks of the tissues have followed the strain: their history.

The inverse metrics `A` in which a network's chains formed
(`tactile_fem.tissue.relaxation`) are linear in each tetrahedron, as its strains are. So they are
known wherever the tissues' stress is needed: at quadrature points of any degree, on the skin, where
the contact asks for the traction, and at receptors. Between the corners they are means of positive
definite matrices, hence positive definite themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from tactile_fem.mechanics.compile import expression
from tactile_fem.mechanics.domain import Domain
from tactile_fem.mechanics.state import PointHistory
from tactile_fem.tissue.relaxation import Network, Prony, ShearLaw, inverse_metric

# A symmetric matrix as a vector.
_ENTRIES = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)
_SIZE = len(_ENTRIES)
# Corners that several tetrahedra share are told apart a little inside of each.
_INSIDE = 0.1


class Relaxation(PointHistory):
    """Networks of all tissues between two states.

    `old` holds, at the corners of each tetrahedron, how far `A` of each network and then
    ``Cbar^-1`` are from the identity, six components each.

    Parameters
    ----------
    domain
        The finger and where its tissues are.
    series
        Of the tissues that relax, by name; at least one.
    F, F_old
        Deformation gradient at the present displacement and at the last accepted step.
    """

    def __init__(self, domain: Domain, series: Mapping[str, Prony], F: Expr, F_old: Expr) -> None:
        msh = domain.mesh
        self._mesh, self._series = msh, dict(series)
        self._count = max(len(prony.g) for prony in series.values())
        super().__init__("formed", self._function(self._count + 1), domain.comm)
        self._carried = self._function(self._count)
        strain = inverse_metric(F) - ufl.Identity(3)
        corners = self._carried.function_space.element.interpolation_points
        self._strain = expression(ufl.as_vector([strain[i, j] for i, j in _ENTRIES]), corners)
        cells = msh.topology.index_map(msh.topology.dim)
        self._cells = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
        tags = domain.tissues_of(domain.tissue)
        self._own = {name: domain.tissue.find(tags[name]) for name in series}
        # Of each network its stiffness ratio and the weights of the present and of the accepted
        # strain at the points themselves, by tissue.
        self._factors = {
            name: [[fem.Constant(msh, x) for x in (ratio, 0.0, 0.0)] for ratio in prony.ratios]
            for name, prony in series.items()
        }
        self._inverse_metric_old = inverse_metric(F_old)

    def networks(self, tissue: str, law: ShearLaw) -> list[Network]:
        """Return the networks of a tissue with that elastic law; none if it does not relax."""
        return [
            Network(law, ratio, self._carried_in(k, new, frozen), new)
            for k, (ratio, new, frozen) in enumerate(self._factors.get(tissue, []))
        ]

    def _carried_in(self, k: int, new: Expr, frozen: Expr) -> Expr:
        """Return `A` of a network without the weight `new` of the present ``Cbar^-1``."""
        carried = (1 - new - frozen) * ufl.Identity(3) + _symmetric(self._carried, k)
        return carried + frozen * self._inverse_metric_old

    def stiffening(self, tissue: str) -> Expr | float:
        """Return how much stiffer than in the long run a tissue is over the present step."""
        return sum(ratio * (1 - new) for ratio, new, _ in self._factors.get(tissue, []))

    def set_time_step(self, dt_s: float) -> None:
        """Carry the history over a step of that duration."""
        old, carried = self._at_cells(self.old), self._at_cells(self._carried)
        for name, prony in self._series.items():
            cells = self._own[name]
            strain = old[cells, :, self._count]
            for k, (kept, before, new) in enumerate(prony.weights(dt_s)):
                carried[cells, :, k] = kept * old[cells, :, k] + before * strain
                self._weigh(name, k, new, 0.0)
        self._put(self._carried.x.array, self._carried, carried)

    def linearize(self, dt_old_s: float, share: Callable[[float], float]) -> None:
        """Freeze the networks at the accepted state, where a further strain breaks chains at once.

        At the accepted displacement `A` is that with which the last step ended, at each point. With
        the strain that is linear in each tetrahedron in place of the accepted one it would not be,
        and not even positive definite where cells are much distorted.

        Parameters
        ----------
        dt_old_s
            Duration of the last step; 0 if there was none.
        share
            Of a network's chains that break, 0 to 1, by its relaxation time, s.
        """
        old, carried = self._at_cells(self.old), self._at_cells(self._carried)
        for name, prony in self._series.items():
            cells = self._own[name]
            strain = old[cells, :, self._count]
            for k, tau_s in enumerate(prony.tau_s):
                ended = prony.weights(dt_old_s)[k][2] if dt_old_s else 0.0
                carried[cells, :, k] = old[cells, :, k] - ended * strain
                self._weigh(name, k, share(tau_s), ended - share(tau_s))
        self._put(self._carried.x.array, self._carried, carried)

    def _weigh(self, tissue: str, k: int, new: float, frozen: float) -> None:
        """Set the weights of the present and of the accepted strain in a network."""
        for constant, value in zip(self._factors[tissue][k][1:], (new, frozen), strict=True):
            constant.value = value

    def times_s(self) -> list[float]:
        """Return the relaxation times of all tissues, each once."""
        return sorted({tau_s for prony in self._series.values() for tau_s in prony.tau_s})

    def points_mm(self) -> np.ndarray:
        """Return places of the values on this rank, (points, dimension)."""
        dim = self._mesh.geometry.dim
        V = self.old.function_space
        corners = V.tabulate_dof_coordinates()[:, :dim]
        in_cells = corners[V.dofmap.list]
        inside = (1 - _INSIDE) * in_cells + _INSIDE * in_cells.mean(axis=1, keepdims=True)
        places = np.empty_like(corners)
        places[V.dofmap.list] = inside
        return places

    def present(self) -> np.ndarray:
        """Return the values at the present state, as `old` holds them."""
        shape = len(self._cells), -1, 1, _SIZE
        strain = self._strain.eval(self._mesh, self._cells).reshape(shape)
        carried = self._at_cells(self._carried)
        values = np.concatenate([carried, strain], axis=2)
        for name, cells in self._own.items():
            for k, (_, new, _) in enumerate(self._factors[name]):
                values[cells, :, k] += float(new.value) * strain[cells, :, 0]
        found = np.empty_like(self.old.x.array)
        self._put(found, self.old, values)
        return found

    def _function(self, count: int) -> fem.Function:
        """Return a function with `count` symmetric matrices at the corners of each cell."""
        cell = self._mesh.topology.cell_name()
        element = basix.ufl.element("Lagrange", cell, 1, shape=(count * _SIZE,), discontinuous=True)
        return fem.Function(fem.functionspace(self._mesh, element))

    def _at_cells(self, function: fem.Function) -> np.ndarray:
        """Return its values, (cells, corners, matrices, 6)."""
        dofmap = function.function_space.dofmap
        return function.x.array.reshape(-1, dofmap.bs // _SIZE, _SIZE)[dofmap.list]

    def _put(self, array: np.ndarray, like: fem.Function, values: np.ndarray) -> None:
        """Set an array of the function's coefficients to values (cells, corners, matrices, 6)."""
        dofmap = like.function_space.dofmap
        array.reshape(-1, dofmap.bs // _SIZE, _SIZE)[dofmap.list] = values


def _symmetric(function: fem.Function, k: int) -> Expr:
    """Return the k-th symmetric matrix of a function."""
    place = {pair: k * _SIZE + i for i, pair in enumerate(_ENTRIES)}
    return ufl.as_matrix(
        [[function[place[min(i, j), max(i, j)]] for j in range(3)] for i in range(3)]
    )
