import numpy as np
import pytest
import shapely

from tactile_fem.errors import StudyError
from tactile_fem.stimulus.body import Embossed, HalfSpace, smooth_minimum
from tactile_fem.stimulus.patterns import cells
from tactile_fem.stimulus.sampled import height_map
from tactile_fem.study import Braille, Cylinder, Dots, Edge, Grating, Plate, Sphere, Text

BODIES = {
    "text": Text(),
    "plate": Plate(),
    "bar across": Cylinder(),
    "bar along": Cylinder(along="y"),
    "ball": Sphere(),
    "edge across": Edge(),
    "edge along": Edge(along="y", angle_deg=100.0),
    "grating across": Grating(),
    "grating along": Grating(along="y"),
    "dots": Dots(),
    "grating from its start": Grating(count=3, start_mm=-0.3),
    "dots from their start": Dots(columns=2, rows=3, start_mm=1.2),
    "braille": Braille(text="ab", shift_mm=(0.0, 0.05)),
}
HEIGHTS = {
    name: stimulus.dot_height_mm if name == "braille" else stimulus.relief_mm
    for name, stimulus in BODIES.items()
    if isinstance(stimulus, Text | Grating | Dots | Braille)
}


def gap(stimulus, points):
    return stimulus.body().distance(np.atleast_2d(np.asarray(points, dtype=float))).gap


def skin_points(body, count=40_000):
    """Return points between the surface and 0.4 mm above it."""
    rng = np.random.default_rng(5)
    points = rng.uniform([-5, -8.5, -1], [5, 8.5, 0.5], (count, 3))
    near = body.distance(points).gap
    return points[(near > 0) & (near < 0.4)]


@pytest.mark.parametrize("name", BODIES)
def test_derivatives_are_those_of_the_gap(name):
    body = BODIES[name].body()
    points, eps = skin_points(body), 1e-5
    assert len(points) > 500
    at = body.distance(points)
    for axis in range(3):
        step = eps * np.eye(3)[axis]
        ahead, behind = body.distance(points + step), body.distance(points - step)
        slope = (ahead.gap - behind.gap) / (2 * eps)
        bend = (ahead.normal - behind.normal) / (2 * eps)
        # The gap is C1: the slope agrees everywhere, the bend except where a step spans a seam.
        assert np.abs(slope - at.normal[:, axis]).max() < 2e-4
        assert np.quantile(np.abs(bend - at.hessian[:, axis]).max(axis=1), 0.995) < 1e-5
    assert at.hessian == pytest.approx(at.hessian.transpose(0, 2, 1), abs=1e-12)
    assert np.abs(at.hessian).max() < 1.05 / 0.025


@pytest.mark.parametrize("name", BODIES)
def test_the_gap_is_a_distance(name):
    body = BODIES[name].body()
    points = skin_points(body)
    if name in HEIGHTS:
        # At the foot plate and wall are blended over 0.2 mm: the gradient is shorter there.
        points = points[points[:, 2] + HEIGHTS[name] > body.distance(points).gap + 0.2]
    # Beyond the radius of a letter's concave corners (0.3 mm) the nearest wall changes: a kink.
    points = points[body.distance(points).gap < 0.25]
    at = body.distance(points)
    assert np.abs(np.linalg.norm(at.normal, axis=1) - 1).max() < 0.02
    foot = points - at.gap[:, None] * at.normal
    assert np.abs(body.distance(foot).gap).max() < 5e-3


@pytest.mark.parametrize("relief", [0.6, 0.15])  # less than the foot's blend, too
def test_what_is_raised_is_united_with_its_plate_everywhere(relief):
    """Also where neither derivatives nor blend are evaluated, on top and far from the sides."""
    body = Embossed(Text(text="G").shape().outline, relief, fillet=0.1)
    points = np.random.default_rng(5).uniform([-5, -4, -1], [5, 4, 3.0], (40_000, 3))
    plate = HalfSpace(relief).distance(points)
    expected = smooth_minimum(body._extrusion(points), plate, body.blend)
    found = body.distance(points)
    np.testing.assert_allclose(found.gap, expected.gap, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.normal, expected.normal, rtol=0, atol=1e-14)
    np.testing.assert_allclose(found.hessian, expected.hessian, rtol=0, atol=1e-12)


