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


BOX = '<rect x="2" y="3" width="4" height="4"{}/>'
PAGE = '<rect width="10" height="10"{}/>'
NESTED = '<path d="M1 1h6v6h-6z M2 2h2v2h-2z M4 4v2h2v-2z"{}/>'  # the second square runs back
SMALL = '<rect id="s" width="2" height="2"/>'


@pytest.mark.parametrize(
    ("drawn", "right_mm2"),
    [
        ('<path d="M1 1h4v4h-4z M3 3h4v4h-4z"/>', 28),  # overlapping, of one sense
        ('<path d="M1 1h4v4h-4z M3 3h4v4h-4z" fill-rule="evenodd"/>', 24),
        ('<style>path{fill-rule:evenodd}</style><path d="M1 1h4v4h-4z M3 3h4v4h-4z"/>', 24),
        ('<g style="fill-rule: evenodd"><path d="M1 1h4v4h-4z M3 3h4v4h-4z"/></g>', 24),
        (NESTED.format(""), 32),
        (NESTED.format(' fill-rule="evenodd"'), 28),
        ('<path d="M2,2 L6,2 L4,6"/>', 8),  # open paths are filled as closed
        ('<polyline points="2,2 6,2 6,6 2,6"/>', 16),
        (BOX.format("") + PAGE.format(' opacity="0"'), 16),
        (BOX.format("") + PAGE.format(' style="opacity:0%"'), 16),
        (f'{BOX.format("")}<g opacity="0">{PAGE.format(" opacity='1'")}</g>', 16),
        (f"<style>.t, #u {{opacity: 0.0}}</style>{BOX.format('')}{PAGE.format(" class='t'")}", 16),
        (BOX.format(' opacity="0.4"'), 16),
        (f'{BOX.format("")}<g display="none">{PAGE.format("")}<text>F</text></g>', 16),
        (f'{BOX.format("")}<g visibility="hidden">{PAGE.format("")}</g>', 16),
        (f'<g visibility="hidden">{BOX.format(" visibility='visible'")}{PAGE.format("")}</g>', 16),
        (BOX.format("") + PAGE.format(' fill="transparent" stroke="none"'), 16),
        (f"{BOX.format('')}<symbol>{PAGE.format('')}</symbol>", 16),
        (f'<symbol id="s">{BOX.format("")}</symbol><use href="#s" x="1"/>', 16),
        (f'<defs>{SMALL}</defs>{BOX.format("")}<use href="#s" x="7" y="7"/>', 20),
        (f'{BOX.format("")}<clipPath id="c">{PAGE.format("")}</clipPath>', 16),
        (f"{BOX.format('')}<mask>{PAGE.format('')}</mask><marker>{PAGE.format('')}</marker>", 16),
        ('<path stroke="#000" stroke-width="1" d="M1 1.5h3M5 1.5h2M1 2.5h6"/>', 11),
        ('<path stroke="#000" stroke-linecap="square" d="M2 2h5"/>', 6),
        ('<g stroke-linecap="round"><path stroke="#000" d="M2 2h5"/></g>', 5 + np.pi / 4),
        ('<path fill="none" stroke="#000" d="M2 2h4v4h-4z"/>', 16),  # mitred corners
        ('<path fill="none" stroke="#000" stroke-linejoin="bevel" d="M2 2h4v4h-4z"/>', 15.5),
        ('<path fill="none" stroke="#000" d="M2 2h4v4h-4v-4"/>', 15.75),  # ends where it began
        ('<g transform="scale(2)"><path stroke="#000" stroke-width=".5" d="M1 1h2"/></g>', 4),
        ('<rect width="2" height="2" transform="translate(1px, 2px) rotate(45)"/>', 4),
        ('<a href="x"><title>t</title><rect width="2" height="2"/></a>', 4),
    ],
)
def test_what_is_seen_of_an_svg_is_raised(drawn, right_mm2, tmp_path):
    drawing = svg(tmp_path, drawn)
    assert sum(shape.area for shape in drawing._placed()) == pytest.approx(right_mm2, rel=2e-3)


@pytest.mark.parametrize(
    ("drawn", "named"),
    [
        (BOX.format(' clip-path="url(#c)"'), "clip-path: url"),
        (f'<g style="mask:url(#m)">{BOX.format("")}</g>', "mask: url"),
        (f"<style>.f{{filter:url(#f)}}</style>{BOX.format(" class='f'")}", "filter: url"),
        (f"<style>g rect{{opacity:0}}</style><g>{BOX.format('')}</g>", 'the selector "g rect"'),
        (f"<style>@media print{{rect{{opacity:0}}}}</style>{BOX.format('')}", "@media"),
        (BOX.format(' fill="url(#p)"') + '<pattern id="p"/>', "fill by pattern"),
        ('<path d="M1 1h5" stroke="#000" stroke-dasharray="2 1"/>', "stroke-dasharray: 2 1"),
        ('<path d="M1 1h5" stroke="#000" marker-end="url(#m)"/>', "marker-end: url"),
        ('<path d="M1 1h5" stroke="#000" transform="scale(2, 1)"/>', "stroke whose width differs"),
        ('<image width="4" height="4" href="a.png"/>', "<image>"),
        (f"<switch>{BOX.format('')}</switch>", "<switch>"),
        (f'<svg x="2" y="2">{BOX.format("")}</svg>', "<svg> within it"),
        (
            f'<symbol id="a" viewBox="0 0 4 4">{SMALL}</symbol><use href="#a" width="1"/>',
            "symbol with a viewBox",
        ),
        ('<use href="b.svg#x"/>', "<use> of something that is not in it"),
        (BOX.format(' style="opacity:var(--o)"'), r"var\(\) in opacity"),
    ],
)
def test_what_an_svg_says_and_is_not_read_is_named(drawn, named, tmp_path):
    with pytest.raises(StudyError, match=f"stimulus.file = .*d.svg has .*{named}.* not read"):
        svg(tmp_path, drawn).body()


def svg(folder, drawn: str) -> Drawing:
    pytest.importorskip("svgelements")
    size = 'width="10mm" height="10mm" viewBox="0 0 10 10"'
    (folder / "d.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{drawn}</svg>')
    return Drawing(file=folder / "d.svg")


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
