"""How the body moves: press, then slide, or pieces of the user's own in order."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tactile_fem.path.motion import Path
from tactile_fem.path.pieces import Piece, Press, Slide
from tactile_fem.runtime.settings import Either, NonNegative, Positive


class Protocol(Either):
    """Press, then slide towards the palm (-Y), the bone being fixed.

    A section is pressed to 0.06 N per mm of its width by default: to a solid finger's depth it
    would be crushed.
    """

    depth_mm: Positive = Field(
        1.97,
        description="paper: indentation of the undeformed pad's lowest point, held in the slide",
    )
    force_N: Positive | None = Field(
        None, description="press to this normal force instead of to depth_mm (paper: 0.6)"
    )
    hold: Literal["depth", "force"] = Field(
        "depth", description="what is constant in the slide: the depth reached, or force_N"
    )
    press_speed_mm_s: Positive = Field(20.0, description="proposed: speed of the indentation")
    speed_mm_s: Positive = Field(20.0, description="paper: speed of the slide")
    distance_mm: NonNegative = Field(10.0, description="paper: length of the slide")
    output_mm: Positive = Field(0.1, description="distance between outputs in the slide")
    path: Annotated[tuple[Piece, ...], Field(min_length=1)] | None = Field(
        None,
        description="pieces in order, instead of all other keys of this table: [[protocol.path]] "
        "with kind = press, hold, slide, lift, push, twist, roll or follow",
    )

    def _alternatives(self) -> dict[str, list[str]]:
        others = [name for name in type(self).model_fields if name != "path"]
        return {"path": others, "force_N": ["depth_mm"]}

    @model_validator(mode="after")
    def _holds_what_is_given(self) -> Self:
        if self.hold == "force" and self.force_N is None:
            raise ValueError('hold = "force" needs force_N, the force to be held')
        return self

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The pieces of the path in order."""
        if self.path is not None:
            return self.path
        depth_mm = self.depth_mm if self.force_N is None else None
        press = Press(depth_mm=depth_mm, force_N=self.force_N, speed_mm_s=self.press_speed_mm_s)
        if not self.distance_mm:
            return (press,)
        slide = Slide(
            by_mm=(0.0, -self.distance_mm),
            speed_mm_s=self.speed_mm_s,
            output_mm=self.output_mm,
            force_N=self.force_N if self.hold == "force" else None,
        )
        return (press, slide)

    def route(self, deepest_mm: float) -> Path:
        """Return the path of the body.

        Parameters
        ----------
        deepest_mm
            Depth at which a press to a force is given up.

        Raises
        ------
        StudyError
            A file cannot be read, or the path is not valid.
        """
        pieces = tuple(piece.resolved(deepest_mm) for piece in self.pieces)
        path = Path(pieces, *pieces[0].first_pose())
        path.check()
        return path
