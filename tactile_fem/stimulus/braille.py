"""Braille: where the dots of a line of cells are."""

from __future__ import annotations

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import Array
from tactile_fem.stimulus.patterns import Row
from tactile_fem.stimulus.settings import Braille

# Unicode's Braille patterns: the bits of a cell are its dots 1 to 8.
_BLANK = 0x2800
# Row from the top and column of the dots 1 to 8.
_PLACES = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 0), (3, 1))
_LETTERS = dict(zip("abcdefghijklmnopqrstuvwxyz", "⠁⠃⠉⠙⠑⠋⠛⠓⠊⠚⠅⠇⠍⠝⠕⠏⠟⠗⠎⠞⠥⠧⠺⠭⠽⠵", strict=True))
_DIGITS = dict(zip("1234567890", "⠁⠃⠉⠙⠑⠋⠛⠓⠊⠚", strict=True))
_NUMBER_SIGN, _LETTER_SIGN = "⠼", "⠰"


def cells(text: str) -> str:
    """Return letters and digits, without contractions, as Braille patterns.

    A number sign goes before digits, and a letter sign before letters a to j that follow them.
    Capital letters are read as small ones; Braille patterns and spaces stay.

    Raises
    ------
    StudyError
        A character is none of these.
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


def dots(stimulus: Braille) -> Array:
    """Return the centres of the dots in the body's frame, mm, (dots, 2).

    The line reads along +Y, its top towards -X; cells are centred on their six upper places.

    Raises
    ------
    StudyError
        There is no dot.
    """
    line = cells(stimulus.text)
    along = Row.of(stimulus.cell_spacing_mm, len(line), stimulus.start_mm).places()
    spacing = stimulus.dot_spacing_mm
    centres = [
        ((row - 1) * spacing, middle + (column - 0.5) * spacing)
        for cell, middle in zip(line, along, strict=True)
        for bit, (row, column) in enumerate(_PLACES)
        if (ord(cell) - _BLANK) >> bit & 1
    ]
    if not centres:
        raise StudyError('stimulus.text holds no dot; for a flat plate set kind = "plate"')
    return np.array(centres)
