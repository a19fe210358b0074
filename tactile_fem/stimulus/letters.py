"""Letters: outlines of a font's glyphs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import shapely
from matplotlib.ft2font import FT2Font
from matplotlib.path import Path as Outline
from matplotlib.textpath import text_to_path
from shapely import affinity

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.rings import filled

# At this font size the chords of curves are shorter than the grid, so that curvature is smooth.
_TYPE_SIZE = 20000


def glyphs_of(
    text: str, font: str, font_file: str | None, g_width_mm: float, pitch_mm: float, start_mm: float
) -> tuple[dict[str, shapely.Geometry], list[tuple[shapely.Geometry, tuple[float, float]]]]:
    """Return the outline of each character, centred, and shape and shift (X, Y) of all, in mm.

    They read along +Y with their tops towards -X, not mirrored as seen from above. The body frame's
    origin is the point of the text over the contact point at displacement 0: half way up a G, or up
    the glyph of a text that has no other.
    """
    opened = _font(font, font_file)
    glyphs = {c: _glyph(c, opened, font) for c in dict.fromkeys(text) if not c.isspace()}
    if not glyphs:
        raise StudyError('stimulus.text holds no letter; for a flat plate set kind = "plate"')
    left, bottom, right, top = _glyph("G", opened, font).bounds
    scale = g_width_mm / (right - left)
    if len(glyphs) == 1:
        _, bottom, _, top = next(iter(glyphs.values())).bounds
    middle = (bottom + top) / 2
    shapes = {}
    for character, glyph in glyphs.items():
        centre = (glyph.bounds[0] + glyph.bounds[2]) / 2
        # Text direction (u, up) to the finger's (x, y) = (-up, u).
        shapes[character] = affinity.affine_transform(
            glyph, [0, -scale, scale, 0, scale * middle, -scale * centre]
        )
    placed = [
        (shapes[c], (0.0, pitch_mm * i - start_mm)) for i, c in enumerate(text) if c in shapes
    ]
    return shapes, placed


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
    if len(glyphs) != 1:  # a mark that combines with a letter, drawn on a dotted circle
        raise StudyError(f'stimulus.text: "{character}" is no character of its own')
    ((vertices, codes),) = glyphs.values()
    path = Outline(vertices * (_TYPE_SIZE / text_to_path.FONT_SCALE), codes)
    shape = filled(path.to_polygons(closed_only=True))
    if shape.is_empty:
        raise StudyError(f'stimulus.text: "{character}" has no outline in the font "{name}"')
    return shape
