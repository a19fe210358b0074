"""How the body moves: press, then slide, or pieces of the user's own in order."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tactile_fem.runtime.settings import Either, File, Finite, NonNegative, Positive, Settings

Speed = Annotated[Positive, Field(description="speed of the body")]
_HELD = "normal force to be held by moving in Z; not set: the depth is held"


class Press(Settings):
    """Press into the pad to a depth, or to a force."""

    kind: Literal["press"] = "press"
    depth_mm: Positive | None = Field(
        None, description="where it ends: indentation of the undeformed pad's lowest point"
    )
    force_N: Positive | None = Field(
        None, description="normal force that ends it, instead of depth_mm"
    )
    speed_mm_s: Speed = 20.0

    @model_validator(mode="after")
    def _has_one_end(self) -> Self:
        if (self.depth_mm is None) == (self.force_N is None):
            raise ValueError("a press needs depth_mm or force_N, one of the two")
        return self


class Vibration(Settings):
    """A vibration of the body on top of a piece of the path; for inertia see `Solver`."""

    frequency_Hz: Positive = Field(description="of the vibration, which begins at its middle")
    amplitude_mm: Positive = Field(description="from the middle to the end of the swing")
    direction: tuple[Finite, Finite, Finite] = Field(
        (0.0, 0.0, 1.0), description="X, Y and Z; its length has no effect"
    )

    @model_validator(mode="after")
    def _goes_somewhere(self) -> Self:
        if not any(self.direction):
            raise ValueError("direction = [0, 0, 0] is none")
        return self


_VIBRATES = "small vibration of the body on top: frequency_Hz, amplitude_mm, direction"


class Hold(Settings):
    """Stay."""

    kind: Literal["hold"] = "hold"
    time_s: Positive = Field(description="how long")
    output_s: Positive | None = Field(
        None, description="time between two outputs; not set: a tenth of time_s"
    )
    force_N: Positive | None = Field(None, description=_HELD)
    vibration: Vibration | None = Field(None, description=_VIBRATES)


class Slide(Settings):
    """Slide across the pad."""

    kind: Literal["slide"] = "slide"
    by_mm: tuple[Finite, Finite] = Field(
        (0.0, -10.0), description="how far across (X) and along (Y; towards the palm is negative)"
    )
    speed_mm_s: Speed = 20.0
    output_mm: Positive = Field(0.1, description="positions that are hit exactly")
    force_N: Positive | None = Field(None, description=_HELD)
    vibration: Vibration | None = Field(None, description=_VIBRATES)

    @model_validator(mode="after")
    def _moves(self) -> Self:
        if not any(self.by_mm):
            raise ValueError("by_mm = [0, 0] is no slide: use a hold")
        return self


class Lift(Settings):
    """Lift the body off."""

    kind: Literal["lift"] = "lift"
    depth_mm: Finite = Field(
        0.0, description="where it ends: 0 just touches the undeformed pad, less is clear of it"
    )
    speed_mm_s: Speed = 20.0


class Follow(Settings):
    """Follow places in a file.

    Its columns are ``time_s,x_mm,y_mm,z_mm``, linear in between. The first row of a path's first
    piece is where the body starts; later pieces go on from where the body is.
    """

    kind: Literal["follow"] = "follow"
    file: File = Field(description="a CSV file with the columns time_s,x_mm,y_mm,z_mm")
    output_s: Positive | None = Field(
        None, description="time between two outputs; not set: a hundredth of the whole"
    )


AnyPiece = Annotated[Press | Hold | Slide | Lift | Follow, Field(discriminator="kind")]


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
        "depth", description="what the slide holds: the depth reached, or force_N"
    )
    press_speed_mm_s: Positive = Field(20.0, description="proposed: speed of the indentation")
    speed_mm_s: Positive = Field(20.0, description="paper: speed of the slide")
    distance_mm: NonNegative = Field(10.0, description="paper: length of the slide")
    output_mm: Positive = Field(0.1, description="slide positions that are hit exactly")
    path: Annotated[tuple[AnyPiece, ...], Field(min_length=1)] | None = Field(
        None,
        description="pieces in order, instead of all other keys of this table: [[protocol.path]] "
        "with kind = press, hold, slide, lift or follow",
    )

    def _alternatives(self) -> dict[str, list[str]]:
        others = [name for name in type(self).model_fields if name != "path"]
        return {"path": others, "force_N": ["depth_mm"]}

    @property
    def pieces(self) -> tuple[AnyPiece, ...]:
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

    @model_validator(mode="after")
    def _holds_what_is_given(self) -> Self:
        if self.hold == "force" and self.force_N is None:
            raise ValueError('hold = "force" needs force_N, the force to be held')
        return self
