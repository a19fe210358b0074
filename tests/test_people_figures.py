"""Figures of people: what is drawn is what was computed, and no text covers another one."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.axis import Tick, XTick
from matplotlib.colors import same_color
from matplotlib.text import Text

from tactile_fem.output.abscissa import Abscissa, Phase
from tactile_fem.output.annotations import BLUE, DISTINCT, VERMILION
from tactile_fem.people.bands import bands
from tactile_fem.people.causes import REST, causes
from tactile_fem.people.figures import bands_figure, causes_figure, paired_figure, people_raster
from tactile_fem.results.histories import DISPLACEMENT

AT = np.linspace(-2, 10, 61)
OVER = Abscissa(DISPLACEMENT, 20.0, AT, (Phase("press", -2, 0), Phase("slide", 0, 10)))
RNG = np.random.default_rng(0)
SIZE = np.exp(0.4 * RNG.standard_normal(20))
FORCE = 0.6 * SIZE[:, None] * np.clip((AT + 2) / 2, 0, 1)
NAMES = ["dermis.C10_MPa", "thickness of the skin", "friction"]
SCORES = RNG.standard_normal((40, 3))
LABELS = ("Normal (N)", "SED of the central\nSA1 receptor (kPa)")
WIDEST_INCHES = 3.7


def histories(*factors):
    names = ("G", "smooth ridge")
    return {label: {n: f * FORCE for n, f in zip(names, factors, strict=False)} for label in LABELS}


def assert_legible(figure):
    """Texts lie within a figure as wide as a column, apart from one another."""
    figure.draw_without_rendering()
    assert figure.get_figwidth() <= WIDEST_INCHES
    shown = [text for text in figure.findobj(Text) if text.get_text().strip()]
    hidden = beyond_the_axes(figure)
    shown = [text for text in shown if text.get_visible() and text not in hidden]
    boxes = [text.get_window_extent() for text in shown]
    whole = figure.bbox.padded(1)
    for text, box in zip(shown, boxes, strict=True):
        assert whole.containsx(box.x0) and whole.containsx(box.x1), text
        assert whole.containsy(box.y0) and whole.containsy(box.y1), text
        assert text.get_fontsize() >= 7, text
    for (one, a), (other, b) in combinations(zip(shown, boxes, strict=True), 2):
        assert not a.overlaps(b), (one, other)


def beyond_the_axes(figure):
    """Return the labels of ticks outside the limits: they are made but not drawn."""
    labels = []
    for tick in figure.findobj(Tick):
        axis = tick.axes.xaxis if isinstance(tick, XTick) else tick.axes.yaxis
        low, high = sorted(axis.get_view_interval())
        if not low - 1e-6 <= tick.get_loc() <= high + 1e-6:
            labels += [tick.label1, tick.label2]
    return labels


def test_bands_are_drawn_under_the_median():
    figure = bands_figure(histories(1.0), OVER)
    normal, sed = figure.axes
    assert (normal.get_ylabel(), sed.get_ylabel()) == LABELS
    expected = bands(FORCE)
    (median,) = (line for line in normal.lines if len(line.get_xdata()) == len(AT))
    assert median.get_ydata() == pytest.approx(expected.median)
    widest, narrow = (band.get_paths()[0].vertices[:, 1] for band in normal.collections)
    for drawn, k in ((widest, 1), (narrow, 0)):
        assert drawn.max() == pytest.approx(expected.high[k].max())
    assert widest.max() > narrow.max() > median.get_ydata().max()
    (legend,) = figure.legends
    texts = [text.get_text() for text in legend.get_texts()]
    assert texts == ["median", "50 % of people", "90 % of people"]
    assert legend.get_title().get_text() == "20 of 20 people"
    assert_legible(figure)


def test_conditions_have_colours_and_the_legend_what_the_fewest_people_allow():
    both = histories(1.0, 1.6)
    both["Normal (N)"]["smooth ridge"] = 1.6 * FORCE[:9]
    figure = bands_figure(both, OVER)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["G", "smooth ridge", "median", "50 % of people", "80 % of people"]
    assert figure.legends[0].get_title().get_text() == "9 to 20 of 20 people"
    colours = [line.get_color() for line in figure.axes[0].lines if len(line.get_xdata()) > 2]
    assert colours == list(DISTINCT[:2])
    assert_legible(figure)


def test_the_raster_is_ordered_and_counts_who_is_missing():
    spikes = [np.full(k, float(k)) for k in range(1, 9)]
    spikes[2] = None
    order = np.array([3, 1, 0, 7, 6, 5, 8, 2.0])
    figure = people_raster(spikes, OVER, order, "Normal force (N)")
    raster, beside = figure.axes
    (drawn,) = [line for line in raster.lines if line.get_gid() == "spikes"]
    assert np.bincount(drawn.get_ydata()).tolist() == [2, 8, 1, 6, 5, 4, 7]
    (dots,) = beside.lines
    assert dots.get_xdata().tolist() == [1, 2, 3, 5, 6, 7, 8]
    assert raster.get_ylabel() == "7 people\n(1 without a scan)"
    assert raster.get_ylim() == beside.get_ylim()
    assert_legible(figure)


def test_many_people_fit_on_a_page():
    figure = people_raster([AT[:3]] * 200, OVER, np.arange(200.0), "Normal force (N)")
    assert figure.get_figheight() < 7
    assert_legible(figure)


def test_causes_are_bars_with_intervals():
    force = causes(SCORES, NAMES, SCORES @ [0.3, 1.0, 0.0])
    rate = causes(SCORES, NAMES, SCORES @ [0.0, 0.2, 0.8] + 0.3 * RNG.standard_normal(40))
    figure = causes_figure({"normal force": force, "rate": rate})
    (axes,) = figure.axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == [REST, "dermis.C10_MPa", "friction", "thickness of the skin"]
    assert axes.get_xlabel() == "Share of the variance (%), 40 people"
    for bars, own in zip(axes.containers[::2], (force, rate), strict=True):
        widths = [bar.get_width() for bar in bars.patches]
        expected = [own.rest, *(own.shares[name] for name in names[1:])]
        assert widths == pytest.approx([100 * share.value for share in expected])
    assert_legible(figure)
    alone = causes_figure({"normal force": force})
    assert not alone.legends
    assert_legible(alone)


def test_a_number_without_causes_is_drawn_too():
    none = causes(SCORES, NAMES, np.ones(40))
    assert_legible(causes_figure({"spikes": none}))


def test_a_line_joins_the_values_of_each_person():
    first, second = [1.0, 2.0, 3.0, 2.0, np.nan], [2.0, 3.0, 2.5, 2.2, 5.0]
    figure = paired_figure(first, second, ("one fibre", "population"), "Correlation")
    (axes,) = figure.axes
    *lines, medians = axes.lines
    assert [line.get_ydata().tolist() for line in lines] == [[1, 2], [2, 3], [3, 2.5], [2, 2.2]]
    drawn = [line.get_color() for line in lines]
    assert all(map(same_color, drawn, [BLUE, BLUE, VERMILION, BLUE]))
    assert medians.get_ydata().tolist() == [2, 2.35]
    assert axes.get_title() == "higher in 75 % of 4 people\n(95 % interval 19 to 99 %)"
    assert [label.get_text() for label in axes.get_xticklabels()] == ["one fibre", "population"]
    assert_legible(figure)
