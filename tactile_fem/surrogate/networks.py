"""Small networks, evaluated with NumPy alone, and what they see of a contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

from tactile_fem.neuron import STANDARD
from tactile_fem.surrogate.contact import ACROSS, ContactPatch, Pad
from tactile_fem.surrogate.heights import Grid, disc

Array = NDArray[Any]
Mirror = tuple[NDArray[np.int64], Array]  # order and signs of inputs if all is mirrored in X


@dataclass(frozen=True)
class Network:
    """Layers of ``max(0, x W + b)``, the last without the maximum.

    Inputs are taken less their `middle` and over their `scale`; outputs are multiplied and shifted
    likewise. Both are folded into the first and the last layer.
    """

    weights: tuple[Array, ...]  # of each layer, (inputs, outputs)
    biases: tuple[Array, ...]  # (outputs,)

    @classmethod
    def scaled(
        cls,
        weights: Sequence[Array],
        biases: Sequence[Array],
        inputs: tuple[Array, Array],
        outputs: tuple[Array, Array],
    ) -> Self:
        """Return layers trained on scaled numbers; `inputs` and `outputs` are (middle, scale)."""
        w = [np.array(each, dtype=float) for each in weights]
        b = [np.array(each, dtype=float) for each in biases]
        middle, scale = inputs
        w[0] = w[0] / scale[:, None]
        b[0] = b[0] - middle @ w[0]
        middle, scale = outputs
        w[-1], b[-1] = w[-1] * scale, b[-1] * scale + middle
        return cls(*(tuple(each.astype(np.float32) for each in layers) for layers in (w, b)))

    def __call__(self, x: Array) -> Array:
        """Return the outputs (n, outputs) of inputs (n, inputs)."""
        *hidden, last = zip(self.weights, self.biases, strict=True)
        for W, b in hidden:
            x = x @ W
            x += b
            np.maximum(x, 0, out=x)
        return x @ last[0] + last[1]

    def mirrored_mean(self, x: Array, mirror: Mirror | None, signs: Array) -> Array:
        """Return the mean of outputs and, with a mirror, of those that `signs` mirror back."""
        if mirror is None:
            return self(x)
        order, flips = mirror
        return (self(x) + signs * self(x[:, order] * flips)) / 2

    def arrays(self, name: str) -> dict[str, Array]:
        """Return its arrays to save, by names that begin with its own."""
        weights = {f"{name}_w{k}": array for k, array in enumerate(self.weights)}
        return weights | {f"{name}_b{k}": array for k, array in enumerate(self.biases)}

    @classmethod
    def read(cls, name: str, saved: Mapping[str, Array]) -> Self:
        """Return the network that was saved under a name."""
        count = sum(key.startswith(f"{name}_w") for key in saved)
        weights, biases = (tuple(saved[f"{name}_{kind}{k}"] for k in range(count)) for kind in "wb")
        return cls(weights, biases)


# Half widths of the means, mm, and their places about a receptor.
_OF_PRESSURE = ((0.5, disc(0.5, 2.1)), (1.0, disc(1.0, 5.1, 2.1)))
_OF_OVERLAP = ((0.25, disc(0.25, 0.8)), (0.5, disc(0.5, 1.6, 0.8)))
_REACH_MM = 5.0  # scale of a receptor's place
_PRESSURES_PER_MPA = 100.0  # scale of a pressure
# Places of the means that the network of the whole finger sees.
_COARSE_MM = 2.0
_AREA_MM2 = 100.0  # scale of an area
_WIDTHS = tuple(np.size(each.rest) for each in STANDARD)  # of outputs
# Largest |X| and |Y| of receptors that scans teach.
TAUGHT_MM = np.array([5.5, 6.0])
# Signs of the networks' outputs if all is mirrored in X: moved_mm and force_N change along it.
FELT_SIGNS = np.array([1, 1, 1, 1, 1, 1, 1, 1, -1, 1, 1], np.float32)
WHOLE_SIGNS = np.array([-1, 1, 1, 1], np.float32)


def _places(parts: tuple[tuple[float, Array], ...]) -> Array:
    return np.concatenate([places for _, places in parts])


def _mirror(*groups: Array | NDArray[np.bool_]) -> Mirror:
    """Return the mirror of groups of inputs: places (n, 2), or whether each changes sign, (n,)."""
    order, flips = list[NDArray[np.int64]](), list[NDArray[np.bool_]]()
    for group in groups:
        is_places, first = group.ndim == 2, sum(map(len, order))
        own = KDTree(group).query(group * (-1, 1))[1] if is_places else np.arange(len(group))
        order.append(first + own)
        flips.append(np.zeros(len(group), bool) if is_places else group)
    signs = np.where(np.concatenate(flips), -1.0, 1.0).astype(np.float32)
    return np.concatenate(order), signs


@dataclass(frozen=True)
class View:
    """What the network of the receptors sees, of receptors at places of the pad."""

    places_mm: Array  # (receptors, 2)
    pressures: sparse.csr_array
    overlaps: sparse.csr_array

    @classmethod
    def of(cls, pad: Pad, places_mm: Array) -> View:
        """Return the view of receptors at X and Y (receptors, 2)."""
        places = np.asarray(places_mm, dtype=float)
        pressures = _around(places, pad.normal.grid, _OF_PRESSURE)
        return cls(places, pressures, _around(places, pad.grid, _OF_OVERLAP))

    def __call__(self, patch: ContactPatch) -> Array:
        """Return the inputs, (bodies, receptors, inputs)."""
        whole = patch.whole()
        bodies, receptors = len(whole), len(self.places_mm)
        parts = (
            _about(self.pressures, _PRESSURES_PER_MPA * patch.pressure_MPa, receptors),
            _about(self.overlaps, patch.overlap_mm, receptors),
            np.broadcast_to(whole[:, None], (bodies, receptors, whole.shape[1])),
            np.broadcast_to(self.places_mm / _REACH_MM, (bodies, receptors, 2)),
        )
        return np.concatenate(parts, axis=2, dtype=np.float32)


def _around(places: Array, grid: Grid, parts: tuple[tuple[float, Array], ...]) -> sparse.csr_array:
    """Return the matrix of means about places; its rows are receptors, in them their parts."""
    matrices = [grid.means((places[:, None] + about).reshape(-1, 2), half) for half, about in parts]
    of_place = np.concatenate([np.repeat(np.arange(len(places)), len(about)) for _, about in parts])
    return sparse.csr_array(sparse.vstack(matrices))[np.argsort(of_place, kind="stable")]


def _about(matrix: sparse.csr_array, values: Array, receptors: int) -> Array:
    """Return means about receptors, (bodies, receptors, means)."""
    return (matrix @ values.T).T.reshape(len(values), receptors, -1)


def mirror_of_view() -> Mirror:
    """Return the mirror of a view's inputs."""
    about = _places(_OF_PRESSURE), _places(_OF_OVERLAP)
    return _mirror(*about, np.array([*ACROSS, True, False]))