def test_an_outline_need_not_tell_its_distance_alone():
    quick = Text().shape().outline

    class Slow:
        distance = staticmethod(quick.distance)

    points = np.random.default_rng(5).uniform([-5, -8.5, -1], [5, 8.5, 0.8], (10_000, 3))
    np.testing.assert_array_equal(quick.gap(points[:, :2]), quick.distance(points[:, :2]).gap)
    pair = [Embossed(outline, 0.6, 0.3).distance(points) for outline in (quick, Slow())]
    for name in ("gap", "normal", "hessian"):
        np.testing.assert_array_equal(*(getattr(distance, name) for distance in pair))


HIGH = {
    "text": Text(relief_mm=2.0),
    "one glyph": Text(text="x", relief_mm=5.0, corner_radius_mm=0.2, fillet_radius_mm=0.2),
    "grating": Grating(relief_mm=2.0),
    "dots": Dots(relief_mm=2.0),
    "braille": Braille(dot_diameter_mm=2.4, dot_height_mm=1.2),
}


@pytest.mark.parametrize("stimulus", [*BODIES.values(), *HIGH.values()], ids=[*BODIES, *HIGH])
@pytest.mark.parametrize("way_mm", [0.02, 1.0])
def test_a_distance_changes_by_no_more_than_the_way(stimulus, way_mm):
    body, rng = stimulus.body(), np.random.default_rng(5)
    points = rng.uniform([-9, -14, -3], [9, 14, 5], (20_000, 3))
    ways = rng.normal(size=points.shape)
    ways *= way_mm / np.linalg.norm(ways, axis=1)[:, None]
    here, there = body.distance(points), body.distance(points + ways)
    outside = (here.gap > 0) & (there.gap > 0)
    # The spline of a letter's outline swings a little where the nearest wall changes.
    excess = 0.01 if isinstance(stimulus, Text) else 1e-9
    assert np.abs(here.gap - there.gap)[outside].max() <= way_mm + excess
    for values in (here.gap, here.normal, here.hessian):
        assert np.isfinite(values).all()
    assert np.linalg.norm(here.normal, axis=1).min() > 1e-4


def test_far_from_high_letters_there_is_the_plate():
    stimulus = Text(text="G", start_mm=0.0, relief_mm=2.0)
    found = stimulus.body().distance(np.array([[7.0, 0.0, -1.9], [0.0, 8.0, -0.5]]))
    assert found.gap == pytest.approx([0.1, 1.5])
    assert found.normal == pytest.approx(np.array([[0.0, 0.0, 1.0]] * 2))


@pytest.mark.parametrize("stimulus", [Dots(columns=1, rows=1), Sphere(radius_mm=0.7)])
def test_on_its_axis_a_body_has_a_normal(stimulus):
    on_axis = np.array([[0.0, 0.0, z] for z in (-0.7, -0.35, 0.1)])
    assert np.linalg.norm(stimulus.body().distance(on_axis).normal, axis=1).min() > 0.5


@pytest.mark.parametrize("name", HEIGHTS)
def test_the_gradient_shortens_only_at_the_foot(name):
    body = BODIES[name].body()
    length = np.linalg.norm(body.distance(skin_points(body)).normal, axis=1)
    assert 0.65 < length.min() and length.max() < 1.02


@pytest.mark.parametrize("name", BODIES)
def test_the_highest_plane_is_zero(name):
    heights = height_map(BODIES[name].body(), np.linspace(-4, 4, 81), np.linspace(-6, 6, 121))
    assert heights.max() == pytest.approx(0, abs=1e-3)
    assert heights.max() <= 1e-9
    if name in HEIGHTS:
        assert heights.min() == pytest.approx(-HEIGHTS[name], abs=1e-9)


