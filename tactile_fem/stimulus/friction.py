"""Laws of friction: the coefficient by pressure, slip speed and place on the body.

Friction is at most the coefficient times the pressure (`tactile_fem.mechanics.contact_law`). A law
states the coefficient in UFL, from which the tangent follows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, PlainValidator, TypeAdapter, ValidationInfo

from tactile_fem.errors import StudyError
from tactile_fem.runtime.files import cached_by_content
from tactile_fem.runtime.settings import File, Finite, Kind, NonNegative, Positive
from tactile_fem.stimulus.body import Array
from tactile_fem.stimulus.heights import read_raw

if TYPE_CHECKING:
    from ufl.core.expr import Expr

    from tactile_fem.finger.plane import Plane

# Values (n,) at points (n, 3) in the body's frame, and their gradients (n, 3) per mm; of a section
# both in its plane, (n, 2).
OverBody = Callable[[Array], tuple[Array, Array]]

# Share of the reference pressure below which the coefficient hardly grows any more.
_LEAST_PRESSURE_SHARE = 0.01
_NUMBER: TypeAdapter[float] = TypeAdapter(NonNegative)


class Friction(Kind):
    """Base class of laws of friction.

    A law states its name `law`, further keys, and `coefficient_at`. In forms its numbers are
    constants of DOLFINx, so that studies with other values use the same compiled code.
    """

    tag = "law"
    former = MappingProxyType({"moved": "define placed"})
    scaled_by: ClassVar[tuple[str, ...]] = ()
    """Keys of numbers to which friction is proportional."""

    @property
    def uniform(self) -> Any:
        """The coefficient if it is the same at all times and places, else None."""
        return None

    def coefficient_at(self, pressure: Expr, speed: Expr, local: Expr | None) -> Expr:
        """Return the coefficient of friction in UFL.

        Parameters
        ----------
        pressure
            Contact pressure per deformed area, MPa.
        speed
            Slip speed of the skin relative to the body, tangential, mean over the present step,
            mm/s.
        local
            Value of `over_body` at the place of the skin; None without it.
        """
        raise StudyError(
            f'stimulus.friction.law = "{self.law}" is known where its module is imported'
        )

    def over_body(self) -> OverBody | None:
        """Return what gives a value at each place on the body; None if all places are alike."""
        return None

    def placed(
        self, angle_deg: float, about_mm: tuple[float, float], shift_mm: tuple[float, float]
    ) -> Self:
        """Return the law of a body turned from X towards Y about a place, and then shifted."""
        return self

    def check_covers(self, low_mm: Array, high_mm: Array) -> None:
        """Raise StudyError unless it is known between two corners (X, Y) in the body's frame."""

    def with_constants(self, constant: Callable[[float], Any]) -> Self:
        """Return the law for forms: each number is what `constant` makes of it."""
        numbers = {key: constant(value) for key, value in self if isinstance(value, float)}
        return self.model_copy(update=numbers)

    if TYPE_CHECKING:

        @property
        def law(self) -> str:
            """Name of the law, as a study states it."""


class ConstantFriction(Friction):
    """One coefficient, Coulomb's law; a number in place of the table means the same."""

    law: Literal["constant"] = "constant"
    scaled_by = ("coefficient",)
    coefficient: NonNegative = Field(0.3, description="of friction")

    @property
    def uniform(self) -> Any:
        """The coefficient."""
        return self.coefficient

    def coefficient_at(self, pressure: Expr, speed: Expr, local: Expr | None) -> Expr:
        """Return the constant."""
        return self.uniform


