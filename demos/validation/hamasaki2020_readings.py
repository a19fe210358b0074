"""What the table and the pictures of `hamasaki2020.py` read from the scans of a finger."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from tactile_fem import Results, Study
from tactile_fem.calibration.measurements import read_measurements
from tactile_fem.calibration.press import deflection
from tactile_fem.finger.deformation import SkinSurface
from tactile_fem.neuron import RateFit, Recording, Response, Window, fit, mean_rates
from tactile_fem.output.histories import central_receptor
from tactile_fem.series import RateImage, rate_image

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
# Windows of the slide, mm: the middle afferent of the paper is silent in every second one.
WINDOWS_MM = (0.0, 1.5, 2.3, 5.2, 6.0, 7.3, 8.5, 10.0)
_GAP_MM = 0.6  # between bundles: 33 spikes/s at 20 mm/s
_ROW_MM, _BLUR_MM, _LATEST_MM = 0.2, 0.3, 1.5
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

    def fitted_neuron(self) -> RateFit:
        """Return the neuron that comes nearest to the assumed rates."""
        recordings = [
            Recording(*one, [Window(*when, [rate]) for when, rate in zip(WHEN, rates, strict=True)])
            for one, *rates in zip(self.cylinders(), RAMP_HZ, HELD_HZ, strict=True)
        ]
        return fit(recordings, self.study.neuron, FREE)

    # --- letters ---------------------------------------------------------------------------------

    def middle(self) -> Middle:
        """Return what the middle afferent feels in the slide, and how it fires."""
        trace, speed = self.scans["letters"].trace, self.study.protocol.speed_mm_s
        central, slide = central_receptor(trace["receptors_mm"]), trace["time_s"] >= -1e-9
        fired = self.study.populations[0].population().fire(trace)
        return Middle(
            trace["displacement_mm"][slide],
            trace["sed_kPa"][slide, central],
            Response([speed * fired.spikes[central]], 0.0, speed * fired.end_s),
        )

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

    def outline_r(self, image: RateImage) -> float:
        """Return an image's correlation with the letters' outline, the largest over its delay."""
        edges = shapely.unary_union([part.boundary for part in self.study.stimulus.outlines()])
        found = []
        for delay in np.arange(0.0, _LATEST_MM, _ROW_MM):
            places = np.meshgrid(image.across_mm, image.along_mm - delay, indexing="ij")
            away = shapely.distance(edges, shapely.points(*places))
            near = np.exp(-0.5 * (away / _BLUR_MM) ** 2)
            found.append(np.corrcoef(near.ravel(), image.rate_Hz.ravel())[0, 1])
        return float(max(found))


class Middle(NamedTuple):
    """SED of the middle receptor over the slide; its spikes, whose times are places in mm."""

    along_mm: Array
    sed_kPa: Array
    fired: Response

    def rates_Hz(self, speed_mm_s: float) -> list[float]:
        """Return the rates in the paper's windows."""
        return [speed_mm_s * float(self.fired.mean_rate(*ends)[0]) for ends in pairwise(WINDOWS_MM)]

    def bundles(self) -> list[str]:
        """Return where the bundles of the slide begin and end."""
        bundles = self.fired.bundles(_GAP_MM)[0]
        return [f"{one.start_s:.1f} to {one.end_s:.1f}" for one in bundles if one.end_s > 0]