@pytest.mark.parametrize("name", HEIGHTS)
def test_far_from_a_relief_there_is_the_plate(name):
    stimulus = BODIES[name]
    far = [[30, 60, 0.7], [-30, 60, -0.1]] if name != "grating along" else [[60, 9, 0.7]]
    expected = np.array(far)[:, 2] + HEIGHTS[name]
    assert gap(stimulus, far)[-1] == pytest.approx(expected[-1])
    assert np.all(gap(stimulus, far) > 0)


def test_bars_ball_and_edge_have_their_distances():
    assert gap(Sphere(radius_mm=2.0), [3, 4, -2]) == pytest.approx(3)
    assert gap(Cylinder(radius_mm=1.0), [[9, 3, 3], [-9, 0, 0]]) == pytest.approx([4, 0])
    assert gap(Cylinder(radius_mm=1.0, along="y"), [3, 9, 3]) == pytest.approx(4)
    edge = Edge(radius_mm=0.025, angle_deg=60.0)
    # On the flank, `down` along it from the tangent point with the crest, 0.1 mm off.
    normal, along = np.array([0, np.cos(np.pi / 6), 0.5]), np.array([0, 0.5, -np.cos(np.pi / 6)])
    point = np.array([0, 0, -0.025]) + 0.125 * normal + 2.0 * along
    at = edge.body().distance(point[None])
    assert at.gap == pytest.approx(0.1)
    assert at.normal[0] == pytest.approx(normal)
    assert gap(edge, [5, 0, 0.3]) == pytest.approx(0.3)


@pytest.mark.parametrize("kind", ["text", "grating across", "dots"])
def test_the_top_edge_is_a_circle(kind):
    stimulus = BODIES[kind]
    r = stimulus.fillet_radius_mm or 0.3
    inward = np.linspace(0.02, 0.98, 25) * r
    # The way inwards over a straight (or, for the dot, the round) wall; H's left stem for text.
    if kind == "text":
        shape = stimulus.outlines()[2]
        x, y = np.array([2.0]), shape.bounds[1] + inward
    else:
        half = stimulus.ridge_mm / 2 if kind == "grating across" else stimulus.radius_mm
        x, y = np.array([0.0]), -half + inward
    heights = height_map(stimulus.body(), x, y)[0]
    expected = np.sqrt(r**2 - (r - inward) ** 2) - r
    assert heights == pytest.approx(expected, abs=2e-3)


def test_letters_have_size_order_pitch_and_shift():
    f, g, h = Text().outlines()
    width = g.bounds[3] - g.bounds[1]
    # Rounding the corners takes a little off a bowl's outermost point, if anything.
    assert width == pytest.approx(6.5, abs=0.01)
    centres = [(s.bounds[1] + s.bounds[3]) / 2 for s in (f, g, h)]
    assert centres == pytest.approx([-5, 5, 15], abs=0.01)
    assert (g.bounds[0] + g.bounds[2]) / 2 == pytest.approx(0, abs=0.01)
    # A common baseline: F and H stand on it.
    assert f.bounds[2] == pytest.approx(h.bounds[2], abs=1e-6)
    (moved,) = Text(text="G", start_mm=1.0, shift_mm=(0.5, -2.0)).outlines()
    assert (moved.bounds[1] + moved.bounds[3]) / 2 == pytest.approx(-3, abs=0.01)
    assert (moved.bounds[0] + moved.bounds[2]) / 2 == pytest.approx(0.5, abs=0.01)
    (single,) = Text(text="G").outlines()
    assert (single.bounds[1] + single.bounds[3]) / 2 == pytest.approx(5, abs=0.01)
    assert [len(Text(text=t).outlines()) for t in ("F H", " FGH ")] == [2, 3]


@pytest.mark.parametrize("glyph", ["F", "g", "-", "."])
def test_a_text_of_one_glyph_is_centred_on_it(glyph):
    small = {"corner_radius_mm": 0.1, "fillet_radius_mm": 0.1, "start_mm": 0.0}
    left, bottom, right, top = Text(text=glyph, **small).outlines()[0].bounds
    assert (left + right, bottom + top) == pytest.approx((0, 0), abs=1e-4)
    # With others it keeps to their line.
    _, other = Text(text=f"G{glyph}", **small).outlines()
    assert (glyph == "F") == (abs(other.bounds[0] + other.bounds[2]) < 0.2)


