"""The report is one HTML file that needs nothing else."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from synthetic import make_results, make_trace

from tactile_fem.cli import app as cli
from tactile_fem.errors import StudyError
from tactile_fem.series import fibre_image, single_fibre, sweep, write_summary
from tactile_fem.series.report import write_report
from tactile_fem.study import Study, Text


class Tags(HTMLParser):
    """Collects tags; raises where they do not match."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.seen.append(tag)
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def tags(path) -> list[str]:
    parser = Tags()
    parser.feed(path.read_text(encoding="utf-8"))
    assert not parser.open
    return parser.seen


def test_scan(tmp_path, capsys):
    results = make_results(tmp_path / "scan", Study(stimulus=Text(text="<G>")))
    assert cli.main(["report", str(results.folder)]) == 0
    path = results.folder / "report.html"
    assert str(path) in capsys.readouterr().out
    text = path.read_text(encoding="utf-8")
    assert "&lt;G&gt;" in text and "<G>" not in text
    assert "<td>pressed_N</td><td>0.6</td>" in text  # the normal force of the made-up trace
    assert tags(path).count("img") >= 4
    assert not re.search(r'(src|href)="(?!data:)', text)


def test_passes_over_one_receptor_are_one_image(tmp_path, monkeypatch):
    passes = single_fibre(Study(), spacing_mm=1.0, half_width_mm=2.0)
    for member in passes:
        make_results(tmp_path / member.name, member.study, make_trace(np.zeros(1)))
    write_summary(passes, tmp_path)
    images = []
    draw = lambda p, **k: images.append(fibre_image(p, **k)) or images[0]  # noqa: E731
    monkeypatch.setattr("tactile_fem.series.image.fibre_image", draw)
    found = tags(write_report(tmp_path, output=tmp_path / "passes.html"))
    assert found.count("tr") == 6 and found.count("img") == 2
    np.testing.assert_allclose(images[0].across_mm, [-2, -1, 0, 1, 2])
    assert (images[0].response.counts() > 0).all()


def test_passes_that_are_missing_are_counted(tmp_path):
    passes = single_fibre(Study(), spacing_mm=1.0, half_width_mm=2.0)
    for member in (*passes[:3], passes[4]):
        make_results(tmp_path / member.name, member.study, make_trace(np.zeros(1)))
    (tmp_path / f"{passes[3].name}.failed.txt").write_text("it did not converge\n")
    write_summary(passes, tmp_path)
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "4 of 5 scans are complete" in page and "it did not converge" in page
    assert "SA1: spikes in 4 of 5 passes over one receptor" in page


def test_a_population_among_the_passes(tmp_path):
    """As the demo of both protocols leaves them: figures of the passes, one of the population."""
    passes = single_fibre(Study(), spacing_mm=1.0, half_width_mm=1.0)
    for member in passes:
        receptors = np.zeros(1) if member.values["shift_mm"] else np.arange(-1, 2) * 1.0
        make_results(tmp_path / member.name, member.study, make_trace(receptors))
    write_summary(passes, tmp_path)
    assert tags(write_report(tmp_path)).count("img") == 3


def test_sweep_and_nothing(tmp_path):
    members = sweep(["stimulus.friction=0.1,0.2"])
    make_results(tmp_path / members[0].name, members[0].study, make_trace())
    write_summary(members, tmp_path)
    path = write_report(tmp_path)
    assert tags(path).count("img") == 1
    assert "not complete" in path.read_text(encoding="utf-8")
    assert "1 of 2 scans are complete" in path.read_text(encoding="utf-8")
    (tmp_path / "empty").mkdir()
    with pytest.raises(StudyError, match="holds no results"):
        write_report(tmp_path / "empty")
