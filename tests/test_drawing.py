"""What is drawn goes in: polygons, SVG files and pictures raised from a plate."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from PIL import Image
from pydantic import ValidationError
from shapely import box

from tactile_fem.errors import StudyError
from tactile_fem.study import Drawing, Study
from tactile_fem.study.file import dump_study, load_study

PLUS = box(-2, -0.6, 2, 0.6) | box(-0.6, -2, 0.6, 2)
SVG = """<svg xmlns="http://www.w3.org/2000/svg" width="10mm" height="8mm" viewBox="0 0 100 80">
<rect width="100" height="80" fill="white"/>
<rect width="9" height="9" display="none"/>
<g transform="translate(10 0)"><circle cx="20" cy="40" r="20"/></g>
<path fill="#333" d="M60 20 h30 v40 h-30 z M70 30 v20 h10 v-20 z"/>
<line x1="0" y1="75" x2="100" y2="75" stroke="black" stroke-width="10"/></svg>"""
# An F, as its file shows it: the upright at the left, the longer arm on top.
F = np.zeros((70, 50), dtype=bool)
F[5:65, 5:17] = F[5:17, 5:45] = F[30:42, 5:35] = True


def gap(drawing: Drawing, *points) -> np.ndarray:
    return drawing.body().distance(np.array(points, dtype=float)).gap


def areas(drawing: Drawing) -> list[float]:
    return [shape.area for shape in drawing.outlines()]


def test_a_plus_is_raised_with_rounded_corners():
    plus = Drawing(polygons=PLUS, relief_mm=0.5)
    (outline,) = plus.outlines()
    # Eight corners outwards and four inwards, each by r^2 (1 - pi/4).
    assert outline.area == pytest.approx(PLUS.area - (8 - 4) * 0.3**2 * (1 - np.pi / 4), abs=2e-3)
    found = gap(plus, (0, 0, 0.1), (0, 1.5, 0.1), (1.5, 1.5, -0.4), (4, 4, -0.3))
    np.testing.assert_allclose(found, [0.1, 0.1, 0.1, 0.2], atol=1e-6)


@pytest.mark.parametrize(
    "polygons",
    [
        [[[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]]],
        [[[[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]]]],
        [np.array([[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]])],
        box(-2, -1, 2, 1),
        [box(-2, -1, 2, 1)],
        shapely.MultiPolygon([box(-2, -1, 2, 1)]),
    ],
    ids=["points", "rings", "array", "polygon", "polygons", "multipolygon"],
)
def test_polygons_may_be_given_as_one_has_them(polygons):
    drawing = Drawing(polygons=polygons)
    assert drawing.outlines()[0].bounds == pytest.approx((-2, -1, 2, 1))
    assert hash(drawing) and drawing == Drawing.model_validate(drawing.model_dump())


def test_a_drawing_is_written_into_a_study(tmp_path):
    ring = PLUS.difference(box(-0.2, -0.2, 0.2, 0.2))
    study = Study(stimulus=Drawing(polygons=[ring, box(3, 3, 5, 5)], relief_mm=(0.5, 0.4)))
    (tmp_path / "s.toml").write_text(dump_study(study))
    assert load_study(tmp_path / "s.toml") == study


def test_size_turn_and_place():
    bar = Drawing(polygons=box(1, 10, 2, 14), width_mm=8.0)
    assert bar.outlines()[0].bounds == pytest.approx((-1, -4, 1, 4))
    turned = Drawing(polygons=box(1, 10, 2, 14), turn_deg=90.0, start_mm=-3.0, shift_mm=(1.0, 0.0))
    assert turned.outlines()[0].bounds == pytest.approx((-1, 2.5, 3, 3.5), abs=1e-9)
    ell = Drawing(polygons=[[[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3]]], turn_deg=90.0)
    np.testing.assert_allclose(gap(ell, (-1, -1.5, 0), (1, 1.5, 0), (-1, 1.5, 0)), [0, 0, 0.6])


def test_several_heights_on_one_plate():
    steps = Drawing(polygons=[box(-3, -3, 3, 3), box(-1, -1, 1, 1)], relief_mm=(0.4, 0.9))
    found = gap(steps, (0, 0, 0.1), (2, 2, -0.4), (5, 5, -0.8))
    np.testing.assert_allclose(found, [0.1, 0.1, 0.1], atol=1e-6)


def test_an_svg_is_placed_as_letters_and_in_its_units(tmp_path):
    (tmp_path / "d.svg").write_text(SVG)
    pytest.importorskip("svgelements")
    drawing = Drawing(file=tmp_path / "d.svg", corner_radius_mm=0.05)
    assert areas(drawing) == pytest.approx([np.pi * 2**2, 12 - 2, 10], rel=2e-3)
    disc, ring, line = drawing.outlines()
    # On top of the picture is -X, its left is -Y. All of it reaches from 2 to 8 mm down.
    assert (disc.centroid.x, disc.centroid.y) == pytest.approx((-1, -2), abs=1e-3)
    assert ring.centroid.y == pytest.approx(2.5, abs=1e-3) and line.centroid.x > ring.centroid.x
    assert Drawing(file=tmp_path / "d.svg", width_mm=5.0).outlines()[0].area == pytest.approx(
        np.pi * (2 * 5 / 10) ** 2, rel=2e-3
    )


def test_what_an_svg_shows_is_raised_or_said(tmp_path):
    pytest.importorskip("svgelements")
    start = '<svg xmlns="http://www.w3.org/2000/svg" width="9mm" height="9mm" viewBox="0 0 9 9">'
    gradient = '<linearGradient id="g"><stop stop-color="red"/></linearGradient>'
    square = '<rect width="6" height="6" fill="url(#g)"/>'
    (tmp_path / "d.svg").write_text(f"{start}{gradient}{square}</svg>")
    assert areas(Drawing(file=tmp_path / "d.svg")) == pytest.approx([36], abs=0.1)
    (tmp_path / "d.svg").write_text(
        f'{start}{gradient}{square}<circle cx="3" cy="3" r="1" fill="#fff"/></svg>'
    )
    assert areas(Drawing(file=tmp_path / "d.svg")) == pytest.approx([36 - np.pi], abs=0.1)
    (tmp_path / "d.svg").write_text(f'{start}{gradient}{square}<text x="1" y="5">F</text></svg>')
    with pytest.raises(StudyError, match=r"has text, .* convert it to paths"):
        Drawing(file=tmp_path / "d.svg").body()


SQUARE = '<rect x="2" y="3" width="4" height="4"{}/>'
TWO = '<path d="M1,1 h4 v4 h-4 z M3,3 h4 v4 h-4 z"{}/>'
NESTED = '<path d="M1,1 h6 v6 h-6 z M3,3 {} z"{}/>'
SYMBOL = '<symbol id="s" viewBox="0 0 2 2"><rect width="2" height="1"/></symbol>'
CLIP = '<clipPath id="c"><rect width="4" height="10"{}/></clipPath>'
LINE = '<path stroke="#000" fill="none" d="M2 5 h4"{}/>'
VEE = '<path stroke="#000" fill="none" d="M2 2 h4 v4"{}/>'


@pytest.mark.parametrize(
    ("drawn", "area"),
    [
        # Which parts of a path are filled.
        (TWO.format(""), 28),
        (TWO.format(' fill-rule="evenodd"'), 24),
        (TWO.format(' style="fill-rule:evenodd"'), 24),
        (f'<g fill-rule="evenodd">{TWO.format("")}</g>', 24),
        (f'<style>.e, #x {{fill-rule: evenodd}}</style>{TWO.format(" class=\'a e\'")}', 24),
        (NESTED.format("h2 v2 h-2", ""), 36),
        (NESTED.format("v2 h2 v-2", ""), 32),
        (NESTED.format("h2 v2 h-2", ' fill-rule="evenodd"'), 32),
        ('<path d="M1 1 h4 v4 h-4 v-4 h4 v4 h-4 z"/>', 16),
        ('<path d="M2,2 L6,2 L4,6"/>', 8),
        ('<path d="M2,2 L6,2 L6,6 L2,6"/>', 16),
        ('<polyline points="2,2 6,2 4,6"/>', 8),
        ('<polygon points="2 2 6 2 6 6 2 6"/>', 16),
        ('<circle cx="5" cy="5" r="2"/>', np.pi * 4),
        ('<ellipse cx="5" cy="5" rx="2" ry="1"/>', np.pi * 2),
        ('<rect x="1" y="1" width="4" height="4" rx="1"/>', 12 + np.pi),
        ('<path d="M1 1 h3 v3 h-3 z h-1 v-1 h1 z"/>', 10),
        # What is not seen.
        *[
            (SQUARE.format("") + f'<rect width="10" height="10" {unseen}/>', 16)
            for unseen in (
                'opacity="0"',
                'style="opacity: 0%"',
                'fill-opacity="0.0"',
                'fill="none"',
                'fill="transparent"',
                'fill="#0000"',
                'fill="rgba(0,0,0,0)"',
                'display="none"',
                'style="display:none"',
                'visibility="hidden"',
                'visibility="collapse"',
                'fill="none" stroke="black" stroke-opacity="0"',
                'fill="none" stroke="black" stroke-width="0"',
            )
        ],
        (f'<g opacity="0">{SQUARE.format("")}</g><rect width="1" height="1"/>', 1),
        (f'<g visibility="hidden"><g>{SQUARE.format(" visibility=\'visible\'")}</g></g>', 16),
        *[
            (SQUARE.format(f' fill="{black}"'), 16)
            for black in ("rgb(0,0,0)", "rgba(0, 0, 0, 1)", "#000", "BLACK", "hsl(0,0%,0%)")
        ],
        (SQUARE.format(' fill="url(#no)"') + '<rect width="1" height="1" fill="url(#x) red"/>', 1),
        *[
            (f'<linearGradient id="a" xlink:href="#b"/><linearGradient id="b"><stop {of}/>'
             '</linearGradient><rect width="1" height="1"/>' + SQUARE.format(' fill="url(#a)"'), a)
            for of, a in (('stop-color="red"', 17), ('style="stop-opacity:0"', 1))
        ],
        (f'<g fill="none">{SQUARE.format(" fill=\'red\'")}</g>', 16),
        (f'<style>rect {{opacity: 0}} #a {{opacity: 1}}</style>{SQUARE.format(" id=\'a\'")}', 16),
        (f'<style>.o {{fill: none !important}}</style>{TWO.format("")}'
         + SQUARE.format(' class="o" style="fill:red"'), 28),
        *[
            (f"{SQUARE.format('')}<{tag}><rect width='9' height='9'/></{tag}>", 16)
            for tag in ("defs", "symbol", "clipPath", "mask", "pattern", "marker")
        ],
        (SQUARE.format(' opacity="0.5" fill="#eee"'), 16),
        ('<rect x="8" y="8" width="4" height="4"/>', 4),  # the page ends at 10
        (SQUARE.format("") + '<rect/><rect width="1"/><circle/><ellipse/><path/><line/>', 16),
        (SQUARE.format("") + '<rect width="-1" height="1"/><circle r="0"/><path d="M1 1"/>', 16),
        ('<ellipse cx="5" cy="5" rx="2"/>', np.pi * 4),
        # What is used and cut.
        (SYMBOL + '<use href="#s" width="4" height="4"/>', 8),
        (SYMBOL + '<use href="#s" x="1" y="2" width="4" height="2"/>', 2),
        ('<defs><rect id="r" width="2" height="2"/></defs>'
         '<use xlink:href="#r" x="1"/><use href="#r" x="5" transform="scale(1 2)"/>', 12),
        ('<svg x="1" y="1" width="4" height="4" viewBox="0 0 2 2">'
         '<rect width="9" height="1"/></svg>', 8),
        ('<svg width="4" height="4" viewBox="0 0 2 1" preserveAspectRatio="none">'
         '<rect width="1" height="1"/></svg>', 8),
        (CLIP.format("") + SQUARE.format(' clip-path="url(#c)"'), 8),
        (CLIP.format("") + f'<g clip-path="url(#c)">{SQUARE.format("")}</g>', 8),
        (CLIP.format(' transform="scale(.75 1)"') + SQUARE.format(' style="clip-path:url(#c)"'), 4),
        # Lines.
        ('<path stroke="#000" stroke-width="1" d="M1 1.5h3M5 1.5h2M1 2.5h6"/>', 11),
        (LINE.format(""), 4),
        (LINE.format(' stroke-linecap="square"'), 5),
        (LINE.format(' stroke-linecap="round"'), 4 + np.pi / 4),
        (f'<g stroke-linecap="round">{LINE.format("")}</g>', 4 + np.pi / 4),
        (VEE.format(""), 8),
        (VEE.format(' stroke-linejoin="bevel"'), 8 - 1 / 8),
        (VEE.format(' stroke-miterlimit="1.4"'), 8 - 1 / 8),
        (VEE.format(' style="stroke-linejoin:round"'), 8 - 1 / 4 + np.pi / 16),
        ('<rect x="2" y="2" width="4" height="4" fill="none" stroke="red"/>', 16),
        ('<path d="M2 2 h4 v4 h-4 v-4" fill="none" stroke="red"/>', 15.75),
        ('<path d="M2 2 h1 v1 h-1 z" stroke="red" stroke-width="10%" fill="white"/>', 4),
        ('<path d="M5 5 z" stroke="red" stroke-linecap="round"/>' + SQUARE.format(' fill="none"'),
         np.pi / 4),
        ('<path d="M1 1 h0 M5 5 M2 2 h1" stroke="red"/>', 1),
        (LINE.format(' stroke-dasharray="none"'), 4),
        ('<polygon points="1 1 5 1" stroke="red" stroke-linejoin="round"/>', 4 + np.pi / 4),
        # S after Q reflects nothing: this is C 6 2 6 6 2 6.
        ('<path d="M2 2 Q 4 2 6 2 S 6 6 2 6 z"/>', 12.8),
        # Transforms, also of strokes.
        (SQUARE.format(' transform="translate(2px, 0) scale(.5)"'), 4),
        (SQUARE.format(' style="transform: translateX(1px) rotate(0.25turn) translate(0 -7px)"'),
         16),
        ('<line x1="2" x2="2" y1="1" y2="5" stroke="red" transform="scale(3 1)"/>', 12),
        (SQUARE.format(' vector-effect="non-scaling-stroke" mask="none" filter="none"'), 16),
        # What editors write.
        ('<switch><foreignObject requiredExtensions="ai" width="1"/><g>' + SQUARE.format("")
         + "</g></switch>", 16),
        ('<metadata><x xmlns="a:b"/></metadata><title>T</title><text> </text>'
         '<g style="mix-blend-mode:normal;-inkscape-stroke:none;font-size:3px" id="g" class="l">'
         + SQUARE.format(' style="marker:none;fill:#000000;paint-order:stroke fill"') + "</g>", 16),
        ("<style>@font-face {font-family: a} svg text, rect:hover {font-size: 1px}</style>"
         + SQUARE.format(' fill="currentColor" color="blue"'), 16),
    ],
)  # fmt: skip
def test_an_svg_is_raised_where_it_is_seen(drawn, area, tmp_path):
    pytest.importorskip("svgelements")
    shapes = Drawing(file=svg(tmp_path, drawn))._placed()
    assert sum(shape.area for shape in shapes) == pytest.approx(area, rel=2e-4)


@pytest.mark.parametrize(
    ("drawn", "feature"),
    [
        *[(SQUARE.format(f' {key}="url(#c)"'), key) for key in ("mask", "filter", "clip-path")],
        (SQUARE.format(' style="mix-blend-mode: difference"'), "mix-blend-mode"),
        ('<clipPath id="c" clipPathUnits="objectBoundingBox"/>'
         + SQUARE.format(' clip-path="url(#c)"'), "clip-path"),
        ('<pattern id="p"/>' + SQUARE.format(' fill="url(#p)"'), "pattern"),
        (SQUARE.format(' fill="no-color"'), "the color 'no-color'"),
        (SQUARE.format(' fill="var(--ink)"'), "the color"),
        (SQUARE.format(' fill="rgb(0 0 0 / 0%)"'), "the color"),
        (LINE.format(' stroke-dasharray="2 1"'), "stroke-dasharray"),
        (LINE.format(' style="vector-effect:non-scaling-stroke"'), "non-scaling-stroke"),
        (LINE.format(' stroke-linejoin="arcs"'), "stroke-linejoin"),
        (LINE.format(' marker-end="url(#m)"'), "marker-end"),
        ("<text>F</text>", "text"),
        ('<image width="2" height="2" href="a.png"/>', "<image>"),
        ('<foreignObject width="2" height="2"/>', "<foreignObject>"),
        (f'<switch><g systemLanguage="de">{SQUARE.format("")}</g></switch>', "systemLanguage"),
        *[
            (f"<style>{selector} {{fill: none}}</style>{SQUARE.format('')}", "styles for")
            for selector in ("g rect", "svg *", "g > rect", "[width]", "rect:hover",)
        ],
        *[
            (f"<style>{rule}</style>{SQUARE.format('')}", rule.split()[0])
            for rule in ("@import 'a.css';", "@media print {rect {fill: red}}")
        ],
        (f'<style media="print">rect {{fill: red}}</style>{SQUARE.format("")}', "media 'print'"),
        (SQUARE.format(' transform="translate(2mm, 0)"'), "transform='translate(2mm, 0)'"),
        (SQUARE.format(' transform="translate(10%, 0)"'), "transform"),
        (SQUARE.format(' style="transform: rotateX(20deg)"'), "transform"),
        ('<rect width="2em" height="2"/>', "a length of '2em'"),
        ('<rect width="calc(1px + 2px)" height="2"/>', "a length of"),
        ('<use href="other.svg#a"/>', "<use> of"),
        ('<svg viewBox="0 0 10"/>', "viewBox='0 0 10'"),
        ('<path d="M 1 1 X 2 2"/>', "path data"),
    ],
)  # fmt: skip
def test_what_is_not_read_of_an_svg_is_named(drawn, feature, tmp_path):
    pytest.importorskip("svgelements")
    with pytest.raises(StudyError, match=r"d\.svg has .*, which is not read: ") as told:
        Drawing(file=svg(tmp_path, drawn)).body()
    assert feature in str(told.value) and "\n" not in str(told.value)


def svg(folder, drawn: str):
    """Write a drawing on a page of 10 by 10 mm."""
    start = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    (folder / "d.svg").write_text(
        f'{start} width="10mm" height="10mm" viewBox="0 0 10 10">{drawn}</svg>'
    )
    return folder / "d.svg"


def test_a_picture_reads_as_letters_do(tmp_path):
    Image.fromarray(np.where(F, 0, 255).astype(np.uint8)).save(tmp_path / "f.png")
    for drawing in (Drawing.of_pixels(F, 0.1), Drawing(file=tmp_path / "f.png", width_mm=4.0)):
        (outline,) = drawing.outlines()
        assert outline.bounds == pytest.approx((-3, -2, 3, 2), abs=0.02)
        assert outline.area == pytest.approx(0.01 * F.sum(), rel=0.02)
        upright, arm, nothing = gap(drawing, (2, -1.4, 0), (-2.4, 1.4, 0), (2, 1.4, 0))
        assert upright == arm == pytest.approx(0, abs=1e-3) and nothing > 0.5


def test_steps_of_pixels_are_no_edges():
    """The outline of a disc of pixels has the disc's curvature."""
    x = np.arange(80) - 39.5
    drawing = Drawing.of_pixels(x[:, None] ** 2 + x**2 < 30**2, 0.1)
    (outline,) = drawing.outlines()
    radii = np.linalg.norm(shapely.get_coordinates(outline), axis=1)
    assert np.ptp(radii) < 0.06 and radii.mean() == pytest.approx(3, abs=0.02)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({}, "polygons or file must be given, and not both"),
        ({"polygons": PLUS, "file": "f.svg"}, "polygons or file must be given, and not both"),
        ({"polygons": [[[0, 0], [1, 0]]]}, "at least 3 items"),
        ({"polygons": [[[0, 0], [1, 0], [float("nan"), 1]]]}, "finite"),
        ({"polygons": "plus"}, "valid tuple"),
        ({"polygons": PLUS, "relief_mm": -1.0}, "greater than 0"),
        ({"polygons": PLUS, "relief_mm": "high"}, "valid number"),
    ],
)
def test_what_is_no_drawing_is_refused(keys, sentence):
    with pytest.raises(ValidationError, match=sentence):
        Drawing(**keys)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"polygons": [[[0, 0], [1, 0], [2, 0]]]}, "a shape has no area"),
        (
            {"polygons": PLUS, "corner_radius_mm": 0.8, "fillet_radius_mm": 0.7},
            r"of shape 1 \(around X 0.0, Y 0.0 mm\) .* exceed 0.59; .* corner_radius_mm \(0.59\)",
        ),
        ({"polygons": PLUS, "width_mm": 0.2}, "make the stimulus larger or simpler"),
        ({"polygons": PLUS, "relief_mm": (0.5, 0.3)}, "has 2 heights for 1 shapes"),
        ({"file": "none.svg"}, "there is no such file"),
        ({"file": "white.png", "width_mm": 3.0}, "shows nothing that could be raised"),
        ({"file": "white.png"}, "which has no size in mm: give width_mm"),
        ({"file": "text.png", "width_mm": 3.0}, "cannot be read"),
        ({"file": "text.svg"}, "cannot be read"),
    ],
)
def test_a_drawing_that_cannot_be_raised_is_told_in_a_sentence(keys, sentence, tmp_path):
    Image.new("L", (20, 20), 255).save(tmp_path / "white.png")
    for name in ("text.png", "text.svg"):
        (tmp_path / name).write_text("no drawing")
    keys = {key: tmp_path / value if key == "file" else value for key, value in keys.items()}
    with pytest.raises(StudyError, match=sentence) as told:
        Drawing(**keys).body()
    assert "\n" not in str(told.value)


