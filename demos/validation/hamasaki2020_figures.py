"""The pictures of `hamasaki2020.py`, arranged as the paper's figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import shapely
from hamasaki2020_readings import (
    BUNDLES_MM,
    CURVATURES,
    HELD_HZ,
    PLATE,
    PROFILE,
    RAMP_HZ,
    Finger,
    first_high_mm,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D

from tactile_fem import draw
from tactile_fem.output import draw_spikes
from tactile_fem.results.histories import DISPLACEMENT
from tactile_fem.series import RateImage

COLOURS = {"reproduction": "#0072B2", "full size": "#009E73", "default": "#D55E00"}
FIRST = {(0.0, 5.0): "#D55E00", (5.0, 10.0): "#0072B2"}  # halves of the slide
INK, SHADE, OUTLINE = "#202020", "#E4E4E4", "#B0B0B0"
TICKS = {"marker": "|", "ms": 7, "mew": 1.2}
_PLACES_MM = np.linspace(0.0, 7.0, 71)
_MOST_SECTIONS = 4


def figures(fingers: Mapping[str, Finger]) -> dict[str, Figure]:
    """Return all figures by name."""
    return {"presses": presses(fingers), "middle": middle(fingers), "rasters": rasters(fingers)}


# --- Figs. 3, 5 and 6 ----------------------------------------------------------------------------


def presses(fingers: Mapping[str, Finger]) -> Figure:
    """Draw forces of the plate, profiles of the skin, and rates under cylinders."""
    figure = Figure(figsize=(8, 6.4), layout="constrained")
    (force, skin), (rates, key) = figure.subplots(2, 2)
    measured = {"ls": "", "marker": "o", "color": INK, "ms": 5}
    force.errorbar(PLATE.depth_mm, PLATE.mean, PLATE.sd, **measured)
    force.plot(1.97, 0.6, "*", color=INK, ms=12)
    skin.plot(PROFILE.place_mm, PROFILE.mean, **measured)
    rates.plot(CURVATURES, RAMP_HZ, **measured)
    rates.plot(CURVATURES, HELD_HZ, **measured | {"mfc": "white"})
    for name, finger in fingers.items():
        colour = COLOURS[name]
        force.plot(1.97, finger.pressed_N(), "*", color=colour, ms=12, mfc="none", mew=1.5)
        if "plate" not in finger.scans:
            continue
        force.plot(*finger.plate(), color=colour)
        for scan, line in (("edge", "-"), ("cylinder", "--")):
            skin.plot(_PLACES_MM, finger.profile(scan, _PLACES_MM), line, color=colour)
        ramp, hold = finger.rates_Hz().T
        rates.plot(CURVATURES, ramp, color=colour)
        rates.plot(CURVATURES, hold, "--", color=colour)
    force.set(title="3a", xlabel="Indentation (mm)", ylabel="Normal force (N)", ylim=(0, None))
    skin.set(title="3b", xlabel="Distance from the bar (mm)", ylabel="Deflection (mm)")
    skin.invert_yaxis()
    rates.set(title="5, 6", xlabel="Curvature of the cylinder (1/inch)", ylabel="Rate (spikes/s)")
    rates.set(xscale="log", xticks=CURVATURES, xticklabels=CURVATURES, ylim=(0, None))
    rates.minorticks_off()
    key.set_axis_off()
    key.legend(handles=_key(fingers), frameon=False, loc="center left")
    return figure


def _key(fingers: Mapping[str, Finger]) -> list[Line2D]:
    """Return what the lines and markers of `presses` mean."""
    dot = {"ls": "", "marker": "o", "color": INK}
    star = {"ls": "", "marker": "*", "ms": 12, "color": INK}
    return [
        *(Line2D([], [], color=COLOURS[name], label=name) for name in fingers),
        Line2D([], [], color=INK, label="plate (3a), edge (3b), ramp (5, 6)"),
        Line2D([], [], color=INK, ls="--", label="cylinder (3b), hold (5, 6)"),
        Line2D([], [], **dot, label="measured (3), assumed ramp (5, 6)"),
        Line2D([], [], **dot, mfc="white", label="assumed hold (5, 6)"),
        Line2D([], [], **star, label="letters, paper"),
        Line2D([], [], **star, mfc="none", label="letters, the fingers"),
    ]


# --- Fig. 8 --------------------------------------------------------------------------------------


def middle(fingers: Mapping[str, Finger]) -> Figure:
    """Draw SED and spikes of the middle afferent over the bundles of the paper's."""
    figure = Figure(figsize=(7.5, 4.8), layout="constrained")
    sed, fired = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
    for row, (name, finger) in enumerate(fingers.items()):
        seen = finger.middle()
        sed.plot(seen.along_mm, seen.sed_kPa, color=COLOURS[name], label=name)
        (spikes_mm,) = seen.fired.spikes
        draw_spikes(fired, spikes_mm, np.full(len(spikes_mm), -row), color=COLOURS[name], **TICKS)
    for number, (start, end) in enumerate(BUNDLES_MM):
        label = "" if number else "bundles of the paper"
        sed.axvspan(start, end, color=SHADE, lw=0, label=label)
        fired.axvspan(start, end, color=SHADE, lw=0)
    sed.set(ylabel="SED at the middle receptor (kPa)", ylim=(0, None))
    sed.legend(frameon=False)
    fired.set(xlabel=DISPLACEMENT, yticks=-np.arange(len(fingers)), yticklabels=list(fingers))
    ends = 0, sed.get_lines()[0].get_xdata()[-1]
    fired.set(xlim=ends, ylim=(0.5 - len(fingers), 0.5))
    return figure


