"""Compares the results of two codes for the same press and slide; used by `calculix.py`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from tactile_fem import write_table
from tactile_fem.study import Protocol


@dataclass(frozen=True)
class Cost:
    """Cost of a code.

    `seconds` is wall time without start-up; `cpu_seconds` hardly changes when the computer has
    other work too.
    """

    code: str
    tetrahedra: int
    unknowns: int
    cores: int
    finished: bool
    steps: int
    iterations: int
    seconds: float
    cpu_seconds: float

    @property
    def seconds_per_iteration(self) -> float:
        """Wall time of an iteration."""
        return self.seconds / max(self.iterations, 1)


@dataclass(frozen=True)
class Way:
    """Histories of a press or slide: (n,) mm, (n, 3) N on the finger, (n, points) kPa."""

    way_mm: np.ndarray
    force_N: np.ndarray
    sed_kPa: np.ndarray

    def at(self, way_mm: np.ndarray) -> Way:
        """Return these histories at other positions, interpolated linearly."""
        force, sed = (
            np.column_stack([np.interp(way_mm, self.way_mm, c) for c in field.T])
            for field in (self.force_N, self.sed_kPa)
        )
        return Way(way_mm, force, sed)


def print_cost(mine: Cost, other: Cost) -> None:
    """Print the cost of both codes."""
    for name, value in asdict(mine).items():
        pair = value, getattr(other, name)
        shown = (f"{v:.4g}" if isinstance(v, float) else str(v) for v in pair)
        print(f"{name.replace('_', ' '):24}{'  '.join(f'{text:>12}' for text in shown)}")
    ratio = other.seconds_per_iteration / mine.seconds_per_iteration
    print(f"ratio of seconds per iteration: {ratio:.1f}")
    if other.finished:
        print(f"ratio of seconds: {other.seconds / mine.seconds:.1f}")


@dataclass(frozen=True)
class Place:
    """Forces at one position; the tangential one is opposite to the motion."""

    depth_mm: float
    slide_mm: float
    normal_N: float
    calculix_normal_N: float
    tangential_N: float
    calculix_tangential_N: float


@dataclass(frozen=True)
class Point:
    """SED at one receptor at the end of press or slide."""

    moment: str
    x_mm: float
    y_mm: float
    sed_kPa: float
    calculix_sed_kPa: float


def compare(protocol: Protocol, points: np.ndarray, mine: Way, other: Way, folder: Path) -> None:
    """Print, save and draw the differences at our steps, as far as both codes got.

    A difference is told as a share of CalculiX's value at the same place; friction as a share of
    its value at the end, since it starts from nothing. `points` are (n, 3) mm.
    """
    mine = mine.at(mine.way_mm[mine.way_mm < other.way_mm[-1] + 1e-9])
    other = other.at(mine.way_mm)
    depth = np.minimum(mine.way_mm, protocol.depth_mm)
    slide = mine.way_mm - depth
    normal, their_normal = mine.force_N[:, 2], other.force_N[:, 2]
    friction, their_friction = -mine.force_N[:, 1], -other.force_N[:, 1]
    table = np.column_stack([depth, slide, normal, their_normal, friction, their_friction])
    places = [Place(*row) for row in table.tolist()]
    write_table(folder / "forces.csv", places)

    pressing = slide < 1e-9
    # Letters that do not touch yet leave nothing to compare.
    touching = their_normal > 0.01 * their_normal[pressing].max()
    differs = 100 * np.abs(normal / np.where(touching, their_normal, np.inf) - touching)
    print(f"press: normal force differs by at most {differs[pressing].max():.2f} %")
    print(f"press: normal force at the end differs by {differs[pressing][-1]:.2f} %")
    ends = {"press": np.count_nonzero(pressing) - 1}
    if not pressing.all():
        ends["slide"] = len(slide) - 1
        print(f"slide: normal force differs by at most {differs[~pressing].max():.2f} %")
        differs = 100 * np.abs(friction - their_friction)[~pressing] / their_friction[-1]
        print(f"slide: friction differs by at most {differs.max():.2f} %")
        print(f"slide: friction at the end differs by {differs[-1]:.2f} %")
    felt = [
        Point(moment, *at[:2].tolist(), float(a), float(b))
        for moment, row in ends.items()
        for at, a, b in zip(points, mine.sed_kPa[row], other.sed_kPa[row], strict=True)
    ]
    felt.sort(key=lambda point: (point.moment, point.y_mm))
    write_table(folder / "sed.csv", felt)
    print_points(felt)
    draw(places, felt, folder / "comparison.png")


def print_points(felt: list[Point]) -> None:
    """Print the SED of both codes at each point."""
    for p in felt:
        sentence = f"{p.moment}: SED at Y {p.y_mm:+.1f} mm {p.sed_kPa:.4f} kPa, CalculiX "
        differs = abs(p.sed_kPa / p.calculix_sed_kPa - 1)
        print(f"{sentence}{p.calculix_sed_kPa:.4f} kPa, differs by {differs:.2%}")


def draw(places: list[Place], felt: list[Point], picture: Path) -> None:
    """Draw forces and SED of both codes."""
    figure = Figure(figsize=(10, 3.2), layout="constrained")
    press, slide, sed = figure.subplots(1, 3)
    pressed = [p for p in places if p.slide_mm < 1e-9]
    slid = [pressed[-1], *(p for p in places if p.slide_mm >= 1e-9)]
    blue, orange = "#0072B2", "#D55E00"
    for axes, rows, x, kinds in (
        (press, pressed, "depth_mm", {"normal": blue}),
        (slide, slid, "slide_mm", {"normal": blue, "tangential": orange}),
    ):
        for kind, colour in kinds.items():
            at = [getattr(p, x) for p in rows]
            axes.plot(at, [getattr(p, f"{kind}_N") for p in rows], color=colour, label=kind)
            other = [getattr(p, f"calculix_{kind}_N") for p in rows]
            axes.plot(at, other, "o", color=colour, mfc="none", label=f"{kind}, CalculiX")
    press.set(xlabel="Indentation (mm)", ylabel="Normal force (N)")
    slide.set(xlabel="Slide (mm)", ylabel="Force (N)")
    for moment, colour in (("press", blue), ("slide", orange)):
        points = [p for p in felt if p.moment == moment]
        if points:
            y = [p.y_mm for p in points]
            label = f"end of {moment}"
            sed.plot(y, [p.sed_kPa for p in points], color=colour, label=label)
            other = [p.calculix_sed_kPa for p in points]
            sed.plot(y, other, "o", color=colour, mfc="none", label=f"{label}, CalculiX")
    sed.set(xlabel="Y along the finger (mm)", ylabel="Strain energy density (kPa)")
    for axes in (press, slide, sed):
        axes.legend(frameon=False, fontsize="small")
        axes.set_ylim(bottom=0)
    figure.savefig(picture, dpi=150)
