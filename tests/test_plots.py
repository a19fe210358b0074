import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image
from synthetic import make_results, make_spikes, make_trace

from tactile_fem import figures
from tactile_fem.extrema import central_receptor, extrema
from tactile_fem.plots import (
    firing_figure,
    force_figure,
    raster_figure,
    sed_figure,
)
from tactile_fem.study import Cylinder, Dots, Protocol, Stimulus, Study, Text

SQUARE = np.array([[-3.0, 2.0], [3.0, 2.0], [3.0, 8.0], [-3.0, 8.0]])


def line(axes, label):
    return next(one for one in axes.lines if one.get_label() == label)


def test_extrema_are_found_and_wiggles_are_not():
    x = np.linspace(0, 4 * np.pi, 400)
    highs, lows = extrema(np.sin(x) + 0.01 * np.sin(40 * x))
    assert x[highs] == pytest.approx([np.pi / 2, 5 * np.pi / 2], abs=0.2)
    assert x[lows] == pytest.approx([3 * np.pi / 2, 7 * np.pi / 2], abs=0.2)
    for nothing in ([], [1.0], np.ones(10)):
        assert all(len(found) == 0 for found in extrema(nothing))


def test_the_central_receptor_is_the_one_next_to_the_origin():
    assert central_receptor(make_trace()["receptors_mm"]) == 10


def test_sed_figure_shows_history_extrema_and_letters_to_scale():
    trace = make_trace()
    d, sed = trace["displacement_mm"][8:], trace["sed_kPa"][8:, 10]
    figure = sed_figure(d, sed, [SQUARE])
    top, below = figure.axes
    assert np.array_equal(top.lines[0].get_xydata(), np.column_stack([d, sed]))
    assert line(top, "maxima").get_xdata() == pytest.approx([2.6, 7.6], abs=0.21)
    assert line(top, "minima").get_xdata() == pytest.approx([5.0], abs=0.21)
    assert top.get_xlim() == below.get_xlim() == (d[0], d[-1])
    assert "kPa" in top.get_ylabel() and "mm" in below.get_xlabel()
    figure.draw_without_rendering()
    box = below.get_window_extent()
    per_mm = box.width / np.ptp(below.get_xlim()), box.height / np.ptp(below.get_ylim())
    assert per_mm[0] == pytest.approx(abs(per_mm[1]), rel=1e-6)
    assert below.get_ylim()[0] > below.get_ylim()[1]


def test_sed_figure_without_letters_is_one_panel():
    figure = sed_figure([0.0, 1.0, 2.0], [0.0, 2.0, 1.0])
    assert len(figure.axes) == 1
    assert "mm" in figure.axes[0].get_xlabel()


def test_raster_has_one_dot_per_spike_in_range():
    x = np.array([-1.0, 0.0, 1.0, 1.0])
    figure = raster_figure([0.5, 3.0, 10.0, 12.0], x, np.arange(-5, 6), (0.0, 10.0), [SQUARE])
    axes = figure.axes[0]
    dots = next(one for one in axes.lines if one.get_gid() == "spikes")
    assert dots.get_xydata().tolist() == [[0.5, -1.0], [3.0, 0.0], [10.0, 1.0]]
    assert axes.get_xlim() == (0.0, 10.0)
    assert sorted(axes.get_ylim()) == pytest.approx([-5.3, 5.3])
    assert len(axes.patches) == 1
    extents = axes.patches[0].get_path().get_extents()
    assert (extents.x0, extents.x1) == (2.0, 8.0)  # along the finger = displacement


def test_raster_of_a_silent_finger():
    figure = raster_figure([], [], np.arange(-5, 6), (0.0, 10.0))
    assert len(figure.axes) == 1


def test_firing_figure_shows_the_rates():
    rate = np.arange(12.0).reshape(3, 4)
    figure = firing_figure([0.0, 1.0, 2.0, 3.0], [-1.0, 0.0, 1.0], rate, [SQUARE])
    image = figure.axes[0].collections[0]
    assert np.array_equal(image.get_array(), rate)
    assert image.get_cmap().name == "cividis"
    assert "spikes/s" in figure.axes[1].get_ylabel()


def test_force_figure_has_press_slide_and_ratio():
    trace = make_trace()
    figure = force_figure(
        trace["depth_mm"],
        trace["displacement_mm"],
        trace["force_N"],
        trace["time_s"] <= 1e-12,
        0.3,
    )
    press, slide, below, ratio = figure.axes
    assert line(press, "normal").get_xdata()[-1] == 1.97
    assert line(press, "normal").get_ydata()[-1] == pytest.approx(0.6)
    assert line(slide, "normal").get_xdata().tolist() == trace["displacement_mm"][7:].tolist()
    assert line(slide, "tangential").get_ydata()[-1] == pytest.approx(0.18)
    assert ratio.lines[0].get_ydata()[-1] == pytest.approx(0.3)
    assert "N" in press.get_ylabel() and "mm" in below.get_xlabel()


def test_force_figure_of_a_press_alone_and_of_nothing():
    for steps in (0, 1, 5):
        depth = np.linspace(0, 1, steps)
        force_figure(depth, 0 * depth, np.zeros((steps, 3)), np.ones(steps, dtype=bool))


def test_figures_leave_the_users_style_alone():
    before = dict(mpl.rcParams)
    sed_figure([0.0, 1.0], [0.0, 1.0])
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize("stimulus", [Text(), Dots(), Cylinder()])
def test_all_figures_of_a_folder(tmp_path, stimulus):
    results = make_results(tmp_path / "r", Study(stimulus=stimulus))
    paths = figures.draw_plots(results)
    assert {path.name for path in paths} == {"sed.png", "raster.png", "firing.png", "force.png"}
    for path in paths:
        with Image.open(path) as image:
            assert min(image.size) > 500
            assert len(image.getcolors(1 << 24)) > 10


def test_receptors_beside_the_line_are_drawn_where_they_meet_the_stimulator(tmp_path):
    trace = make_trace()
    trace["receptors_mm"][:, 1] = np.linspace(-2, 2, 21)
    results = make_results(tmp_path / "r", trace=trace)
    names = {path.name for path in figures.draw_plots(results)}
    assert names == {"sed.png", "raster.png", "force.png"}


def test_a_press_without_a_slide_has_its_forces(tmp_path):
    trace = {k: v if k == "receptors_mm" else v[:8] for k, v in make_trace().items()}
    results = make_results(tmp_path / "r", Study(protocol=Protocol(distance_mm=0)), trace)
    assert [path.name for path in figures.draw_plots(results)] == ["force.png"]


def test_letters_have_holes(tmp_path):
    def area(ring):
        x, y = ring.T
        return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))

    rings = figures.rings(Text(text="O"))
    assert len(rings) == 2
    assert area(rings[0][:-1]) > 0 > area(rings[1][:-1])
    assert figures.rings(Cylinder()) == []
    assert isinstance(Text(), Stimulus)


def test_spikes_of_the_synthetic_folder_are_all_drawn(tmp_path):
    trace = make_trace()
    results = make_results(tmp_path / "r", trace=trace)
    figure = figures._raster(results, [])
    dots = next(one for one in figure.axes[0].lines if one.get_gid() == "spikes")
    assert len(dots.get_xdata()) == sum(map(len, make_spikes(trace)))
    assert np.unique(dots.get_xdata()) == pytest.approx([1, 3, 5, 7, 9])
