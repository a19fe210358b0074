"""Regular patterns raised from a plate: a grating and an array of dots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from tactile_fem.runtime.settings import Finite, Positive, Whole
from tactile_fem.stimulus.body import Array, Distance, norm_of
from tactile_fem.stimulus.embossed import Embossed, embossed
from tactile_fem.stimulus.stimulus import ACROSS, Relief, Stimulus

if TYPE_CHECKING:
    from shapely import Polygon

# Endless ridges are drawn so long.
_DRAWN_MM = 20.0


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

    def _row(self) -> Row:
        return Row.of(self.ridge_mm + self.groove_mm, self.count, self.start_mm)

    def shape(self) -> Embossed:
        """Return the raised ridges."""
        ridges = Ridges(self.ridge_mm, self._row(), ACROSS[self.along])
        limits = {"half of ridge_mm": self.ridge_mm / 2}
        return embossed(ridges, self.relief_mm, self.fillet_radius_mm, limits)

    def raised(self) -> list[Polygon]:
        """Return the ridges, cut to 20 mm."""
        import shapely  # takes a while

        across, half = ACROSS[self.along], np.full(2, _DRAWN_MM / 2)
        half[across] = self.ridge_mm / 2
        middles = np.outer(self._row().places(), np.eye(2)[across])
        return [shapely.box(*middle - half, *middle + half) for middle in middles]


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

    def _places(self) -> tuple[Row, Row]:
        rows = Row.of(self.spacing_mm, self.rows, self.start_mm)
        return Row.of(self.spacing_mm, self.columns), rows

    def shape(self) -> Embossed:
        """Return the raised discs."""
        discs, limits = Discs(self.radius_mm, *self._places()), {"radius_mm": self.radius_mm}
        return embossed(discs, self.relief_mm, self.fillet_radius_mm, limits)

    def raised(self) -> list[Polygon]:
        """Return the discs."""
        x, y = self._places()
        return polygons_of_discs(product(x.places(), y.places()), self.radius_mm)


@dataclass(frozen=True)
class Row:
    """`count` equally spaced positions along an axis, the first at `first` mm."""

    first: float
    spacing: float
    count: int

    @classmethod
    def of(cls, spacing: float, count: int, start: float | None = None) -> Row:
        """Return positions such that `start` mm from the first is 0; default the middle."""
        return cls(-spacing * (count - 1) / 2 if start is None else -start, spacing, count)

    def places(self) -> Array:
        """Return all positions (count,)."""
        return np.add(self.first, self.spacing * np.arange(self.count), dtype=np.float64)

    def nearest(self, coordinate: Array) -> Array:
        """Return the position nearest to each coordinate."""
        index = np.round((coordinate - self.first) / self.spacing)
        return self.first + self.spacing * np.clip(index, 0, self.count - 1)


@dataclass(frozen=True)
class Ridges:
    """Parallel ridges, endless along the other axis; `across` is the axis of their `row`."""

    width: float
    row: Row
    across: int

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        offset = xy[:, self.across] - self.row.nearest(xy[:, self.across])
        gradient = np.zeros_like(xy)
        gradient[:, self.across] = np.where(offset < 0, -1.0, 1.0)
        return Distance(np.abs(offset) - self.width / 2, gradient, np.zeros((len(xy), 2, 2)))


@dataclass(frozen=True)
class Discs:
    """A rectangular array of discs, their centres at `x` and `y`."""

    radius: float
    x: Row
    y: Row

    def distance(self, xy: Array) -> Distance:
        """Return the signed distance in the plane at `xy` (n, 2)."""
        centre = np.column_stack([self.x.nearest(xy[:, 0]), self.y.nearest(xy[:, 1])])
        r, n, H = norm_of(xy - centre)
        return Distance(r - self.radius, n, H)


def polygons_of_discs(centres: Iterable[Sequence[float]], radius: float) -> list[Polygon]:
    """Return discs as polygons."""
    import shapely  # takes a while

    return [shapely.Point(centre).buffer(radius) for centre in centres]
