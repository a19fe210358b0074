"""Fields that are shown: their names, one colour scale, categories, and sizes in print."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from PIL import Image
from synthetic import make_results, make_section, make_trace

from tactile_fem.cli import app as cli
from tactile_fem.errors import StudyError
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.figures import draw_plots
from tactile_fem.output.film import Film, titles_of
from tactile_fem.output.maps import surface_map
from tactile_fem.output.plots import force_figure
from tactile_fem.output.quantities import QUANTITIES, around_corners, quantity_of
from tactile_fem.output.section import SectionScene, gap_of
from tactile_fem.results.surfaces import SurfaceFields
from tactile_fem.runtime.files import Print
from tactile_fem.study import Plate

TRIANGLES = np.array([[0, 1, 2], [1, 3, 2]])
COLUMNS = {
    "displacement_mm": np.tile([3.0, 4.0, 0.0], (4, 1)),
    "stretches": np.tile([0.8, 1.0, 1.25], (4, 1)),
    "sed_kPa": np.arange(4.0),
    "stress_kPa": np.tile([2.0, 0.0, 0.0, 0.0, 0.0, 0.0], (4, 1)),
    "contact_pressure_kPa": np.arange(4.0),
    "friction_kPa": np.tile([0.0, 0.6, 0.8], (4, 1)),
    "contact": np.array([0.0, 1.0, 2.0, 2.0]),
}


@pytest.fixture(scope="module")
def section(tmp_path_factory):
    return make_section(tmp_path_factory.mktemp("quantities") / "r")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        *[("displacement", 5.0), ("stretch", 1.25), ("von_mises", 2.0), ("friction", 1.0)],
        *[("stress_xx_kPa", 2.0), ("stretches_1", 0.8), ("displacement_y_mm", 4.0)],
    ],
)
def test_a_quantity_has_its_values(name, expected):
    quantity = quantity_of(name, COLUMNS, "the finger")
    assert quantity.of(COLUMNS[quantity.column]) == pytest.approx(np.full(4, expected))


def test_names_of_all_quantities_and_of_their_columns_are_known():
    for name, quantity in QUANTITIES.items():
        assert quantity_of(name.upper(), COLUMNS, "the finger") is quantity
    assert quantity_of("contact", COLUMNS, "the finger") is QUANTITIES["slip"]
    with pytest.raises(StudyError, match=r"no column of the finger: choose .*, sed, .*slip"):
        quantity_of("heat", COLUMNS, "the finger")


def test_a_film_has_one_colour_scale(section):
    film = Film.of_scan(section, "displacement")
    largest = np.linalg.norm(film.moved_mm, axis=-1).max()
    assert film.limits == pytest.approx((0.0, largest), rel=0.01)
    scene = SectionScene(film, gap_of(Plate().body()))
    ends = {scene.figure(k, 50).axes[1].get_ylim() for k in range(len(film))}
    assert ends == {film.limits}
    assert Film.of_scan(section, "displacement_z_mm").limits[0] >= 0
    signed = Film.of_scan(section, "displacement_y_mm").limits
    assert signed[0] < signed[1] <= 0.01


def test_contact_is_a_category_in_every_frame_and_on_a_map(section, monkeypatch):
    slip = replace(QUANTITIES["slip"], column="sed_kPa")
    monkeypatch.setitem(QUANTITIES, "sed", slip)
    film = Film.of_scan(section)
    assert {*film.weights.ravel()} == {0.0, 1.0} and len(film) == len(film.values)  # states only
    assert QUANTITIES["slip"].limits(np.zeros((1, 2))) == (0.0, 2.0)
    with pytest.raises(StudyError, match="contact is no column"):
        Film.of_scan(section, "contact")  # the fields have none
    places = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [2.0, 2.0, 0.0]])
    surface = SurfaceFields(0.1, 0.0, places, TRIANGLES, COLUMNS)
    figure = surface_map(surface, "slip", "turned 5.0°")
    (parts,) = figure.axes[0].collections
    chosen = [to_rgba(colour) for colour in QUANTITIES["slip"].categories.values()]
    assert {*map(tuple, parts.get_facecolors())} == {*chosen}
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["no contact", "sticks", "slips"]
    assert figure.axes[0].get_title() == "turned 5.0°"


def test_parts_around_corners_fill_their_facets():
    places = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [2.0, 2.0]])
    x, y = np.moveaxis(around_corners(places, TRIANGLES), -1, 0)
    areas = (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1) / 2
    assert np.abs(areas) == pytest.approx(np.full(6, 2 / 3))
    assert around_corners(places, np.array([[0, 1]])).tolist() == [
        [[0, 0], [1, 0]],
        [[2, 0], [1, 0]],
    ]


@pytest.mark.parametrize(
    ("options", "pixels", "dpi"),
    [
        (["--width-mm", "85", "--dpi", "300"], 1003, 300),
        (["--width-mm", "180", "--dpi", "100"], 708, 100),
        (["--dpi", "100"], 750, 100),
        ([], 1500, 200),
    ],
)
def test_pictures_have_their_size_in_print(section, tmp_path, options, pixels, dpi):
    path = tmp_path / "view.png"
    assert cli.main(["view", str(section.folder), "--save", str(path), *options]) == 0
    with Image.open(path) as image:
        assert image.width == pixels
        assert image.info["dpi"] == pytest.approx((dpi, dpi), abs=0.01)


def test_films_have_their_resolution_and_figures_their_width(tmp_path):
    results, path = make_section(tmp_path / "r", (0.0,)), str(tmp_path / "film.gif")
    size = ["--width-mm", "85", "--dpi", "60"]
    assert cli.main(["view", str(results.folder), "--show", "sed", "--save", path, *size]) == 0
    with Image.open(path) as image:
        assert image.width == 200
    with Print(85.0, 60).used():
        drawn = draw_plots(results)
    assert {file.stem for file in drawn} >= {"force", "sed", "raster"}
    assert {Image.open(file).width for file in drawn} == {200}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--show", "nonsense"], "nonsense is no column of the fields in"),
        (["--show", "sed", "--width-mm", "0"], "Must be >= 40"),
        (["--show", "sed", "--vibration", "100"], "--show does not go with --vibration"),
    ],
)
def test_what_cannot_be_shown_is_told_in_one_line(section, tmp_path, capsys, options, message):
    path = str(tmp_path / "view.png")
    assert cli.main(["view", str(section.folder), "--save", path, *options]) == 2
    stderr = [line for line in capsys.readouterr().err.splitlines() if "INFO" not in line]
    assert len(stderr) == 1 and message in stderr[0]


def test_a_followed_path_has_no_panel_of_an_indentation():
    trace = make_trace()
    trace["time_s"] = trace["clock_s"]
    assert len(force_figure(trace, Abscissa.of(trace), 0.3).axes) == 2


def test_titles_say_what_moves(tmp_path):
    trace = make_trace()
    trace["stimulator_rad"][:, 2] = np.radians(trace["displacement_mm"])
    results = make_results(tmp_path / "r", trace=trace)
    press, slide = titles_of(results.trace, [-0.05, 0.25])
    assert "turned" not in press and slide.endswith(
        "displacement 5.00 mm, depth 1.97 mm, turned 5.0°"
    )
