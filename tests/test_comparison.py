"""The scans of a series side by side."""

import numpy as np
import pytest
from PIL import Image
from synthetic import make_results, make_trace

from tactile_fem.cli import compute
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.histories import DISPLACEMENT, TIME
from tactile_fem.series import compare, comparison, numbers_of, sweep, write_comparison
from tactile_fem.simulation.results import Results

MEMBERS = sweep(["stimulus.friction=0.1,0.2,0.3"])


def series(folder, factors=(1.0, 1.5)):
    """Write scans of the first members, each with its forces larger by a factor."""
    for member, factor in zip(MEMBERS, factors, strict=False):
        trace = make_trace()
        trace["force_N"] = factor * trace["force_N"]
        make_results(folder / member.name, member.study, trace)
    return folder


def test_the_table_has_differences_to_the_first_scan(tmp_path):
    heading, first, second = compare(MEMBERS, series(tmp_path))
    assert heading[:2] == ["scan", "Pressed (N)"] and heading[-2:] == [
        "Central SED (kPa)",
        "Spikes",
    ]
    assert first[:2] == ["friction-0.1", "0.6"] and not any("%" in cell for cell in first)
    assert second[0] == "friction-0.2"
    assert second[1:4] == ["0.9 (+50 %)", "0.9 (+50 %)", f"{1.5 * float(first[3]):.3g} (+50 %)"]
    assert second[-1] == "105 (+0 %)"


def test_the_histories_have_common_axes(tmp_path):
    folder = series(tmp_path)
    scans = [Results(folder / member.name) for member in MEMBERS[:2]]
    figure = comparison.comparison_figure(["a", "b"], scans)
    normal, tangential, sed, spikes, table = figure.axes
    drawn = {line.get_label(): line for line in normal.lines}
    assert drawn["b"].get_ydata() == pytest.approx(1.5 * drawn["a"].get_ydata())
    assert drawn["a"].get_xdata() == pytest.approx(Abscissa.of(scans[0].trace).values)
    assert spikes.get_xlabel() == DISPLACEMENT
    assert [text.get_text() for text in normal.texts] == ["press", "slide"]
    (cells,) = table.tables
    assert cells[2, 0].get_text().get_text() == "b"
    assert len({axes.get_xlim() for axes in (normal, tangential, sed, spikes)}) == 1


def test_scans_at_different_speeds_have_the_time():
    slow = make_trace()
    slow["time_s"] = 2 * slow["time_s"]
    both = [Abscissa.of(trace) for trace in (make_trace(), slow)]
    over = comparison.common(both)
    assert over.label == TIME and over.phases == ()
    assert over.ends == pytest.approx((slow["time_s"][0], slow["time_s"][-1]))
    assert comparison.common(both[:1]).label == DISPLACEMENT


def test_a_sweep_shows_them_at_once(tmp_path, capsys):
    compute._show_comparison(MEMBERS, series(tmp_path))
    told = capsys.readouterr().out
    assert "friction-0.2" in told and "0.9 (+50 %)" in told
    with Image.open(tmp_path / "comparison.png") as image:
        assert min(image.size) > 500


def test_one_scan_is_not_compared(tmp_path):
    assert write_comparison(MEMBERS, series(tmp_path, (1.0,))) is None
    assert not (tmp_path / "comparison.png").exists()


def test_a_path_without_a_slide_has_its_largest_force(tmp_path):
    """As of a ball that is pressed and lifted off."""
    trace = {k: v if k == "receptors_mm" else v[:8] for k, v in make_trace().items()}
    back = {
        k: v
        if k == "receptors_mm"
        else np.vstack([v, v[-2::-1]])
        if v.ndim > 1
        else np.concatenate([v, v[-2::-1]])
        for k, v in trace.items()
    }
    back["time_s"][8:] = -back["time_s"][8:]
    numbers = numbers_of(make_results(tmp_path / "r", MEMBERS[0].study, back))
    assert numbers["normal_N"] == numbers["pressed_N"] == pytest.approx(0.6)
    assert numbers["central_largest_sed_kPa"] == pytest.approx(back["sed_kPa"][:, 10].max())
    assert numbers["spikes"] == 21 * 5
