"""What the table and the pictures of `hamasaki2020.py` read from the scans of a finger."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from tactile_fem import Results, Study
from tactile_fem.calibration.measurements import read_measurements
from tactile_fem.calibration.press import deflection
from tactile_fem.finger import SkinSurface
from tactile_fem.neuron import RateFit, Recording, Response, Window, fit, mean_rates, respond
from tactile_fem.neuron.response import Bundle
from tactile_fem.results.histories import central_receptor, extrema
from tactile_fem.series import RateImage, rate_image
from tactile_fem.study import Neuron

Array = NDArray[np.float64]

MEASURED = Path(__file__).parent / "measured"
(PLATE,), (PROFILE,) = (read_measurements([MEASURED / f"{n}.csv"]) for n in ("plate", "cylinder"))
# Curvatures of the paper's cylinders, 1/inch, and rates assumed under them, from what is known of
# SA1 afferents: 100 to 200 spikes/s at the end of the ramp, 10 to 50 after a second, falling.
CURVATURES = (16, 8, 4, 2)
RAMP_HZ, HELD_HZ = np.linspace(200, 100, 4), np.linspace(50, 10, 4)
CYLINDER_MM, RAMP_S, HOLD_S = 1.97, 0.0985, 1.0
WHEN = (0.8 * RAMP_S, RAMP_S), (RAMP_S + 0.9 * HOLD_S, RAMP_S + 0.999 * HOLD_S)
FREE = ("static_gain_pA_per_kPa", "adaptation")
# Where the middle afferent of the paper fires in bundles of high rate, mm of the slide; of what it
# does between them the text says nothing.
BUNDLES_MM = ((1.5, 2.3), (5.2, 6.0), (7.3, 8.5))
BETWEEN_MM = ((0.0, 1.5), (2.3, 5.2), (6.0, 7.3), (8.5, 10.0))
_GAP_MM = 0.6  # between bundles: 33 spikes/s at 20 mm/s
_BESIDE_MM = 0.8  # before and after a maximum of SED
# A high rate, /s, and the rows that are called central and outer; the letters reach to X = 3.9 mm.
HIGH_HZ, CENTRAL_MM, OUTER_MM = 100.0, (0.0, 1.0), (2.0, 4.0)
_HALF_MM = 5.0
# The gap of a G: between its strokes, so far from its right side; less a margin; columns about it.
_STROKE_MM, _MARGIN_MM, _ABOUT_MM = 0.4, 0.3, 1.0
_ROW_MM = 0.2
_SKIN_MM, _SKIN_POINTS = 8.0, 321


class Finger(NamedTuple):
    """A study and its scans, by name."""

    study: Study
    scans: dict[str, Results]

    # --- presses ---------------------------------------------------------------------------------

    def plate(self) -> tuple[Array, Array]:
        """Return depth, mm, and normal force, N, of the flat plate."""
        trace = self.scans["plate"].trace
        return trace["depth_mm"], trace["force_N"][:, 2]

    def pressed_N(self) -> float:
        """Return the letters' normal force at the end of the press."""
        trace = self.scans["letters"].trace
        return float(trace["force_N"][trace["time_s"] <= 1e-9][-1, 2])

    def profile(self, scan: str, places_mm: Array) -> Array:
        """Return the skin's deflection at distances from a bar, the mean of both sides, mm."""
        y = np.linspace(-_SKIN_MM, _SKIN_MM, _SKIN_POINTS)
        skin = SkinSurface(self.study.finger.mesh(), np.column_stack([np.zeros_like(y), y]))
        moved = skin.deformed_mm(self.scans[scan].load_checkpoint()["u"])
        return deflection(moved, skin.rest_mm, places_mm, axis=1)

    # --- rates under cylinders -------------------------------------------------------------------

    def cylinders(self) -> Iterator[tuple[Array, Array]]:
        """Yield times from the first touch and the SED of the receptor under each cylinder."""
        for curvature in CURVATURES:
            trace = self.scans[f"cylinder-{curvature}"].trace
            yield trace["time_s"] - trace["time_s"][0], trace["sed_kPa"][:, :1]

    def rates_Hz(self) -> Array:
        """Return the rates at the end of the ramp and of the hold, (cylinders, 2)."""
        windows = [Window(*when, [0.0]) for when in WHEN]
        each = [mean_rates(*one, windows, self.study.neuron)[:, 0] for one in self.cylinders()]
        return np.array(each)

    def fitted_neuron(self, decay_s: float | None = None) -> RateFit:
        """Return the neuron that comes nearest to the assumed rates; by default, its own decay."""
        recordings = [
            Recording(*one, [Window(*when, [rate]) for when, rate in zip(WHEN, rates, strict=True)])
            for one, *rates in zip(self.cylinders(), RAMP_HZ, HELD_HZ, strict=True)
        ]
        own = self.study.neuron
        start = own.model_copy(update={"adaptation_time_s": decay_s or own.adaptation_time_s})
        return fit(recordings, start, FREE)

    def with_neuron(self, neuron: Neuron) -> Finger:
        """Return the finger with another neuron: mechanics does not depend on it."""
        return self._replace(study=self.study.model_copy(update={"neuron": neuron}))

    # --- letters ---------------------------------------------------------------------------------

    def middle_history(self) -> tuple[Array, Array]:
        """Return times, 0 where the slide begins, and the SED of the middle receptor, kPa."""
        trace = self.scans["letters"].trace
        return trace["time_s"], trace["sed_kPa"][:, central_receptor(trace["receptors_mm"])]

    def middle(self) -> Middle:
        """Return what the middle afferent feels in the slide, and how it fires."""
        return middle_of(*self.middle_history(), self.study)

    def population(self, half_mm: float = np.inf) -> RateImage:
        """Return the image that the receptors up to X make in one pass: Fig. 9a."""
        trace = self.scans["letters"].trace
        x = trace["receptors_mm"][:, 0]
        near = np.abs(x) < half_mm + 1e-9
        return self._image(x[near], trace["time_s"], trace["sed_kPa"][:, near])

    def fibre(self) -> RateImage:
        """Return the image that the receptors near the middle make in all passes: Fig. 9b.

        The receptor at x passes over x - s of letters that are shifted by s.
        """
        passes = [scan for name, scan in self.scans.items() if name.startswith("letters")]
        shifts = np.array([scan.study.stimulus.shift_mm[0] for scan in passes])
        reach = np.diff(np.sort(shifts)).min(initial=np.inf) / 2
        time = np.unique(np.concatenate([scan.trace["time_s"] for scan in passes]).round(12))
        rows: dict[float, Array] = {}
        for shift, scan in zip(shifts, passes, strict=True):
            x = scan.trace["receptors_mm"][:, 0]
            for k in np.flatnonzero((x > -reach - 1e-9) & (x < reach - 1e-9)):
                felt = scan.trace["sed_kPa"][:, k]
                rows[round(float(x[k] - shift), 6)] = np.interp(time, scan.trace["time_s"], felt)
        return self._image(np.array(list(rows)), time, np.column_stack(list(rows.values())))

    def _image(self, across_mm: Array, time_s: Array, sed_kPa: Array) -> RateImage:
        """Return the image of receptors that pass at some X of the letters."""
        order, speed = np.argsort(across_mm), self.study.protocol.speed_mm_s
        afferents, felt = self.study.populations[0].population(), sed_kPa[:, order]
        return rate_image(across_mm[order], time_s, felt, speed, afferents, column_mm=_ROW_MM)

    def to_edge_mm(self, along_mm: float) -> float:
        """Return the middle receptor's distance from the letters' nearest edge."""
        edges = shapely.unary_union([part.boundary for part in self.study.stimulus.outlines()])
        return float(shapely.distance(edges, shapely.Point(0.0, along_mm)))

    def gap_Hz(self, image: RateImage) -> tuple[float, float]:
        """Return the rates over the right-hand gap of the middle letter and over its strokes.

        Both where its right side passes the row of receptors.
        """
        letter = min(self.study.stimulus.outlines(), key=lambda o: abs(o.centroid.y - _HALF_MM))
        right = letter.bounds[3]
        side = right - _STROKE_MM
        line = shapely.LineString([(-9.0, side), (9.0, side)])
        pieces = sorted(shapely.get_parts(line & letter).tolist(), key=lambda piece: piece.bounds)
        open_ = [(a.bounds[2], b.bounds[0]) for a, b in pairwise(pieces)]
        low, high = max(open_, key=lambda ends: ends[1] - ends[0])
        x, y = image.across_mm, image.along_mm
        columns = np.abs(y - right) < _ABOUT_MM
        over = shapely.contains_xy(letter, x, np.full(len(x), side))
        within = (x > low + _MARGIN_MM) & (x < high - _MARGIN_MM)
        return tuple(float(image.rate_Hz[np.ix_(rows, columns)].mean()) for rows in (within, over))