MASK = np.zeros((100, 100), dtype=bool)
MASK[30:70, 20:80] = True


@pytest.mark.parametrize(
    ("pixels", "sentence"),
    [
        (np.zeros((9, 9)), "no pixel is raised"),
        (np.ones(9), "in rows"),
        (np.zeros((0, 0)), "in rows"),
        (MASK * np.uint8(255), "from 0 to 255 but must be booleans or from 0 to 1"),
        (np.where(MASK, 1.0, -1.0), "from -1 to 1 but must be"),
        (np.where(MASK, np.nan, 1.0), "needs finite values"),
        (np.ma.masked_array(MASK, ~MASK), "pixels are masked"),
        ([["black", "white"]], "must be numbers"),
    ],
)
def test_pixels_that_cannot_be_raised_are_refused(pixels, sentence):
    with pytest.raises(StudyError, match=sentence):
        Drawing.of_pixels(pixels, 0.05)


def test_equal_pixels_of_any_type_are_raised_alike():
    for pixels in (MASK, MASK.astype(int), MASK * 1.0, np.ma.masked_array(MASK)):
        assert areas(Drawing.of_pixels(pixels, 0.05)) == pytest.approx([6], rel=0.02)
    with pytest.raises(StudyError, match="pixel_mm is 0"):
        Drawing.of_pixels(MASK, 0)