def test_letters_are_not_mirrored():
    """F seen from above, its top to -X: stem first along +Y, the longer arm at the top."""
    (f,) = Text(text="F").outlines()
    top, low, bottom, high = f.bounds
    stem = shapely.box(top, low, bottom, low + 0.5)
    assert f.intersection(stem).area > 0.9 * stem.area
    end = f.intersection(shapely.box(top, high - 0.2, bottom, high))
    assert end.bounds[2] < top + 1.2
    x, y = (top + bottom) / 2 + 3, low + 0.4
    assert gap(Text(text="F"), [[x, y, -0.3], [-x, y, -0.3]])[0] < 0


@pytest.mark.parametrize(
    "stimulus",
    [
        Text(text="OG", shift_mm=(0.3, 0.7)),
        Dots(columns=2, rows=3, start_mm=-1.3, shift_mm=(0.3, 0.7)),
        Grating(count=3, start_mm=4.5),
        Grating(count=4, start_mm=0.6, along="y", shift_mm=(0.3, 0.7)),
    ],
    ids=["text", "dots", "grating across", "grating along"],
)
def test_the_body_lies_where_its_outline_lies(stimulus):
    rng = np.random.default_rng(2)
    xy = rng.uniform([-4, -9], [4, 9], (4000, 2))
    shape = shapely.union_all(stimulus.outlines())
    clear = shapely.distance(shape.boundary, shapely.points(xy)) > 0.02
    inside = shapely.contains_xy(shape, *xy[clear].T)
    assert inside.any()
    at = gap(stimulus, np.column_stack([xy[clear], np.full(clear.sum(), -0.3)]))
    assert np.array_equal(at < 0, inside)


def test_the_counter_of_a_letter_is_outside():
    stimulus = Text(text="OG", shift_mm=(0.3, 0.7))
    counter = shapely.Polygon(stimulus.outlines()[0].interiors[0]).centroid
    assert gap(stimulus, [counter.x, counter.y, -0.3]) > 0.2


def test_start_says_which_place_of_a_pattern_lies_over_the_contact_point():
    """Counted from the first letter, row or ridge; the default is the middle of a pattern."""
    rows = [d.centroid.y for d in Dots(columns=1, rows=3, start_mm=1.2).outlines()]
    assert rows == pytest.approx([-1.2, 1.8, 4.8])
    ridges = Grating(count=2, start_mm=0.0, along="y", shift_mm=(0.1, 0.0)).outlines()
    assert [r.centroid.x for r in ridges] == pytest.approx([0.1, 2.1])
    (first, _) = Text(text="FG", start_mm=1.2).outlines()
    assert (first.bounds[1] + first.bounds[3]) / 2 == pytest.approx(-1.2, abs=0.01)
    middle = {Dots(rows=7): Dots(rows=7, start_mm=9.0), Grating(): Grating(start_mm=8.0)}
    for default, explicit in middle.items():
        assert all(map(shapely.equals, default.outlines(), explicit.outlines()))


def test_outlines_of_patterns():
    assert Plate().outlines() == Sphere().outlines() == []
    ridges = Grating(count=3, shift_mm=(0.0, 1.0)).outlines()
    assert [r.centroid.y for r in ridges] == pytest.approx([-1, 1, 3])
    dots = Dots(columns=2, rows=3).outlines()
    assert len(dots) == 6
    assert gap(Dots(columns=2, rows=3), [d.centroid.coords[0] + (0,) for d in dots]) == (
        pytest.approx(0)
    )


