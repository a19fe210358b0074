"""The scans that a surrogate learns from, and those that test it; all are drawn by number."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from tactile_fem.errors import StudyError
from tactile_fem.series import Member
from tactile_fem.study import Study
from tactile_fem.surrogate.networks import TAUGHT_MM

# Ranges of what is drawn; lengths in mm, speeds in mm/s.
DEEPEST_MM = 2.1
_LEAST_MM, _LEAST_PRESS_MM = 0.5, 0.6
_LARGEST_FRICTION, _USUAL_FRICTION = 0.7, 0.3
_USUAL_SPEED, _SPEEDS = 20.0, (10.0, 40.0)
_SIZES, _GAPS, _RELIEF = (0.35, 1.8), (0.8, 5.0), (0.2, 1.1)
_SLIDE_MM, _OUTPUT_MM = 10.0, 0.2
# How far shapes reach beyond the path of the finger's centre, in X and Y.
_MARGIN_MM = np.array([7.5, 9.0])
# Corners are rounded by this radius; shapes and holes of less area are left out, mm2.
_ROUND_MM, _SMALLEST_MM2, _SMALLEST_HOLE_MM2 = 0.2, 0.35, 0.6
_STYLES = ("dots", "strokes", "bars", "blobs", "polygons")
_KINDS = {"drawing": 0.80, "cylinder": 0.06, "sphere": 0.06, "edge": 0.05, "plate": 0.03}
_RECEPTORS = 220
_SALT = 7
# A drawing whose corners cannot be rounded is drawn again, so often at most.
_DRAWS, _NEXT_DRAW = 20, 1000

# What tests a surrogate: its kinds, depths and letters.
TEST_KINDS = ("letters", "dots", "gratings", "textures")
_DEPTHS_MM = (1.0, 2.0)
_LETTERS = "ABCDEFGHJKLMNOPQRSTUVWXYZ"

Random = np.random.Generator


def random_scan(study: Study, number: int, kind: str = "lesson") -> Member:
    """Return a scan of a study's finger, with a body, path, friction and receptors of its number.

    Of the `TEST_KINDS`, it tests what has learnt from others: it slides along the finger. Raises
    StudyError if no body can be made, or the study is not that of a solid finger.
    """
    for k in range(_DRAWS):
        drawn = _drawn(study, number + _NEXT_DRAW * k, kind)
        try:
            drawn.stimulus.body()
        except StudyError:
            continue
        return Member(f"{kind}-{number:04d}", drawn, {"number": number})
    raise StudyError(f"random scan {number}: none of {_DRAWS} bodies could be made.")


def _drawn(study: Study, seed: int, kind: str = "lesson") -> Study:
    protocol: dict[str, Any]
    if kind in TEST_KINDS:
        random = np.random.default_rng([_SALT, seed, 1])
        protocol = {"depth_mm": float(random.uniform(*_DEPTHS_MM)), "output_mm": _OUTPUT_MM}
        stimulus = {"friction": float(_friction(random)), **_of_kind(random, kind)}
    else:
        random = np.random.default_rng([_SALT, seed])
        friction = float(_friction(random))
        path, places = _path(random)
        protocol, stimulus = {"path": path}, _stimulus(random, places) | {"friction": friction}
        stimulus["shift_mm"] = tuple(map(float, stimulus["shift_mm"]))
    receptors = study.receptors.model_dump(exclude_unset=True) | {
        "placement": "random",
        "count": _RECEPTORS,
        "seed": seed,
        "half_width_mm": float(TAUGHT_MM[0]),
        "half_length_mm": float(TAUGHT_MM[1]),
    }
    kept = {name: getattr(study, name) for name in ("finger", "tissue", "solver", "neuron")}
    own = {"stimulus": stimulus, "protocol": protocol, "receptors": receptors}
    return Study.model_validate({**kept, **own, "output": {"pictures": False}})


def _friction(random: Random) -> float:
    if random.random() < 0.1:
        return 0.0
    if random.random() < 0.2:
        return _USUAL_FRICTION
    return random.uniform(0, _LARGEST_FRICTION)


def _path(random: Random) -> tuple[list[dict[str, Any]], np.ndarray]:
    """Return the pieces of a path, and its corners (n, 2) in mm."""
    depth = random.uniform(_LEAST_PRESS_MM, DEEPEST_MM)
    speed = _USUAL_SPEED if random.random() < 0.7 else _log_uniform(random, *_SPEEDS)
    down, half = np.array([0.0, -1.0]), _SLIDE_MM / 2
    if random.random() < 0.5:
        legs = [_SLIDE_MM * down]
    else:
        first = down if random.random() < 0.5 else _heading(random)
        legs = [half * first, half * _heading(random)]
    path: list[dict[str, Any]] = [{"kind": "press", "depth_mm": depth, "speed_mm_s": speed}]
    places = [np.zeros(2)]
    for k, leg in enumerate(legs):
        if k and random.random() < 0.6:
            other = float(np.clip(depth + random.normal(0, 0.4), _LEAST_MM, DEEPEST_MM))
            if abs(other - depth) > 0.05:
                kind = "press" if other > depth else "lift"
                path.append({"kind": kind, "depth_mm": other, "speed_mm_s": speed})
                depth = other
        by = [float(v) for v in leg]
        path.append({"kind": "slide", "by_mm": by, "speed_mm_s": speed, "output_mm": _OUTPUT_MM})
        places.append(places[-1] + leg)
    return path, np.array(places)


def _stimulus(random: Random, places: np.ndarray) -> dict[str, Any]:
    """Return the table of a body that a finger meets all along a path."""
    # As the body goes along the path, the finger goes the other way over it.
    low, high = (-places).min(axis=0) - _MARGIN_MM, (-places).max(axis=0) + _MARGIN_MM
    kind = str(random.choice(list(_KINDS), p=list(_KINDS.values())))
    middle = -places.mean(axis=0)
    if kind == "drawing":
        return _drawing(random, low, high)
    if kind == "sphere":
        shift = middle + random.normal(0, 1, 2)
        return {"kind": kind, "shift_mm": shift, "radius_mm": _log_uniform(random, 1.5, 10)}
    own: dict[str, Any] = {"kind": kind, "shift_mm": middle if kind != "plate" else (0.0, 0.0)}
    if kind == "cylinder":
        own["radius_mm"] = _log_uniform(random, 1, 10)
    if kind == "edge":
        own["radius_mm"] = float(random.uniform(0.1, 0.6))
        own["angle_deg"] = float(random.uniform(50, 130))
    if kind != "plate":
        own["along"] = str(random.choice(["x", "y"]))
    return own


def _drawing(random: Random, low: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    shapes = _shapes(random, low, high)
    relief = random.uniform(*_RELIEF)
    heights = [float(round(relief, 3))]
    if random.random() >= 0.7:
        shares = random.choice([0.5, 0.75, 1.0], len(shapes))
        others = [float(round(relief * share, 2)) for share in shares]
        heights = others if max(others) >= relief * 0.99 else heights + others[1:]
    left, bottom, right, top = shapely.GeometryCollection(shapes).bounds
    return {
        "kind": "drawing",
        "polygons": shapes,
        "relief_mm": heights,
        "start_mm": 0.0,
        "shift_mm": ((left + right) / 2, (bottom + top) / 2),
    }


def _shapes(
    random: Random, low: np.ndarray, high: np.ndarray, known: tuple[str, float, float] | None = None
) -> list[shapely.Polygon]:
    """Return shapes over a rectangle, rounded so that each can be raised.

    They have one style, size and gap, which are drawn if they are not known.
    """
    style, size, gap = known or (
        str(random.choice(list(_STYLES))),
        _log_uniform(random, *_SIZES),
        _log_uniform(random, *_GAPS),
    )
    if style == "bars":
        found = _bars(random, low, high, size, gap)
    else:
        found = _scattered(random, low, high, style, size, gap)
    r = _ROUND_MM
    whole = shapely.union_all(found).intersection(shapely.box(*low, *high))
    whole = whole.buffer(-r).buffer(2 * r).buffer(-2 * r).buffer(r)
    kept = []
    for part in shapely.get_parts(whole):
        holes = [h for h in part.interiors if shapely.Polygon(h).area > _SMALLEST_HOLE_MM2]
        shape = shapely.Polygon(part.exterior, holes)
        if shape.area > _SMALLEST_MM2:
            kept.append(shape.simplify(0.01))
    return kept


def _bars(
    random: Random, low: np.ndarray, high: np.ndarray, size: float, gap: float
) -> list[shapely.Geometry]:
    angle = random.uniform(0, np.pi)
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    middle, reach = (low + high) / 2, float(np.linalg.norm(high - low) / 2)
    found, at = [], -reach
    while at < reach:
        width = 2 * size * random.uniform(0.7, 1.4)
        centre = middle + across * (at + width / 2)
        line = shapely.LineString([centre - reach * along, centre + reach * along])
        found.append(line.buffer(width / 2, cap_style="flat"))
        at += width + gap * random.uniform(0.6, 1.6)
    return found


def _scattered(
    random: Random, low: np.ndarray, high: np.ndarray, style: str, size: float, gap: float
) -> list[shapely.Geometry]:
    area_of_one = {
        "dots": np.pi * (size + gap / 2) ** 2,
        "strokes": (2 * size + gap) * 5,
        "blobs": (2 * size + gap) ** 2 * 2,
        "polygons": (2.5 * size + gap) ** 2,
    }[style]
    found = []
    for _ in range(max(3, round(0.8 * np.prod(high - low) / area_of_one))):
        place = random.uniform(low, high)
        radius = size * random.uniform(0.7, 1.5)
        if style == "dots":
            found.append(shapely.Point(place).buffer(radius))
        elif style == "blobs":
            found.append(_blob(random, place, radius))
        elif style == "polygons":
            corners = np.sort(random.uniform(0, 2 * np.pi, random.integers(3, 7)))
            ring = place + 2 * radius * np.column_stack([np.cos(corners), np.sin(corners)])
            found.append(shapely.MultiPoint(ring).convex_hull.buffer(0.2))
        else:
            found.append(_stroke(random, place).buffer(0.7 * radius, cap_style="flat"))
    return found


def _blob(random: Random, place: np.ndarray, radius: float) -> shapely.Geometry:
    centres = (shapely.Point(place + random.normal(0, radius, 2)) for _ in range(3))
    return shapely.union_all([at.buffer(radius * random.uniform(0.6, 1.2)) for at in centres])


def _stroke(random: Random, place: np.ndarray) -> shapely.LineString:
    heading, bend, points = random.uniform(0, 2 * np.pi), random.normal(0, 0.5), [place]
    for _ in range(10):
        points.append(points[-1] + 0.5 * np.array([np.cos(heading), np.sin(heading)]))
        heading += bend * 0.5
    return shapely.LineString(points)


def _heading(random: Random) -> np.ndarray:
    angle = random.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _log_uniform(random: Random, least: float, largest: float) -> float:
    return float(np.exp(random.uniform(np.log(least), np.log(largest))))


def _of_kind(random: Random, kind: str) -> dict[str, Any]:
    """Return the table of a body of the `TEST_KINDS`."""
    if kind == "letters":
        return {"kind": "text", "text": str(random.choice(list(_LETTERS)))}
    if kind == "dots":
        radius, gap = random.uniform(0.5, 0.9), random.uniform(1.0, 3.5)
        array = {"spacing_mm": 2 * radius + gap, "columns": 9, "rows": 13}
        return {"kind": "dots", "radius_mm": radius, **array}
    if kind == "gratings":
        ridge, groove = random.uniform(0.8, 3.0, 2).tolist()
        return {"kind": "grating", "ridge_mm": ridge, "groove_mm": groove, "count": 25}
    # Small grains of irregular shapes, places and heights.
    reach = _MARGIN_MM + np.array([0.0, _SLIDE_MM / 2])
    grains = _shapes(random, -reach, reach, ("blobs", 0.4, 0.8))
    heights = random.choice([0.15, 0.25, 0.35], len(grains)).tolist()
    return {"kind": "drawing", "polygons": grains, "relief_mm": heights}
