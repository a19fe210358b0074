"""Letters of all sorts: those of several pieces, of overlapping contours, and none at all."""

from __future__ import annotations

import string
import unicodedata

import numpy as np
import pytest
import shapely
from PIL import ImageFont

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.letters import glyphs_of
from tactile_fem.stimulus.text import find_font
from tactile_fem.study import Text

# Contours of some letters overlap, such as the cedilla of ç.
BEYOND_ASCII = "äöüÄÖÜßéèêçñÅØøÆÇęơ÷±§€°“”…¿ΑΒΓΞΨΩαβγБДЖЯию"
CHARACTERS = string.digits + string.ascii_letters + string.punctuation + BEYOND_ASCII


def test_each_character_is_raised_as_its_font_draws_it():
    """The area is that of FreeType's own picture."""
    font, size = "DejaVu Sans", 2000
    freetype = ImageFont.truetype(find_font(font), size)
    glyphs, _ = glyphs_of(CHARACTERS, font, find_font(font), 6.5, 10.0, 0.0)
    unit = None
    for character in ["G", *CHARACTERS]:
        mask = freetype.getmask(character)
        pixels = np.sum(mask) / 255
        unit = unit or glyphs["G"].area / pixels
        assert glyphs[character].area == pytest.approx(unit * pixels, rel=6e-3), character


@pytest.mark.parametrize(
    "text", ["i", "j!?", ":;=%", '"äÖΞ÷', "ç", unicodedata.normalize("NFD", "Ü")]
)
def test_letters_of_several_pieces_are_raised(text):
    """The distance at the edge of each piece vanishes."""
    stimulus = Text(text=text, start_mm=0.0)
    body, shapes = stimulus.body(), stimulus.raised()
    assert len(shapes) == len(unicodedata.normalize("NFC", text))
    for piece in shapely.get_parts(shapes):
        inside = piece.representative_point()
        assert body.distance(np.array([[inside.x, inside.y, 0.5]])).gap[0] == pytest.approx(
            0.5, abs=0.01
        )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("\u0308", "is no character of its own"),
        ("\U00010380", "has no glyph for"),
        ("a\tb\x07", "has no glyph for"),
        ("  ", "holds no letter"),
    ],
)
def test_what_is_no_letter_is_refused(text, sentence):
    with pytest.raises(StudyError, match=sentence):
        Text(text=text).body()
