import matplotlib as mpl
import numpy as np
import pytest
from synthetic import make_trace

from tactile_fem.output.histories import DISPLACEMENT, extrema
from tactile_fem.output.plots import force_figure


def line(axes, label):
    return next(one for one in axes.lines if one.get_label() == label)


def test_extrema_are_found_and_wiggles_are_not():
    x = np.linspace(0, 4 * np.pi, 400)
    highs, lows = extrema(np.sin(x) + 0.01 * np.sin(40 * x))
    assert x[highs] == pytest.approx([np.pi / 2, 5 * np.pi / 2], abs=0.2)
    assert x[lows] == pytest.approx([3 * np.pi / 2, 7 * np.pi / 2], abs=0.2)
    for nothing in ([], [1.0], np.ones(10)):
        assert all(len(found) == 0 for found in extrema(nothing))


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
    force_figure(([0.5], "", np.ones((1, 3))), ([0.5], "", np.ones((1, 3))))
    assert dict(mpl.rcParams) == before
