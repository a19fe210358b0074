"""Embossed letters, and where fonts are found."""

from __future__ import annotations

import unicodedata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field

from tactile_fem.runtime.settings import Finite, Positive, absolute
from tactile_fem.stimulus.body import Embossed
from tactile_fem.stimulus.stimulus import CornerRadius, FilletRadius, Relief, Stimulus

if TYPE_CHECKING:
    from shapely import Geometry

    from tactile_fem.stimulus.outlines import Outlines


def _composed(text: str) -> str:
    """Return a text whose letters and their marks are one character each where Unicode has it."""
    return unicodedata.normalize("NFC", text)


def _is_font_file(font: str) -> bool:
    return Path(font).suffix.lower() in (".ttf", ".otf", ".ttc")


def font_file(font: str, folder: Path | str = "") -> str:
    """Return an absolute path for a font file; return the name of a font family unchanged."""
    return str(absolute(font, folder)) if _is_font_file(font) else font


def find_font(font: str) -> str | None:
    """Return the file of a font, None if no family of this name is installed.

    From matplotlib 3.11 on, it also states the face of a collection (`face_index`).
    """
    if _is_font_file(font):
        return font
    from matplotlib.font_manager import FontProperties, findfont  # takes a while

    try:
        # As a list, because a plain name is parsed as a fontconfig pattern.
        return findfont(FontProperties(family=[font]), fallback_to_default=False)
    except ValueError:
        return None


class Text(Stimulus):
    """Embossed letters on a plate."""

    kind: Literal["text"] = Field("text", description="which stimulator; each has keys of its own")
    text: Annotated[str, Field(min_length=1, max_length=40), AfterValidator(_composed)] = Field(
        "FGH", description="paper: letters in the order in which they pass the receptor"
    )
    font: Annotated[str, AfterValidator(font_file)] = Field(
        "DejaVu Sans", description="proposed: font family or path of a font file"
    )
    g_width_mm: Annotated[Positive, Field(le=100)] = Field(
        6.5, description="paper: width of the letter G, sets the scale"
    )
    pitch_mm: Positive = Field(10.0, description="paper: centre to centre")
    relief_mm: Relief = Field(0.6, description="paper: height of the letters")
    corner_radius_mm: CornerRadius = None
    fillet_radius_mm: FilletRadius = None
    start_mm: Finite | None = Field(
        None,
        description="place of the text over the contact point at displacement 0, from the first "
        "letter's centre; default half way to the second letter (single letter: half a pitch "
        "before it)",
    )

    @classmethod
    def file_keys(cls) -> set[str]:
        """Return the font's key."""
        return {"font"}

    @classmethod
    def absolute_name(cls, name: str, folder: Path) -> str:
        """Return an absolute path for a font file; a family's name unchanged."""
        return font_file(name, folder)

    def files(self) -> dict[str, Path]:
        """Return the font's file, if there is one, and those of its tables."""
        file = find_font(self.font)
        return super().files() | ({} if file is None else {"font": Path(file)})

    def shape(self) -> Embossed:
        """Return the raised letters."""
        outlines, fillet_mm = self._outlines()
        return Embossed(outlines, self.relief_mm, fillet_mm)

    def raised(self) -> list[Geometry]:
        """Return the outlines of the letters, their holes cut out."""
        return self._outlines()[0].polygons()

    def _outlines(self) -> tuple[Outlines, float]:
        """Return the rounded letters and the radius of their top edges, mm."""
        from tactile_fem.stimulus.letters import glyphs_of  # takes a while
        from tactile_fem.stimulus.outlines import Outlines, radii_that_fit

        start = self.start_mm
        if start is None:
            start = self.pitch_mm / 2 if len(self.text) > 1 else -self.pitch_mm / 2
        file = find_font(self.font)
        shapes, placed = glyphs_of(
            self.text, self.font, file, self.g_width_mm, self.pitch_mm, start
        )
        corner_mm, fillet_mm = radii_that_fit(
            {f'"{c}"': shape for c, shape in shapes.items()},
            self.corner_radius_mm,
            self.fillet_radius_mm,
            self.relief_mm,
            f' in "{self.font}"',
        )
        return Outlines(placed, corner_mm, self.relief_mm), fillet_mm
