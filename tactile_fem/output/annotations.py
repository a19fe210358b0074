"""Colours of the tissues, and what is written on pictures: title, legend and colour bar."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from typing import NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LogNorm, Normalize, to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from tactile_fem.finger.mesh_data import TISSUES

# Okabe and Ito's colours, which colour-blind readers can distinguish.
BLUE, VERMILION, GREEN, INK = "#0072B2", "#D55E00", "#009E73", "#222222"
DISTINCT = (BLUE, VERMILION, GREEN, "#CC79A7", "#E69F00", "#56B4E9")
COLOURS = {
    "stratum_corneum": "#E7C6A5",
    "epidermis": "#A8683F",
    "dermis": "#C8553D",
    "subcutaneous": "#F2DFA7",
    "bone": "#B9C0C6",
    "nail": "#7FB0BF",
}
# Tissues without strain energy.
RIGID = ("bone", "nail")
_SCALE_BAR_MM = 2.0
SCALE = "viridis"
SIZE_INCHES, PICTURE_DPI, WINDOW_DPI, FILM_DPI = (7.5, 4.775), 200, 147, 112


class ColourBar(NamedTuple):
    """A quantity and its colours."""

    quantity: str
    scale: Normalize
    colours: Colormap | str = SCALE


class ShownFigure(Figure):
    """A figure that a notebook shows even if pyplot has not drawn there yet."""

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()


def pixels(dots_per_inch: float, size_inches: tuple[float, float] = SIZE_INCHES) -> tuple[int, int]:
    """Return width and height of a picture."""
    width, height = (int(dots_per_inch * inches + 1e-6) for inches in size_inches)
    return width, height


def is_soft(tissue: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return which tags are those of tissues whose strain energy density is shown."""
    return ~np.isin(tissue, [TISSUES[name] for name in RIGID])


def legend_of(tissues: Iterable[str]) -> dict[str, str]:
    """Return colours by the names of tissues as they are written."""
    return {name.replace("_", " "): COLOURS[name] for name in tissues}


def dots(legend: Mapping[str, str]) -> list[Line2D]:
    """Return the entries of a legend: colours by their names."""
    style = {"ls": "", "marker": "o", "ms": 6, "mec": "black", "mew": 0.6}
    return [Line2D([], [], color=colour, label=name, **style) for name, colour in legend.items()]


def colours_of(populations: Iterable[str]) -> dict[str, str]:
    """Return the colour of each population by its name; a single one is black."""
    names = list(dict.fromkeys(populations))
    colours = DISTINCT if len(names) > 1 else (INK,)
    return dict(zip(names, cycle(colours), strict=False))


def receptor_labels(name: str, populations: Sequence[str]) -> tuple[str, str]:
    """Return what a population's silent and its firing receptors are called in a legend."""
    if len(populations) == 1:
        return "receptor, silent", "receptor, firing"
    return name, f"{name}, firing"


def receptor_colours(populations: Iterable[str], single: tuple[str, str]) -> dict[str, str]:
    """Return the colours of silent and firing receptors by their labels.

    Those of a single population are given; of several the firing ones are lighter.
    """
    colours = colours_of(str(name) for name in populations)
    names, found = list(colours), {}
    for name, colour in colours.items():
        light = to_hex(0.5 * np.array(to_rgb(colour)) + 0.5)
        pair = single if len(names) == 1 else (colour, light)
        found |= dict(zip(receptor_labels(name, names), pair, strict=True))
    return found


def draw_scale(figure: Figure, share_of_width: float) -> None:
    """Draw a scale bar at the lower right; a millimetre takes a share of the figure's width."""
    right, height = 0.965, 0.06
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 3}
    left, text = right - _SCALE_BAR_MM * share_of_width, f"{_SCALE_BAR_MM:g} mm"
    style = {"ha": "center", "va": "top", "fontsize": 8, "bbox": box, "zorder": 3}
    figure.text((left + right) / 2, height - 0.012, text, **style)
    bar = Line2D(
        [left, right], [height] * 2, color="black", lw=2.5, solid_capstyle="butt", zorder=4
    )
    figure.add_artist(bar)


def annotate(
    figure: Figure, title: str, legend: Mapping[str, str], bar: ColourBar | None = None
) -> None:
    """Write a title at the upper left and a legend at the lower left, and draw a colour bar."""
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 3}
    figure.text(0.02, 0.97, title, fontsize=10, va="top", bbox=box if title else None, wrap=True)
    style = {"loc": "lower left", "fontsize": 8, "framealpha": 0.85, "edgecolor": "none"}
    figure.legend(handles=dots(legend), handletextpad=0.2, **style)
    if bar is not None and bar.quantity:
        drawn = figure.colorbar(
            ScalarMappable(bar.scale, bar.colours),
            cax=figure.add_axes((0.34, 0.41 / figure.get_figheight(), 0.4, 0.022)),
            orientation="horizontal",
            extend="both" if isinstance(bar.scale, LogNorm) else "max",
            format="{x:g}",
        )
        drawn.set_label(bar.quantity, fontsize=9)
        drawn.ax.tick_params(labelsize=8)
