"""Figures of a scan show its whole path, all populations and the outline of any stimulator."""

import numpy as np
import pytest
from matplotlib.ticker import Formatter
from PIL import Image
from synthetic import SPEED, make_results, make_spikes, make_trace

from tactile_fem.cli import app as cli
from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response
from tactile_fem.output import figures
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.cross_section import CrossSectionMap
from tactile_fem.output.felt import Felt, felt
from tactile_fem.output.plots import force_figure
from tactile_fem.output.rasters import Trains, draw_psth, draw_raster, draw_rates, firing, raster
from tactile_fem.output.snapshots import snapshots
from tactile_fem.results.histories import DISPLACEMENT, TIME
from tactile_fem.stimulus.sampled import DistanceGrid
from tactile_fem.study import Cylinder, Dots, Plate, Sphere, Study, Text

NAMES = {"sed.png", "raster.png", "firing.png", "force.png"}


def scan(folder, study=None, trace=None):
    return make_results(folder, study or Study(stimulus=Plate()), trace)


def held(trace):
    """Return a trace with a hold after the slide."""
    longer = {
        k: v if k == "receptors_mm" else np.concatenate([v, v[-1:]]) for k, v in trace.items()
    }
    longer["time_s"][-1] += 0.1
    names = ["press"] * 8 + ["slide"] * 50 + ["hold"]
    return {**longer, "phase": np.array(names)}


def square(at_mm=0.0):
    """Return the outline of |X| < 3, 2 < Y < 8 on a stimulator that slides as the trace says."""
    trace = make_trace()
    x, y = np.meshgrid(np.arange(-8, 8.01, 0.1), np.arange(-1, 12.01, 0.1), indexing="ij")
    inside = np.minimum(3 - np.abs(x - at_mm), 3 - np.abs(y - 5))
    origin = np.array([-8.0, -1.0])
    return CrossSectionMap(origin, 0.1, inside, trace["time_s"], trace["stimulator_mm"][:, :2])


def dots(axes):
    return [one for one in axes.lines if one.get_gid() == "spikes"]


# --- forces --------------------------------------------------------------------------------------


def test_a_body_that_turns_shows_its_torque_about_its_own_origin():
    trace = make_trace()
    plain = force_figure(trace, Abscissa.of(trace))
    assert len(plain.axes) == 4 and "mm" in plain.axes[2].get_xlabel()
    trace["stimulator_rad"][:, 2] = 0.1
    trace["moment_Nmm"] = np.cross(trace["stimulator_mm"], trace["force_N"])
    trace["moment_Nmm"][:, 2] += 0.7
    turned = force_figure(trace, Abscissa.of(trace))
    press, slide = turned.axes[4:6]
    assert press.get_ylabel() == "Torque (Nmm)" and press.get_xlabel() == "Indentation (mm)"
    assert press.lines[0].get_ydata() == pytest.approx(0.7)
    assert slide.lines[0].get_ydata() == pytest.approx(0.7) and slide.get_xlabel() == TIME
    assert not turned.axes[3].get_xlabel()


# --- the axis ------------------------------------------------------------------------------------


def test_a_straight_slide_has_its_displacement_and_the_press_before_it():
    trace = make_trace()
    over = Abscissa.of(trace)
    assert over.label == DISPLACEMENT and over.is_to_scale
    slide = trace["time_s"] >= 0
    assert over.values[slide] == pytest.approx(trace["displacement_mm"][slide])
    assert over.values[~slide] == pytest.approx(SPEED * trace["time_s"][~slide])
    (press, start, end), (slid, begin, last) = over.phases
    assert (press, slid) == ("press", "slide")
    assert (start, end, begin, last) == pytest.approx((-1.97, 0, 0, 10))