def misfit_Hz(found: RateFit) -> float:
    """Return the root mean square of what a fit misses."""
    return float(np.sqrt(np.mean(np.square(found.residuals_Hz))))


def middle_of(time_s: Array, sed_kPa: Array, study: Study) -> Middle:
    """Return how the neuron of a study fires, with places of the slide for times."""
    speed, slide = study.protocol.speed_mm_s, time_s >= -1e-9
    fired = respond(time_s, sed_kPa[:, None], study.neuron)
    spikes = Response([speed * fired.spikes[0]], 0.0, speed * fired.end_s)
    return Middle(speed * time_s[slide], sed_kPa[slide], spikes)


def rows_of(image: RateImage, ends_mm: tuple[float, float]) -> NDArray[np.intp]:
    """Return the rows whose distance from the middle is between two."""
    away = np.abs(image.across_mm)
    return np.flatnonzero((away >= ends_mm[0] - 1e-9) & (away <= ends_mm[1] + 1e-9))


def first_high_mm(image: RateImage, speed_mm_s: float, ends_mm: tuple[float, float]) -> Array:
    """Return where each row first has a high rate between two places, NaN where it has none."""
    found = []
    for spikes in image.response.spikes:
        fast = spikes[:-1][np.diff(spikes) <= 1 / HIGH_HZ] * speed_mm_s
        fast = fast[(fast >= ends_mm[0]) & (fast < ends_mm[1])]
        found.append(fast.min(initial=np.inf))
    return np.where(np.isfinite(found), found, np.nan)


class Middle(NamedTuple):
    """SED of the middle receptor over the slide; its spikes, whose times are places in mm."""

    along_mm: Array
    sed_kPa: Array
    fired: Response

    def rates_Hz(self, speed_mm_s: float, windows_mm: Iterable[tuple[float, float]]) -> list[float]:
        """Return the rates in windows of the slide."""
        return [speed_mm_s * float(self.fired.mean_rate(*ends)[0]) for ends in windows_mm]

    def maxima(self) -> NDArray[np.intp]:
        """Return the steps at which SED has its maxima."""
        return extrema(self.sed_kPa)[0]

    def beside_maxima_Hz(self, speed_mm_s: float) -> list[list[float]]:
        """Return the rates before the maxima of SED, and those after them."""
        places = self.along_mm[self.maxima()]
        before, after = [(y - _BESIDE_MM, y) for y in places], [(y, y + _BESIDE_MM) for y in places]
        return [self.rates_Hz(speed_mm_s, windows) for windows in (before, after)]

    def bundles(self) -> list[Bundle]:
        """Return the bundles of the slide; their times are places in mm."""
        return [one for one in self.fired.bundles(_GAP_MM)[0] if one.end_s > 0]
