import matplotlib as mpl
import numpy as np
import pytest
from synthetic import make_trace

from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.plots import force_figure
from tactile_fem.results.histories import DISPLACEMENT, extrema


def line(axes, label):
    return next(one for one in axes.lines if one.get_label() == label)


def test_extrema_are_found_and_wiggles_are_not():
    x = np.linspace(0, 4 * np.pi, 400)
    highs, lows = extrema(np.sin(x) + 0.01 * np.sin(40 * x))
    assert x[highs] == pytest.approx([np.pi / 2, 5 * np.pi / 2], abs=0.2)
    assert x[lows] == pytest.approx([3 * np.pi / 2, 7 * np.pi / 2], abs=0.2)
    for nothing in ([], [1.0], np.ones(10)):
        assert all(len(found) == 0 for found in extrema(nothing))


def test_forces_have_press_path_and_ratio():
    trace = make_trace()
    press, path, below, ratio = force_figure(trace, Abscissa.of(trace), 0.3).axes
    assert line(press, "normal").get_xdata()[-1] == 1.97
    assert line(press, "normal").get_ydata()[-1] == pytest.approx(0.6)
    assert line(path, "normal").get_xdata()[7:] == pytest.approx(trace["displacement_mm"][7:])
    assert line(path, "tangential").get_ydata()[-1] == pytest.approx(0.18)
    assert ratio.lines[0].get_ydata()[-1] == pytest.approx(0.3)
    assert "N" in press.get_ylabel() and below.get_xlabel() == "Indentation (mm)"
    assert ratio.get_xlabel() == DISPLACEMENT


@pytest.mark.parametrize("steps", [1, 5])
def test_forces_of_a_press_alone(steps):
    trace = {name: values[:steps] for name, values in make_trace().items()}
    trace["depth_mm"] = depth = np.linspace(1, 2, steps)
    trace["force_N"] = np.outer(depth, [0.0, -0.1, 0.5])
    figure = force_figure(trace, Abscissa.of(trace))
    press, path, below, ratio = figure.axes
    for label, values in (("normal", 0.5 * depth), ("tangential", 0.1 * depth)):
        assert np.array_equal(line(press, label).get_xydata(), np.column_stack([depth, values]))
        assert np.array_equal(line(path, label).get_ydata(), values)
    assert below.lines[0].get_ydata() == pytest.approx([0.2] * steps)
    assert ratio.get_legend() is None  # no friction was given
    figure.draw_without_rendering()
    assert all(low < high for axes in figure.axes for low, high in [axes.get_ylim()])


@pytest.mark.parametrize(
    ("sideways", "friction", "told"),
    [(0.3001, 0.3, False), (0.36, 0.3, True), (1e-6, 0.0, False), (0.05, 0.0, True)],
)
def test_forces_say_why_the_ratio_exceeds_the_friction(sideways, friction, told):
    trace = make_trace()
    trace["force_N"] = np.outer(trace["depth_mm"] / 1.97, [0.0, 0.0, 0.5])
    trace["force_N"][-1, 1] = 0.5 * sideways
    *_, ratio = force_figure(trace, Abscissa.of(trace), friction).axes
    (text,) = ratio.get_legend().get_texts()
    assert text.get_text().startswith("friction coefficient")
    assert ("flanks" in text.get_text()) == told


def test_figures_leave_the_users_style_alone():
    before, trace = dict(mpl.rcParams), make_trace()
    force_figure(trace, Abscissa.of(trace))
    assert dict(mpl.rcParams) == before
