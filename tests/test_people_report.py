"""What an ensemble tells: its tables are those of its scans, and every figure is written."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from synthetic import make_results, make_trace

from tactile_fem import Ensemble, Study
from tactile_fem.calibration.parameters import Parameter, powers_of
from tactile_fem.calibration.posterior import Posterior
from tactile_fem.people import people, run_people
from tactile_fem.people.report import write_report
from tactile_fem.series import Outcome, sweep
from tactile_fem.series.run import keep_reason
from tactile_fem.study import People


def ensemble(folder, number, conditions, factor, failed=()):
    """Return an ensemble whose forces and energies are `factor` of a scan times a trace's."""
    scans = people(conditions, number)
    for scan in scans:
        if scan.person in failed:
            keep_reason(Outcome(scan, "it did not converge.", 1.0), folder)
            continue
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
    lines = write_report(twice)
    (spread,) = [line.split() for line in lines if line.startswith("text-G: pressed_N")]
    assert spread[:6] == ["text-G:", "pressed_N", "3", "1.2", "1.2", "to"]
    assert "text-G after text-C, within people" in lines
    (pressed,) = [line for line in lines if line.startswith("  pressed_N")]
    assert "difference 0.6 " in pressed and "ratio 2 " in pressed and "in 3 of 3" in pressed
    assert any("needs 19" in line for line in lines)
    assert lines[-1] == f"3 people: the causes of the spread need {len(twice.names) + 2} or more"
    assert written(twice) == ["bands.png", "paired.png", "raster.png"]
    rows = read(tmp_path / "histories.csv")
    last = [r for r in rows if r["history"] == "normal_N" and r["condition"] == "text-G"][-1]
    assert (float(last["time_s"]), last["people"]) == (pytest.approx(0.5), "3")
    assert float(last["median"]) == float(last["low_90"]) == float(last["high_50"]) == 1.2
    assert (last["share_50"], last["share_90"], last["missing"]) == ("0.5", "0.5", "0")
    rate = [r for r in rows if r["history"] == "central_rate_Hz" and r["condition"] == "text-G"]
    spikes = np.trapezoid(*([float(r[name]) for r in rate] for name in ("median", "time_s")))
    assert spikes == pytest.approx(5, abs=0.05)  # of a receptor, as written to the scan
    places = read(tmp_path / "places.csv")
    assert len(places) == 2 * 21 and {row["median"] for row in places} == {"5"}
    assert [float(row["x_mm"]) for row in places[:2]] == [-5, -4.5]


def test_many_people_tell_the_cause(tmp_path):
    one = ensemble(tmp_path, 24, Study(), lambda s: np.exp(0.5 * s.scores["skin"]))
    lines = write_report(one)
    (cause,) = [line for line in lines if line.startswith("pressed_N") and "skin" in line]
    share = float(cause.split("skin ")[1].split(" %")[0])
    assert share > 90
    assert not any(line.endswith("within people") for line in lines)
    assert written(one) == ["bands.png", "causes.png", "raster.png"]


def test_people_who_failed_are_counted_with_their_reasons(tmp_path):
    """Of twenty, the two with the stiffest skin fail, in one of two conditions."""
    conditions = sweep(["stimulus.text=C,G"])
    skin = [scan.scores["skin"] for scan in people(conditions, 20)[::2]]
    failed = [f"person-{k + 1:03d}" for k in np.argsort(skin)[-2:]]
    found = ensemble(tmp_path, 20, conditions, lambda s: 1.0, failed)
    lines = write_report(found)
    assert lines[0] == "18 of 20 people are complete, 2 failed"
    assert f"  {failed[0]}_text-C: it did not converge." in lines
    assert any("a biased sample" in line for line in lines)
    (pressed,) = [line for line in lines if line.startswith("text-C: pressed_N")]
    assert "18 (2 without)" in pressed
    (paired,) = [line for line in lines if line.startswith("  pressed_N")]
    assert "2 left out" in paired
    (heading,) = [line for line in lines if line.startswith("number ") and "median" in line]
    assert "50 % of people" in heading and "89 % of people" in heading
    assert not any("90 % of people" in line for line in lines)
    for name in ("histories", "places"):
        row = read(tmp_path / f"{name}.csv")[-1]
        assert (row["people"], row["missing"], row["share_90"]) == ("18", "2", "0.895")
    assert written(found) == ["bands.png", "paired.png", "raster.png"]


def test_who_has_not_been_scanned_yet_has_not_failed(tmp_path):
    found = ensemble(tmp_path, 3, Study(), lambda s: 1.0)
    (tmp_path / "person-002" / "run.json").write_text('{"status": "stopped"}')
    lines = write_report(Ensemble.open(found.folder))
    assert lines[:2] == ["2 of 3 people are complete, 0 failed, 1 not scanned yet", ""]


def test_causes_of_a_fit_are_those_of_its_draws(tmp_path):
    """The first of two scores with r = 0.9, less half of the second: 86 and 14 %, see `causes`."""
    start, names = Study(), ("skin", "subcutaneous.C10_MPa")
    parameters = tuple(Parameter(name, powers_of(name, start), 3.0) for name in names)
    covariance = 0.04 * np.array([[1.0, 0.9], [0.9, 1.0]])
    Posterior.of(start, parameters, np.zeros(2), covariance).save(tmp_path / "posterior.json")
    fixed = [p for p in people(start, 1)[0].scores if p not in ("skin", "finger.size")]
    study = Study(people=People(fit=tmp_path / "posterior.json", fixed=tuple(fixed)))
    found = ensemble(
        tmp_path / "scans",
        40,
        study,
        lambda s: np.exp(0.3 * s.scores["skin"] - 0.15 * s.scores["subcutaneous.C10_MPa"]),
    )
    assert found.draws[:, 0] == pytest.approx(found.scores[:, 0])
    assert abs(np.corrcoef(found.draws[:, :2], rowvar=False)[0, 1]) < 0.1
    lines = write_report(found)
    (cause,) = [line for line in lines if line.startswith("pressed_N") and "skin" in line]
    first, second = (float(cause.split(f"{name} ")[1].split(" %")[0]) for name in names)
    assert first == pytest.approx(86, abs=4) and second == pytest.approx(14, abs=4)
    assert f"{names[1]}: its share beyond that of correlated values above" in lines
