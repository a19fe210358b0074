"""What an ensemble tells: its tables are those of its scans, and every figure is written."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from synthetic import make_results, make_trace

from tactile_fem import Ensemble, Study
from tactile_fem.people import people, run_people
from tactile_fem.people.report import tell
from tactile_fem.series import sweep


def ensemble(folder, number, conditions, factor):
    """Return an ensemble whose forces and energies are `factor` of a scan times a trace's."""
    scans = people(conditions, number)
    for scan in scans:
        trace = make_trace()
        for name in ("force_N", "sed_kPa"):
            trace[name] = factor(scan) * trace[name]
        make_results(folder / scan.name, scan.study, trace)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactile_fem.people.ensemble.run_series", lambda members, *_, **__: [])
        run_people(scans, folder)
    return Ensemble.open(folder)


def read(path):
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def written(found):
    return sorted(path.name for path in (found.folder / "figures").iterdir())


def test_few_people_in_two_conditions(tmp_path):
    twice = ensemble(
        tmp_path, 3, sweep(["stimulus.text=C,G"]), lambda s: 1.0 + (s.condition == "text-G")
    )
    lines = tell(twice)
    (spread,) = [line.split() for line in lines if line.startswith("text-G: pressed_N")]
    assert spread[:6] == ["text-G:", "pressed_N", "3", "1.2", "1.2", "to"]
    assert "text-G after text-C, within people" in lines
    (pressed,) = [line for line in lines if line.startswith("  pressed_N")]
    assert "difference 0.6 " in pressed and "ratio 2 " in pressed and "in 3 of 3" in pressed
    assert any("needs 19" in line for line in lines)
    assert lines[-1] == f"3 people: {len(twice.names) + 2} or more tell where the spread comes from"
    assert written(twice) == ["bands.png", "paired.png", "raster.png"]
    rows = read(tmp_path / "histories.csv")
    last = [r for r in rows if r["history"] == "normal_N" and r["condition"] == "text-G"][-1]
    assert (float(last["time_s"]), last["people"]) == (pytest.approx(0.5), "3")
    assert float(last["median"]) == float(last["low_90"]) == float(last["high_50"]) == 1.2
    rate = [r for r in rows if r["history"] == "central_rate_Hz" and r["condition"] == "text-G"]
    spikes = np.trapezoid(*([float(r[name]) for r in rate] for name in ("median", "time_s")))
    assert spikes == pytest.approx(5, abs=0.05)  # of a receptor, as written to the scan
    places = read(tmp_path / "places.csv")
    assert len(places) == 2 * 21 and {row["median"] for row in places} == {"5"}
    assert [float(row["x_mm"]) for row in places[:2]] == [-5, -4.5]


def test_many_people_tell_the_cause(tmp_path):
    one = ensemble(tmp_path, 24, Study(), lambda s: np.exp(0.5 * s.scores["skin"]))
    lines = tell(one)
    (cause,) = [line for line in lines if line.startswith("pressed_N") and "skin" in line]
    share = float(cause.split("skin ")[1].split(" %")[0])
    assert share > 90
    assert not any(line.endswith("within people") for line in lines)
    assert written(one) == ["bands.png", "causes.png", "raster.png"]
