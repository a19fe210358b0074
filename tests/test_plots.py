import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from synthetic import make_trace

from tactile_fem.output import histories
from tactile_fem.output.histories import DISPLACEMENT, extrema
from tactile_fem.output.plots import PAPER, firing_figure, force_figure, raster_figure
from tactile_fem.study import Cylinder, Text

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


def test_firing_figure_shows_the_rates():
    rate = np.arange(12.0).reshape(3, 4)
    figure = firing_figure([0.0, 1.0, 2.0, 3.0], [-1.0, 0.0, 1.0], rate, [SQUARE])
    image = figure.axes[0].collections[0]
    assert np.array_equal(image.get_array(), rate)
    assert image.get_cmap().name == "cividis"
    assert "spikes/s" in figure.axes[1].get_ylabel()


def test_force_figure_has_press_slide_and_ratio():
    trace = make_trace()
    pressing, sliding = trace["time_s"] <= 1e-12, trace["time_s"] >= -1e-12
    figure = force_figure(
        (trace["depth_mm"][pressing], "Indentation (mm)", trace["force_N"][pressing]),
        (trace["displacement_mm"][sliding], DISPLACEMENT, trace["force_N"][sliding]),
        0.3,
    )
    press, slide, below, ratio = figure.axes
    assert line(press, "normal").get_xdata()[-1] == 1.97
    assert line(press, "normal").get_ydata()[-1] == pytest.approx(0.6)
    assert line(slide, "normal").get_xdata().tolist() == trace["displacement_mm"][7:].tolist()
    assert line(slide, "tangential").get_ydata()[-1] == pytest.approx(0.18)
    assert ratio.lines[0].get_ydata()[-1] == pytest.approx(0.3)
    assert "N" in press.get_ylabel() and "mm" in below.get_xlabel()


@pytest.mark.parametrize("steps", [0, 1, 5])
def test_force_figure_of_a_press_alone_and_of_nothing(steps):
    depth = np.linspace(1, 2, steps)
    force = np.outer(depth, [0.0, -0.1, 0.5])
    end = slice(max(steps - 1, 0), None)
    figure = force_figure(
        (depth, "Indentation (mm)", force), (0 * depth[end], DISPLACEMENT, force[end])
    )
    press, slide, below, ratio = figure.axes
    for label, values in (("normal", 0.5 * depth), ("tangential", 0.1 * depth)):
        assert np.array_equal(line(press, label).get_xydata(), np.column_stack([depth, values]))
        # Of the slide there is its beginning, the end of the press.
        assert np.array_equal(line(slide, label).get_ydata(), values[-1:])
    assert below.lines[0].get_ydata() == pytest.approx([0.2] * steps)
    assert len(ratio.lines) == 1 and ratio.get_legend() is None  # no friction was given
    figure.draw_without_rendering()
    assert all(low < high for axes in figure.axes for low, high in [axes.get_ylim()])


@pytest.mark.parametrize(
    ("sideways", "friction", "told"),
    [(0.3001, 0.3, False), (0.36, 0.3, True), (1e-6, 0.0, False), (0.05, 0.0, True)],
)
def test_force_figure_says_why_the_ratio_exceeds_the_friction(sideways, friction, told):
    depth, slide = np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, 1.0])
    force = np.array([[0, 0, 0], [0, 0, 0.5], [0.0, 0.5 * sideways, 0.5]])
    press = depth[:2], "Indentation (mm)", force[:2]
    *_, ratio = force_figure(press, (slide[1:], DISPLACEMENT, force[1:]), friction).axes
    (text,) = ratio.get_legend().get_texts()
    assert text.get_text().startswith("friction coefficient")
    assert ("flanks" in text.get_text()) == told


def test_figures_leave_the_users_style_alone():
    before = dict(mpl.rcParams)
    raster_figure([0.5], [0.0], [0.0, 1.0], (0.0, 1.0))
    assert dict(mpl.rcParams) == before


def test_letters_have_holes():
    def area(ring):
        x, y = ring.T
        return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))

    rings = histories.rings(Text(text="O"))
    assert len(rings) == 2
    assert area(rings[0][:-1]) > 0 > area(rings[1][:-1])
    assert histories.rings(Cylinder()) == []
    # Drawn, the O has a stroke, and its middle is as white as what is around it.
    around, middle = rings[0].min(axis=0) - 0.2, rings[1].mean(axis=0)
    stroke = (rings[0][rings[0][:, 0].argmin()] + rings[1][rings[1][:, 0].argmin()]) / 2
    ends = rings[0][:, 1].min() - 1, rings[0][:, 1].max() + 1
    figure = raster_figure([], [], np.arange(-6, 7), ends, rings)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[::-1, :, :3] / 255
    places = figure.axes[0].transData.transform([p[::-1] for p in (around, middle, stroke)])
    white, *drawn = [image[y, x] for x, y in places.astype(int)]
    assert white.tolist() == drawn[0].tolist() == [1, 1, 1]
    assert drawn[1] == pytest.approx(to_rgb(PAPER), abs=0.01)
