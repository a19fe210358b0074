"""From the study's stimulus to the rigid body, and to its shape for pictures."""

from __future__ import annotations

import math

import shapely
from shapely import affinity

from tactile_fem.errors import StudyError
from tactile_fem.runtime.files import cached_by_content
from tactile_fem.stimulus.body import (
    Ball,
    Domes,
    Embossed,
    HalfSpace,
    Moved,
    Outline,
    RigidBody,
    Turned,
    Wedge,
)
from tactile_fem.stimulus.braille import dots
from tactile_fem.stimulus.letters import Letters
from tactile_fem.stimulus.patterns import Discs, Ridges, Row
from tactile_fem.stimulus.relief import make_relief
from tactile_fem.stimulus.settings import (
    AnyStimulus,
    Braille,
    Cylinder,
    Dots,
    Edge,
    Grating,
    Mesh,
    Plate,
    Sphere,
    Surface,
    Text,
)

# Axis over which something that lies along "x" or "y" rises and falls.
_ACROSS = {"x": 1, "y": 0}


@cached_by_content(maxsize=4)
def make_body(stimulus: AnyStimulus) -> RigidBody:
    """Return the rigid body of a stimulus.

    Raises
    ------
    StudyError
        A font or glyph is missing, a file cannot be used, or a radius does not fit.
    """
    match stimulus:
        case Plate():
            body: RigidBody = HalfSpace()
        case Sphere():
            body = Ball(stimulus.radius_mm)
        case Cylinder():
            body = Ball(stimulus.radius_mm, (_ACROSS[stimulus.along], 2))
        case Edge():
            angle = math.radians(stimulus.angle_deg)
            body = Wedge(stimulus.radius_mm, angle, _ACROSS[stimulus.along])
        case Mesh():
            from tactile_fem.stimulus.part import make_part  # what it needs is not always installed

            body = make_part(stimulus)
        case Braille():
            _check_dots(stimulus)
            body = Domes(dots(stimulus), stimulus.dot_diameter_mm / 2, stimulus.dot_height_mm)
        case Surface():
            body = Turned(make_relief(stimulus), math.radians(stimulus.turn_deg))
        case _:
            outline = _outline(stimulus)
            _check_fillet(stimulus)
            body = Embossed(outline, stimulus.relief_mm, stimulus.fillet_radius_mm)
    return Moved(body, stimulus.shift_mm)


def _outline(stimulus: Text | Grating | Dots) -> Outline:
    match stimulus:
        case Grating():
            spacing = stimulus.ridge_mm + stimulus.groove_mm
            row = Row.of(spacing, stimulus.count, stimulus.start_mm)
            return Ridges(stimulus.ridge_mm, row, _ACROSS[stimulus.along])
        case Dots():
            x = Row.of(stimulus.spacing_mm, stimulus.columns)
            y = Row.of(stimulus.spacing_mm, stimulus.rows, stimulus.start_mm)
            return Discs(stimulus.radius_mm, x, y)
        case _:
            return Letters(stimulus)


def _check_fillet(stimulus: Text | Grating | Dots) -> None:
    """Raise StudyError if the top edge's radius does not fit the raised part."""
    limits = {"relief_mm": stimulus.relief_mm}
    match stimulus:
        case Grating():
            limits["half of ridge_mm"] = stimulus.ridge_mm / 2
        case Dots():
            limits["radius_mm"] = stimulus.radius_mm
        case _:
            limits["corner_radius_mm"] = stimulus.corner_radius_mm
    name = min(limits, key=limits.__getitem__)
    _at_most("fillet_radius_mm", stimulus.fillet_radius_mm, name, limits[name])


def _check_dots(stimulus: Braille) -> None:
    """Raise StudyError if dots are more than half balls, or touch."""
    height, diameter = stimulus.dot_height_mm, stimulus.dot_diameter_mm
    _at_most("dot_height_mm", height, "half of dot_diameter_mm", diameter / 2)
    _at_most("dot_diameter_mm", diameter, "dot_spacing_mm", stimulus.dot_spacing_mm)


def _at_most(name: str, value: float, what: str, limit: float) -> None:
    if value > limit + 1e-12:
        raise StudyError(f"stimulus.{name} = {value:g} must not exceed {what} ({limit:g})")


def outlines(stimulus: AnyStimulus) -> list[shapely.Geometry]:
    """Return the outlines of what is raised, at displacement 0; none for smooth bodies.

    Coordinates are X and Y in mm over the contact point.
    """
    match stimulus:
        case Text() | Grating() | Dots():
            shapes = _outline(stimulus).polygons()
        case Braille():
            base = stimulus.dot_diameter_mm / 2
            shapes = [shapely.Point(centre).buffer(base) for centre in dots(stimulus)]
        case _:
            shapes = []
    return [affinity.translate(shape, *stimulus.shift_mm) for shape in shapes]
