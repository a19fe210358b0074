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
_TRIED = 121  # positions of contact, in each of two rounds
# Contact is not at 0 if it, or the force before, is off by this share of the press and 0 adds so
# many variances to the sum of squares, more of them with few degrees of freedom. The least variance
# is that of deviations in their standard deviations.
_OFF, _REJECTED, _MORE_OF_FEW, _LEAST_VARIANCE = 0.05, 12.0, 8.0, 0.1
_NO_OFFSET = 1e-6  # share of the largest force


def from_contact(depth_mm: Array, force_N: Array, where: str) -> tuple[Array, list[str]]:
    """Return depth and force of a curve since first contact, (rows, 2), and what it was in words.

    The rows may be in any order. Contact is at 0 unless the force shows another position; without
    rows before it there is no offset of the force.

    Raises
    ------
    StudyError
        The depth does not change, or the force falls with it; the message begins with `where`.
    """
    order = np.argsort(depth_mm, kind="stable")
    order = order[np.isfinite(depth_mm + force_N)[order]]
    z, force = depth_mm[order], force_N[order]
    if len(z) and z[0] == z[-1]:
        raise StudyError(f"{where}: the depth does not change, so there is no press.")
    changes = len(z) > 1 and np.ptp(force) > 0
    if changes and np.corrcoef(z, force)[0, 1] < 0:
        raise StudyError(
            f"{where}: the force at the largest depth is {force[-1]:.3g} N but must be above 0 and "
            f"the largest; it is {force[0]:.3g} N at the smallest, {z[0]:.3g} mm. Depths must grow "
            "into the finger, and forces are positive where it is pressed."
        )
    contact_mm = _fitted(z, force) if changes and len(z) >= _LEAST_ROWS else 0.0
    before = force[z < contact_mm]
    offset_N = float(np.median(before)) if len(before) >= _BEFORE else 0.0
    said = [f"contact at {contact_mm:.3f} mm"] if contact_mm else []
    if abs(offset_N) > _NO_OFFSET * np.ptp(force):
        said.append(f"force offset {offset_N:.3g} N")
    return np.column_stack([depth_mm - contact_mm, force_N - offset_N]), said


def _fitted(z: Array, force: Array) -> float:
    """Return the position of first contact of rows in the order of their position."""
    parts = np.array_split(np.arange(len(z)), min(len(z), _AVERAGES))
    z, force = (np.array([of[part].mean() for part in parts]) for of in (z, force))
    rise = force - np.sort(force)[: max(_BEFORE, len(force) // 20)].mean()
    after = np.sort(rise[rise > 0.01 * rise.max()])[:_AFTER]
    end = np.flatnonzero(rise <= max(_LOWEST * rise.max(), after[-1]))[-1] + 1
    sd = np.hypot(_SHARE * rise, _SHARE_OF_LARGEST * rise.max())
    lowest = z[:end], force[:end], sd[:end]
    tried = np.linspace(z[0] - (z[end - 1] - z[0]) / 2, z[end - _BEFORE], _TRIED)
    for _ in range(2):
        squares = [_squares(at, *lowest) for at in tried]
        contact, step = float(tried[np.argmin(squares)]), tried[1] - tried[0]
        tried = np.linspace(contact - step, contact + step, _TRIED)
    freedom = max(end - 4, 1)
    variance = max(min(squares) / freedom, _LEAST_VARIANCE)
    excess = (_squares(0.0, *lowest) - min(squares)) / variance
    before = force[z < contact]
    if len(before) < _BEFORE or excess < _REJECTED * (1 + _MORE_OF_FEW / freedom):
        return 0.0
    is_off = abs(contact) > _OFF * (z[-1] - contact)
    return contact if is_off or abs(np.median(before)) > _OFF * rise.max() else 0.0


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