def picture(ink: float, paper: float, kind: type) -> np.ndarray:
    return np.where(MASK, ink, paper).astype(kind)


def saved(path, values, **options):
    Image.fromarray(values).save(path, **options)
    return path


def test_pictures_of_any_depth_are_raised_where_they_are_dark(tmp_path):
    """Ink of 5000 on paper of 60000 of 65535 is black on white."""
    cmyk = Image.fromarray(picture(20, 230, np.uint8)).convert("CMYK")
    cmyk.save(tmp_path / "cmyk.tif")
    files = [
        saved(tmp_path / "8.png", picture(20, 230, np.uint8)),
        saved(tmp_path / "16.png", picture(5000, 60000, np.uint16)),
        saved(tmp_path / "16.tif", picture(5000, 60000, np.uint16)),
        saved(tmp_path / "float.tif", picture(0.1, 0.9, np.float32)),
        saved(tmp_path / "white.tif", picture(60000, 5000, np.uint16), tiffinfo={262: 0}),
        saved(tmp_path / "1.png", picture(0, 1, bool)),
        tmp_path / "cmyk.tif",
    ]
    for file in files:
        assert areas(Drawing(file=file, width_mm=3.0)) == pytest.approx([6], rel=0.02), file
    for kind, ink in ((np.int32, 100000), (np.float32, 255), (np.float32, np.nan)):
        file = saved(tmp_path / "odd.tif", picture(ink, 0, kind))
        with pytest.raises(StudyError, match="must have 8 or 16 bits, or floating-point"):
            Drawing(file=file, width_mm=3.0).body()


