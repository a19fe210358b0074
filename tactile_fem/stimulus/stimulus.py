"""A kind of stimulus: its keys in the study and the body that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from tactile_fem.errors import StudyError
from tactile_fem.runtime.files import cached_by_content
from tactile_fem.runtime.settings import Finite, Kind, Positive
from tactile_fem.stimulus.body import Moved, RigidBody
from tactile_fem.stimulus.friction import Friction, NumberOrLaw, law_of

if TYPE_CHECKING:
    from shapely import Geometry

# The finger is some 13 mm thick.
Relief = Annotated[Positive, Field(le=20)]
# Of outlines; see `tactile_fem.stimulus.outlines.radii_that_fit`.
CornerRadius = Annotated[
    Positive | None,
    Field(
        description="proposed: least radius of the outline; default 0.3, or the largest that its "
        "strokes and gaps allow"
    ),
]
FilletRadius = Annotated[
    Positive | None,
    Field(
        description="proposed: radius of the top edge; default 0.3, or the largest that relief and "
        "corner radius allow"
    ),
]
# Axis across something that lies along "x" or "y".
ACROSS = {"x": 1, "y": 0}


class Stimulus(Kind):
    """Base class of stimuli: rigid bodies that move along the path of the protocol.

    Each kind is a subclass: it states its `kind`, further keys, whose values must be hashable, and
    its `shape`.
    """

    former = MappingProxyType(
        dict.fromkeys(("resolution", "hindrance"), "leave it out, the body is measured")
    )
    friction: NumberOrLaw = Field(
        0.3, description="paper: Coulomb friction (nylon); or a table with its law"
    )
    shift_mm: tuple[Finite, Finite] = Field(
        (0.0, 0.0), description="shift of the body across (X) and along (Y) the finger"
    )

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if "body" in vars(cls):
            raise TypeError(f"{cls.__name__} must define shape: body moves it by shift_mm")

    def shape(self) -> RigidBody:
        """Return the body before `shift_mm`, its highest plane at z = 0."""
        raise StudyError(f'stimulus.kind = "{self.kind}" is known where its module is imported')

    def law(self) -> Friction:
        """Return the law of friction, in the frame of `body`."""
        return law_of(self.friction).placed(*self.turn(), self.shift_mm)

    def turn(self) -> tuple[float, tuple[float, float]]:
        """Return by which angle about Z the body is turned, in degrees, and about which X and Y."""
        return getattr(self, "turn_deg", 0.0), (0.0, 0.0)

    def raised(self) -> Sequence[Geometry]:
        """Return the outlines of what is raised from a plate, before `shift_mm`."""
        return ()

    @property
    def is_kept_sampled(self) -> bool:
        """Whether results keep a sampled copy for pictures: its kind may not be known there."""
        return not type(self).__module__.startswith("tactile_fem.")

    @cached_by_content(maxsize=4)
    def body(self) -> RigidBody:
        """Return the rigid body.

        It is cached by the keys and the content of the files that they name.

        Raises
        ------
        StudyError
            A font or glyph is missing, a file cannot be used, or a radius does not fit.
        """
        return Moved(self.shape(), self.shift_mm)

    def outlines(self) -> list[Geometry]:
        """Return the outlines of what is raised, at displacement 0; none for smooth bodies.

        Coordinates are X and Y in mm over the contact point.
        """
        from shapely import affinity  # takes a while

        return [affinity.translate(shape, *self.shift_mm) for shape in self.raised()]


def check_limit(key: str, value: float, limits: Mapping[str, float]) -> None:
    """Raise StudyError if a key's value exceeds the least of the named limits."""
    name = min(limits, key=limits.__getitem__)
    if value > limits[name] + 1e-12:
        raise StudyError(f"stimulus.{key} = {value:g} must not exceed {name} ({limits[name]:g})")
