"""A line of Braille: domes on a plate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from tactile_fem.errors import StudyError
from tactile_fem.runtime.settings import Finite, Positive
from tactile_fem.stimulus.body import Array, Ball, Distance, HalfSpace, smooth_minimum
from tactile_fem.stimulus.patterns import Row, polygons_of_discs
from tactile_fem.stimulus.stimulus import Stimulus, check_limit

if TYPE_CHECKING:
    from shapely import Polygon

# Unicode's Braille patterns: the bits of a cell are its dots 1 to 8.
_BLANK = 0x2800
# Row from the top and column of the dots 1 to 8.
_PLACES = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 0), (3, 1))
_LETTERS = dict(zip("abcdefghijklmnopqrstuvwxyz", "⠁⠃⠉⠙⠑⠋⠛⠓⠊⠚⠅⠇⠍⠝⠕⠏⠟⠗⠎⠞⠥⠧⠺⠭⠽⠵", strict=True))
_DIGITS = dict(zip("1234567890", "⠁⠃⠉⠙⠑⠋⠛⠓⠊⠚", strict=True))
_NUMBER_SIGN, _LETTER_SIGN = "⠼", "⠰"


class Braille(Stimulus):
    """A line of Braille on a plate; its dots are parts of balls."""

    kind: Literal["braille"] = "braille"
    text: Annotated[str, Field(min_length=1, max_length=40)] = Field(
        "tactile", description="letters and digits, without contractions, or Braille patterns"
    )
    dot_diameter_mm: Positive = Field(1.6, description="of a dot's base; ADA 2010: 1.5 to 1.6")
    dot_height_mm: Positive = Field(
        0.5, description="of a dot; on paper 0.48 (Library of Congress, Specification 800)"
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
        """Return the dots, which are at most half balls and do not touch."""
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


@dataclass(frozen=True)
class Domes:
    """Caps of balls on a plate, which they join as in `Embossed`.

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