def sections(finger: Finger, picture: Path) -> None:
    """Tile the finger, cut open, at the extrema of the middle receptor's SED in the slide."""
    drawn = sorted(file for file in draw(finger.scans["letters"]) if "deformation" in file.name)
    slid = [file for file in drawn if not file.stem.endswith("_s")][:_MOST_SECTIONS]
    if not slid:
        return
    figure = Figure(figsize=(10, 7), layout="constrained")
    for number, file in enumerate(slid):
        axes = figure.add_subplot(2, 2, number + 1)
        axes.imshow(imread(file))
        axes.set_axis_off()
    figure.savefig(picture, dpi=100)


# --- Fig. 9 --------------------------------------------------------------------------------------


def rasters(fingers: Mapping[str, Finger]) -> Figure:
    """Draw the population's spikes beside those of one fibre in many passes.

    Where each row of the population first has a high rate, in either half of the slide, is marked.
    """
    figure = Figure(figsize=(8, 3.5 * len(fingers)), layout="constrained")
    grid = figure.subplots(len(fingers), 2, squeeze=False, sharex=True, sharey=True)
    for row, (name, finger) in zip(grid, fingers.items(), strict=True):
        images = {"9a, population": finger.population(), "9b, one fibre": finger.fibre()}
        for axes, (title, image) in zip(row, images.items(), strict=True):
            raster(axes, image, finger)
            axes.set(title=f"{title}, {name}")
        for ends, colour in FIRST.items():
            image = images["9a, population"]
            place = first_high_mm(image, finger.study.protocol.speed_mm_s, ends)
            row[0].plot(place, image.across_mm, ls="", marker="o", ms=3.5, mew=0, color=colour)
        row[0].set_ylabel("X on the letter (mm)")
    for axes in grid[-1]:
        axes.set_xlabel(DISPLACEMENT)
    return figure


def raster(axes: Axes, image: RateImage, finger: Finger) -> None:
    """Draw a dot for each spike over the outline of the letters; X decreases upwards."""
    for ring in shapely.get_rings(shapely.get_parts(finger.study.stimulus.outlines())):
        y_on_x = shapely.get_coordinates(ring)[:, ::-1]
        axes.plot(*y_on_x.T, color=OUTLINE, lw=1)
    row, time_s = image.response.events()
    places = finger.study.protocol.speed_mm_s * time_s
    draw_spikes(axes, places, image.across_mm[row], ms=1.8, color=INK)
    axes.set(xlim=(0, image.along_mm[-1]), ylim=(5.2, -5.2), aspect="equal")
