"""Scans side by side."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from synthetic import make_results, make_section, make_trace

from tactile_fem.cli import app as cli
from tactile_fem.cli import compute
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.results.histories import DISPLACEMENT, TIME
from tactile_fem.series import compare, comparison, numbers_of, sweep
from tactile_fem.study import Study

MEMBERS = sweep(["stimulus.friction=0.1,0.2,0.3"])


def series(folder, factors=(1.0, 1.5)):
    """Write scans of the first members, each with its forces larger by a factor."""
    scans = {}
    for member, factor in zip(MEMBERS, factors, strict=False):
        trace = make_trace()
        trace["force_N"] = factor * trace["force_N"]
        scans[member.name] = make_results(folder / member.name, member.study, trace)
    return scans


def with_ra(folder):
    """Write a scan whose last three receptors are RA; their middle one is central."""
    trace = make_trace()
    names = np.repeat(["SA1", "RA"], [len(trace["receptors_mm"]) - 3, 3])
    study = Study(afferents=[{"name": "SA1"}, {"name": "RA", "kind": "RA"}])
    return make_results(folder, study, {**trace, "population": names})


def test_the_table_has_differences_to_the_first_scan(tmp_path):
    heading, first, second = compare(series(tmp_path))
    assert heading[:2] == ["scan", "Pressed (N)"] and heading[-2:] == [
        "Central SED (kPa)",
        "Spikes",
    ]
    assert first[:2] == ["friction-0.1", "0.6"] and not any("%" in cell for cell in first)
    assert second[0] == "friction-0.2"
    assert second[1:4] == ["0.9 (+50 %)", "0.9 (+50 %)", f"{1.5 * float(first[3]):.3g} (+50 %)"]
    assert second[-1] == "105 (+0 %)"


def test_each_population_has_its_spikes(tmp_path):
    scans = {"both": with_ra(tmp_path / "both"), **series(tmp_path, (1.0,))}
    heading, both, one = compare(scans)
    assert heading[-2:] == ["SA1 spikes", "RA spikes"]
    assert both[-2:] == ["90", "15"] and one[-2:] == ["105 (+17 %)", "\N{EN DASH}"]
    figure = comparison.comparison_figure(scans)
    *_, sed, sa1, ra, _ = figure.axes
    assert sed.get_ylabel() == "SED of the central\nSA1 receptor (kPa)"
    assert [axes.get_ylabel().split()[-1] for axes in (sa1, ra)] == ["SA1", "RA"]
    ticks = [sum(line.get_marker() == "|" for line in axes.lines) for axes in (sa1, ra)]
    assert ticks == [2, 1]


def test_counts_are_whole(tmp_path):
    (scan,) = series(tmp_path, (1.0,)).values()
    scan.save_spikes([np.linspace(0.01, 0.4, 60)] * 21, SimpleNamespace(**scan.trace))
    assert compare({"a": scan})[1][-1] == "1260"


def test_a_section_and_a_solid_have_columns_of_their_own(tmp_path):
    scans = series(tmp_path, (1.0,)) | {"section": make_section(tmp_path / "section")}
    heading, solid, section = compare(scans)
    assert heading[1:3] == ["Pressed (N)", "Pressed (N/mm)"]
    assert solid[1:3] == ["0.6", "\N{EN DASH}"] and section[1:3] == ["\N{EN DASH}", "0.6"]
    assert comparison.comparison_figure(scans).axes[0].get_ylabel() == "Normal (N or N/mm)"


def test_the_histories_have_common_axes(tmp_path):
    a, b = series(tmp_path).values()
    figure = comparison.comparison_figure({"a": a, "b": b})
    normal, tangential, sed, spikes, table = figure.axes
    drawn = {line.get_label(): line for line in normal.lines}
    assert drawn["b"].get_ydata() == pytest.approx(1.5 * drawn["a"].get_ydata())
    assert drawn["a"].get_xdata() == pytest.approx(Abscissa.of(a.trace).values)
    assert spikes.get_xlabel() == DISPLACEMENT
    assert [text.get_text() for text in normal.texts] == ["press", "slide"]
    (cells,) = table.tables
    assert cells[2, 1].get_text().get_text() == "b"
    assert cells[2, 0].get_text().get_color() == drawn["b"].get_color()
    assert table.get_position().x1 == pytest.approx(normal.get_position().x1)
    assert len({axes.get_xlim() for axes in (normal, tangential, sed, spikes)}) == 1


@pytest.mark.parametrize("name", ["b", "friction-0.1_depth_mm-1.97_tangential"])
def test_cells_of_the_table_do_not_overlap(tmp_path, name):
    scan = with_ra(tmp_path)
    figure = comparison.comparison_figure({"a": scan, name: scan})
    figure.draw_without_rendering()
    for cell in figure.axes[-1].tables[0].get_celld().values():
        text, box = cell.get_text().get_window_extent(), cell.get_window_extent()
        assert box.x0 <= text.x0 and text.x1 <= box.x1


def test_scans_at_different_speeds_have_the_time():
    slow = make_trace()
    slow["time_s"] = 2 * slow["time_s"]
    both = [Abscissa.of(trace) for trace in (make_trace(), slow)]
    over = comparison.common(both)
    assert over.label == TIME and over.phases == ()
    assert over.ends == pytest.approx((slow["time_s"][0], slow["time_s"][-1]))
    assert comparison.common(both[:1]).label == DISPLACEMENT


def test_a_sweep_shows_them_at_once(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(compute, "_run_series", lambda *args: [])
    command = ["sweep", "--over", "stimulus.friction=0.1,0.2,0.3", "--results", str(tmp_path)]
    series(tmp_path, (1.0,))
    assert cli.main(command) == 0
    assert not (tmp_path / "comparison.png").exists()  # of one scan
    series(tmp_path / "more")
    assert cli.main([*command[:-1], str(tmp_path / "more")]) == 0
    told = capsys.readouterr().out
    assert "friction-0.2" in told and "0.9 (+50 %)" in told
    with Image.open(tmp_path / "more" / "comparison.png") as image:
        assert min(image.size) > 500


def test_any_scans_are_compared(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    series(Path("a")), series(Path("b"))
    folders = ["a/friction-0.1", "b/friction-0.1", "b/friction-0.2/"]
    assert cli.main(["compare", *folders]) == 0
    told = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in told[1:-1]] == [*folders[:2], "friction-0.2"]
    assert "0.9 (+50 %)" in told[3] and told[-1] == "Written to comparison.png"
    assert Path("comparison.png").is_file()


def test_what_cannot_be_compared_is_refused_in_a_sentence(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, second = series(Path()).values()
    second.save_run({"status": "running"})
    Path("empty").mkdir()
    one, other = str(first.folder), str(second.folder)
    for arguments, sentence in (
        ([], "A comparison needs the folders of two or more scans."),
        ([one], "A comparison needs the folders of two or more scans."),
        ([one, f"./x/../{one}"], f"{one} is given twice: name each scan once."),
        ([one, "empty"], "empty holds no results: there is no study.toml in it."),
        ([one, other], f"The scan in {other} is not complete: resume it first."),
        ([one, other, "-o", "a.pdf"], '--output is "a.pdf" but must end in .png.'),
    ):
        assert cli.main(["compare", *arguments]) == 2
        assert capsys.readouterr().err == f"tactile-fem: {sentence}\n"
    assert not Path("comparison.png").exists()


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
