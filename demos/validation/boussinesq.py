"""An elastic half-space under a rigid relief: pressures by Boussinesq's solution, strain in depth.

The skin is incompressible, without friction, and flat but for the gap that its form leaves between
it and the relief before either is loaded, as in Hertz's theory. x runs across the finger, y along.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.optimize import minimize

Array = NDArray[np.float64]

_TOLERANCE = 1e-9  # of the work of the pressures, relative, when the search for them ends
_MOST_STEPS = 2000
_KPA_PER_MPA = 1e3


@dataclass(frozen=True)
class HalfSpace:
    """An incompressible half-space, loaded within a rectangle about the origin.

    Attributes
    ----------
    modulus_MPa
        Young's.
    half_mm
        Half the sides of the rectangle, x and y.
    cell_mm
        Side of the square cells, under each of which the pressure is uniform.
    """

    modulus_MPa: float
    half_mm: tuple[float, float]
    cell_mm: float = 0.1

    @cached_property
    def places_mm(self) -> tuple[Array, Array]:
        """The cells' x and y, (n,) and (m,); both contain 0."""
        counts = [round(half / self.cell_mm) for half in self.half_mm]
        x, y = (self.cell_mm * np.arange(-count, count + 1) for count in counts)
        return x, y

    # --- surface -------------------------------------------------------------------------------

    @cached_property
    def _padded(self) -> tuple[int, int]:
        """Cells in x and y with a border that keeps loads from meeting their periodic images."""
        n, m = (fft.next_fast_len(2 * len(line), real=True) for line in self.places_mm)
        return n, m

    @cached_property
    def _compliance(self) -> Array:
        """Transform of what 1 MPa on a cell does to the surface, mm (Love 1929)."""
        x, y = np.meshgrid(
            *(self.cell_mm * n * fft.fftfreq(n) for n in self._padded), indexing="ij"
        )
        a = self.cell_mm / 2

        def corner(x: Array, y: Array) -> Array:
            return x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y))

        depth = corner(x + a, y + a) - corner(x - a, y + a)
        depth += corner(x - a, y - a) - corner(x + a, y - a)
        return fft.rfft2(0.75 / (np.pi * self.modulus_MPa) * depth)

    def deflection_mm(self, pressure_MPa: Array) -> Array:
        """Return how far pressures, (n, m), push the surface down, (n, m)."""
        moved = fft.irfft2(self._compliance * self._transform(pressure_MPa), self._padded)
        return moved[: pressure_MPa.shape[0], : pressure_MPa.shape[1]]

    def _transform(self, pressure_MPa: Array) -> NDArray[np.complex128]:
        return fft.rfft2(pressure_MPa, self._padded)

    def pressures_MPa(
        self, gap_mm: Array, depth_mm: float, start_MPa: Array | None = None
    ) -> Array:
        """Return the pressures under a relief that has come `depth_mm` past the first touch.

        They minimize the complementary energy among those that do not pull (Kalker 1977).

        Parameters
        ----------
        gap_mm
            Between skin and relief before either is loaded, (n, m); infinite where there is none.
        depth_mm
            Of the relief.
        start_MPa
            Where the search starts, those of a state nearby.
        """
        wanted = depth_mm - gap_mm
        near = wanted > 0  # nothing rises under pressures: elsewhere skin is not touched
        full = np.zeros_like(gap_mm)
        if not near.any():
            return full

        def energy(pressure: Array) -> tuple[float, Array]:
            full[near] = pressure
            moved = self.deflection_mm(full)[near]
            return float(pressure @ (moved / 2 - wanted[near])), moved - wanted[near]

        start = np.zeros(near.sum()) if start_MPa is None else start_MPa[near]
        options = {"maxiter": _MOST_STEPS, "maxfun": 2 * _MOST_STEPS, "maxcor": 20}
        options |= {"ftol": _TOLERANCE, "gtol": 0.0}
        bounds = [(0, None)] * len(start)
        found = minimize(energy, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        if not found.success:
            raise RuntimeError(f"no pressures found: {found.message}")
        full[near] = found.x
        return full.copy()

    def force_N(self, pressure_MPa: Array) -> float:
        """Return the force of pressures."""
        return float(pressure_MPa.sum()) * self.cell_mm**2

    # --- in depth ------------------------------------------------------------------------------

    def sed_kPa(self, pressure_MPa: Array, depth_mm: float) -> Array:
        """Return the strain energy density below the cells, (n, m), at a depth in the skin.

        Sum of squared strains times the shear modulus, a third of Young's: nothing is compressed.
        """
        n, m = self._padded
        kx = 2j * np.pi * fft.fftfreq(n, self.cell_mm)[:, None]
        ky = 2j * np.pi * fft.rfftfreq(m, self.cell_mm)[None, :]
        q = np.sqrt(np.abs(kx) ** 2 + np.abs(ky) ** 2)
        q[0, 0] = 1.0  # there all strains vanish
        shear_MPa = self.modulus_MPa / 3
        p = self._transform(pressure_MPa) * np.exp(-q * depth_mm) / (2 * shear_MPa)
        p[0, 0] = 0.0
        z = depth_mm
        # Displacements of a pressure with wave number q: along z p (1 + q z)/q, across -k z p/q.
        strains = {
            "xx": -kx * kx * z / q * p,
            "yy": -ky * ky * z / q * p,
            "zz": -q * z * p,
            "xy": -kx * ky * z / q * p,
            "xz": kx * z * p,
            "yz": ky * z * p,
        }
        n, m = pressure_MPa.shape
        squares = np.zeros((n, m))
        for name, strain in strains.items():
            weight = 1 if name[0] == name[1] else 2
            squares += weight * fft.irfft2(strain, self._padded)[:n, :m] ** 2
        return _KPA_PER_MPA * shear_MPa * squares
