"""Outlines of an SVG: what it shows, in the order in which it is painted.

What a file may say and this reader does not know is refused by its name: elements, properties and
selectors. Otherwise something that is not seen would be raised without a word.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.winding import filled

Element = ET.Element

_MM_PER_INCH = 25.4
# CSS pixels, in which an SVG without units counts.
_PIXELS_PER_INCH = 96.0
# Chords of an SVG's curves, as a share of the drawing's size.
_CHORD_SHARE = 1 / 2000
_SVG = "{http://www.w3.org/2000/svg}"
_LINK = "href", "{http://www.w3.org/1999/xlink}href"
_SHAPES = {"path", "rect", "circle", "ellipse", "line", "polyline", "polygon"}
_GROUPS = {"svg", "g", "a", "use"}
# They paint nothing themselves, but may be referred to.
_NOT_PAINTED = {
    *("defs", "symbol", "clipPath", "mask", "marker", "pattern", "filter", "linearGradient"),
    *("radialGradient", "style", "title", "desc", "metadata", "script"),
}
# Properties that change what is seen, with values that do not.
_REFUSED = {
    **{name: {"none"} for name in ("clip-path", "mask", "filter", "vector-effect", "mask-image")},
    **{"clip": {"auto"}, "mix-blend-mode": {"normal"}, "transform-origin": set[str]()},
}
_REFUSED_OF_SHAPES = {
    **{name: {"none"} for name in ("marker", "marker-start", "marker-mid", "marker-end")},
    **{"paint-order": {"normal", "fill", "fill stroke", "fill stroke markers"}},
}
_INHERITED = {
    *("fill", "fill-rule", "fill-opacity", "stroke", "stroke-width", "stroke-linecap"),
    *("stroke-linejoin", "stroke-miterlimit", "stroke-dasharray", "stroke-opacity", "visibility"),
    *("color", *_REFUSED_OF_SHAPES),
}
_KNOWN = _INHERITED | {*_REFUSED, "display", "opacity", "transform"}
_SELECTOR = re.compile(r"(\*|[\w-]+)?((?:[.#][\w-]+)*)")
_CAPS: dict[str, Literal["round", "square", "flat"]] = {"round": "round", "square": "square"}
_JOINS: dict[str, Literal["round", "bevel", "mitre"]] = {"round": "round", "bevel": "bevel"}


class _Line(NamedTuple):
    """A subpath as points (n, 2), of which curves have chords of some length."""

    points: NDArray[np.float64]
    is_closed: bool


def read_svg(file: Path) -> list[shapely.Geometry]:
    """Return the filled shapes and the strokes in mm, in the order of the file.

    Raises
    ------
    StudyError
        It shows something that is not read.
    """
    try:
        import svgelements
    except ImportError:
        raise StudyError(
            "stimulus.file: svgelements, which reads .svg files, is not installed: pip install "
            "svgelements"
        ) from None
    root = ET.parse(file).getroot()
    _Seen(root, file).reduce()
    source = io.BytesIO(ET.tostring(root))
    svg = svgelements.SVG.parse(source, ppi=_PIXELS_PER_INCH)
    elements = [own for own in svg.elements() if isinstance(own, svgelements.Shape)]
    box = svgelements.Group.union_bbox(elements)
    if box is None:
        return []
    chord = max(box[2] - box[0], box[3] - box[1]) * _CHORD_SHARE
    mm = _MM_PER_INCH / _PIXELS_PER_INCH
    found: list[shapely.Geometry] = []
    for element in elements:
        if element.values.get("visibility") in ("hidden", "collapse"):
            continue
        lines = _lines(svgelements.Path(element).reify(), chord)
        raised: shapely.Geometry = shapely.Polygon()
        for is_raised, region in _painted(element, lines):
            if is_raised:
                raised = raised.union(region)
            else:  # white covers what lies below it
                found = [shape.difference(region) for shape in found]
                raised = raised.difference(region)
        found.append(raised)
    to_finger = [0, mm, mm, 0, 0, 0]
    return [affinity.affine_transform(shape, to_finger) for shape in found if shape.area]


# --- what is seen ----------------------------------------------------------------------------


class _Seen:
    """Reduces a document to what is seen, with the styles of a sheet at its elements."""

    def __init__(self, root: Element, file: Path) -> None:
        self._root, self._start = root, f"stimulus.file = {file}"
        self._by_id = {f"#{own.get('id')}": own for own in root.iter() if own.get("id")}

    def reduce(self) -> None:
        """Inline rules, remove what is not seen, and check what is left."""
        rules = self._rules()
        own = {element: self._declared(element, rules) for element in self._root.iter()}
        for parent in list(self._root.iter()):
            for child in list(parent):
                if own[child].get("display") == "none" or _is_zero(own[child].get("opacity")):
                    parent.remove(child)
        self._check(self._root, own, {}, has_round_pens=True)
        for parent in list(self._root.iter()):
            for child in list(parent):
                if _name(child) in _NOT_PAINTED - {"defs", "symbol"}:
                    parent.remove(child)
                elif _name(child) == "symbol":  # svgelements would paint it where it stands
                    child.tag = f"{_SVG}g"
                    place = list(parent).index(child)
                    parent[place] = ET.Element(f"{_SVG}defs")
                    parent[place].append(child)

    def _refuse(self, what: str) -> StudyError:
        return StudyError(f"{self._start} has {what}, which is not read: convert it to plain paths")

    def _rules(self) -> list[tuple[tuple[int, int], str, dict[str, str]]]:
        """Return the rules of style sheets: specificity and number, selector, declarations."""
        found: list[tuple[tuple[int, int], str, dict[str, str]]] = []
        sheets = [own.text or "" for own in self._root.iter() if _name(own) == "style"]
        css = re.sub(r"/\*.*?\*/|<!--|-->", "", " ".join(sheets), flags=re.DOTALL)
        css = re.sub(r"@(font-face\s*\{[^}]*\}|charset[^;]*;|namespace[^;]*;)", "", css)
        if at := re.search(r"@[\w-]+", css):
            raise self._refuse(f"{at[0]} in its style sheet")
        for selectors, body in re.findall(r"([^{}]+)\{([^{}]*)\}", css):
            declared = _declarations(body)
            for selector in (each.strip() for each in selectors.split(",")):
                simple = _SELECTOR.fullmatch(selector)
                if simple is None and _KNOWN & declared.keys():
                    raise self._refuse(f'the selector "{selector}" in its style sheet')
                if simple is not None:
                    ids, classes = selector.count("#"), selector.count(".")
                    tag = simple[1] not in (None, "*")
                    found.append(((100 * ids + 10 * classes + tag, len(found)), selector, declared))
        return sorted(found, key=lambda rule: rule[0])

    def _declared(
        self, element: Element, rules: list[tuple[tuple[int, int], str, dict[str, str]]]
    ) -> dict[str, str]:
        """Return the properties of an element itself, which then stand in its style."""
        declared = {name: value.strip() for name, value in element.attrib.items() if name in _KNOWN}
        for _, selector, own in rules:
            if _matches(element, selector):
                declared.update(own)
        declared.update(_declarations(element.get("style", "")))
        kept = {name: value for name, value in declared.items() if name in _KNOWN}
        for name, value in kept.items():
            if "var(" in value:
                raise self._refuse(f"var() in {name}")
        if kept and isinstance(element.tag, str):
            element.set("style", ";".join(f"{name}:{value}" for name, value in kept.items()))
        return kept

    def _check(
        self,
        element: Element,
        own: Mapping[Element, dict[str, str]],
        inherited: Mapping[str, str],
        *,
        has_round_pens: bool,
    ) -> None:
        """Refuse what an element or those in it show and this reader does not know."""
        name, declared = _name(element), own[element]
        if name is None or name in _NOT_PAINTED:
            return
        if name == "text":
            if "".join(element.itertext()).strip():
                text = "has text, whose font is not in it: convert it to paths"
                raise StudyError(f"{self._start} {text}")
            return
        if name not in _SHAPES | _GROUPS or (name == "svg" and element is not self._root):
            raise self._refuse(f"<{name}>{' within it' if name == 'svg' else ''}")
        style = {**inherited, **{k: v for k, v in declared.items() if v != "inherit"}}
        refused = {**_REFUSED, **(_REFUSED_OF_SHAPES if name in _SHAPES else {})}
        for prop, harmless in refused.items():
            if prop in style and style[prop] not in harmless:
                raise self._refuse(f"{prop}: {style[prop]}")
        transform = declared.get("transform", element.get("transform", ""))
        is_even = element.get("preserveAspectRatio") != "none" and _is_similarity(transform)
        has_round_pens = has_round_pens and is_even
        if name in _SHAPES:
            self._check_paint(style, has_round_pens)
        passed = {prop: value for prop, value in style.items() if prop in _INHERITED}
        children = list(element)
        if name == "use":
            target = self._by_id.get(next(filter(None, map(element.get, _LINK)), ""))
            if target is None or _name(target) not in _SHAPES | {"g", "a", "use", "symbol"}:
                raise self._refuse("<use> of something that is not in it")
            if target.get("viewBox"):
                raise self._refuse("<use> of a symbol with a viewBox")
            children = list(target) if _name(target) == "symbol" else [target]
        for child in children:
            self._check(child, own, passed, has_round_pens=has_round_pens)

    def _check_paint(self, style: Mapping[str, str], has_round_pens: bool) -> None:
        for what in ("fill", "stroke"):
            if link := re.match(r"url\(\s*['\"]?(#[^'\")]+)", style.get(what, "")):
                kind = _name(self._by_id.get(link[1]))
                if kind not in ("linearGradient", "radialGradient"):
                    raise self._refuse(f"a {what} by {kind or 'something that is not in it'}")
        if style.get("stroke", "none") in ("none", "transparent"):
            return
        dashes = style.get("stroke-dasharray", "none")
        if dashes != "none" and not _is_zero(dashes):
            raise self._refuse(f"stroke-dasharray: {dashes}")
        if not has_round_pens:
            raise self._refuse("a stroke whose width differs between directions")


def _name(element: Element | None) -> str | None:
    """Return the name of an SVG element; None of others, and of comments."""
    if element is None or not isinstance(element.tag, str):
        return None
    space, brace, local = element.tag.rpartition("}")
    return local if not brace or f"{space}}}" == _SVG else None


def _declarations(text: str) -> dict[str, str]:
    pairs = (each.partition(":") for each in text.split(";"))
    found = ((name.strip(), value.replace("!important", "").strip()) for name, _, value in pairs)
    return {name: value for name, value in found if value}


def _matches(element: Element, selector: str) -> bool:
    """Return whether a simple selector is one of an element."""
    tag, rest = _SELECTOR.fullmatch(selector).groups()  # type: ignore[union-attr]
    marks = re.findall(r"[.#][\w-]+", rest)
    own = {f"#{element.get('id')}", *(f".{name}" for name in element.get("class", "").split())}
    return tag in (None, "*", _name(element)) and own.issuperset(marks)


def _is_zero(value: str | None) -> bool:
    return bool(value and re.fullmatch(r"[+-]?0*\.?0*(e\d+)?(%|px)?", value) and "0" in value)


def _is_similarity(transform: str) -> bool:
    """Return whether a transform keeps circles round."""
    import svgelements

    matrix = svgelements.Matrix(transform)
    a, b, c, d = (float(x) for x in (matrix.a, matrix.b, matrix.c, matrix.d))
    size = a * a + b * b + c * c + d * d
    return abs(a * a + b * b - c * c - d * d) + 2 * abs(a * c + b * d) < 1e-6 * size


# --- what is painted -------------------------------------------------------------------------


def _painted(element: Any, lines: list[_Line]) -> Iterator[tuple[bool, shapely.Geometry]]:
    """Yield the regions of an element's fill and stroke, and whether they are raised, not white."""
    values = element.values
    if (is_raised := _is_raised(element, "fill")) is not None:
        rule: Any = values.get("fill-rule", "nonzero")
        yield is_raised, filled([line.points for line in lines], rule)
    if (is_raised := _is_raised(element, "stroke")) is not None and element.stroke_width:
        join = _JOINS.get(values.get("stroke-linejoin", ""), "mitre")
        strokes = [
            _geometry(line).buffer(
                float(element.stroke_width) / 2,
                cap_style=_CAPS.get(values.get("stroke-linecap", ""), "flat"),
                join_style=join,
                mitre_limit=float(values.get("stroke-miterlimit", 4.0)),
            )
            for line in lines
        ]
        yield is_raised, shapely.union_all(strokes)


