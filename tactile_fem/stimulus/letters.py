"""Letters: rounded font outlines with their signed distance as a spline."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.ft2font import FT2Font
from matplotlib.path import Path as Outline
from matplotlib.textpath import text_to_path
from numpy.typing import NDArray
from shapely import affinity

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import Array, Distance
from tactile_fem.stimulus.spline import GridSpline

_GRID_MM = 0.05
# Farther from an outline than its relief and this, the distance is constant: the plate is nearer.
_BEYOND_RELIEF_MM = 0.6
# How much farther the grid of a letter's distance reaches.
_MARGIN_MM = 0.4
# At this font size the chords of curves are shorter than the grid, so that curvature is smooth.
_TYPE_SIZE = 20000
# In the search for the largest radius that fits.
_BISECTIONS = 10


@dataclass(frozen=True)
class Letter:
    """One letter: its signed distance as a spline on a grid around it; `polygon` in mm."""

    polygon: shapely.Geometry
    spline: GridSpline
    bounds: tuple[float, float, float, float]


class Letters:
    """Letters that read along +Y with their tops towards -X, not mirrored as seen from above.

    The body frame's origin is the point of the text over the contact point at displacement 0: half
    way up a G, or up the glyph of a text that has no other.
    """

    def __init__(
        self,
        text: str,
        font: str,
        font_file: str | None,
        *,
        g_width_mm: float,
        pitch_mm: float,
        start_mm: float,
        corner_radius_mm: float,
        fillet_radius_mm: float,
        relief_mm: float,
    ) -> None:
        opened = _font(font, font_file)
        glyphs = {c: _glyph(c, opened, font) for c in dict.fromkeys(text) if not c.isspace()}
        if not glyphs:
            raise StudyError('stimulus.text holds no letter; for a flat plate set kind = "plate"')
        left, bottom, right, top = _glyph("G", opened, font).bounds
        scale = g_width_mm / (right - left)
        if len(glyphs) == 1:
            _, bottom, _, top = next(iter(glyphs.values())).bounds
        middle = (bottom + top) / 2
        placed = {}
        for character, glyph in glyphs.items():
            centre = (glyph.bounds[0] + glyph.bounds[2]) / 2
            # Text direction (u, up) to the finger's (x, y) = (-up, u).
            placed[character] = affinity.affine_transform(
                glyph, [0, -scale, scale, 0, scale * middle, -scale * centre]
            )
        _check_radii(placed, font, corner_radius_mm, fillet_radius_mm)
        self._far_mm = relief_mm + _BEYOND_RELIEF_MM
        reach = self._far_mm + _MARGIN_MM
        shapes = {c: _letter(shape, corner_radius_mm, reach) for c, shape in placed.items()}
        self._letters = [
            (pitch_mm * i - start_mm, shapes[c]) for i, c in enumerate(text) if c in shapes
        ]

    def polygons(self) -> list[shapely.Geometry]:
        """Return the outlines in the body's frame."""
        return [affinity.translate(letter.polygon, 0, y) for y, letter in self._letters]

    def gap(self, xy: Array) -> Array:
        """Return the signed distance (n,) at `xy` (n, 2); constant far from all letters."""
        return self._nearest(xy)[0]

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance at `xy` (n, 2); constant far from all letters."""
        gap, nearest = self._nearest(xy)
        result = Distance(gap, np.zeros((len(xy), 2)), np.zeros((len(xy), 2, 2)))
        for k, (y, letter) in enumerate(self._letters):
            here = np.flatnonzero(nearest == k)
            _, slope, bend = letter.spline.derivatives(xy[here] - [0.0, y], 2)
            result.normal[here], result.hessian[here] = slope, bend
        return result

    def _nearest(self, xy: Array) -> tuple[Array, NDArray[np.intp]]:
        """Return the signed distance (n,) and the index of the nearest letter, -1 far from all."""
        gap, nearest = np.full(len(xy), self._far_mm), np.full(len(xy), -1)
        for k, (y, letter) in enumerate(self._letters):
            here, low, high = xy - [0.0, y], letter.bounds[:2], letter.bounds[2:]
            near = np.flatnonzero(np.all((here > low) & (here < high), axis=1))
            d = letter.spline.values(here[near])
            nearer = d < gap[near]
            gap[near[nearer]], nearest[near[nearer]] = d[nearer], k
        return gap, nearest


def _font(name: str, file: str | None) -> FT2Font:
    """Return the font of a family name or file, without silent replacement.

    It is read anew: matplotlib keeps fonts by their path, whatever has become of the file.
    """
    if file is None:
        raise StudyError(
            f'stimulus.font = "{name}": no such font is installed; give a family name or the path '
            "of a .ttf file"
        )
    if not Path(file).is_file():
        raise StudyError(f'stimulus.font = "{name}": there is no such file')
    number = getattr(file, "face_index", 0)  # of a collection, from matplotlib 3.11 on
    options: dict[str, Any] = {"face_index": number} if number else {}
    try:
        font = FT2Font(file, **options)
    except (OSError, RuntimeError) as error:
        raise StudyError(f'stimulus.font = "{name}" cannot be read as a font') from error
    font.set_size(text_to_path.FONT_SCALE, text_to_path.DPI)
    return font


def _glyph(character: str, font: FT2Font, name: str) -> shapely.Geometry:
    """Return a character's outline in the font's units, holes cut out."""
    if not (font.get_char_index(ord(character)) and character.isprintable()):
        raise StudyError(f'stimulus.text: the font "{name}" has no glyph for "{character}"')
    try:
        _, glyphs, _ = text_to_path.get_glyphs_with_font(font, character)
    except RuntimeError as error:
        raise StudyError(f'stimulus.font = "{name}" cannot be read as a font') from error
    ((vertices, codes),) = glyphs.values()
    path = Outline(vertices * (_TYPE_SIZE / text_to_path.FONT_SCALE), codes)
    shape = shapely.Polygon()
    for ring in path.to_polygons(closed_only=True):
        shape = shape.symmetric_difference(shapely.Polygon(ring).buffer(0))
    if shape.is_empty:
        raise StudyError(f'stimulus.text: "{character}" has no outline in the font "{name}"')
    return shape


def _topology(shape: shapely.Geometry) -> tuple[int, int]:
    """Return the number of parts and of holes."""
    parts = shapely.get_parts(shape)
    return len(parts), int(shapely.get_num_interior_rings(parts).sum())


def _check_radii(
    shapes: Mapping[str, shapely.Geometry], font: str, radius: float, fillet_radius: float
) -> None:
    """Raise StudyError if strokes or gaps are too thin for the radii, with what would fit."""
    thin = [c for c, shape in shapes.items() if _rounded(shape, radius) is None]
    if thin:
        fits = min(_largest_radius(shapes[c], radius) for c in thin)
        also = " and fillet_radius_mm" if fillet_radius > fits else ""
        raise StudyError(
            f'stimulus.corner_radius_mm = {radius:g}: strokes or gaps of "{"".join(thin)}" in '
            f'"{font}" are too thin for it, which must be less than half of each: '
            f"corner_radius_mm{also} must not exceed {fits:g}"
        )


def _largest_radius(shape: shapely.Geometry, above: float) -> float:
    """Return the largest radius below `above` mm that fits a shape, by bisection, rounded down."""
    fits = 0.0
    for _ in range(_BISECTIONS):
        middle = (fits + above) / 2
        fits, above = (fits, middle) if _rounded(shape, middle) is None else (middle, above)
    digit = 10.0 ** (math.floor(math.log10(fits)) - 1) if fits else 1.0
    return digit * math.floor(fits / digit)


@lru_cache(maxsize=64)
def _rounded(shape: shapely.Geometry, radius: float) -> shapely.Geometry | None:
    """Return a shape with rounded corners, None if the radius takes away more than corners."""
    # Morphological opening rounds convex corners, closing rounds concave ones.
    opened = shape.buffer(-radius, quad_segs=32).buffer(radius, quad_segs=32)
    rounded = opened.buffer(radius, quad_segs=32).buffer(-radius, quad_segs=32)
    # If a stroke vanishes, a part, a hole or the end of an arm is lost. An acute corner loses less
    # than four radii.
    if rounded.is_empty or _topology(rounded) != _topology(shape):
        return None
    lost = shapely.distance(rounded, shapely.points(shapely.get_coordinates(shape))).max()
    return None if lost > 4 * radius else rounded


@lru_cache(maxsize=64)
def _letter(shape: shapely.Geometry, radius: float, reach: float) -> Letter:
    """Round a shape's corners and spline its signed distance on a grid that goes on by `reach`."""
    rounded = _rounded(shape, radius)
    assert rounded is not None, "_rounded has been tried with this radius"
    low = np.array(rounded.bounds[:2]) - reach
    high = np.array(rounded.bounds[2:]) + reach
    x, y = (np.arange(a, b + _GRID_MM, _GRID_MM) for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    points = shapely.points(grid)
    shapely.prepare(rounded)
    edges = shapely.STRtree(_edges(rounded))  # three times as fast as `shapely.distance`
    _, distance = edges.query_nearest(points, all_matches=False, return_distance=True)
    distance[shapely.contains(rounded, points)] *= -1
    grid_mm = (_GRID_MM, _GRID_MM)
    spline = GridSpline.through(distance.reshape(len(x), len(y)), low, grid_mm)
    return Letter(rounded, spline, (*low, *high))


def _edges(shape: shapely.Geometry) -> NDArray[np.object_]:
    """Return the straight parts of a shape's boundary."""
    corners, ring = shapely.get_coordinates(shapely.get_rings(shape), return_index=True)
    same = ring[1:] == ring[:-1]
    return shapely.linestrings(np.stack([corners[:-1][same], corners[1:][same]], axis=1))
