"""Mean rates as a fast finger answers them, with their errors: in words and in a figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem import Trace
from tactile_fem.output import DISTINCT, styled

Array = NDArray[Any]

_MOST_OUTSIDE = 0.1  # part of the time for which errors may be unknown
_SIZE_INCHES, _ALPHA = (3.35, 2.6), 0.25


@dataclass(frozen=True)
class Rates:
    """Mean rates of afferents on surfaces from the end of the indentation on, with their errors.

    Attributes
    ----------
    traces
        Of a fast finger, by the names of the surfaces.
    rate_Hz
        Spikes/s, (surfaces, receptors).
    """

    traces: Mapping[str, Trace]
    rate_Hz: Array

    def error_Hz(self, name: str = "mean_rate_error") -> Array:
        """Return the error of the mean of all or, by ``rate_error``, of one afferent, (surfaces,).

        It is NaN if the finger's file states none, or it answers beyond what it was made from.
        """
        found = []
        for trace, rates in zip(self.traces.values(), self.rate_Hz, strict=True):
            columns = trace.arrays()
            share = columns.get(name, np.full(len(trace), np.nan))
            outside = np.average(np.isnan(share[1:]), weights=np.diff(columns["clock_s"]))
            known = np.nanmax(share) if outside < _MOST_OUTSIDE else np.nan
            fires = rates > 0 if name == "rate_error" else np.ones_like(rates)
            found.append(known * rates.sum() / max(np.sum(fires), 1))
        return np.array(found)

    def alike(self) -> str | None:
        """Return in a sentence which mean rates differ by less than their error, or None."""
        mean, error = self.rate_Hz.mean(axis=1), self.error_Hz()
        if unknown := [name for name, one in zip(self.traces, error, strict=True) if np.isnan(one)]:
            return (
                f"the errors of the rates on {', '.join(unknown)} are unknown: the fast finger "
                "answers beyond what it was made from, or its file is older and must be made anew"
            )
        pairs = [
            f"{one} and {other} ({abs(mean[a] - mean[b]):.1f} of {limit:.1f} spikes/s)"
            for (a, one), (b, other) in combinations(enumerate(self.traces), 2)
            if abs(mean[a] - mean[b]) < (limit := np.hypot(error[a], error[b]))
        ]
        said = f"means over all afferents differ by less than their error: {', '.join(pairs)}"
        return said if pairs else None

    @styled
    def figure(self) -> Figure:
        """Draw the rates across the finger, with the error of one afferent as a band.

        Receptors at the same X are averaged. The legend has the mean of all, with its error.
        """
        figure = Figure(figsize=_SIZE_INCHES, layout="constrained")
        axes, errors = figure.subplots(), (self.error_Hz(), self.error_Hz("rate_error"))
        rows = zip(self.traces.items(), self.rate_Hz, *errors, cycle(DISTINCT), strict=False)
        for (name, trace), rates, of_mean, error, colour in rows:
            x, at = np.unique(trace.receptors_mm[:, 0], return_inverse=True)
            drawn = np.bincount(at, rates) / np.bincount(at)
            known = "error unknown" if np.isnan(of_mean) else f"± {of_mean:.1f} spikes/s"
            label = f"{name}: {rates.mean():.1f} {known}"
            axes.plot(x, drawn, color=colour, lw=1.2, label=label)
            low = np.maximum(drawn - error, 0.0)
            axes.fill_between(x, low, drawn + error, color=colour, alpha=_ALPHA, lw=0)
        axes.set(xlabel="X of the receptor (mm)", ylabel="Mean rate (spikes/s)", ylim=(0, None))
        figure.legend(loc="outside upper left", fontsize=7.5)
        return figure