def stencil_parts() -> tuple[slice, slice]:
    """Return which inputs are pressures and which overlaps."""
    pressures, overlaps = len(_places(_OF_PRESSURE)), len(_places(_OF_OVERLAP))
    return slice(0, pressures), slice(pressures, pressures + overlaps)


class Overview:
    """What the network of the whole finger sees: coarse pressures, and the whole contact."""

    def __init__(self, pad: Pad) -> None:
        grid = pad.normal.grid
        half = _COARSE_MM * np.floor(np.abs(grid.low_mm) / _COARSE_MM)
        self._coarse = Grid.over(-half, half, _COARSE_MM)
        self._means = grid.means(self._coarse.points_mm, _COARSE_MM)
        self._cell_mm2 = pad.normal.cell_mm2

    def __call__(self, patch: ContactPatch) -> Array:
        """Return the inputs, (bodies, inputs)."""
        fine = patch.pressure_MPa
        coarse = _about(self._means, _PRESSURES_PER_MPA * fine, 1)[:, 0]
        pressed_mm2 = self._cell_mm2 * (fine > 0).sum(axis=1)
        # As many, if all cells that press pressed alike.
        alike = fine.sum(axis=1) ** 2 / np.maximum((fine**2).sum(axis=1), 1e-12)
        areas = np.column_stack([pressed_mm2, alike * self._cell_mm2]) / _AREA_MM2
        return np.concatenate([coarse, areas, patch.whole()], axis=1, dtype=np.float32)

    def mirror(self) -> Mirror:
        """Return the mirror of its inputs."""
        return _mirror(self._coarse.points_mm, np.array([False, False, *ACROSS]))


def columns_of(values: Array) -> dict[str, Array]:
    """Return the columns of every trace from outputs (..., outputs) of the receptors' network."""
    found, parts = {}, np.split(values, np.cumsum(_WIDTHS)[:-1], axis=-1)
    for each, part in zip(STANDARD, parts, strict=True):
        found[each.name] = part[..., 0] if np.ndim(each.rest) == 0 else part
    # The network's first output is the root of the energy density, which is nearly linear.
    found["sed_kPa"] = np.maximum(found["sed_kPa"], 0.0) ** 2
    return found


def outputs_of(trace: Mapping[str, Array]) -> Array:
    """Return the outputs (rows, receptors, outputs) that the receptors' network should give."""
    columns = [np.asarray(trace[each.name], dtype=float) for each in STANDARD]
    columns[0] = np.sqrt(np.maximum(columns[0], 0.0))
    return np.concatenate([c.reshape(*columns[0].shape, -1) for c in columns], axis=-1)
