"""Flat shapes of an SVG file: what a viewer shows, or a sentence that names what is not read.

svgelements reads path data, transforms and colors. The tree is walked here, since svgelements does
not know what is unseen, cut, or styled by anything but one name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from xml.etree import ElementTree as ET

import numpy as np
import shapely
import svgelements
from shapely import affinity

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.rings import Array, filled, polylines, thick

Style = dict[str, str]

# CSS pixels, in which an SVG without units counts.
_PIXELS = {"": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "q": 24 / 25.4}
_PIXELS |= {"pt": 96 / 72, "pc": 16.0}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TRANSFORMS = re.compile(
    r"((matrix|translate[xy]?|scale[xy]?|rotate|skew[xy])\s*"
    rf"\(([\s,]*{_NUMBER}(px|deg|g?rad|turn)?)+\s*\)[\s,]*)+",
    re.IGNORECASE,
)
_BLACK = re.compile(r"black$|#000f?$|#0{6}(ff)?$|rgba?\((\s*0%?\s*,?){3}(\s*1)?\)$|hsl.*\D0%\)$")
_HREF = "{http://www.w3.org/1999/xlink}href"
_GROUPS = ("svg", "g", "a", "symbol", "switch", "clipPath")
# Shown only where something refers to them, or never.
_UNSEEN = set(
    "defs symbol clipPath mask pattern marker filter linearGradient radialGradient meshgradient "
    "style title desc metadata script view cursor font font-face color-profile solidColor".split()
)
_INHERITED = set(
    "fill fill-rule fill-opacity stroke stroke-width stroke-opacity stroke-linecap stroke-linejoin "
    "stroke-miterlimit stroke-dasharray visibility color paint-order clip-rule marker "
    "marker-start marker-mid marker-end".split()
)
# Properties that change what is seen but are not read, unless they say so.
_REFUSED = set("mask mask-image filter backdrop-filter mix-blend-mode translate scale zoom".split())
_REFUSED |= set("marker marker-start marker-mid marker-end transform-origin offset-path".split())
_REFUSED |= {"clip", "animation", "animation-name", "all", "systemLanguage"}
_HARMLESS = ("none", "normal", "auto", "", "1", "0 0", "0px 0px")
_SIZES = ("x", "y", "width", "height", "cx", "cy", "r", "rx", "ry", "x1", "y1", "x2", "y2")
_SEEN = {*_REFUSED, *_INHERITED, *_SIZES, "d", "display", "opacity", "clip-path", "transform"}


class _Drawn(NamedTuple):
    """A shape in units of its own, its place on the page, and where it is not cut away."""

    style: Style
    lines: list[tuple[Array, bool]]
    matrix: Array
    clip: shapely.Geometry | None
    diagonal: float

    def filled(self, rule: str) -> shapely.Geometry:
        """Return what it fills by the rule that a property names."""
        return filled([points for points, _ in self.lines], self.style.get(rule) == "evenodd")

    def seen(self, shape: shapely.Geometry) -> shapely.Geometry:
        """Return on the page what is seen of a shape."""
        placed = _placed(shape, self.matrix)
        return placed if self.clip is None else placed.intersection(self.clip)


def read_svg(file: Path) -> list[shapely.Geometry]:
    """Return the shapes that an SVG shows, in mm, in its order; its top lies towards -X.

    Raises
    ------
    StudyError
        It needs what is not read here.
    """
    reader = _Reader(file)
    found: list[shapely.Geometry] = []
    for one in reader.walk(reader.root, {}, np.eye(3), None, (0.0, 0.0)):
        raised: shapely.Geometry = shapely.Polygon()
        for is_raised, painted in reader.painted(one):
            region = one.seen(painted)
            if is_raised:
                raised = raised.union(region)
            else:  # white covers what lies below it
                found = [shape.difference(region) for shape in found]
                raised = raised.difference(region)
        found.append(raised)
    mm = 1 / _PIXELS["mm"]
    return [affinity.affine_transform(s.buffer(0), [0, mm, mm, 0, 0, 0]) for s in found if s.area]


class _Reader:
    """Walk through the tree of an SVG."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.root = ET.parse(file).getroot()
        for element in self.root.iter():
            element.tag = element.tag.removeprefix("{http://www.w3.org/2000/svg}")
        self.by_id = {e.get("id"): e for e in reversed(list(self.root.iter()))}
        if b"<?xml-stylesheet" in file.read_bytes():
            self.refuse("styles in another file")
        self.rules = list(self._rules())

    def refuse(self, feature: str, helps: str = "convert it to plain filled paths") -> NoReturn:
        raise StudyError(f"stimulus.file = {self.file} has {feature}, which is not read: {helps}")

    def _rules(self) -> Iterator[tuple[str, set[str], Style]]:
        """Yield of each rule in <style> the tag, the .classes and #ids, and what it declares."""
        sheets = ""
        for sheet in self.root.iter("style"):
            if sheet.get("media", "all") not in ("", "all", "screen"):
                self.refuse(f"styles for media {sheet.get('media')!r}")
            sheets += (sheet.text or "") + "\n"
        sheets = re.sub(r"(?s)/\*.*?\*/|<!--|-->", "", sheets)
        sheets = re.sub(r"@font-face\s*{[^}]*}|@(charset|namespace)[^;]*;", "", sheets)
        if found := re.search(r"@\w+", sheets):
            self.refuse(f"styles with {found[0]}", "write them into the elements")
        for selectors, body in re.findall(r"([^{}]*)({[^{}]*)", sheets):
            declared = _declared(body[1:])
            for selector in (one.strip() for one in selectors.split(",")):
                simple = re.fullmatch(r"(\*|[\w-]+)?((?:[.#][\w-]+)*)", selector)
                if simple and selector:
                    yield simple[1] or "*", set(re.findall(r"[.#][\w-]+", simple[2])), declared
                elif _SEEN & set(declared):
                    self.refuse(f"styles for {selector!r}", "write them into the elements")

    def style(self, element: Any, parent: Style) -> Style:
        """Return the attributes and properties of an element, its own and inherited ones."""
        names = {"#" + element.get("id", "")} | {f".{c}" for c in element.get("class", "").split()}
        sheets: list[tuple[Any, Style]] = [((9,), _declared(element.get("style", "")))]
        for tag, needed, declared in self.rules:
            if tag in ("*", element.tag) and needed <= names:
                ids = sum(name[0] == "#" for name in needed)
                sheets.append(((0, ids, len(needed) - ids, tag != "*"), declared))
        own, important = dict(element.attrib), Style()
        for _, declared in sorted(sheets, key=lambda sheet: sheet[0]):
            for key, value in declared.items():
                if key == "d":
                    self.refuse("a path in a style")
                to = important if "!" in value else own
                to[key.removeprefix("-webkit-")] = value.partition("!")[0].strip()
        style = {key: parent[key] for key in _INHERITED & set(parent)}
        for key, value in (own | important).items():
            if value == "inherit" or (value == "unset" and key in _INHERITED):
                value = parent.get(key, "initial")
            style[key] = value
        return {k: v for k, v in style.items() if v not in ("initial", "unset", "revert")}

    def length(self, value: str, whole: float) -> float:
        """Return a length in pixels; percents are of the whole."""
        found = re.fullmatch(rf"({_NUMBER})\s*(%|[a-z]*)", value.strip().lower(), re.IGNORECASE)
        if found is None or found[2] not in ("%", *_PIXELS):
            self.refuse(f"a length of {value!r}", "state lengths in mm or without a unit")
        if found[2] == "%" and not whole:
            self.refuse(f"a length of {value!r}", "state the width and height of <svg>")
        return float(found[1]) * (whole / 100 if found[2] == "%" else _PIXELS[found[2]])

    def _matrix(self, style: Style) -> Array:
        """Return the transform of an element, (3, 3)."""
        if (said := style.get("transform", "none").strip()) in ("none", ""):
            return np.eye(3)
        if not _TRANSFORMS.fullmatch(said):  # in mm, of what a viewBox scales?
            self.refuse(f"transform={said!r}", "write it as matrix(a b c d e f), without units")
        return _affine(said)

    def walk(
        self, element: Any, parent: Style, matrix: Array, clip: Any, size: Any, used: Any = None
    ) -> Iterator[_Drawn]:
        """Yield the shapes shown in a viewport of some size; `used` are attributes of a <use>."""
        tag = element.tag
        if tag.startswith("{") or (tag in _UNSEEN and used is None):
            return
        style = self.style(element, parent)
        is_visible = style.get("visibility", "visible") == "visible"
        unseen = style.get("display") == "none" or style.get("requiredExtensions")
        if unseen or _is_clear(style, ""):
            return
        for key in _REFUSED & set(style):
            if style[key] not in _HARMLESS:
                self.refuse(f"{key}: {style[key]}")
        matrix = matrix @ self._matrix(style)
        clip = _cut(clip, self._clip(style.get("clip-path", "none"), matrix, size))
        if tag in ("svg", "symbol"):
            matrix, clip, size = self._viewport(element, style | (used or {}), matrix, clip, size)
        if tag in _GROUPS:
            for child in element:
                yield from self.walk(child, style, matrix, clip, size)
                if tag == "switch" and not child.get("requiredExtensions") and child.tag[0] != "{":
                    break
        elif tag == "use":
            link = element.get("href", element.get(_HREF, ""))
            if link[:1] not in ("#", ""):
                self.refuse(f"<use> of {link!r}", "copy it into the file")
            target = self.by_id.get(link[1:])
            if target is not None and target.tag not in _UNSEEN - {"symbol"}:
                shift = np.eye(3)
                shift[:2, 2] = [self.length(style.get("xy"[k], "0"), size[k]) for k in range(2)]
                sizes = {key: style[key] for key in ("width", "height") if key in style}
                yield from self.walk(target, style, matrix @ shift, clip, size, sizes)
        elif tag in ("text", "flowRoot"):
            if "".join(element.itertext()).strip() and is_visible:
                self.refuse("text", "its font is not in the file, convert it to paths")
        elif is_visible:
            diagonal = float(np.hypot(*size) / np.sqrt(2))
            wholes = {"x": size[0], "w": size[0], "y": size[1], "h": size[1]}
            values: dict[str, Any] = dict(style)
            for key in _SIZES & style.keys():
                whole = wholes.get(key.lstrip("cr")[:1], diagonal)
                values[key] = None if style[key] == "auto" else self.length(style[key], whole)
            yield _Drawn(style, self._lines(tag, values), matrix, clip, diagonal)

    def _clip(self, said: str, matrix: Array, size: Any) -> shapely.Geometry | None:
        """Return what a clip path leaves, None for everything."""
        if said == "none":
            return None
        target = self._linked(said)
        if target is None or target.get("clipPathUnits", "userSpaceOnUse") != "userSpaceOnUse":
            self.refuse(f"clip-path {said}", "cut the shapes themselves")
        shapes = [
            one.seen(one.filled("clip-rule"))
            for one in self.walk(target, {}, matrix, None, size, {})
        ]
        return shapely.union_all(shapes)

    def _linked(self, said: str) -> Any:
        """Return the element of a url(#id)."""
        found = re.match(r"url\(\s*[\"']?#([^\"')]+)[\"']?\s*\)", said)
        return self.by_id.get(found[1]) if found else None

    def _viewport(self, element: Any, style: Style, matrix: Array, clip: Any, size: Any) -> Any:
        """Return the transform, what is not cut away and the size within an <svg> or <symbol>."""
        view = [float(number) for number in re.findall(_NUMBER, style.get("viewBox", ""))]
        if len(view) not in (0, 4) or (view and min(view[2:]) <= 0):
            self.refuse(f"viewBox={style['viewBox']!r}", "it takes x, y, a width and a height")
        (x, y), said = (0.0, 0.0), [style.get(key, "auto") for key in ("width", "height")]
        if element is not self.root:
            x, y = (self.length(style.get("xy"[k], "0"), size[k]) for k in range(2))
        elif view:  # a share of a window is no size
            said = ["auto" if one.endswith("%") else one for one in said]
            known = [
                self.length(s, 0) / v for s, v in zip(said, view[2:], strict=True) if s != "auto"
            ]
            size = [known[0] * v if known else v for v in view[2:]]
        elif "auto" in said or "%" in "".join(said):
            return matrix, clip, (0.0, 0.0)
        wide, high = (
            self.length("100%" if one == "auto" else one, size[k]) for k, one in enumerate(said)
        )
        if style.get("overflow") not in ("visible", "auto"):
            clip = _cut(clip, _placed(shapely.box(x, y, x + wide, y + high), matrix))
        if view:
            ratio = style.get("preserveAspectRatio", "xMidYMid")
            text = svgelements.Viewbox.viewbox_transform(x, y, wide, high, *view, ratio)
            return matrix @ _affine(text), clip, view[2:]
        return matrix @ _affine(f"translate({x} {y})"), clip, (wide, high)

    def _lines(self, tag: str, values: dict[str, Any]) -> list[tuple[Array, bool]]:
        """Return the subpaths of a shape as points (n, 2), and whether each is closed."""
        kinds = ("Path", "Rect", "Circle", "Ellipse", "SimpleLine", "Polyline", "Polygon")
        names = {name.lower().removeprefix("simple"): name for name in kinds}
        if tag not in names:
            self.refuse(f"<{tag}>")
        if re.search(r"[^MZLHVCSQTAE\d+\-.,\s]", values.get("d", ""), re.IGNORECASE):
            self.refuse(f"path data {values['d'][:20]!r}")
        kept = {k: v for k, v in values.items() if k in (*_SIZES, "d", "points") and v is not None}
        # What is not said is not the 1 of svgelements.
        radii = {"rx": kept.get("ry", 0.0), "ry": kept.get("rx", 0.0)}
        unsaid = {"rect": {"width": 0.0, "height": 0.0}, "circle": {"r": 0.0}, "ellipse": radii}
        needed = unsaid.get(tag, {})
        kept = needed | kept
        if any(kept[key] <= 0 for key in needed):
            return []
        # S after Q, or T after C, reflects nothing, which svgelements does not know.
        other = r"([QT][^A-DF-Z]*(?=S)|[CS][^A-DF-Z]*(?=T))"
        if "d" in kept:
            kept["d"] = re.sub(other, r"\1 l0 0 ", kept["d"], flags=re.IGNORECASE)
        path = svgelements.Path(getattr(svgelements, names[tag])(kept))
        box = path.bbox()
        return list(polylines(path, max(box[2] - box[0], box[3] - box[1]))) if box else []

    def painted(self, one: _Drawn) -> Iterator[tuple[bool, shapely.Geometry]]:
        """Yield the regions of a fill and a stroke, and whether they are raised, not white."""
        order = one.style.get("paint-order", "").partition("fill")[0]
        for part in ("stroke", "fill") if "stroke" in order else ("fill", "stroke"):
            is_raised = self._is_raised(one.style, part)
            if is_raised is not None:
                yield is_raised, self._stroke(one) if part == "stroke" else one.filled("fill-rule")

    def _is_raised(self, style: Style, part: str) -> bool | None:
        """Return whether a fill or stroke is raised, not if it is white; None if not painted."""
        said = style.get(part, "none" if part == "stroke" else "black").lower().strip()
        if _is_clear(style, f"{part}-"):
            return None
        if said.startswith("url("):
            target = self._linked(style[part].strip())
            if target is not None and target.tag.endswith("Gradient"):
                return self._gradient(target)
            if target is not None:
                self.refuse(f"a {target.tag} as {part}", "give it one color")
            said = said.partition(")")[2].strip() or "none"
        if said == "currentcolor":
            said = style.get("color", "black").lower()
        if said in ("none", "transparent"):
            return None
        said = said.partition(" icc-color")[0]
        color = svgelements.Color(said)
        # svgelements takes what it does not know for black.
        if color.value == 255 and not _BLACK.match(said):
            self.refuse(f"the color {said!r}", "write it as #rrggbb")
        return min(color.red, color.green, color.blue) < 255 if color.opacity else None

    def _gradient(self, target: Any) -> bool | None:
        """Return whether a gradient is raised, which it is where it is neither white nor clear."""
        for _ in range(9):  # one may have the stops of another
            if target.find("stop") is None:
                link = target.get("href", target.get(_HREF, ""))
                target = self.by_id.get(link[1:], target)
        stops = [self.style(stop, {}) for stop in target.iter("stop")]
        names = {"stop-color": "fill", "stop-opacity": "fill-opacity", "color": "color"}
        fills = [{to: stop[key] for key, to in names.items() if key in stop} for stop in stops]
        kinds = {self._is_raised(fill, "fill") for fill in fills}
        return True if True in kinds else False if False in kinds else None

    def _stroke(self, one: _Drawn) -> shapely.Geometry:
        """Return what the stroke of lines covers."""
        width = self.length(one.style.get("stroke-width", "1"), one.diagonal)
        for key in ("vector-effect", "stroke-dasharray"):
            if one.style.get(key, "none") not in ("none", "0"):
                self.refuse(f"{key}: {one.style[key]}", "convert strokes to paths")
        join = one.style.get("stroke-linejoin", "miter")
        if join not in ("miter", "round", "bevel"):
            self.refuse(f"stroke-linejoin: {join}", "convert strokes to paths")
        cap = one.style.get("stroke-linecap", "butt").replace("butt", "flat")
        limit = float(one.style.get("stroke-miterlimit", "4"))
        parts = [thick(p, ring, width, cap, join, limit) for p, ring in one.lines if width > 0]
        return shapely.union_all([shapely.Polygon(), *parts])


def _declared(text: str) -> Style:
    """Return the declarations of a style."""
    pairs = (one.partition(":") for one in re.sub(r"(?s)/\*.*?\*/", "", text).split(";"))
    return {key.strip().lower(): value.strip() for key, _, value in pairs if value.strip()}


def _is_clear(style: Style, part: str) -> bool:
    """Return whether an opacity is 0."""
    return (
        re.fullmatch(r"\s*(-.*|\+?[0.]+(e.*)?%?)\s*", style.get(f"{part}opacity", "1")) is not None
    )


def _affine(text: str) -> Array:
    """Return a transform as a matrix (3, 3)."""
    m = svgelements.Matrix(text)
    return np.array([[m.a, m.c, m.e], [m.b, m.d, m.f], [0, 0, 1]], dtype=float)


def _placed(shape: shapely.Geometry, matrix: Array) -> shapely.Geometry:
    return affinity.affine_transform(shape, [*matrix[:2, :2].flat, *matrix[:2, 2]])


def _cut(clip: shapely.Geometry | None, other: shapely.Geometry | None) -> shapely.Geometry | None:
    if clip is None or other is None:
        return other if clip is None else clip
    return clip.intersection(other)
