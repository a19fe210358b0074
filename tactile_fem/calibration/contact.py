"""First contact in a curve of force over position: where the force begins to grow.

At the lowest forces of a press the force grows as a power of the depth. So

    F = F_0 + k max(z - z_0, 0)^p,    1 <= p <= 2.75,

is fitted to them, with an offset ``F_0`` if there are rows before contact. Only where this rejects
``z_0 = 0`` do positions count from elsewhere: a curve that is tared stays as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError

Array = NDArray[np.float64]

_POWERS = np.arange(1.0, 2.76, 0.125)
# Share of the largest force up to which the law is fitted: above, fingers stiffen.
_LOWEST = 0.12
# Standard deviation of a force in the fit, as shares of it and of the largest.
_SHARE, _SHARE_OF_LARGEST = 0.03, 0.005
# Averages that are fitted; rows that are needed in all, before contact, and in the fit after it.
_AVERAGES, _LEAST_ROWS, _BEFORE, _AFTER = 1000, 5, 2, 6
_LEAST_VARIANCE = 0.1  # of deviations in their standard deviations
_TRIED = 121  # positions of contact, in each of two rounds
# Contact is not at 0 if that adds so many variances to the sum of squares, more of them with few
# degrees of freedom, and is off by this share of the press. If it is off by the second share before
# the first row, where it is extrapolated, there is no depth.
_REJECTED, _MORE_OF_FEW, _OFF, _OFF_BEFORE = 12.0, 8.0, 0.05, 0.5


def first_contact(position_mm: Array, force_N: Array, where: str) -> tuple[float, float]:
    """Return position in mm and force in N at first contact of a curve, (rows,) in any order.

    The position is 0 unless the force shows another one; the force is 0 without rows before it.

    Raises
    ------
    StudyError
        Positions do not grow into the finger, or count from elsewhere and begin in contact; the
        message begins with `where`.
    """
    order = np.argsort(position_mm, kind="stable")
    order = order[np.isfinite(position_mm + force_N)[order]]
    z, force = position_mm[order], force_N[order]
    if len(z) < 2:
        return 0.0, 0.0
    if z[0] == z[-1]:
        raise StudyError(f"{where}: the depth does not change, so there is no press.")
    if np.ptp(force) and np.corrcoef(z, force)[0, 1] < 0:
        raise StudyError(
            f"{where}: the force at the largest depth is {force[-1]:.3g} N but must be above 0 and "
            f"the largest; it is {force[0]:.3g} N at the smallest, {z[0]:.3g} mm. Depths must grow "
            "into the finger, and forces are positive where it is pressed."
        )
    contact = _fitted(z, force, where) if len(z) >= _LEAST_ROWS and np.ptp(force) else 0.0
    before = force[z < contact]
    return contact, float(np.median(before)) if len(before) >= _BEFORE else 0.0


def _fitted(z: Array, force: Array, where: str) -> float:
    """Return the position of first contact of rows in the order of their position."""
    if len(z) > _AVERAGES:
        part = np.ceil((z - z[0]) / (z[-1] - z[0]) * _AVERAGES)
        _, part, rows = np.unique(part, return_inverse=True, return_counts=True)
        z, force = np.bincount(part, z) / rows, np.bincount(part, force) / rows
    rise = force - np.sort(force)[: max(_BEFORE, len(force) // 20)].mean()
    largest, deepest = rise.max(), z[-1]
    after = np.sort(rise[rise > 0.01 * largest])[:_AFTER]
    end = np.flatnonzero(rise <= max(_LOWEST * largest, after[-1]))[-1] + 1
    lowest = z[:end], force[:end], np.hypot(_SHARE * rise, _SHARE_OF_LARGEST * largest)[:end]
    tried = np.linspace(z[0] - (z[end - 1] - z[0]) / 2, z[end - _BEFORE], _TRIED)
    for _ in range(2):
        squares = [_squares(at, *lowest) for at in tried]
        contact, step = float(tried[np.argmin(squares)]), tried[1] - tried[0]
        tried = np.linspace(contact - step, contact + step, _TRIED)
    freedom = max(end - 4, 1)
    variance = max(min(squares) / freedom, _LEAST_VARIANCE)
    rejected = _REJECTED * (1 + _MORE_OF_FEW / freedom) * variance
    off = abs(contact) / (deepest - contact)
    if off < _OFF or _squares(0.0, *lowest) - min(squares) < rejected:
        return 0.0
    if np.count_nonzero(z < contact) >= _BEFORE:
        return contact
    if off > _OFF_BEFORE:
        raise StudyError(
            f"{where}: depths begin at {z[0]:.3g} mm, in contact, and by its force the curve met "
            f"the finger at about {contact:.2g} mm: depths must count from first contact, or the "
            "curve must begin some rows before it."
        )
    return 0.0


def _squares(contact: float, z: Array, force: Array, sd: Array) -> float:
    """Return the least sum of squares of the law with its contact there."""
    depth = np.maximum(z - contact, 0.0) / max(z[-1] - contact, 1e-9)
    law = np.where(depth > 0, depth ** _POWERS[:, None], 0.0) / sd  # (powers, rows)
    flat, values = 1 / sd, force / sd
    if np.count_nonzero(depth == 0) >= _BEFORE:  # with an offset: without its share of both
        law = law - np.outer(law @ flat, flat) / (flat @ flat)
        values = values - flat * (flat @ values) / (flat @ flat)
    slopes = np.maximum(law @ values, 0.0) / np.maximum(np.sum(law**2, axis=1), 1e-30)
    return float(np.sum((values - slopes[:, None] * law) ** 2, axis=1).min())