class KineticFriction(Friction):
    """Friction that changes exponentially from a static to a kinetic coefficient as skin slips.

    mu = kinetic + (static - kinetic) exp(-v / speed_mm_s), with v the slip speed (Bo and Pavelescu,
    Wear 82, 1982). A kinetic coefficient above the static one makes friction grow with speed.
    Friction that falls with speed is unstable without inertia or viscosity (`solver.inertia`,
    `tissue.viscous_time_s`): if skin then jumps from sticking to sliding, no smaller step follows.
    """

    law: Literal["kinetic"] = "kinetic"
    scaled_by = ("static", "kinetic")
    static: NonNegative = Field(description="coefficient of friction at rest")
    kinetic: NonNegative = Field(description="coefficient at high speed; may exceed the static one")
    speed_mm_s: Positive = Field(description="slip speed at which 1/e of the difference remains")

    def coefficient_at(self, pressure: Expr, speed: Expr, local: Expr | None) -> Expr:
        """Return the coefficient at a slip speed."""
        import ufl  # takes a while

        return self.kinetic + (self.static - self.kinetic) * ufl.exp(-speed / self.speed_mm_s)


class PressureFriction(Friction):
    """Friction that falls with pressure, as of skin, whose true contact area saturates.

    mu = coefficient (p / pressure_MPa)^(load_index - 1): friction is proportional to p^load_index
    (Adams et al., J. R. Soc. Interface 10, 2013). Below a hundredth of `pressure_MPa` the
    coefficient hardly grows any more.
    """

    law: Literal["pressure"] = "pressure"
    scaled_by = ("coefficient",)
    coefficient: NonNegative = Field(description="of friction at pressure_MPa")
    pressure_MPa: Positive = Field(description="pressure at which `coefficient` holds")
    load_index: Annotated[Positive, Field(le=1)] = Field(
        description="exponent of friction over pressure: 2/3 to 1; 1 is Coulomb's law"
    )

    def coefficient_at(self, pressure: Expr, speed: Expr, local: Expr | None) -> Expr:
        """Return the coefficient at a pressure, bounded and smooth at none."""
        share = pressure / self.pressure_MPa
        return self.coefficient * (share**2 + _LEAST_PRESSURE_SHARE**2) ** (
            (self.load_index - 1) / 2
        )


class MappedFriction(Friction):
    """A coefficient for each place on the body, from a file, bilinear between its values.

    Beyond the file's edges the nearest value holds.
    """

    law: Literal["map"] = "map"
    scaled_by = ("unit",)
    file: File = Field(
        description='coefficients over X and Y, in the formats of kind = "surface"; rows follow '
        "each other along X, columns along Y"
    )
    spacing_mm: Positive | None = Field(
        None, description="between two values; default as the file states"
    )
    unit: Positive = Field(
        1.0, description="coefficient of one unit of the values, such as 0.01 for gray values"
    )
    middle_mm: tuple[Finite, Finite] = Field(
        (0.0, 0.0),
        description="X and Y of the map's middle on the body, before its turn_deg and shift_mm",
    )
    turn_deg: Finite = Field(
        0.0, description="further turn of the map about its middle, from X towards Y"
    )

    @cached_by_content(maxsize=4)
    def coefficients(self) -> CoefficientMap:
        """Return the map; raises StudyError if the file cannot be used."""
        key = "stimulus.friction.file"
        raw = read_raw(self.file, key)
        spacing = raw.spacing_mm if self.spacing_mm is None else (self.spacing_mm,) * 2
        values = np.asarray(raw.values, dtype=np.float64)
        if spacing is None:
            raise StudyError(f"stimulus.friction.spacing_mm must be given: {self.file} states none")
        if min(values.shape) < 2:
            rows, columns = values.shape
            raise StudyError(f"{key} = {self.file}: {rows} x {columns} values make no map")
        wrong = ~(values >= 0) | np.isinf(values)
        if wrong.any():
            row, column = np.argwhere(wrong)[0]
            raise StudyError(
                f"{key} = {self.file} has {wrong.sum()} missing or negative coefficients, the "
                f"first in row {row}, column {column}"
            )
        middle, turn = np.array(self.middle_mm), _rotation(self.turn_deg)
        return CoefficientMap(values * self.unit, np.array(spacing), middle, turn)

    def coefficient_at(self, pressure: Expr, speed: Expr, local: Expr | None) -> Expr:
        """Return the value of the map."""
        assert local is not None
        return local

    def over_body(self) -> OverBody:
        """Return the map as a function of the place on the body."""
        return self.coefficients().at

    def placed(
        self, angle_deg: float, about_mm: tuple[float, float], shift_mm: tuple[float, float]
    ) -> Self:
        """Return the map, turned and shifted with the body."""
        middle = np.array(self.middle_mm)
        if angle_deg:
            middle = about_mm + _rotation(angle_deg) @ np.subtract(self.middle_mm, about_mm)
        x, y = np.add(middle, shift_mm).tolist()
        update = {"middle_mm": (x, y), "turn_deg": self.turn_deg + angle_deg}
        return self.model_copy(update=update)

    def check_covers(self, low_mm: Array, high_mm: Array) -> None:
        """Raise StudyError unless the map covers what lies between two corners (X, Y)."""
        own = self.coefficients()
        corners = [[x, y] for x in (low_mm[0], high_mm[0]) for y in (low_mm[1], high_mm[1])]
        if np.all(np.abs(own.in_own_frame(np.array(corners))) <= own.half_mm + 1e-6):
            return
        half = np.abs(own.turn) @ own.half_mm
        ends = own.middle_mm - half, own.middle_mm + half
        covers, touches = (
            f"X {low[0]:.3g} to {high[0]:.3g}, Y {low[1]:.3g} to {high[1]:.3g} mm"
            for low, high in (ends, (low_mm, high_mm))
        )
        raise StudyError(
            f"stimulus.friction.file = {self.file} covers {covers} of the body, but the finger may "
            f"touch {touches}: give a larger map, or another spacing_mm or middle_mm"
        )


