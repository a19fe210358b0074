"""Spike bundles: runs of spikes that follow one another closely along the scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tactile_fem.errors import StudyError


@dataclass(frozen=True)
class Bundle:
    """A run of spikes.

    Attributes
    ----------
    start_mm, end_mm
        Displacement of the first and the last spike.
    spikes
        Their number.
    rate_Hz
        Mean rate between them, spikes/s.
    """

    start_mm: float
    end_mm: float
    spikes: int
    rate_Hz: float


def bundles(
    displacement_mm: ArrayLike, speed_mm_s: float, *, gap_mm: float = 0.6, least: int = 3
) -> list[Bundle]:
    """Return the bundles in one receptor's spikes.

    Parameters
    ----------
    displacement_mm
        (spikes,) rising.
    speed_mm_s
        Of the slide.
    gap_mm
        Spikes farther apart belong to different bundles; a gap of 0.6 mm is a rate of 33
        spikes/s at 20 mm/s.
    least
        Fewer spikes make no bundle.

    Raises
    ------
    StudyError
        The speed or the gap is not positive.
    """
    if not (gap_mm > 0 and speed_mm_s > 0):
        raise StudyError(f"gap_mm {gap_mm:g} and speed_mm_s {speed_mm_s:g} must be positive.")
    places = np.sort(np.asarray(displacement_mm, dtype=float))
    runs = np.split(places, np.flatnonzero(np.diff(places) > gap_mm) + 1)
    return [_bundle(run, speed_mm_s) for run in runs if len(run) >= max(least, 2)]


def _bundle(run: np.ndarray, speed_mm_s: float) -> Bundle:
    length = run[-1] - run[0]
    rate = (len(run) - 1) * speed_mm_s / length if length > 0 else np.inf
    return Bundle(float(run[0]), float(run[-1]), len(run), float(rate))
