"""Fields: quantities of the tissue that the mechanics averages for each receptor."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]
_KPA_PER_MPA = 1000.0


@dataclass(frozen=True)
class MaterialPoint:
    """State of the tissue at a point, as UFL expressions.

    Attributes
    ----------
    displacement_mm
        (3,).
    deformation_gradient
        ``F = I + grad u``, (3, 3).
    energy_MPa
        Strain energy per undeformed volume.
    cauchy_MPa
        Cauchy stress, viscous stress included, (3, 3).
    """

    displacement_mm: Any
    deformation_gradient: Any
    energy_MPa: Any
    cauchy_MPa: Any


@dataclass(frozen=True)
class Field:
    """A quantity of the tissue, averaged over the points that a receptor samples.

    A drive names the fields that it needs (`tactile_fem.neuron.Drive`); the scan evaluates them
    and stores each as a column of the trace.

    Parameters
    ----------
    name
        Name of the column, with its unit: ``shear_strain``, ``pressure_kPa``.
    at
        Takes a `MaterialPoint` and returns a UFL scalar, vector or tensor; import UFL in it.
    rest
        Value of the column in the undeformed finger: a number, or (n,) numbers for a column of n
        components.
    of_mean
        Makes the column, (receptors,) or (receptors, n), of the averaged expression, whose first
        dimension is that of the receptors; by default it is the column.
    """

    name: str
    at: Callable[[MaterialPoint], Any]
    rest: ArrayLike = 0.0
    of_mean: Callable[[Array], Array] = np.asarray

    def at_rest(self, count: int) -> Array:
        """Return the row of the column for `count` receptors of the undeformed finger."""
        rest = np.asarray(self.rest, dtype=float)
        return np.tile(rest, (count, *[1] * rest.ndim))


def _von_mises(point: MaterialPoint) -> Any:
    import ufl

    deviator = ufl.dev(point.cauchy_MPa)
    return _KPA_PER_MPA * ufl.sqrt(1.5 * ufl.inner(deviator, deviator) + 1e-30)


def _right_cauchy_green(point: MaterialPoint) -> Any:
    F = point.deformation_gradient
    return F.T * F


def _principal_stretches(C: Array) -> Array:
    return np.sqrt(np.linalg.eigvalsh((C + np.swapaxes(C, 1, 2)) / 2))


def _lower(matrix: Any) -> Any:
    """Return xx, yx, yy, zx, zy, zz of a symmetric UFL matrix."""
    import ufl

    return ufl.as_vector([matrix[i, j] for i in range(3) for j in range(i + 1)])


def _principal_stresses(lower: Array) -> Array:
    matrices = np.zeros((len(lower), 3, 3))
    matrices[:, *np.tril_indices(3)] = lower
    finite = np.isfinite(lower).all(axis=1)
    values = np.full((len(lower), 3), np.nan)
    values[finite] = np.linalg.eigvalsh(matrices[finite])
    return values


SED = Field("sed_kPa", lambda point: _KPA_PER_MPA * point.energy_MPa)
VON_MISES = Field("von_mises_kPa", _von_mises)
# Principal values rise; tension is positive.
STRETCHES = Field("stretches", _right_cauchy_green, (1.0, 1.0, 1.0), _principal_stretches)
STRESSES = Field(
    "stresses_kPa",
    lambda point: _lower(_KPA_PER_MPA * point.cauchy_MPa),
    (0.0, 0.0, 0.0),
    _principal_stresses,
)
MOVED = Field("moved_mm", lambda point: point.displacement_mm, (0.0, 0.0, 0.0))
# Every trace has these.
STANDARD = (SED, VON_MISES, STRETCHES, STRESSES, MOVED)
# C = F^T F: xx, yx, yy, zx, zy, zz.
RIGHT_CAUCHY_GREEN = Field(
    "right_cauchy_green",
    lambda point: _lower(_right_cauchy_green(point)),
    (1.0, 0.0, 1.0, 0.0, 0.0, 1.0),
)


def stretch_along(right_cauchy_green: Array, directions: Array) -> Array:
    """Return the stretch ``sqrt(d . C d)`` in directions of the undeformed finger.

    C is (..., receptors, 6), as `RIGHT_CAUCHY_GREEN` has it; directions are unit vectors,
    (receptors, 3).
    """
    row, column = np.tril_indices(3)
    products = np.where(row == column, 1.0, 2.0) * directions[:, row] * directions[:, column]
    return np.sqrt(np.sum(right_cauchy_green * products, axis=-1))


def trial_histories(fields: Iterable[Field]) -> dict[str, Array]:
    """Return an artificial history of one receptor, to test drives and transductions with."""
    rise = np.array([0.0, 0.1, 0.05])
    columns = {field.name: np.add.outer(rise, field.at_rest(1)) for field in fields}
    return {"time_s": np.array([0.0, 0.05, 0.1]), "directions": np.eye(1, 3), **columns}
