"""What studies and results look like in a notebook, and how studies differ."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from synthetic import make_results, make_spikes, make_trace

from tactile_fem.results.results import Results
from tactile_fem.runtime.differences import brief, differences
from tactile_fem.study import Hold, Lift, Press, Protocol, Sphere, Study, Text

HOLD = Protocol(path=(Press(depth_mm=1), Hold(time_s=1), Lift()))


def cells(html: str) -> list[list[str]]:
    """Return the rows of the tables."""
    return [re.findall(r"<t[hd]>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>.*?</tr>", html)]


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"stimulus": Text(text="G")}, [("stimulus.text", "G", "FGH")]),
        (
            {"stimulus": Sphere(radius_mm=4)},
            [("stimulus.kind", "sphere", "text"), ("stimulus.radius_mm", 4.0, None)],
        ),
        (
            {"protocol": HOLD.model_copy(update={"path": (*HOLD.path[:2], Press(depth_mm=2))})},
            [
                ("protocol.path (entry 3).kind", "press", "lift"),
                ("protocol.path (entry 3).depth_mm", 2.0, 0.0),
                ("protocol.path (entry 3).direction", (0.0, 0.0, 1.0), None),
            ],
        ),
        ({"protocol": Protocol()}, [("protocol.path", None, HOLD.path)]),
        ({}, []),
    ],
)
def test_the_keys_that_differ(changes, found):
    before = Study(protocol=HOLD)
    assert list(differences(before.model_copy(update=changes), before)) == found


def test_values_in_few_words():
    assert brief(HOLD.path) == "press depth_mm = 1; hold time_s = 1; lift"
    assert [brief(value) for value in (None, True, 0.5, (1.0, 2.0), "G")] == [
        *("not set", "true", "0.5", "[1, 2]", "G")
    ]
    assert brief("x" * 70) == "x" * 57 + "..."
    assert brief(Path("/" + "a" * 70 + "/map.npy")).endswith("a/map.npy")


def test_a_study_shows_what_is_not_the_papers():
    html = Study(stimulus=Text(text="<G>"), protocol=HOLD)._repr_html_()
    assert cells(html) == [
        ["key", "value", "default"],
        ["stimulus.text", "&lt;G&gt;", "FGH"],
        ["protocol.path", brief(HOLD.path), "not set"],
    ]
    assert "As by default: finger, tissue, receptors, neuron, solver, output." in html
    assert cells(Study()._repr_html_()) == []


def test_a_table_of_a_study_shows_what_its_keys_mean():
    rows = cells(Protocol(force_N=0.6)._repr_html_())
    assert ["speed_mm_s", "20", "paper: speed of the slide"] in rows
    assert [row[0] for row in rows[1:]] == list(Protocol.model_fields)


def test_results_show_numbers_and_rasters(tmp_path):
    study = Study(afferents=[{"name": "SA1"}, {"name": "RA", "kind": "RA"}])
    trace = make_trace()
    trace["population"] = np.repeat(["SA1", "RA"], [11, 10])
    results = make_results(tmp_path / "<r>", study, trace)
    html = results._repr_html_()
    rows = dict(cells(html))
    assert rows["status"] == "complete" and rows["path"] == "0.599 s, 57 steps"
    assert rows["force at the end of the press"] == "0.6 N"
    assert rows["spikes"] == "SA1 55 from 11 receptors; RA 50 from 10 receptors"
    assert "&lt;r&gt;" in html and html.count('src="data:image/png;base64,') == 1
    assert len(html) < 400_000 and not results.figures.exists()
    assert "There is no" in Results(tmp_path / "none")._repr_html_()


def test_results_in_memory_show_the_same(tmp_path):
    pytest.importorskip("tactile_fem.runtime.backend")
    from tactile_fem.neuron import Response
    from tactile_fem.results.trace import Trace
    from tactile_fem.simulation.scan_result import ScanResult

    results = make_results(tmp_path / "r")
    trace = Trace.read(results.trace)
    response = Response(make_spikes(trace.arrays()), *trace.time_s[[0, -1]])
    in_memory = ScanResult(trace, response, None, Study())
    assert cells(in_memory._repr_html_()) == cells(results._repr_html_())
    assert ScanResult(trace, response, tmp_path / "r", Study())._repr_html_().count("<img") == 1
    assert repr(in_memory).splitlines() == [
        "ScanResult",
        "  folder: none, in memory",
        "  path: 0.599 s, 57 steps",
        f"  largest normal force: {results.trace['force_N'][:, 2].max():.3g} N",
        f"  largest SED: {results.trace['sed_kPa'].max():.3g} kPa",
        f"  spikes: {len(results.spikes.time_s)} from 21 receptors",
    ]
