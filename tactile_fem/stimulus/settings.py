"""Rigid bodies that the finger touches."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from tactile_fem.runtime.settings import (
    File,
    Finite,
    NonNegative,
    Positive,
    Settings,
    Whole,
    absolute,
    nonzero,
)


def is_font_file(font: str) -> bool:
    """Return whether a font is given by its file and not by the name of its family."""
    return Path(font).suffix.lower() in (".ttf", ".otf", ".ttc")


def font_file(font: str, folder: Path | str = "") -> str:
    """Return an absolute path for a font file; return the name of a font family unchanged."""
    return str(absolute(font, folder)) if is_font_file(font) else font


def find_font(font: str) -> Path | None:
    """Return the file of a font, None if no family of this name is installed."""
    if is_font_file(font):
        return Path(font)
    from matplotlib.font_manager import FontProperties, findfont  # takes a while

    try:
        # As a list, because a plain name is parsed as a fontconfig pattern.
        return Path(findfont(FontProperties(family=[font]), fallback_to_default=False))
    except ValueError:
        return None


class Stimulus(Settings):
    """Keys of every rigid body, which translates along the protocol without rotation."""

    friction: NonNegative = Field(0.3, description="paper: Coulomb friction (nylon)")
    shift_mm: tuple[Finite, Finite] = Field(
        (0.0, 0.0), description="shift of the body across (X) and along (Y) the finger"
    )


# The finger is some 13 mm thick.
Relief = Annotated[Positive, Field(le=20)]


class Text(Stimulus):
    """Embossed letters on a plate."""

    kind: Literal["text"] = Field("text", description="which stimulator; each has keys of its own")
    text: Annotated[str, Field(min_length=1, max_length=40)] = Field(
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
    corner_radius_mm: Positive = Field(0.3, description="proposed: least radius of the outline")
    fillet_radius_mm: Positive = Field(0.3, description="proposed: radius of the top edge")
    start_mm: Finite | None = Field(
        None,
        description="place of the text over the contact point at displacement 0, from the first "
        "letter's centre; default half way to the second letter (single letter: half a pitch "
        "before it)",
    )

    def files(self) -> dict[str, Path]:
        """Return the font's file, if there is one."""
        file = find_font(self.font)
        return {} if file is None else {"font": file}


class Plate(Stimulus):
    """A flat plate."""

    kind: Literal["plate"] = "plate"


class Cylinder(Stimulus):
    """A cylindrical bar lying in the horizontal plane."""

    kind: Literal["cylinder"] = "cylinder"
    radius_mm: Positive = Field(1.585, description="half of 3.17 mm, a usual test bar")
    along: Literal["x", "y"] = Field("x", description="axis of the bar: across or along the finger")


class Sphere(Stimulus):
    """A ball."""

    kind: Literal["sphere"] = "sphere"
    radius_mm: Positive = Field(3.0, description="of the ball")


class Edge(Stimulus):
    """A wedge with a rounded ridge, for the sharp-edge test."""

    kind: Literal["edge"] = "edge"
    radius_mm: Positive = Field(0.025, description="paper: radius of the ridge")
    angle_deg: Annotated[Finite, Field(gt=0, lt=180)] = Field(60.0, description="opening angle")
    along: Literal["x", "y"] = Field("x", description="the ridge: across or along the finger")


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


class Mesh(Stimulus):
    """A rigid part from a file of triangles, such as a key or a button, its edges rounded."""

    kind: Literal["mesh"] = "mesh"
    file: File = Field(description="the part: a closed surface in a .stl, .obj or .ply file")
    unit_mm: Positive = Field(1.0, description="length of the file's unit in mm")
    up: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = Field(
        "+z",
        description="axis of the file that points up into the finger; its next axis (x, y, z, x) "
        "lies across the finger",
    )
    tilt_deg: tuple[Finite, Finite] = Field(
        (0.0, 0.0), description="then the part is tilted about X, then about Y"
    )
    turn_deg: Finite = Field(
        0.0, description="then turned about Z, counter-clockwise seen from above"
    )
    edge_radius_mm: Positive = Field(
        0.3, description="proposed: least radius of convex and concave edges"
    )
    reach_mm: Positive = Field(
        3.0,
        description="how far below its highest point the part is modelled; it goes straight on "
        "below",
    )
    window_mm: tuple[Positive, Positive] | None = Field(
        None,
        description="width (X) and length (Y) of the piece about the contact point at displacement "
        "0 that is modelled; default the whole part",
    )
    grid_mm: Positive | None = Field(
        None,
        description="grid of the distance, half of edge_radius_mm at most; default a third of it",
    )


class Surface(Stimulus):
    """A measured surface: heights over a plane, repeated without end."""

    kind: Literal["surface"] = "surface"
    file: File = Field(
        description="heights: .npy, .csv, .txt or .asc, a gray .png or .tif, or an instrument's "
        "file; rows follow each other along X, columns along Y; an instrument's x and y are X and Y"
    )
    spacing_mm: Positive | None = Field(
        None, description="between two values; default as the file states"
    )
    unit_mm: Annotated[Finite, AfterValidator(nonzero)] | None = Field(
        None,
        description="height of one unit of the values, such as 0.001 for micrometres; negative if "
        "small values are high; default as the file states",
    )
    crop_mm: tuple[NonNegative, NonNegative, Positive, Positive] | None = Field(
        None,
        description="the part that is used, from its least X and Y to its largest, counted from "
        "those of the map; default all",
    )
    level: Literal["mean", "plane", "quadratic"] = Field(
        "plane", description="what is subtracted: the mean, the plane or the paraboloid that fits"
    )
    low_pass_mm: NonNegative = Field(
        0.1,
        description="wavelength that a Gaussian filter (ISO 16610-61) halves; shorter waves vanish",
    )
    repeat: Literal["mirrored", "periodic"] = Field(
        "mirrored", description="what follows beyond the file's edges: its mirror image, or itself"
    )
    turn_deg: Finite = Field(0.0, description="turn about Z through the middle, from X towards Y")


AnyStimulus = Annotated[
    Text | Plate | Cylinder | Sphere | Edge | Grating | Dots | Braille | Surface | Mesh,
    Field(discriminator="kind"),
]
