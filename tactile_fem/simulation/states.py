"""Finds a state that a scan kept, by its displacement or its time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tactile_fem.errors import StudyError

_SAME_MM, _SAME_S = 1e-6, 1e-6


def choose_state(
    displacement_mm: ArrayLike,
    time_s: ArrayLike,
    at_mm: float | None = None,
    at_s: float | None = None,
) -> int:
    """Return the number of the only state at a displacement, at a time, or at both.

    By the displacement alone, states from the end of the indentation on are preferred: before it
    the displacement is 0.

    Parameters
    ----------
    displacement_mm, time_s
        Of the states that were kept, (states,).
    at_mm, at_s
        At least one of them.

    Raises
    ------
    StudyError
        There is none, or several, as where the body holds and lifts; it has no subject.
    """
    slid, times = np.asarray(displacement_mm, dtype=float), np.asarray(time_s, dtype=float)
    there = np.full(len(times), True)
    wanted = []
    if at_mm is not None:
        there &= np.abs(slid - at_mm) < _SAME_MM
        wanted.append(f"{at_mm:g} mm")
    if at_s is not None:
        there &= np.isclose(times, at_s, rtol=1e-5, atol=_SAME_S)  # as messages round it
        wanted.append(f"{at_s:g} s")
    elif (there & (times > -_SAME_S)).any():
        there &= times > -_SAME_S
    found = np.flatnonzero(there)
    if len(found) == 1:
        return int(found[0])
    where = " and ".join(wanted)
    if len(found):
        listed = ", ".join(f"{time:.6g}" for time in times[found])
        raise StudyError(f"has several states at {where}: choose one by its time, {listed} s.")
    values, unit = (slid, "mm") if at_s is None else (times, "s")
    kept = ", ".join(f"{value:.6g}" for value in values)
    kept = f"states were kept at {kept} {unit}" if kept else "set output.states for the scan"
    raise StudyError(f"has no state at {where}: {kept}.")