def _geometry(line: _Line) -> shapely.Geometry:
    points = line.points
    if line.is_closed:
        return shapely.LinearRing(points)
    if np.array_equal(points[0], points[-1]):  # it has ends there, not a corner
        points = np.concatenate([points[:-1], points[-1:] + 1e-9 * (points[-2:-1] - points[-1:])])
    return shapely.LineString(points)


def _is_raised(element: Any, what: str) -> bool | None:
    """Return whether a fill or stroke is raised, not if it is white; None if it is not painted."""
    if str(element.values.get(what, "")).startswith("url("):  # a gradient
        return True
    color = getattr(element, what)
    if color is None or color.value is None or color.opacity == 0:
        return None
    return bool(min(color.red, color.green, color.blue) < 255)


def _lines(path: Any, chord: float) -> list[_Line]:
    """Return the subpaths with chords of some length for curves."""
    found = []
    for subpath in path.as_subpaths():
        points: list[tuple[float, float]] = []
        is_closed = False
        for segment in subpath:
            name = type(segment).__name__
            if name == "Move" or segment.start is None or segment.end is None:
                continue
            is_closed = name == "Close"
            count = 1
            if name not in ("Line", "Close"):
                count = int(np.ceil(segment.length(error=1e-2) / chord)) + 1
            for t in np.linspace(0, 1, count + 1)[0 if not points else 1 :]:
                point = segment.point(t)
                points.append((point.x, point.y))
        if len(points) > 1:
            found.append(_Line(np.array(points), is_closed and len(points) > 2))
    return found
