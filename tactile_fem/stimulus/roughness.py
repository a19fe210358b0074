"""Which waves a measured surface is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import dctn

from tactile_fem.stimulus.body import Array
from tactile_fem.stimulus.spline import GridSpline

_BINS = 400


@dataclass(frozen=True)
class Roughness:
    """The variance of heights (n,), in mm2, of waves between decreasing wavelengths (n + 1,)."""

    wavelength_mm: Array
    variance_mm2: Array

    @classmethod
    def of(cls, heights: GridSpline) -> Roughness:
        """Analyse heights over a plane, without their mean."""
        values = heights.values_on_grid()
        power = dctn(values, type=2, norm="ortho") ** 2 / values.size
        # The wave of number k goes up and down k / 2 times over the grid.
        across, along = (
            np.arange(n) / (2 * n * step)
            for n, step in zip(values.shape, heights.spacing, strict=True)
        )
        frequency = np.hypot(across[:, None], along[None, :])
        power[0, 0] = 0.0
        lowest, highest = min(across[1], along[1]), frequency[-1, -1]
        edges = np.geomspace(0.999 * lowest, 1.001 * highest, _BINS + 1)
        variance, _ = np.histogram(frequency, edges, weights=power)
        return cls(1 / edges, variance)

    @property
    def rms_mm(self) -> float:
        """The root mean square of the heights."""
        return float(np.sqrt(self.variance_mm2.sum()))

    def share(self, wavelength_mm: float) -> float:
        """Return the share of the variance in waves of this length and longer ones."""
        total = self.variance_mm2.sum()
        if not total:
            return 1.0
        carried = np.append(0.0, np.cumsum(self.variance_mm2)) / total
        return float(np.interp(-wavelength_mm, -self.wavelength_mm, carried))

    def wavelength_of(self, share: float) -> float:
        """Return the wavelength in mm of which longer waves carry this share of the variance."""
        carried = np.cumsum(self.variance_mm2) / max(self.variance_mm2.sum(), 1e-300)
        return float(self.wavelength_mm[1:][np.searchsorted(carried, share)])