@pytest.mark.parametrize("change", ["across", "held", "faster", "pressed"])
def test_any_other_path_has_the_time(change):
    trace = held(make_trace()) if change == "held" else make_trace()
    if change == "across":
        trace["stimulator_mm"][:, 0] += trace["displacement_mm"]
    if change == "faster":
        trace["time_s"][-20:] -= np.linspace(0.0, 0.05, 20)
    if change == "pressed":
        trace = {k: v if k == "receptors_mm" else v[:8] for k, v in trace.items()}
    over = Abscissa.of(trace)
    assert over.label == TIME and not over.is_to_scale
    assert over.values.tolist() == trace["time_s"].tolist()
    names = {"held": ["press", "slide", "hold"], "pressed": ["press"]}
    assert [phase.name for phase in over.phases] == names.get(change, ["press", "slide"])
    assert over.phases[-1].end == trace["time_s"][-1]


# --- what passes beneath -------------------------------------------------------------------------


def test_the_outline_stays_in_the_press_and_passes_in_the_slide():
    times = np.array([-0.05, 0.0, 0.1, 0.45])
    under = square().under(np.array([[0.0, 0.0], [0.0, 3.0], [4.0, 3.0]]), times)
    # At Y = 0 the square is met from 2 to 8 mm: at 0.1 s it is just there, at 0.45 s gone.
    assert under[0] == pytest.approx([-2.0, -2.0, 0.0, -1.0], abs=1e-6)
    # At Y = 3 the receptor lies over Y = 3 of it from the beginning.
    assert under[1] == pytest.approx([1.0, 1.0, 3.0, -3.0 - 1.0], abs=1e-6)
    assert (under[2] < 0).all()


@pytest.mark.parametrize(
    ("stimulus", "inside", "outside"),
    [
        (Dots(), None, None),
        (Text(text="I"), None, None),
        # A ball that is pressed 1.97 mm deep: half of that is 2.2 mm away from its middle.
        (Sphere(radius_mm=3.0), [2.1, 0.0], [2.3, 0.0]),
        (Cylinder(radius_mm=3.0), [3.0, 2.1], [3.0, 2.3]),
    ],
)
def test_every_kind_has_its_outline(tmp_path, stimulus, inside, outside):
    beneath = CrossSectionMap.of(scan(tmp_path / "r", Study(stimulus=stimulus)))
    assert beneath.inside.min() < 0 < beneath.inside.max()
    if inside is not None:
        felt_there = beneath.under(np.array([inside, outside]), np.zeros(1))
        assert felt_there[0, 0] > 0 > felt_there[1, 0]


def test_a_plate_has_no_outline(tmp_path):
    assert CrossSectionMap.of(scan(tmp_path / "r")).inside.max() < 0


def test_a_body_of_a_script_has_the_outline_of_its_samples(tmp_path):
    results = scan(tmp_path / "r")
    body = Sphere(radius_mm=3.0, shift_mm=(0.5, 0.0)).body()
    results.save_stimulator(DistanceGrid.of(body, results.trace["stimulator_mm"]))
    beneath = CrossSectionMap.of(results)
    edges = np.array([[2.6, 0.0], [2.8, 0.0], [-1.6, 0.0], [-1.8, 0.0]])
    assert (beneath.under(edges, np.zeros(1))[:, 0] > 0).tolist() == [True, False, True, False]


# --- felt ----------------------------------------------------------------------------------------


def test_what_is_felt_has_its_extrema_phases_and_the_outline_to_scale():
    trace = make_trace()
    sed, over = trace["sed_kPa"][:, 10], Abscissa.of(trace)
    figure = felt([Felt("SA1", "black", np.zeros(3), "SED (kPa)", sed)], over, square())
    top, below = figure.axes
    assert np.array_equal(top.lines[1].get_xydata(), np.column_stack([over.values, sed]))
    marked = {line.get_label(): line for line in top.lines}
    assert marked["maxima"].get_xdata() == pytest.approx([2.6, 7.6], abs=0.21)
    assert marked["minima"].get_xdata() == pytest.approx([5.0], abs=0.21)
    assert top.get_xlim() == below.get_xlim() == pytest.approx((-1.97, 10))
    assert [text.get_text() for text in top.texts] == ["press", "slide"]
    assert top.get_ylabel() == "SED (kPa)" and below.get_xlabel() == DISPLACEMENT
    assert min(below.get_xticks()) == 0
    figure.draw_without_rendering()
    box = below.get_window_extent()
    per_mm = box.width / np.ptp(below.get_xlim()), box.height / np.ptp(below.get_ylim())
    assert per_mm[0] == pytest.approx(abs(per_mm[1]), rel=1e-6)
    assert below.get_ylim()[0] > below.get_ylim()[1]
    assert sorted(below.get_ylim()) == pytest.approx([-3.4, 3.4], abs=0.11)


