"""Where fonts are found."""

from __future__ import annotations

from pathlib import Path

from tactile_fem.runtime.settings import absolute


def _is_file(font: str) -> bool:
    return Path(font).suffix.lower() in (".ttf", ".otf", ".ttc")


def font_file(font: str, folder: Path | str = "") -> str:
    """Return an absolute path for a font file; return the name of a font family unchanged."""
    return str(absolute(font, folder)) if _is_file(font) else font


def find_font(font: str) -> str | None:
    """Return the file of a font, None if no family of this name is installed.

    From matplotlib 3.11 on, it also states the face of a collection (`face_index`).
    """
    if _is_file(font):
        return font
    from matplotlib.font_manager import FontProperties, findfont  # takes a while

    try:
        # As a list, because a plain name is parsed as a fontconfig pattern.
        return findfont(FontProperties(family=[font]), fallback_to_default=False)
    except ValueError:
        return None
