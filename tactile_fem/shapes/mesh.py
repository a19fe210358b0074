"""A rigid part from a file of triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from tactile_fem.runtime.settings import File, Finite, Positive
from tactile_fem.stimulus import Stimulus

if TYPE_CHECKING:
    from tactile_fem.shapes.part import Gridded


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
        0.3,
        description="proposed: least radius of convex and concave edges; walls and gaps must be "
        "wider than twice as much",
    )
    reach_mm: Positive = Field(
        3.0,
        description="how far below its highest point the part is modelled; it continues "
        "straight down",
    )
    window_mm: tuple[Positive, Positive] | None = Field(
        None,
        description="width (X) and length (Y) of the piece about the contact point at displacement "
        "0 that is modelled; default: the whole part",
    )
    grid_mm: Positive | None = Field(
        None,
        description="grid of the distance, at most edge_radius_mm / 2; default: a third of it",
    )

    @property
    def is_kept_sampled(self) -> bool:
        """Whether results keep a sampled copy for pictures: it takes long to make."""
        return True

    def shape(self) -> Gridded:
        """Return the rounded part."""
        from tactile_fem.shapes import part  # libigl is not always installed

        solid = part.read_solid(self.file, self.unit_mm)
        piece = part.piece_of(
            part.placed(solid, self.up, self.tilt_deg, self.turn_deg),
            radius=self.edge_radius_mm,
            step=self.grid_mm,
            reach=self.reach_mm,
            window=self.window_mm,
            shift=self.shift_mm,
        )
        return part.rounded(piece, self.edge_radius_mm)
