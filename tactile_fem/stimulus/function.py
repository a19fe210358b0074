"""A surface whose heights are a function."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from tactile_fem.errors import StudyError
from tactile_fem.runtime.own_code import Code
from tactile_fem.runtime.settings import NonNegative, Positive
from tactile_fem.stimulus.body import Array
from tactile_fem.stimulus.stimulus import Stimulus

if TYPE_CHECKING:
    from tactile_fem.stimulus.relief import Relief

_MAX_VALUES, _MAX_RELIEF_MM = 4_000_000, 20.0
# By how much it may leave a smooth surface through its values, mm and as a share of its relief.
_ERROR_MM, _ERROR_SHARE = 1e-3, 0.01


class Heights(Stimulus):
    """A surface whose heights are a function of X and Y."""

    kind: Literal["heights"] = "heights"
    z: Code = Field(
        description='"module:name", a function in a Python file beside the study (in Python the '
        "function itself): heights, mm, of arrays X and Y, mm"
    )
    cell_mm: Positive = Field(0.05, description="between two places at which it is evaluated")
    period_mm: tuple[NonNegative, NonNegative] = Field(
        (0.0, 0.0), description="after which it repeats along X and along Y; 0: it does not"
    )
    size_mm: tuple[Positive, Positive] = Field(
        (40.0, 60.0),
        description="part about X = Y = 0 without a period; its mirror image lies beyond",
    )

    @property
    def is_kept_sampled(self) -> bool:
        """Whether results keep a sampled copy for pictures: these need not run the code then."""
        return True

    def shape(self) -> Relief:
        """Return what lies below the spline through the function's values."""
        from tactile_fem.stimulus.relief import Relief  # SciPy takes a while

        lengths = [own or size for own, size in zip(self.period_mm, self.size_mm, strict=True)]
        counts = [2 * max(math.ceil(length / self.cell_mm / 2), 2) for length in lengths]
        if math.prod(counts) > _MAX_VALUES:
            raise StudyError(
                f"stimulus.cell_mm = {self.cell_mm:g} makes {math.prod(counts):,} heights, but "
                f"{_MAX_VALUES:,} are allowed: choose a longer one, a smaller size_mm or a period"
            )
        steps, repeats = np.divide(lengths, counts), any(self.period_mm)
        axes = [step * (np.arange(n) - (n - 1) / 2) for step, n in zip(steps, counts, strict=True)]
        values = self._values(axes)
        # Beside an axis with a period, the part and its mirror image are that of the other one.
        more = [
            0 if own or not repeats else n // 2
            for own, n in zip(self.period_mm, counts, strict=True)
        ]
        padded = np.pad(values, [(n, n) for n in more], mode="symmetric")
        body = Relief.of(padded, steps, 0.0, "grid-wrap" if repeats else "mirror")
        self._check_smooth(body, axes, values)
        return body

    def _check_smooth(self, body: Relief, axes: list[Array], values: Array) -> None:
        """Refuse edges that the values cannot follow, and other heights after a period."""
        between = [(at[1:] + at[:-1]) / 2 for at in axes]
        x, y = (at.ravel() for at in np.meshgrid(*between, indexing="ij"))
        below = values[0, 0] - body.heights.values(np.array([[at[0] for at in axes]]))
        later = [at + period for at, period in zip(between, self.period_mm, strict=True)]
        found = body.heights.values(np.column_stack([x, y])) + below
        error = np.abs(found - self._values(later).ravel())
        worst = int(np.argmax(error))
        if error[worst] > _ERROR_MM + _ERROR_SHARE * np.ptp(values):
            check = "; check that it repeats after period_mm" if any(self.period_mm) else ""
            raise StudyError(
                f"stimulus.z = {self.z} has an edge at X {x[worst]:.3g}, Y {y[worst]:.3g} mm that "
                f"is too sharp for cell_mm = {self.cell_mm:g} ({error[worst]:.2g} mm off a smooth "
                f"surface): round it off or choose a smaller cell_mm{check}"
            )

    def _values(self, axes: list[Array]) -> Array:
        """Return the heights (nx, ny) at X (nx,) and Y (ny,)."""
        places = np.meshgrid(*axes, indexing="ij")
        function = self.z.load("stimulus.z = ")
        with self.z.running("stimulus.z = "):
            values = np.broadcast_to(np.asarray(function(*places), float), places[0].shape)
        if not np.ptp(values) <= _MAX_RELIEF_MM:
            raise StudyError(
                f"stimulus.z = {self.z} must return finite heights in mm that differ by at most "
                f"{_MAX_RELIEF_MM:g} mm, but they differ by {np.ptp(values):.3g} mm"
            )
        return values