@pytest.mark.parametrize(
    ("stimulus", "sentence"),
    [
        (Text(text="G\N{ZERO WIDTH SPACE}"), "no glyph"),
        (Text(font="DejaVu Sans:bold"), "no such font is installed"),
        # The G would fall in two, with most of its area kept.
        (Text(corner_radius_mm=0.42), "less than half of each"),
        (Text(relief_mm=0.2, fillet_radius_mm=0.3), "must not exceed relief_mm"),
        (
            Text(corner_radius_mm=0.45, fillet_radius_mm=0.45),
            r"exceed 0.4; stimulus.fillet_radius_mm = 0.45 must not exceed corner_radius_mm",
        ),
        (Text(g_width_mm=0.5), "too thin: rounded by 0.05 mm"),
        (Grating(ridge_mm=0.3), "must not exceed half of ridge_mm"),
        (Dots(radius_mm=0.1), "must not exceed radius_mm"),
        (Braille(text="  "), "stimulus.text holds no dot"),
        (Braille(dot_height_mm=0.9), r"0.9 must not exceed half of dot_diameter_mm \(0.8\)"),
        (Braille(dot_diameter_mm=2.6), r"2.6 must not exceed dot_spacing_mm \(2.5\)"),
    ],
)
def test_bad_input_is_told_in_a_sentence(stimulus, sentence):
    with pytest.raises(StudyError, match=sentence):
        stimulus.body()


def test_the_radius_that_would_fit_stands_in_the_message_and_is_used_unless_one_is_given():
    letters = {"g_width_mm": 3.0, "text": "W"}
    with pytest.raises(StudyError) as told:
        Text(corner_radius_mm=0.3, **letters).body()
    fits = float(str(told.value).rsplit(" ", 1)[1])
    with pytest.raises(StudyError):
        Text(corner_radius_mm=1.1 * fits, **letters).body()
    given = Text(corner_radius_mm=fits, fillet_radius_mm=fits, **letters)
    points = np.random.default_rng(0).uniform([-3, 3, -1], [3, 8, 0], (500, 3))
    np.testing.assert_array_equal(gap(Text(**letters), points), gap(given, points))


def test_curves_are_smooth():
    """Chords of the font's curves would show as a curvature that jumps between 0 and 3/mm."""
    stimulus = Text(text="O")
    ring = stimulus.outlines()[0].exterior
    wall = shapely.get_coordinates(shapely.line_interpolate_point(ring, np.linspace(0, 18, 900)))
    at = stimulus.body().distance(np.column_stack([wall, np.full(len(wall), -0.32)]))
    curvature = np.trace(at.hessian, axis1=1, axis2=2)
    assert curvature.min() > 0 and curvature.max() < 0.7


def test_braille_spells_letters_numbers_and_patterns():
    assert cells("Tea 42") == "⠞⠑⠁⠀⠼⠙⠃"
    assert cells("a1b") == "⠁⠼⠁⠰⠃"  # after a digit, b needs a letter sign
    assert cells("1z⡇") == "⠼⠁⠵⡇"
    with pytest.raises(StudyError, match='"é" is neither letter, digit, space nor Braille'):
        cells("é")


def test_braille_reads_along_the_finger_with_its_top_towards_minus_x():
    places = Braille(text="l b", start_mm=1.0).dots()
    # l is dots 1, 2, 3: a column; b, two cells on, is dots 1 and 2.
    expected = [(-2.5, -2.25), (0.0, -2.25), (2.5, -2.25), (-2.5, 10.15), (0.0, 10.15)]
    np.testing.assert_allclose(places, expected, atol=1e-12)
    middle = Braille(text="⠿⠿").dots()
    np.testing.assert_allclose(middle.mean(axis=0), 0.0, atol=1e-12)
    assert len(Braille(text="l b").outlines()) == 5


def test_a_braille_dot_is_a_part_of_a_ball_on_a_plate():
    dot = Braille(text="⠂", shift_mm=(0.0, 1.25))  # dot 2 alone, at the middle
    R = (0.8**2 + 0.5**2) / (2 * 0.5)
    x = np.array([0.0, 0.3, 0.5])
    cap = np.sqrt(R**2 - x**2) - R
    np.testing.assert_allclose(gap(dot, np.column_stack([x, 0 * x, cap])), 0.0, atol=1e-12)
    assert gap(dot, [3.0, 0.0, -0.5]) == pytest.approx(0.0, abs=1e-12)
    foot = dot.body().distance(np.array([[0.8, 0.0, -0.5]])).gap[0]
    assert -0.08 < foot < 0  # the foot is filled
