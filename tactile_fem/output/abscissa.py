"""The horizontal axis of the figures of a scan: the whole path, with its phases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from tactile_fem.results.histories import DISPLACEMENT, TIME

Array = NDArray[np.float64]

_SHADE, _BORDER = "#EEF1F5", "#B9C2CC"
# Names of phases, in points; the width of a letter, and the height of a line.
_NAME_PT, _LETTER_PT, _LINE_PT = 7.5, 4.4, 9.0
_ROUNDING = 1e-9


class Phase(NamedTuple):
    """A named part of the path, from one value of the axis to another."""

    name: str
    start: float
    end: float


@dataclass(frozen=True)
class Abscissa:
    """The axis of a scan's figures, `values` (steps,) being those of the rows of its trace.

    It is the time. If a press is followed by nothing but a steady slide along the finger, towards
    the palm, it is the displacement, which is also Y on the stimulator; times of the press are then
    as far below 0 as the slide goes in the same time. ``per_s`` is the length of a second.
    """

    label: str
    per_s: float
    values: Array
    phases: tuple[Phase, ...]

    @classmethod
    def of(cls, trace: Mapping[str, NDArray[Any]]) -> Abscissa:
        """Return the axis for the arrays of a trace."""
        time_s, speed_mm_s = trace["time_s"], _steady_speed_mm_s(trace)
        label, per_s = (DISPLACEMENT, speed_mm_s) if speed_mm_s else (TIME, 1.0)
        phases = tuple(
            Phase(name, float(per_s * time_s[first]), float(per_s * time_s[last]))
            for name, first, last in _phase_rows(trace)
        )
        return cls(label, per_s, per_s * time_s, phases)

    @property
    def ends(self) -> tuple[float, float]:
        """The first and the last value."""
        return float(self.values[0]), float(self.values[-1])

    @property
    def is_to_scale(self) -> bool:
        """Whether it is a length on the stimulator."""
        return self.label == DISPLACEMENT

    def at(self, time_s: ArrayLike) -> Array:
        """Return the places of times on the axis."""
        return self.per_s * np.asarray(time_s, dtype=float)

    def columns_s(self, count: int) -> Array:
        """Return evenly spaced times, from the first to the last."""
        return np.linspace(*self.ends, count) / self.per_s

    def draw(self, axes: Axes, *, names: bool = True, label: bool = True) -> None:
        """Set the limits and ticks of the axis, shade every other phase and name them on top."""
        start, end = self.ends
        axes.set_xlim(start, end if end > start else start + 1.0)
        for k, phase in enumerate(self.phases):
            if k % 2 == 0:
                axes.axvspan(phase.start, phase.end, facecolor=_SHADE, lw=0, zorder=0)
            if k:
                axes.axvline(phase.start, color=_BORDER, lw=0.6, zorder=0.05)
            if names:
                _name(axes, phase, end - start)
        if self.is_to_scale:
            ticks = _locator(axes).tick_values(0.0, end)
            axes.set_xticks(ticks[(ticks >= 0) & (ticks <= end + _ROUNDING)])
        if label:
            axes.set_xlabel(self.label)
        if label and self.is_to_scale:  # then the time is a second axis below
            functions = (lambda at: at / self.per_s), self.at
            second = axes.secondary_xaxis("bottom", functions=functions)
            second.spines["bottom"].set_position(("outward", 34))
            second.xaxis.set_major_locator(_locator(axes))
            second.set_xlabel(TIME)


def inches(axes: Axes) -> tuple[float, float]:
    """Return width and height of axes."""
    figure, box = axes.get_figure(root=True), axes.get_position()
    width, height = figure.get_size_inches()
    return box.width * width, box.height * height


def _locator(axes: Axes) -> MaxNLocator:
    """Return what finds as many ticks as the width of axes has room for."""
    return MaxNLocator(min(8, max(3, int(1.6 * inches(axes)[0]))), steps=[1, 2, 5, 10])


def _name(axes: Axes, phase: Phase, whole: float) -> None:
    """Write the name of a phase above it, upright where it is narrow, if there is any room."""
    width_pt = 72 * inches(axes)[0]
    room_pt = (phase.end - phase.start) / whole * width_pt if whole else width_pt
    if room_pt < _LINE_PT:
        return
    style: dict[str, Any] = {"rotation": 0 if room_pt > _LETTER_PT * len(phase.name) else 90}
    style |= {"ha": "center", "va": "bottom", "fontsize": _NAME_PT, "color": "#55606B"}
    middle, above = (phase.start + phase.end) / 2, axes.get_xaxis_transform()
    axes.text(middle, 1.015, phase.name, transform=above, gid="phase", **style)


def _phase_rows(trace: Mapping[str, NDArray[Any]]) -> list[tuple[str, int, int]]:
    """Return name, and rows of the beginning and the end, of each phase.

    Folders without phases have a press up to time 0.
    """
    pressed = np.where(trace["time_s"] <= _ROUNDING, "press", "slide")
    names = np.asarray(trace.get("phase", pressed))[1:]
    if not len(names):
        return []
    first = np.flatnonzero(np.concatenate([[True], names[1:] != names[:-1]]))
    last = np.concatenate([first[1:], [len(names)]])
    return [(str(names[a]), int(a), int(b)) for a, b in zip(first, last, strict=True)]


def _steady_speed_mm_s(trace: Mapping[str, NDArray[Any]]) -> float:
    """Return the speed of a slide towards the palm that fills the time from 0 on; 0 if none does.

    Two times are needed. A body that turns slides along no line.
    """
    rows = trace["time_s"] >= -_ROUNDING
    time_s, slid_mm = trace["time_s"][rows], trace["displacement_mm"][rows]
    turns = np.any(trace.get("stimulator_rad", 0.0))
    if len(time_s) < 2 or slid_mm[-1] <= 0 or turns:
        return 0.0
    speed = float(slid_mm[-1] / time_s[-1])
    places = trace["stimulator_mm"][rows, :2]
    straight = places[:1] + slid_mm[:, None] * [0.0, -1.0]
    steady = np.allclose(slid_mm, speed * time_s, atol=1e-6)
    return speed if steady and np.allclose(places, straight, atol=1e-9) else 0.0
