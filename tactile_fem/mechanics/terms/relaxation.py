"""Transient networks of the tissues: their stress, and their history.

The inverse metrics `A` in which a network's chains formed
(`tactile_fem.tissue.relaxation`) are linear in each tetrahedron, as its strains are. So they are
known wherever the tissues' stress is needed: at quadrature points of any degree, on the skin, where
the contact asks for the traction, and at receptors. Between the corners they are means of positive
definite matrices, hence positive definite themselves.
"""

from __future__ import annotations

from collections.abc import Callable

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from tactile_fem.assembly.compile import Constant, expression
from tactile_fem.mechanics.state import PointHistory
from tactile_fem.mechanics.terms.term import Delay, StressTerm, sum_of
from tactile_fem.mechanics.tissues import Tissues
from tactile_fem.study import Solver
from tactile_fem.tissue.energies import shear_stiffness
from tactile_fem.tissue.relaxation import Network, Prony, inverse_metric

# A symmetric matrix as a vector.
_ENTRIES = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)
_SIZE = len(_ENTRIES)
# Corners that several tetrahedra share are shifted towards each centre to tell them apart.
_SHIFT_SHARE = 0.1


class Relaxation(StressTerm, PointHistory):
    """Networks of all tissues that relax.

    `old` holds, at the corners of each tetrahedron, the deviation of `A` of each network and then
    of ``Cbar^-1`` from the identity, six components each.
    """

    # Over a step that lets them relax, stress does not derive from a potential.
    is_symmetric = False

    def __init__(self, tissues: Tissues, series: dict[str, Prony]) -> None:
        StressTerm.__init__(self, tissues)
        domain = tissues.domain
        self._mesh = msh = domain.mesh
        self._series = series
        self._count = max(len(prony.g) for prony in series.values())
        PointHistory.__init__(self, "formed", self._function(self._count + 1), domain.comm)
        self.histories = [self]
        self._carried = self._function(self._count)
        strain = inverse_metric(tissues.F) - ufl.Identity(3)
        corners = self._carried.function_space.element.interpolation_points
        self._strain = expression(ufl.as_vector([strain[i, j] for i, j in _ENTRIES]), corners)
        cells = msh.topology.index_map(msh.topology.dim)
        self._cells = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
        self._own = {name: domain.tissue.find(tissues.tags[name]) for name in series}
        # For each network its stiffness ratio and the weights of the present and of the accepted
        # strain at the points themselves, by tissue.
        self._factors = {
            name: [[Constant(msh, x) for x in (ratio, 0.0, 0.0)] for ratio in prony.ratios]
            for name, prony in series.items()
        }
        self._inverse_metric_old = inverse_metric(tissues.F_old)
        times_s = sorted({tau_s for prony in series.values() for tau_s in prony.tau_s})
        self._delay_of = {tau_s: Delay(_broken_share(tau_s)) for tau_s in times_s}
        self.delays = list(self._delay_of.values())

    @classmethod
    def of(cls, tissues: Tissues, solver: Solver) -> list[Relaxation]:
        """Return the term, if any tissue of the finger relaxes."""
        constants = {name: getattr(tissues.constants, name) for name in tissues.tags}
        series = {name: Prony(c.g, c.tau_s) for name, c in constants.items() if c.g}
        return [cls(tissues, series)] if series else []

    def stress(self, tissue: str) -> Expr | None:
        """Return the stress of a tissue's networks, MPa; None if it does not relax."""
        return sum_of(network.stress(self.tissues.F) for network in self._networks(tissue))

    def energy(self, tissue: str) -> Expr | None:
        """Return what a tissue's networks store, MPa; None if it does not relax."""
        return sum_of(network.energy(self.tissues.F) for network in self._networks(tissue))

    def skin_stiffness(self, tissue: str, gamma: Expr, height: Expr) -> Expr | None:
        """Return ``gamma 4 G/3/h`` of the chains that do not break in the step, MPa/mm."""
        factors, own = self._factors.get(tissue), self.tissues
        if factors is None:
            return None
        unbroken = sum(ratio * (1 - new) for ratio, new, _ in factors)
        G = shear_stiffness(own.laws[tissue], own.F_old, own.at)
        return gamma * 4 * unbroken * G / 3 / height

    def _networks(self, tissue: str) -> list[Network]:
        """Return the networks of a tissue; none if it does not relax."""
        law, at = self.tissues.laws[tissue], self.tissues.at
        return [
            Network(law, ratio, at, self._carried_in(k, new, frozen), new)
            for k, (ratio, new, frozen) in enumerate(self._factors.get(tissue, []))
        ]

    def _carried_in(self, k: int, new: Expr, frozen: Expr) -> Expr:
        """Return `A` of a network without the weight `new` of the present ``Cbar^-1``."""
        carried = (1 - new - frozen) * ufl.Identity(3) + _symmetric(self._carried, k)
        return carried + frozen * self._inverse_metric_old

    def begin_step(self) -> None:
        """Carry the history over the state's time step."""
        dt_s = self.tissues.state.dt_s
        old, carried = self._at_cells(self.old), self._at_cells(self._carried)
        for name, prony in self._series.items():
            cells = self._own[name]
            strain = old[cells, :, self._count]
            for k, (kept, before, new) in enumerate(prony.weights(dt_s)):
                carried[cells, :, k] = kept * old[cells, :, k] + before * strain
                self._weigh(name, k, new, 0.0)
        self._put(self._carried.x.array, self._carried, carried)

    def freeze(self, delay: Delay | None) -> None:
        """Freeze the networks at the accepted state; further strain breaks the chains of `delay`.

        At the accepted displacement `A` is that with which the last step ended, at each point. With
        the strain that is linear in each tetrahedron in place of the accepted one it would not be,
        and not even positive definite where cells are much distorted.
        """
        dt_old_s = self.tissues.state.dt_old_s
        old, carried = self._at_cells(self.old), self._at_cells(self._carried)
        for name, prony in self._series.items():
            cells = self._own[name]
            strain = old[cells, :, self._count]
            for k, tau_s in enumerate(prony.tau_s):
                ended = prony.weights(dt_old_s)[k][2] if dt_old_s else 0.0
                carried[cells, :, k] = old[cells, :, k] - ended * strain
                broken = float(self._delay_of[tau_s] is delay)
                self._weigh(name, k, broken, ended - broken)
        self._put(self._carried.x.array, self._carried, carried)

    def _weigh(self, tissue: str, k: int, new: float, frozen: float) -> None:
        """Set the weights of the present and of the accepted strain in a network."""
        for constant, value in zip(self._factors[tissue][k][1:], (new, frozen), strict=True):
            constant.value = value

    def points_mm(self) -> np.ndarray:
        """Return places of the values on this rank, (points, dimension)."""
        dim = self._mesh.geometry.dim
        V = self.old.function_space
        corners = V.tabulate_dof_coordinates()[:, :dim]
        in_cells = corners[V.dofmap.list]
        inside = (1 - _SHIFT_SHARE) * in_cells + _SHIFT_SHARE * in_cells.mean(axis=1, keepdims=True)
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


def _broken_share(tau_s: float) -> Callable[[float], complex]:
    """Return the share of chains that break in a vibration, by its angular frequency."""
    return lambda w: 1 / (1 + 1j * w * tau_s)


def _symmetric(function: fem.Function, k: int) -> Expr:
    """Return the k-th symmetric matrix of a function."""
    place = {pair: k * _SIZE + i for i, pair in enumerate(_ENTRIES)}
    return ufl.as_matrix(
        [[function[place[min(i, j), max(i, j)]] for j in range(3)] for i in range(3)]
    )
