"""A drawing raised from a plate: polygons, an SVG, or a black and white picture."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from tactile_fem.errors import StudyError
from tactile_fem.runtime.settings import File, Finite, Positive
from tactile_fem.stimulus.body import Embossed, RigidBody, United
from tactile_fem.stimulus.stimulus import CornerRadius, FilletRadius, Relief, Stimulus

if TYPE_CHECKING:
    from shapely import Geometry

    from tactile_fem.stimulus.outlines import Outlines

Point = tuple[Finite, Finite]
Ring = Annotated[tuple[Point, ...], Field(min_length=3)]
Heights = Annotated[tuple[Relief, ...], Field(min_length=1)]
Shape = Annotated[tuple[Ring, ...], Field(min_length=1)]


def _shapes(given: Any) -> Any:
    """Return polygons of Shapely, or lists of points, as shapes of rings."""
    if hasattr(given, "geom_type"):
        given = [given]
    if isinstance(given, str) or not isinstance(given, Iterable):
        return given
    found: list[Any] = []
    for one in given:
        if hasattr(one, "geom_type"):
            import shapely  # takes a while

            found += [
                [ring.coords[:-1] for ring in (part.exterior, *part.interiors)]
                for part in shapely.get_parts(one)
                if part.geom_type == "Polygon"
            ]
        else:
            try:  # a list of points, not of rings?
                is_ring = len(one[0]) == 2 and not hasattr(one[0][0], "__len__")
            except (TypeError, IndexError, KeyError):
                is_ring = False
            found.append([one] if is_ring else one)
    return found


def _heights(given: Any) -> Any:
    return given if isinstance(given, Sequence) and not isinstance(given, str) else (given,)


class Drawing(Stimulus):
    """Flat shapes raised from a plate: your own polygons, or those of a file.

    In Python, `polygons` may be polygons of Shapely or arrays of points; `Drawing.of_pixels` takes
    a boolean array.
    """

    kind: Literal["drawing"] = "drawing"
    polygons: Annotated[tuple[Shape, ...], BeforeValidator(_shapes)] = Field(
        (),
        description="shapes, each a list of points [X, Y] in mm, or several such rings, of which "
        "the inner ones are holes; the middle of all comes to X = 0 and start_mm, wherever it lies",
    )
    file: File | None = Field(
        None,
        description="instead of polygons an .svg, or a picture that is black where it is raised; "
        "its right is along Y and its top towards -X, as letters read",
    )
    width_mm: Positive | None = Field(
        None,
        description="width along Y of what is drawn; default: as the .svg states it in mm; a "
        "picture needs it",
    )
    turn_deg: Finite = Field(0.0, description="turn about Z through the middle, from X towards Y")
    relief_mm: Annotated[Heights, BeforeValidator(_heights)] = Field(
        (0.6,), description="height of the shapes: one number, or a list with one for each"
    )
    corner_radius_mm: CornerRadius = None
    fillet_radius_mm: FilletRadius = None
    start_mm: Finite = Field(
        0.0,
        description="place of the drawing over the contact point at displacement 0, from its "
        "middle along Y",
    )

    @model_validator(mode="after")
    def _is_drawn_once(self) -> Self:
        if bool(self.polygons) == bool(self.file):
            raise ValueError("polygons or file must be given, and not both")
        return self

    @classmethod
    def of_pixels(cls, pixels: Any, pixel_mm: float, **keys: Any) -> Self:
        """Return the drawing of a picture in an array.

        Parameters
        ----------
        pixels
            Booleans, true where it is raised, or gray values from 0 to 1, raised above a half;
            (rows, columns), none of them masked. Rows follow each other along X, columns along Y.
        pixel_mm
            Size of a pixel.
        **keys
            Others of the drawing.

        Raises
        ------
        StudyError
            They are no such values, or nothing is raised.
        """
        from tactile_fem.stimulus.outline_files import outlines_of_pixels

        return cls(polygons=outlines_of_pixels(pixels, pixel_mm), **keys)

    def turn(self) -> tuple[float, tuple[float, float]]:
        """Return the angle, and the middle of the drawing."""
        return self.turn_deg, (0.0, -self.start_mm)

    def shape(self) -> RigidBody:
        """Return the raised shapes."""
        bodies = [Embossed(outlines, h, fillet_mm) for outlines, h, fillet_mm in self._levels()]
        return bodies[0] if len(bodies) == 1 else United(tuple(bodies))

    def raised(self) -> list[Geometry]:
        """Return the outlines, their holes cut out."""
        return [shape for outlines, *_ in self._levels() for shape in outlines.polygons()]

    def _levels(self) -> list[tuple[Outlines, float, float]]:
        """Return for each height the shapes, the height and the radius of the top edges, mm."""
        from tactile_fem.stimulus.outlines import Outlines, radii_that_fit

        shapes = self._placed()
        heights = self.relief_mm
        if len(heights) not in (1, len(shapes)):
            raise StudyError(
                f"stimulus.relief_mm has {len(heights)} heights for {len(shapes)} shapes: give "
                "one, or one for each"
            )
        names = {_name(k, shape): shape for k, shape in enumerate(shapes, 1)}
        corner_mm, fillet_mm = radii_that_fit(
            names, self.corner_radius_mm, self.fillet_radius_mm, min(heights)
        )
        of_shape = heights * len(shapes) if len(heights) == 1 else heights
        levels = []
        for height in sorted(set(heights), reverse=True):
            raised = [one for one, own in zip(shapes, of_shape, strict=True) if own == height]
            placed = [(shape, (0.0, 0.0)) for shape in raised]
            levels.append((Outlines(placed, corner_mm, height), height, fillet_mm))
        return levels

    def _placed(self) -> list[Geometry]:
        """Return the shapes in mm, sized, turned, and with their middle at the place of start."""
        import shapely  # takes a while
        from shapely import affinity

        from tactile_fem.stimulus.outline_files import read_outlines, shape_of

        if self.file is None:
            _check_rings(self.polygons)
            shapes = [shape_of(rings) for rings in self.polygons]
        else:
            shapes = read_outlines(self.file, self.width_mm is None)
        whole = shapely.GeometryCollection(shapes)
        (left, low, right, high) = whole.bounds
        scale = 1.0 if self.width_mm is None else self.width_mm / (high - low)
        middle = ((left + right) / 2, (low + high) / 2)
        angle = math.radians(self.turn_deg)
        c, s = scale * math.cos(angle), scale * math.sin(angle)
        to = [c, -s, s, c, -c * middle[0] + s * middle[1], -s * middle[0] - c * middle[1]]
        to[5] -= self.start_mm
        return [affinity.affine_transform(shape, to) for shape in shapes]


def _check_rings(polygons: Sequence[Shape]) -> None:
    """Raise StudyError for a ring that crosses itself or another one of its shape."""
    import shapely  # takes a while

    for number, rings in enumerate(polygons, 1):
        lines: list[Geometry] = [shapely.LinearRing(ring) for ring in rings]
        for k, line in enumerate(lines, 1):
            start = f"stimulus.polygons: ring {k} of shape {number}"
            has_area = shapely.convex_hull(line).area > 0  # of others `shape_of` tells
            if has_area and not line.is_simple:
                reason = shapely.is_valid_reason(shapely.Polygon(line))
                raise StudyError(f"{start} crosses or touches itself ({reason}): give simple rings")
            if any(line.crosses(other) for other in lines[: k - 1]):
                raise StudyError(f"{start} crosses another one: give one ring around both")


def _name(number: int, shape: Geometry) -> str:
    """Return what a message calls a shape."""
    x, y = (round(place, 1) + 0.0 for place in shape.centroid.coords[0])  # no -0.0
    return f"shape {number} (around X {x:.1f}, Y {y:.1f} mm)"
