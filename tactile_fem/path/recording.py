"""Measured places and forces of a finger and a body over time, from a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from tactile_fem.errors import StudyError
from tactile_fem.path.loads import Array
from tactile_fem.runtime.settings import Finite, Positive, Settings
from tactile_fem.runtime.text import read_rows

_TIME = "time_s"
PLACES = ("x_mm", "y_mm", "z_mm")
TURNS = ("rx_deg", "ry_deg", "rz_deg")
LOADS = ("fx_N", "fy_N", "fz_N", "tz_Nmm")
COLUMNS = (*PLACES, *TURNS, *LOADS)
_Axis = Literal["x", "-x", "y", "-y", "z", "-z"]
_KNOTS = 12  # of the smoothing spline in a period that it halves
_REVERSED = -0.5  # mean sign, between -1 and 1, of a column that should be positive


@dataclass(frozen=True)
class Recording:
    """What a file holds.

    Attributes
    ----------
    time_s, contact_s
        Increasing times, (n,); that of the contact, infinite if it is not given.
    names
        The columns that it has.
    values, smooth
        All `PLACES` (of the body's origin), `TURNS` (its rotation vector) and `LOADS` (forces on
        the finger, and torque about Z through the body's origin), 0 for what it lacks, (n, 10).
    """

    time_s: Array
    names: tuple[str, ...]
    values: Array
    smooth: Array
    contact_s: float = np.inf

    def of(self, names: Sequence[str]) -> Array:
        """Return some columns after smoothing, (n, names)."""
        return self.smooth[:, [COLUMNS.index(name) for name in names]]

    def smoothed(self, period_s: float) -> Recording:
        """Return it with smooth places and loads, at times that need not be even.

        The P-spline (Eilers and Marx 1996) minimizes the integral of (y - f)^2 + (period / 2 pi)^4
        f''^2: it halves a wave of the period, and keeps a straight line; SciPy's smoothing spline,
        with a knot at each sample, loses its digits where these are thousands to a period.
        """
        from scipy import interpolate, sparse  # takes a while

        since_s = self.time_s - self.time_s[0]
        count = int(min(np.ceil(_KNOTS * since_s[-1] / period_s), 2 * len(since_s)))
        at = since_s / since_s[-1] * count
        basis = interpolate.BSpline.design_matrix(at, np.arange(-3.0, count + 4), 3)
        weighted = basis.T @ sparse.diags_array(np.gradient(at))
        bend = sparse.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count + 1, count + 3))
        stiffness = (period_s / since_s[-1] * count / (2 * np.pi)) ** 4 * (bend.T @ bend)
        matrix, right = (weighted @ basis + stiffness).tocsc(), weighted @ self.values
        smooth = basis @ sparse.linalg.spsolve(matrix, right)
        smooth[:, 3:6] = self.values[:, 3:6]  # rotation vectors may jump
        return replace(self, smooth=smooth)

    def pressed_mm(self) -> float:
        """Return the mean Z where the normal force is above half its largest; NaN without it."""
        force, height = self.of(["fz_N", "z_mm"]).T
        is_known = {"fz_N", "z_mm"} <= {*self.names} and _sign(force) > -_REVERSED
        return float(height[force > force.max() / 2].mean()) if is_known else np.nan

    def against_motion(self) -> list[str]:
        """Return the tangential forces that do negative work, while friction's is positive."""
        works = np.diff(self.of(PLACES[:2]), axis=0) * self.of(LOADS[:2])[1:]
        share = np.abs(works).sum(axis=0) / max(np.abs(works).sum(), 1e-300)
        return [LOADS[k] for k in (0, 1) if share[k] > 0.1 and _sign(works[:, k]) < _REVERSED]


def _sign(values: Array) -> float:
    """Return the mean sign of values, weighted by their squares."""
    return float((values * np.abs(values)).sum() / max((values**2).sum(), 1e-300))


def _rotation(axes: tuple[str, ...]) -> Array:
    """Return the rotation of a recording into the finger's axes, (3, 3)."""
    return np.array([np.eye(3)["xyz".index(axis[-1])] * (-1) ** (axis[0] == "-") for axis in axes])


def _right_handed(axes: tuple[str, ...]) -> tuple[str, ...]:
    if np.linalg.det(_rotation(axes)) < 0.5:
        raise ValueError(f"{', '.join(axes)} is not right-handed, as -y, x, z is")
    return axes


class Frame(Settings):
    """Whose places and forces a recording has, along which axes, and when contact begins."""

    moves: Literal["body", "finger"] = Field("body", description="whose places the file has")
    forces_on: Literal["finger", "body"] = Field("finger", description="what its forces act on")
    axes: Annotated[tuple[_Axis, _Axis, _Axis], AfterValidator(_right_handed)] = Field(
        ("x", "y", "z"), description="its axes along X (across), Y (to the tip) and Z (to the nail)"
    )
    contact_N: Positive | None = Field(
        None, description="normal force above the noise: the first touch is extrapolated from it"
    )
    contact_s: Finite | None = Field(None, description="its time instead; with neither, z_mm = 0")

    def read(self, file: Path, start: str, smooth_s: float | None = None) -> Recording:
        """Return places of the body, from the contact, and forces on the finger, in its axes."""
        where, recorded = f"{start}: {file}", self._turned(read_recording(file, start), start)
        if smooth_s is not None:
            recorded = recorded.smoothed(smooth_s)
        if _sign(recorded.values[:, 8]) < _REVERSED:
            raise StudyError(
                f"{where}: the sign of fz_N is wrong, for a body cannot pull at the finger: change "
                f'forces_on, which is "{self.forces_on}", or axes.'
            )
        time_s, force, at = recorded.time_s, recorded.values[:, 8], self.contact_s
        if self.contact_N is not None:
            z = recorded.of(["z_mm"])[:, 0] + 1e-9 * time_s  # rises also without z_mm
            levels = np.array([1, 4]) * (self.contact_N if at is None else np.nan)
            at_s = np.interp(levels, np.maximum.accumulate(force), time_s, np.nan, np.nan)
            near, deep = np.interp(at_s, time_s, z)  # twice as deep if force is as depth squared
            at = float(np.interp(2 * near - deep, np.maximum.accumulate(z), time_s, np.nan, np.nan))
        if at is None:
            return recorded
        if not time_s[0] <= at <= time_s[-1]:
            within = f"within its times, {time_s[0]:g} to {time_s[-1]:g} s."
            if self.contact_N is None:
                raise StudyError(f"{where}: contact_s is {at:g} but must be {within}")
            if "fz_N" not in recorded.names:
                raise StudyError(
                    f"{where} has no normal force, which contact_N needs: set contact_s, {within}"
                )
            raise StudyError(
                f"{where} has no contact from {time_s[0]:g} to {time_s[-1]:g} s, and up to "
                f"{force.max():.3g} N: set contact_s, or contact_N to a quarter of that at most; "
                f'if the sign of z_mm is wrong, change moves, which is "{self.moves}".'
            )
        rows, shift = recorded.of(PLACES).T, np.zeros_like(recorded.values)
        shift[:, :3] = x, y, _ = [np.interp(at, time_s, row) for row in rows]
        if self.moves == "finger":  # the torque was about the laboratory's axis
            shift[:, 9] = recorded.values[:, 6:8] @ [y, -x]
        values, smooth = recorded.values - shift, recorded.smooth - shift
        return Recording(time_s, recorded.names, values, smooth, float(at))

    def _turned(self, recorded: Recording, start: str) -> Recording:
        """Return a recording in the finger's axes."""
        into = str.maketrans("".join(axis[-1] for axis in self.axes), "xyz")
        names = tuple(name.translate(into) for name in recorded.names)
        if "tz_Nmm" in recorded.names and self.axes[2][-1] != "z":
            raise StudyError(f"{start}: with tz_Nmm the last of axes must be z or -z.")
        if self.moves == "finger" and {*TURNS} & {*names}:
            raise StudyError(f'{start}: with turns moves must be "body".')
        axes, of, on = _rotation(self.axes), self.moves == "body", self.forces_on == "finger"
        signs = np.where([[of], [True], [on]], 1.0, -1.0)
        vectors = recorded.values[:, :9].reshape(-1, 3, 3) @ axes.T * signs
        torque = recorded.values[:, 9:] * axes[2, 2] * signs[2]
        values = np.hstack([vectors.reshape(-1, 9), torque]) + 0.0  # no -0
        return Recording(recorded.time_s, names, values, values)


def read_recording(file: Path, start: str = "protocol.path") -> Recording:
    """Return what a CSV file holds, whose first line names its columns.

    StudyError, beginning with `start`, the key that names it: it cannot be read, has other columns,
    less than two rows, a value that is no finite number, or times that do not increase.
    """
    rows = read_rows(file, f"{start}: {file}")
    heading = rows[0][1] if rows else ["empty"]
    names = [name.strip() for name in heading]
    is_known = names[0] == _TIME and {*names[1:]} <= {*COLUMNS}
    if not is_known or len(names) < 2 or len({*names}) < len(names):
        raise StudyError(
            f"{start}: the first line of {file} is {_shown(heading)} but must be {_TIME} and some "
            f"of {', '.join(COLUMNS)}."
        )
    values = np.array(
        [_numbers(row, len(names), f"{start}: line {line} of {file}") for line, row in rows[1:]]
    )
    if len(values) < 2:
        raise StudyError(
            f"{start}: {file} must have at least two rows of numbers but has {len(values)}."
        )
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if late.size:
        before, after = values[late[0] : late[0] + 2, 0]
        raise StudyError(
            f"{start}: {_TIME} in {file} must increase, but {after:g} follows {before:g} in "
            f"line {rows[late[0] + 2][0]}."
        )
    whole = np.zeros((len(values), len(COLUMNS)))
    whole[:, [COLUMNS.index(name) for name in names[1:]]] = values[:, 1:]
    return Recording(values[:, 0], tuple(names[1:]), whole, whole)


def _numbers(row: list[str], count: int, where: str) -> list[float]:
    try:
        values = [float(text) for text in row]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise StudyError(f"{where} is {_shown(row)} but must be {count} finite numbers.")
    return values


def _shown(row: list[str]) -> str:
    """Return a line of the file, short enough for a sentence."""
    text = " ".join(",".join(row).split())
    return text if len(text) <= 60 else text[:57] + "..."