def test_each_drive_has_a_panel_and_each_population_a_colour():
    trace = make_trace()
    sed, over = trace["sed_kPa"][:, 10], Abscissa.of(trace)
    kinds = [("SA1", "blue", "SED (kPa)"), ("SA2", "green", "SED (kPa)"), ("PC", "red", "Z (mm)")]
    found = [Felt(name, colour, np.zeros(3), label, sed) for name, colour, label in kinds]
    first, second, _ = felt(found, over, square()).axes
    assert (first.get_ylabel(), second.get_ylabel()) == ("SED (kPa)", "Z (mm)")
    drawn = [line.get_color() for line in first.lines if line.get_label() in ("SA1", "SA2")]
    assert drawn == ["blue", "green"]
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["SA1", "SA2", "PC"]


def test_what_meets_nothing_has_no_outline():
    trace = make_trace()
    over = Abscissa.of(trace)
    far = square(at_mm=30.0)
    figure = felt([Felt("SA1", "k", np.zeros(3), "", trace["sed_kPa"][:, 10])], over, far)
    assert len(figure.axes) == 1 and figure.axes[0].get_xlabel() == DISPLACEMENT


# --- rasters -------------------------------------------------------------------------------------


def trains(name, places_xy, times):
    places = np.column_stack([places_xy, np.zeros(len(places_xy))])
    response = Response([np.array(times) for _ in places], -0.1, 0.5)
    return Trains(name, "red", places, response)


def test_a_spike_of_the_press_is_shown_before_the_slide():
    over = Abscissa.of(make_trace())
    figure = raster([trains("SA1", [[0.0, 0.0], [1.0, 0.0]], [-0.05, 0.1])], over, square())
    axes = figure.axes[0]
    (drawn,) = dots(axes)
    assert drawn.get_xydata().tolist() == [[-1, 0], [2, 0], [-1, 1], [2, 1]]
    assert axes.get_ylim() == pytest.approx((1.3, -0.3))
    assert len(axes.collections) == 2  # the outline, filled, and its edge


def test_populations_on_a_line_share_its_rows():
    over = Abscissa.of(make_trace())
    line = [[x, 0.0] for x in range(3)]
    figure = raster([trains(name, line, [0.1]) for name in ("SA1", "RA")], over, square())
    axes = figure.axes[0]
    first, second = (one.get_ydata() for one in dots(axes))
    assert first.tolist() == [-0.15, 0.85, 1.85] and second.tolist() == [0.15, 1.15, 2.15]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["SA1", "RA"]


def test_many_receptors_over_the_skin_are_an_image_over_the_whole_path():
    over = Abscissa.of(make_trace())
    side = np.linspace(-4, 4, 17)
    grid = [[x, y] for y in side for x in side]
    figure = raster([trains("SA1", grid, [0.1])], over, square())
    axes, bar = figure.axes
    assert not dots(axes) and bar.get_ylabel() == "Rate (spikes/s)"
    image = axes.collections[0].get_array()
    assert image.shape[0] == 289 and np.allclose(image, image[0])
    columns = np.linspace(*over.ends, image.shape[1])
    assert columns[image[0].argmax()] == pytest.approx(2.0, abs=0.05)
    ticks = dict(
        zip([t.get_text() for t in axes.get_yticklabels()], axes.get_yticks(), strict=True)
    )
    assert (
        ticks[Formatter.fix_minus("-4")] == 8 and ticks["0"] == 144
    )  # the middle of their 17 receptors


