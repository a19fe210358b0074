"""Output of a scan: figures, pictures and animations."""

from typing import TYPE_CHECKING

from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.output.abscissa import Abscissa
    from tactile_fem.output.annotations import BLUE, DISTINCT, GREEN, INK, VERMILION
    from tactile_fem.output.modes import Archived, Modes, nearest
    from tactile_fem.output.pictures import draw_pictures
    from tactile_fem.output.plots import styled
    from tactile_fem.output.preview import surfaces_figure
    from tactile_fem.output.rasters import draw_spikes

__all__ = [
    "BLUE",
    "DISTINCT",
    "GREEN",
    "INK",
    "VERMILION",
    "Abscissa",
    "Archived",
    "Modes",
    "draw_pictures",
    "draw_spikes",
    "nearest",
    "styled",
    "surfaces_figure",
]

__getattr__ = lazily(
    __name__,
    {
        "abscissa": ["Abscissa"],
        "annotations": ["BLUE", "DISTINCT", "GREEN", "INK", "VERMILION"],
        "modes": ["Archived", "Modes", "nearest"],
        "pictures": ["draw_pictures"],
        "plots": ["styled"],
        "preview": ["surfaces_figure"],
        "rasters": ["draw_spikes"],
    },
)