SQUARE = [(-2, -2), (2, -2), (2, 2), (-2, 2)]


@pytest.mark.parametrize(
    ("rings", "right"),
    [
        ([SQUARE, [(5, 5), (6, 5), (6, 6)]], 16.5),  # beside it
        ([SQUARE, [(-1, -1), (1, -1), (1, 1), (-1, 1)]], 12),  # within it
        ([SQUARE[:2] + SQUARE[1:]], 16),  # a point twice
        ([[(-2, -2), (2, 2), (2, -2), (-2, 2)]], r"shape 1 crosses or touches itself \(.*\[0 0\]"),
        ([[(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)]], "crosses or touches itself"),
        ([SQUARE, [(0, 0), (4, 0), (4, 1), (0, 1)]], "ring 2 of shape 1 crosses another one"),
    ],
)
def test_rings_are_raised_whole_or_refused(rings, right):
    drawing = Drawing(polygons=[rings], corner_radius_mm=0.1)
    if isinstance(right, str):
        with pytest.raises(StudyError, match=right):
            drawing.body()
    else:
        assert sum(areas(drawing)) == pytest.approx(right, rel=0.01)
        drawing.body()


def test_pieces_that_touch_in_a_point_are_raised(tmp_path):
    """As the modules of a QR code do over their corners."""
    pytest.importorskip("svgelements")
    file = svg(tmp_path, '<path d="M1 1h2v2h-2z M3 3h2v2h-2z M5 1h2v2h-2z"/>')
    drawing = Drawing(file=file, corner_radius_mm=0.1)
    assert sum(areas(drawing)) == pytest.approx(12, rel=0.02)
    drawing.body()