def test_a_grid_of_81_receptors_has_a_row_each():
    grid = [[x, y] for y in range(-4, 5) for x in range(-4, 5)]
    figure = raster([trains("SA1", grid, [0.1])], Abscissa.of(make_trace()), square())
    (drawn,) = dots(figure.axes[0])
    assert sorted(drawn.get_ydata()) == list(range(81))
    height_pt = 72 * figure.get_figheight() * figure.axes[0].get_position().height
    assert drawn.get_markersize() <= height_pt / 81  # rows do not overlap


# --- classes -------------------------------------------------------------------------------------

KINDS = ["SA1"] * 3 + ["RA"] * 2 + ["PC"]
SPIKES = [[0.0, 0.1], [0.2], [], [0.05, 0.15], [0.4], [0.3, 0.31, 0.32]]
FIRED = Response([np.array(times) for times in SPIKES], -0.1, 0.5)


def test_a_raster_has_each_spike_in_the_band_of_its_class():
    figure = draw_raster(FIRED, KINDS)
    (axes,) = figure.axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["SA1: 3\n3 spikes", "RA: 2\n3 spikes", "PC: 1\n3 spikes"]
    bands = [patch.get_extents() for patch in axes.patches]
    for drawn, band, kind in zip(dots(axes), bands, ("SA1", "RA", "PC"), strict=True):
        x, y = drawn.get_data()
        own = [time for times, k in zip(SPIKES, KINDS, strict=True) if k == kind for time in times]
        assert sorted(x) == sorted(own) and len(set(np.diff(np.unique(y)))) <= 1
        low, high = sorted(axes.transData.inverted().transform(band.get_points())[:, 1])
        assert (y > low).all() and (y < high).all()
    assert figure.get_figwidth() == pytest.approx(85 / 25.4)
    assert draw_raster({"SA1": FIRED}, width_mm=170).get_figwidth() == pytest.approx(170 / 25.4)
    with pytest.raises(StudyError, match=r"by has shape \(2,\); it needs \(6,\)"):
        draw_raster(FIRED, ["SA1", "RA"])


def test_a_psth_counts_every_spike():
    (axes,) = draw_psth(FIRED, KINDS, bin_s=0.05).axes
    found = {one.get_label(): one.get_data() for one in axes.patches if one.get_label() in KINDS}
    for kind, (rate_Hz, edges_s, _) in found.items():
        counts = rate_Hz * np.diff(edges_s) * KINDS.count(kind)
        assert counts.sum() == pytest.approx(3)
    assert list(found) == ["SA1", "RA", "PC"]


def test_rates_of_all_classes_share_colours_that_one_afferent_does_not_set():
    wild = Response([*FIRED.spikes * 20, np.linspace(0.2, 0.21, 30)], -0.1, 0.5)
    figure = draw_rates(wild, [*KINDS * 20, "RA"])
    *panels, bar = figure.axes
    (scale,) = {one.collections[0].norm for one in panels}
    brightest = max(float(one.collections[0].get_array().max()) for one in panels)
    assert len(panels) == 3 and scale.vmax < 0.5 * brightest
    assert bar.get_ylabel() == "Rate (spikes/s)"
    assert draw_rates(Response([np.empty(0)], 0.0, 1.0)).axes


def test_four_populations_on_a_line_have_a_panel_each_and_one_bar():
    line, over = [[x, 0.0] for x in range(3)], Abscissa.of(make_trace())
    four = [trains(name, line, [0.1]) for name in ("SA1", "RA", "PC", "SA2")]
    figure = raster(four, over, square())
    assert [axes.get_ylabel()[:3] for axes in figure.axes] == ["SA1", "RA,", "PC,", "SA2"]
    *panels, bar = firing(four, over, square()).axes
    assert len(panels) == 4 and bar.get_ylabel() == "Rate (spikes/s)"


