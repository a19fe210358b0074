"""Patterns raised from a plate: a grating, an array of dots and a line of Braille."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from tactile_fem.errors import StudyError
from tactile_fem.runtime.settings import Finite, Positive, Whole
from tactile_fem.stimulus.body import (
    Array,
    Ball,
    Distance,
    Embossed,
    HalfSpace,
    norm_of,
    smooth_minimum,
)
from tactile_fem.stimulus.stimulus import ACROSS, Relief, Stimulus, check_limit

if TYPE_CHECKING:
    from shapely import Polygon

# Endless ridges are drawn so long.
_RIDGE_LENGTH_MM = 20.0
# Unicode's Braille patterns: the bits of a cell are its dots 1 to 8.
_BLANK = 0x2800
# Row from the top and column of the dots 1 to 8.
_PLACES = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 0), (3, 1))
_LETTERS = dict(zip("abcdefghijklmnopqrstuvwxyz", "⠁⠃⠉⠙⠑⠋⠛⠓⠊⠚⠅⠇⠍⠝⠕⠏⠟⠗⠎⠞⠥⠧⠺⠭⠽⠵", strict=True))
_DIGITS = dict(zip("1234567890", "⠁⠃⠉⠙⠑⠋⠛⠓⠊⠚", strict=True))
_NUMBER_SIGN, _LETTER_SIGN = "⠼", "⠰"


class Grating(Stimulus):
    """Parallel rectangular ridges with rounded edges on a plate."""

    kind: Literal["grating"] = "grating"
    ridge_mm: Positive = Field(1.0, description="width of a ridge")
    groove_mm: Positive = Field(1.0, description="width of a groove")
    relief_mm: Relief = Field(0.6, description="height of the ridges")
    fillet_radius_mm: Positive = Field(0.2, description="radius of the top edges")
    count: Annotated[Whole, Field(ge=1, le=200)] = Field(9, description="number of ridges")
    along: Literal["x", "y"] = Field("x", description="direction of the ridges")
    start_mm: Finite | None = Field(
        None,
        description="place of the grating over the contact point at displacement 0, from the "
        "centre of the first ridge (least Y; least X if they lie along y); default its middle",
    )

    def _row(self) -> Row:
        return Row.of(self.ridge_mm + self.groove_mm, self.count, self.start_mm)

    def shape(self) -> Embossed:
        """Return the raised ridges."""
        limits = {"relief_mm": self.relief_mm, "half of ridge_mm": self.ridge_mm / 2}
        check_limit("fillet_radius_mm", self.fillet_radius_mm, limits)
        ridges = Ridges(self.ridge_mm, self._row(), ACROSS[self.along])
        return Embossed(ridges, self.relief_mm, self.fillet_radius_mm)

    def raised(self) -> list[Polygon]:
        """Return the ridges, cut to 20 mm."""
        import shapely  # takes a while

        across, half = ACROSS[self.along], np.full(2, _RIDGE_LENGTH_MM / 2)
        half[across] = self.ridge_mm / 2
        middles = np.outer(self._row().places(), np.eye(2)[across])
        return [shapely.box(*middle - half, *middle + half) for middle in middles]


class Dots(Stimulus):
    """A rectangular array of round, flat-topped, filleted dots on a plate."""

    kind: Literal["dots"] = "dots"
    radius_mm: Positive = Field(0.7, description="radius of a dot")
    spacing_mm: Positive = Field(3.0, description="centre to centre, both ways")
    relief_mm: Relief = Field(0.6, description="height of the dots")
    fillet_radius_mm: Positive = Field(0.2, description="radius of the top edge")
    columns: Annotated[Whole, Field(ge=1, le=100)] = Field(3, description="across the finger (X)")
    rows: Annotated[Whole, Field(ge=1, le=100)] = Field(7, description="along the finger (Y)")
    start_mm: Finite | None = Field(
        None,
        description="place of the array over the contact point at displacement 0, from the "
        "centre of the first row (least Y); default its middle",
    )

    def _places(self) -> tuple[Row, Row]:
        rows = Row.of(self.spacing_mm, self.rows, self.start_mm)
        return Row.of(self.spacing_mm, self.columns), rows

    def shape(self) -> Embossed:
        """Return the raised discs."""
        limits = {"relief_mm": self.relief_mm, "radius_mm": self.radius_mm}
        check_limit("fillet_radius_mm", self.fillet_radius_mm, limits)
        discs = Discs(self.radius_mm, *self._places())
        return Embossed(discs, self.relief_mm, self.fillet_radius_mm)

    def raised(self) -> list[Polygon]:
        """Return the discs."""
        x, y = self._places()
        return polygons_of_discs(product(x.places(), y.places()), self.radius_mm)


class Braille(Stimulus):
    """A line of Braille on a plate; its dots are spherical caps."""

    kind: Literal["braille"] = "braille"
    text: Annotated[str, Field(min_length=1, max_length=40)] = Field(
        "tactile", description="letters and digits, without contractions, or Braille patterns"
    )
    dot_diameter_mm: Positive = Field(1.6, description="base of a dot; ADA 2010: 1.5 to 1.6")
    dot_height_mm: Positive = Field(
        0.5, description="height; on paper 0.48 (Library of Congress, Specification 800)"
    )
    dot_spacing_mm: Positive = Field(
        2.5, description="between dots of a cell, both ways; ADA 2010: 2.3 to 2.5"
    )
    cell_spacing_mm: Positive = Field(
        6.2, description="between cells; Specification 800, ADA 2010: 6.1 to 7.6"
    )
    start_mm: Finite | None = Field(
        None,
        description="place of the line over the contact point at displacement 0, from the first "
        "cell's centre; default its middle",
    )

    def shape(self) -> Domes:
        """Return the dots, at most hemispheres, which do not touch."""
        height, diameter = self.dot_height_mm, self.dot_diameter_mm
        check_limit("dot_height_mm", height, {"half of dot_diameter_mm": diameter / 2})
        check_limit("dot_diameter_mm", diameter, {"dot_spacing_mm": self.dot_spacing_mm})
        return Domes(self.dots(), diameter / 2, height)

    def raised(self) -> list[Polygon]:
        """Return the bases of the dots."""
        return polygons_of_discs(self.dots(), self.dot_diameter_mm / 2)

    def dots(self) -> Array:
        """Return the centres of the dots before `shift_mm`, mm, (dots, 2).

        The line reads along +Y, its top towards -X; cells are centred on their six upper places.
        """
        line = cells(self.text)
        along = Row.of(self.cell_spacing_mm, len(line), self.start_mm).places()
        spacing = self.dot_spacing_mm
        centres = [
            ((row - 1) * spacing, middle + (column - 0.5) * spacing)
            for cell, middle in zip(line, along, strict=True)
            for bit, (row, column) in enumerate(_PLACES)
            if (ord(cell) - _BLANK) >> bit & 1
        ]
        if not centres:
            raise StudyError('stimulus.text holds no dot; for a flat plate set kind = "plate"')
        return np.array(centres)


@dataclass(frozen=True)
class Row:
    """`count` equally spaced positions along an axis, the first at `first` mm."""

    first: float
    spacing: float
    count: int

    @classmethod
    def of(cls, spacing: float, count: int, start: float | None = None) -> Row:
        """Return positions such that `start` mm from the first is 0; default the middle."""
        return cls(-spacing * (count - 1) / 2 if start is None else -start, spacing, count)

    def places(self) -> Array:
        """Return all positions (count,)."""
        return np.add(self.first, self.spacing * np.arange(self.count), dtype=np.float64)

    def nearest(self, coordinate: Array) -> Array:
        """Return the position nearest to each coordinate."""
        index = np.round((coordinate - self.first) / self.spacing)
        return self.first + self.spacing * np.clip(index, 0, self.count - 1)


@dataclass(frozen=True)
class Ridges:
    """Parallel ridges, endless along the other axis; `across` is the axis of their `row`."""

    width: float
    row: Row
    across: int

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        offset = xy[:, self.across] - self.row.nearest(xy[:, self.across])
        gradient = np.zeros_like(xy)
        gradient[:, self.across] = np.where(offset < 0, -1.0, 1.0)
        return Distance(np.abs(offset) - self.width / 2, gradient, np.zeros((len(xy), 2, 2)))


@dataclass(frozen=True)
class Discs:
    """A rectangular array of discs, their centres at `x` and `y`."""

    radius: float
    x: Row
    y: Row

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        centre = np.column_stack([self.x.nearest(xy[:, 0]), self.y.nearest(xy[:, 1])])
        r, n, H = norm_of(xy - centre)
        return Distance(r - self.radius, n, H)


def polygons_of_discs(centres: Iterable[Sequence[float]], radius: float) -> list[Polygon]:
    """Return discs as polygons."""
    import shapely  # takes a while

    return [shapely.Point(centre).buffer(radius) for centre in centres]


@dataclass(frozen=True)
class Domes:
    """Spherical caps on a plate, which they join as in `Embossed`.

    `centres` are (n, 2), `base` the radius of the base and `height` the height of a cap, in mm.
    """

    centres: Array
    base: float
    height: float
    blend: float = 0.2

    def distance(self, points: Array) -> Distance:
        """Return the signed distance at `points` (n, 3)."""
        from scipy.spatial import KDTree  # takes a while

        _, nearest = KDTree(self.centres).query(points[:, :2])
        offset = points - np.column_stack([self.centres[nearest], np.zeros(len(points))])
        cap = Ball((self.base**2 + self.height**2) / (2 * self.height)).distance(offset)
        return smooth_minimum(cap, HalfSpace(self.height).distance(points), self.blend)


def cells(text: str) -> str:
    """Return letters and digits, without contractions, as Braille patterns.

    A number sign goes before digits, and a letter sign before letters a to j that follow them.
    Capital letters are read as small ones; Braille patterns and spaces stay.
    """
    found, counting = "", False
    for character in text.lower():
        if character in _DIGITS:
            found += ("" if counting else _NUMBER_SIGN) + _DIGITS[character]
        elif character in _LETTERS:
            sign = _LETTER_SIGN if counting and character in "abcdefghij" else ""
            found += sign + _LETTERS[character]
        elif character.isspace():
            found += chr(_BLANK)
        elif _BLANK <= ord(character) < _BLANK + 256:
            found += character
        else:
            raise StudyError(
                f'stimulus.text: "{character}" is neither letter, digit, space nor Braille pattern'
            )
        counting = character in _DIGITS
    return found
