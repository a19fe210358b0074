"""How afferents fire under letters, beside what is known of recorded ones."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import shapely
from recordings import HISTORIES, Array

from tactile_fem import Study
from tactile_fem.neuron import Drive, Response, respond
from tactile_fem.study import Neuron

STUDY = Study()
# Spikes further apart belong to different bursts: 33 spikes/s at 20 mm/s.
_GAP_MM = 0.6
_STEP_MM = 0.01
_MIDDLE_MM, _AFTER_MM = 1.0, 1.0


@dataclass(frozen=True)
class LetterFiring:
    """The firing of a row of afferents in the default scan.

    Attributes
    ----------
    x_mm
        Places of the receptors, (receptors,), from one side to the other.
    response
        Spikes from the begin of the slide on; times are displacements over the speed.
    slid_mm
        Length of the slide.
    """

    x_mm: Array
    response: Response
    slid_mm: float

    @classmethod
    def of(cls, neuron: Neuron, drive: Drive) -> LetterFiring:
        """Return how afferents fire to what `histories.py` stored of the letters."""
        with np.load(HISTORIES / "letters.npz") as stored:
            arrays = {key: stored[key] for key in stored.files}
        time_s, felt = drive.of(arrays)
        order = np.argsort(arrays["x_mm"])
        slide = float(time_s[np.argmax(arrays["displacement_mm"] > 0) - 1])
        fired = respond(time_s, felt[:, order], neuron, feels=drive)
        spikes = [times[times >= slide] - slide for times in fired.spikes]
        length = float(arrays["displacement_mm"][-1])
        end = length / STUDY.protocol.speed_mm_s
        return cls(arrays["x_mm"][order], Response(spikes, 0.0, end), length)

    @property
    def middle(self) -> int:
        """The afferent at the finger's middle."""
        return int(np.abs(self.x_mm).argmin())

    def bursts(self) -> str:
        """Return where the middle afferent fires in bursts, in words."""
        speed = STUDY.protocol.speed_mm_s
        bundles = self.response.bundles(_GAP_MM / speed)[self.middle]
        return ", ".join(
            f"{speed * b.start_s:.1f} to {speed * b.end_s:.1f} mm: {b.spikes} at {b.rate_Hz:.0f}/s"
            for b in bundles
        )

    def rate_away(self, away_mm: float) -> float:
        """Return the rate, spikes/s, of middle afferents farther than that from every stroke.

        The first millimetre of the slide, in which they still answer to the press, is left out.
        """
        speed = STUDY.protocol.speed_mm_s
        spikes, seconds = 0, 0.0
        for k in np.flatnonzero(np.abs(self.x_mm) <= _MIDDLE_MM):
            at = np.arange(_AFTER_MM, self.slid_mm, _STEP_MM)
            mine = speed * self.response.spikes[k]
            mine = mine[mine > _AFTER_MM]
            seconds += (to_strokes(self.x_mm[k], at) > away_mm).sum() * _STEP_MM / speed
            spikes += int((to_strokes(self.x_mm[k], mine) > away_mm).sum())
        return spikes / seconds


@cache
def strokes() -> shapely.Geometry:
    """Return all strokes of the default letters."""
    return shapely.unary_union([s for s in STUDY.stimulus.outlines() if not s.is_empty])


def to_strokes(x_mm: float, displacement_mm: Array) -> Array:
    """Return the distance of the undeformed skin at x from the nearest stroke, mm."""
    x = np.full_like(displacement_mm, x_mm)
    return shapely.distance(strokes(), shapely.points(x, displacement_mm))