def test_populations_over_the_skin_are_bands_of_one_panel():
    grid, over = [[x, y] for x in range(3) for y in range(3)], Abscissa.of(make_trace())
    (axes,) = raster([trains(k, grid, [0.1]) for k in KINDS[2:4]], over, square()).axes
    assert [one.get_text() for one in axes.get_yticklabels()] == [f"{k}: 9\n9 spikes" for k in KINDS[2:4]]  # fmt: skip  # noqa: E501


def test_snapshots_show_the_rates_of_each_part_of_the_path_and_the_outline_there():
    over = Abscissa.of(make_trace())
    grid = [[x, y] for y in range(-4, 5) for x in range(-4, 5)]
    figure = snapshots([trains("SA1", grid, [0.1])], over, square())
    *maps, _ = figure.axes
    edges = over.columns_s(len(maps) + 1)
    part = int(np.searchsorted(edges, 0.1)) - 1
    rates = [axes.collections[0].get_array() for axes in maps]
    assert [bool(rate.any()) for rate in rates] == [k == part for k in range(len(maps))]
    assert np.asarray(rates[part]) == pytest.approx(np.full(81, 1 / (edges[1] - edges[0])))
    assert maps[0].get_title().startswith("press") and maps[-1].get_title().startswith("slide")
    left = maps[part].collections[1].get_paths()[0].vertices[:, 0].min()
    assert left == pytest.approx(2.0 - SPEED * edges[part : part + 2].mean(), abs=0.02)


def test_receptors_in_lines_have_no_snapshots():
    over = Abscissa.of(make_trace())
    assert snapshots([trains("SA1", [[0, 0], [1, 0]], [0.1])], over, square()) is None


def test_a_few_receptors_over_the_skin_have_a_row_each():
    over = Abscissa.of(make_trace())
    figure = raster([trains("SA1", [[1, 1], [-1, 0], [0, 2]], [0.1])], over, square())
    (drawn,) = dots(figure.axes[0])
    assert drawn.get_ydata().tolist() == [2, 0, 1]


# --- folders -------------------------------------------------------------------------------------


@pytest.mark.parametrize("stimulus", [Text(), Dots(), Cylinder(), Plate()])
def test_all_figures_of_a_folder(tmp_path, stimulus):
    results = scan(tmp_path / "r", Study(stimulus=stimulus))
    paths = figures.draw_plots(results)
    assert {path.name for path in paths} == NAMES
    for path in paths:
        with Image.open(path) as image:
            assert min(image.size) > 500
            assert len(image.getcolors(1 << 24)) > 10


def test_a_press_without_a_slide_has_all_figures(tmp_path):
    trace = {k: v if k == "receptors_mm" else v[:8] for k, v in make_trace().items()}
    paths = figures.draw_plots(scan(tmp_path / "r", trace=trace))
    assert {path.name for path in paths} == NAMES


def test_figures_have_as_many_dots_as_are_wanted(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(figures, "draw_pictures", lambda results, **_: [])
    results, sizes = scan(tmp_path / "r"), []
    for words in ([], ["--dpi", "400"]):
        assert cli.main(["plot", str(results.folder), *words]) == 0
        with Image.open(results.figures / "sed.png") as image:
            sizes.append(np.array(image.size))
    assert sizes[1] == pytest.approx(2 * sizes[0], abs=2)
    assert cli.main(["plot", str(results.folder), "--dpi", "0"]) == 2
    assert "--dpi" in capsys.readouterr().err


def test_spikes_of_the_synthetic_folder_are_all_drawn(tmp_path):
    trace = make_trace()
    (one,) = figures.trains_of(scan(tmp_path / "r", trace=trace))
    assert one.response.counts().sum() == sum(map(len, make_spikes(trace)))
    assert one.places_mm.tolist() == trace["receptors_mm"].tolist()