@dataclass(frozen=True, eq=False)
class CoefficientMap:
    """Coefficients (nx, ny) at points of a rectangular grid, bilinear between them."""

    values: Array
    spacing_mm: Array
    middle_mm: Array
    turn: Array  # a rotation, (2, 2)

    @property
    def half_mm(self) -> Array:
        """Half its size along its own axes."""
        return self.spacing_mm * (np.array(self.values.shape) - 1) / 2

    def in_own_frame(self, xy_mm: Array) -> Array:
        """Return places (n, 2) of the body from its middle, along its own axes."""
        return (xy_mm - self.middle_mm) @ self.turn

    def at(self, points: Array) -> tuple[Array, Array]:
        """Return the coefficients (n,) and their gradients (n, 3) at points (n, 3) of the body."""
        place = (self.in_own_frame(points[:, :2]) + self.half_mm) / self.spacing_mm
        last = np.array(self.values.shape) - 1
        inside = np.clip(place, 0, last)
        i, j = cell = np.minimum(inside.astype(int), last - 1).T
        x, y = inside.T - cell
        v = self.values
        at_y, next_y = ((1 - y) * v[k, j] + y * v[k, j + 1] for k in (i, i + 1))
        at_x, next_x = ((1 - x) * v[i, k] + x * v[i + 1, k] for k in (j, j + 1))
        gradient = np.zeros_like(points)
        gradient[:, :2] = np.column_stack([next_y - at_y, next_x - at_x]) / self.spacing_mm
        gradient[:, :2][place != inside] = 0.0
        gradient[:, :2] = gradient[:, :2] @ self.turn.T
        return (1 - x) * at_y + x * next_y, gradient


def _rotation(angle_deg: float) -> Array:
    """Return a turn from X towards Y as a matrix, (2, 2)."""
    angle = math.radians(angle_deg)
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _number_or_law(value: Any, info: ValidationInfo) -> float | Friction:
    if isinstance(value, dict | Friction):
        return Friction.one_of_the_kinds(value, info)
    return _NUMBER.validate_python(value)


NumberOrLaw = Annotated[
    float | Friction, PlainValidator(_number_or_law, json_schema_input_type=NonNegative)
]


def field_in_plane(field: OverBody, plane: Plane) -> OverBody:
    """Return a function of the place on a body as a section, or space, takes it."""

    def at(points: Array) -> tuple[Array, Array]:
        values, gradient = field(plane.vectors(points))
        return values, plane.within(gradient)

    return at


def law_of(friction: float | Friction) -> Friction:
    """Return the law of friction that a number or a law states."""
    if isinstance(friction, Friction):
        return friction
    return ConstantFriction(coefficient=friction)
