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
# What the spline through the values may differ from the function between them, mm and as a share of
# the relief: a smooth function differs by far less, a step by half its height.
_ERROR_MM, _ERROR_SHARE = 1e-3, 0.01


class Heights(Stimulus):
    """A surface whose heights are a function of X and Y, in a file of the user's."""

    kind: Literal["heights"] = "heights"
    z: Code = Field(
        description='"module:name", a function in a Python file beside the study, or in Python the '
        "function: it takes arrays of X and Y (mm, over the contact point at displacement 0) and "
        "returns heights in mm"
    )
    cell_mm: Positive = Field(0.05, description="between two places at which it is evaluated")
    period_mm: tuple[NonNegative, NonNegative] = Field(
        (0.0, 0.0), description="after which it repeats along X and along Y; 0: it does not"
    )
    size_mm: tuple[Positive, Positive] = Field(
        (40.0, 60.0),
        description="part around the origin that is used, along an axis without a period; beyond "
        "it follows its mirror image",
    )

    @property
    def is_kept_sampled(self) -> bool:
        """Whether results keep a sampled copy for pictures: then these need not run the code."""
        return True

    def shape(self) -> Relief:
        """Return everything below the spline through the function's values."""
        from tactile_fem.stimulus.relief import Relief  # SciPy takes a while

        lengths = [own or size for own, size in zip(self.period_mm, self.size_mm, strict=True)]
        counts = [2 * max(math.ceil(length / self.cell_mm / 2), 2) for length in lengths]
        if math.prod(counts) > _MAX_VALUES:
            raise StudyError(
                f"stimulus.cell_mm = {self.cell_mm:g} makes {math.prod(counts):,} heights, but "
                f"{_MAX_VALUES:,} are allowed: choose a longer one, a smaller size_mm or a period"
            )
        steps = np.divide(lengths, counts)
        axes = [step * (np.arange(n) - (n - 1) / 2) for step, n in zip(steps, counts, strict=True)]
        values, repeats = self._values(axes), any(self.period_mm)
        # An axis without a period has that of the part and its mirror image beside one with it.
        more = [repeats and not own for own in self.period_mm]
        pad = [(n // 2 * own,) * 2 for n, own in zip(counts, more, strict=True)]
        padded = np.pad(values, pad, mode="symmetric")
        body = Relief.of(padded, steps, 0.0, "grid-wrap" if repeats else "mirror")
        self._check_smooth(body, axes, values)
        return body

    def _check_smooth(self, body: Relief, axes: list[Array], values: Array) -> None:
        """Refuse edges that the values cannot follow, and other heights after a period."""
        middles = [(at[1:] + at[:-1]) / 2 for at in axes]
        found, first = (
            body.heights.values(np.stack(np.meshgrid(*at, indexing="ij"), -1).reshape(-1, 2))
            for at in (middles, [at[:1] for at in axes])
        )
        later = [at + period for at, period in zip(middles, self.period_mm, strict=True)]
        error = np.abs(found - first + values[0, 0] - self._values(later).ravel())
        worst = int(np.argmax(error))
        if error[worst] > _ERROR_MM + _ERROR_SHARE * np.ptp(values):
            x, y = (float(at.flat[worst]) for at in np.meshgrid(*middles, indexing="ij"))
            check = "; check that it repeats after period_mm" if any(self.period_mm) else ""
            raise StudyError(
                f"stimulus.z = {self.z} has an edge at X {x:.3g}, Y {y:.3g} mm that is too sharp "
                f"for cell_mm = {self.cell_mm:g} (there it is {error[worst]:.2g} mm off a smooth "
                f"surface through its values): round it off or choose a smaller cell_mm{check}"
            )

    def _values(self, axes: list[Array]) -> Array:
        """Return the heights (nx, ny) at X (nx,) and Y (ny,)."""
        key, places = "stimulus.z = ", np.meshgrid(*axes, indexing="ij")
        function = self.z.load(key)
        with self.z.running(key):
            values = np.asarray(function(*places), dtype=np.float64)
            values = np.broadcast_to(values, places[0].shape)
        if not np.ptp(values) <= _MAX_RELIEF_MM:
            raise StudyError(
                f"{key}{self.z} must return finite heights in mm that differ by at most "
                f"{_MAX_RELIEF_MM:g} mm, but they differ by {np.ptp(values):.3g} mm"
            )
        return values
