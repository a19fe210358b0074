"""People: what varies between them, who is drawn, and what an ensemble's folder gives."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from synthetic import make_results, make_trace

from tactile_fem import Ensemble
from tactile_fem.calibration.parameters import Parameter, powers_of, with_values
from tactile_fem.calibration.posterior import Posterior
from tactile_fem.cli import app as cli
from tactile_fem.errors import StudyError
from tactile_fem.people import people, run_people
from tactile_fem.people.draw import standard_scores
from tactile_fem.people.settings import PRIORS
from tactile_fem.people.spread import Varied
from tactile_fem.series import numbers_of, sweep
from tactile_fem.study import Finger, Output, People, Plate, Protocol, Receptors, Study
from tactile_fem.study.file import dump_study, load_study

# --- names ---------------------------------------------------------------------------------------


def test_the_size_of_a_finger_is_that_of_all_its_lengths_but_ridges():
    keys = {key for _, key in powers_of("finger.size", Study())}
    lengths = {key for key in Study().finger.model_dump() if key.endswith("_mm")}
    other = {"smooth_mm", "file_unit_mm", "contact_mm", "pad_size_mm", "far_size_mm"}
    assert keys == {key for key in lengths - other if not key.startswith(("ridge", "papilla"))}
    meshed = Study(finger=Finger(pad_size_mm=2.0))
    assert ("finger", "pad_size_mm") in powers_of("finger.size", meshed)
    scanned = Study(finger=Finger(skin_file=Path("a.stl"), contact_mm=(1.0, 0.0, -2.0)))
    keys = set(powers_of("finger.size", scanned))
    assert ("finger", "half_width_mm") not in keys
    assert {("finger", "file_unit_mm"), ("finger", "contact_mm", "2")} <= keys


@pytest.mark.parametrize(
    ("study", "name", "keys"),
    [
        ({}, "stimulus.friction", ["stimulus.friction"]),
        (
            {"stimulus": {"friction": {"law": "kinetic", "static": 1, "kinetic": 0.5}}},
            "stimulus.friction",
            ["stimulus.friction.static", "stimulus.friction.kinetic"],
        ),
        ({}, "SA1.threshold_mV", ["neuron.threshold_mV"]),
        (
            {"afferents": [{"name": "fast", "kind": "RA"}]},
            "fast.gain",
            ["afferents.fast.neuron.filter_gain_pA"],
        ),
        (
            {"neuron": {"model": "gerling2018"}},
            "SA1.gain",
            [f"neuron.generator_gains_pA_per_kPa.{k}" for k in range(4)],
        ),
        ({}, "protocol.depth_mm", ["protocol.depth_mm"]),
    ],
)
def test_a_name_reaches_any_number_above_0(study, name, keys):
    if "stimulus" in study:
        study["stimulus"]["friction"]["speed_mm_s"] = 5.0
    study = Study.model_validate({**study, "people": {"fixed": [], "spread": {name: 1.5}}})
    varied = Varied.of(study)
    assert [".".join(key) for key in varied.parameters[name].powers] == keys
    changed, _ = varied.person({**dict.fromkeys(varied.parameters, 0.0), name: 1.0})
    before, after = (dict(flat(one.model_dump(mode="json"))) for one in (varied.study, changed))
    differs = {key: after[key] / before[key] for key in before if after[key] != before[key]}
    assert differs == pytest.approx(dict.fromkeys(keys, 1.5))


def flat(value, start=""):
    if isinstance(value, dict):
        entries = value.items()
    elif isinstance(value, list):
        named = ((e.get("name", k) if isinstance(e, dict) else k, e) for k, e in enumerate(value))
        entries = list(named)
    else:
        yield start, value
        return
    for key, entry in entries:
        yield from flat(entry, f"{start}.{key}" if start else str(key))


def test_what_a_study_does_not_have_does_not_vary(small_finger):
    study = Study(finger=Finger(mesh_file=small_finger), stimulus=Plate(friction=0.0))
    assert list(Varied.of(study).parameters) == [
        "skin",
        "subcutaneous",
        "SA1.gain",
        "SA1.threshold_mV",
    ]
    assert set(Varied.of(Study()).parameters) == {*PRIORS, "SA1.gain", "SA1.threshold_mV"}


def test_a_layer_takes_its_room_from_the_tissue_below():
    layer = Parameter("finger.dermis", powers_of("finger.dermis", Study()), 1.2)
    finger = with_values(Study(), [layer], [0.02]).finger
    assert finger.dermis_mm == pytest.approx(0.8 * np.exp(0.02))
    assert finger.pad_thickness_mm == pytest.approx(Study().finger.pad_thickness_mm, abs=2e-4)


# --- distributions -------------------------------------------------------------------------------


def only(**spread):
    """Return a study in which nothing else than this varies."""
    known = {*PRIORS, "SA1.gain", "SA1.threshold_mV"} - spread.keys()
    return Study(people=People(fixed=tuple(known), spread=spread))


def test_values_have_the_stated_distributions():
    study = only(
        **{
            "finger.dermis_mm": {"sd": 0.1},
            "stimulus.friction": {"low": 0.1, "high": 0.9},
            "skin": 1.5,
        }
    )
    scans = people(study, 256)
    value = {name: np.array([scan.values[name] for scan in scans]) for name in scans[0].values}
    assert list(value) == ["finger.dermis_mm", "stimulus.friction", "skin"]
    assert value["finger.dermis_mm"].mean() == pytest.approx(0.8, abs=1e-3)
    assert value["finger.dermis_mm"].std() == pytest.approx(0.1, rel=0.02)
    assert np.sort(value["stimulus.friction"]) == pytest.approx(
        np.linspace(0.1, 0.9, 256), abs=0.01
    )
    assert np.log(value["skin"]).std() == pytest.approx(np.log(1.5), rel=0.02)
    assert np.log(value["skin"]).mean() == pytest.approx(0.0, abs=0.01)
    for scan in scans[:5]:
        assert scan.study.finger.dermis_mm == pytest.approx(scan.values["finger.dermis_mm"], 1e-5)
        ratio = scan.study.tissue.epidermis.C10_MPa / study.tissue.epidermis.C10_MPa
        assert ratio == pytest.approx(scan.values["skin"], rel=1e-5)


@pytest.mark.parametrize("number", [1, 5, 8, 13])
def test_the_first_of_a_larger_ensemble_are_a_smaller_one(number):
    assert people(Study(), 20)[:number] == people(Study(), number)


def test_scores_are_evenly_spread_and_seeded():
    scores = standard_scores(64, 3, seed=1)
    for column in scores.T:  # one in each 64th of the distribution
        assert len(np.unique(np.floor(64 * normal_cdf(column)))) == 64
    assert np.all(np.abs(np.corrcoef(scores.T) - np.eye(3)) < 0.1)
    assert not np.allclose(scores, standard_scores(64, 3, seed=2))


def normal_cdf(values):
    from scipy.special import ndtr

    return ndtr(values)


def test_what_is_fixed_changes_nobody_else():
    free, fixed = people(Study(), 3), people(Study(people=People(fixed=("skin",))), 3)
    for one, other in zip(free, fixed, strict=True):
        assert {**other.scores, "skin": one.scores["skin"]} == one.scores
        assert other.study.tissue.dermis == Study().tissue.dermis != one.study.tissue.dermis


def test_a_person_is_a_usual_study(tmp_path):
    (scan,) = people(Study(people=People(seed=3)), 1)
    assert (scan.name, scan.study.people) == ("person-001", None)
    path = tmp_path / "study.toml"
    path.write_text(dump_study(scan.study))
    assert load_study(path) == scan.study


# --- a fit ---------------------------------------------------------------------------------------


@pytest.fixture
def fitted(tmp_path) -> Posterior:
    """What a fit has found, and its file in the folder."""
    start, names = Study(), ("skin", "subcutaneous.C10_MPa", "finger.pad_radius_mm")
    sd = np.array([0.2, 0.5, 0.1])
    correlation = np.array([[1.0, -0.8, 0.3], [-0.8, 1.0, 0.0], [0.3, 0.0, 1.0]])
    parameters = tuple(Parameter(name, powers_of(name, start), 3.0) for name in names)
    found = Posterior.of(
        start, parameters, np.array([0.1, -0.3, 0.2]), correlation * np.outer(sd, sd)
    )
    found.save(tmp_path / "posterior.json")
    return found


def test_a_posterior_comes_back_from_its_file(fitted, tmp_path):
    again = Posterior.load(tmp_path / "posterior.json", "it")
    assert again.parameters == fitted.parameters and again.start == fitted.start
    np.testing.assert_array_equal(again.x, fitted.x)
    np.testing.assert_array_equal(again.covariance, fitted.covariance)


def test_a_fit_takes_the_place_of_the_shipped_spread(fitted, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('[finger]\npad_radius_mm = 20.0\n[people]\nfit = "posterior.json"\n')
    study = load_study(path)
    varied = Varied.of(study)
    # Of subcutaneous tissue the fit has one constant only: the others vary as shipped.
    assert list(varied.parameters)[:4] == [*(p.name for p in fitted.parameters), "finger.size"]
    assert varied.study.finger.pad_radius_mm == pytest.approx(29.0 * np.exp(0.2))
    scans = people(study, 512)
    logs = np.log([[scan.values[p.name] for p in fitted.parameters] for scan in scans])
    assert np.cov(logs.T) == pytest.approx(fitted.covariance, abs=0.01)
    middle = [0.0, np.log(Study().tissue.subcutaneous.C10_MPa) - 0.3, np.log(29.0) + 0.2]
    assert logs.mean(axis=0) == pytest.approx(middle, abs=0.02)
    scores = np.array([list(scan.scores.values()) for scan in scans])
    assert np.corrcoef(scores.T)[:3, :3] == pytest.approx(fitted.correlation, abs=0.03)
    assert scores.std(axis=0) == pytest.approx(np.ones(scores.shape[1]), abs=0.03)
    assert "people.fit" in study.files() and "people.fit" not in scans[0].study.files()


def test_the_draws_behind_correlated_scores_are_kept(fitted, tmp_path):
    """Independent, and with what a fixed one shares with others among theirs."""
    fit = tmp_path / "posterior.json"
    for fixed in ((), ("subcutaneous.C10_MPa",)):
        scans = people(Study(people=People(fit=fit, fixed=fixed)), 512)
        names = [p.name for p in fitted.parameters if p.name not in fixed]
        draws = np.array([[scan.draws[name] for name in names] for scan in scans])
        scores = np.array([[scan.scores[name] for name in names] for scan in scans])
        assert list(scans[0].draws) == names
        assert np.cov(draws.T) == pytest.approx(np.eye(len(names)), abs=0.03)
        assert draws[:, 0] == pytest.approx(scores[:, 0])
        r = fitted.correlation[0, 1 + len(fixed)]
        second = r * draws[:, 0] + np.sqrt(1 - r**2) * draws[:, 1]
        assert second == pytest.approx(scores[:, 1], abs=0.05)
    assert people(Study(), 4)[0].draws == {}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"covariance": [[1.0, 2.0], [2.0, 1.0]]}, "2 parameters"),
        ({"covariance": [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}, "positive definite"),
        ({"x": [0.0, "a"]}, "is no posterior.json"),
    ],
)
def test_a_bad_posterior_gets_one_sentence(fitted, tmp_path, change, says):
    import json

    path = tmp_path / "posterior.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    says = says.replace("2 parameters", "3 parameters, but x or covariance of another size")
    with pytest.raises(StudyError, match=says):
        Varied.of(Study(people=People(fit=path)))


def test_a_fit_of_what_a_study_lacks_or_varies_is_refused(fitted, tmp_path, small_finger):
    fit = tmp_path / "posterior.json"
    with pytest.raises(StudyError, match=r"people\.fit varies it already"):
        Varied.of(Study(people=People(fit=fit, spread={"skin": 1.5})))
    plain = Study(
        finger=Finger(mesh_file=small_finger), stimulus=Plate(friction=0.0), people=People(fit=fit)
    )
    with pytest.raises(StudyError, match="pad_radius_mm, which this study does not have"):
        Varied.of(plain)


# --- ensembles -----------------------------------------------------------------------------------


@pytest.fixture
def written(tmp_path) -> Path:
    """An ensemble of four in two conditions: one scan is missing, forces grow with the person."""
    conditions = sweep(["stimulus.text=C,G"])
    scans = people(conditions, 4)
    for scan in scans:
        trace = make_trace()
        factor = int(scan.person[-1]) * (2 if scan.condition == "text-G" else 1)
        trace["force_N"] = factor * trace["force_N"]
        trace["time_s"] = trace["time_s"] - 1e-3 * factor
        make_results(tmp_path / scan.name, scan.study, trace)
    run = tmp_path / "person-002_text-G" / "run.json"
    complete = run.read_text()
    run.write_text('{"status": "stopped"}')
    with pytest.MonkeyPatch.context() as patch:
        failed = "tactile_fem.people.ensemble.run_series"
        patch.setattr(failed, lambda members, *_, **__: [])
        patch.setattr("tactile_fem.people.ensemble.check", check_but_the_second)
        run_people(scans, tmp_path)
    assert complete != run.read_text()
    return tmp_path


def check_but_the_second(study):
    second = people(sweep(["stimulus.text=C,G"]), 2)[-1].study
    if study == second:
        raise StudyError("it has no bone.")


def test_an_ensemble_is_read_again(written):
    ensemble = Ensemble.open(written)
    scans = people(sweep(["stimulus.text=C,G"]), 4)
    assert ensemble.people == tuple(f"person-00{k}" for k in (1, 2, 3, 4))
    assert ensemble.conditions == ("text-C", "text-G")
    assert ensemble.names == tuple(scans[0].scores)
    np.testing.assert_array_equal(ensemble.scores, [[*s.scores.values()] for s in scans[::2]])
    assert ensemble.complete.tolist() == [True, False, True, True]
    assert ensemble.failed == {"person-002_text-G": "it has no bone."}
    assert (ensemble.draws == ensemble.scores).all()
    known = ensemble.of_all([1.0, 3.0, 4.0])
    assert np.isnan(known[1]) and known[[0, 2, 3]].tolist() == [1, 3, 4]
    names = [results.folder.name for results in ensemble.results("text-G")]
    assert names == [f"person-00{k}_text-G" for k in (1, 3, 4)]


def test_numbers_and_histories_are_those_of_the_complete_people(written):
    ensemble = Ensemble.open(written)
    pressed = ensemble.numbers("text-G")["pressed_N"]
    assert pressed == pytest.approx(0.6 * np.array([2, 6, 8]))
    assert ensemble.numbers()["pressed_N"][0] == numbers_of(ensemble.results()[0])["pressed_N"]
    time_s, force = ensemble.history("text-C", steps=50)
    assert force.shape == (3, 50)
    trace = make_trace()
    assert time_s[0] == trace["time_s"][0] - 1e-3 and time_s[-1] == trace["time_s"][-1] - 4e-3
    expected = 3 * np.interp(time_s, trace["time_s"] - 3e-3, trace["force_N"][:, 2])
    assert force[1] == pytest.approx(expected)
    for of in ("tangential", "central_sed_kPa", "contact_area_mm2", lambda s: s.trace["depth_mm"]):
        assert ensemble.history(of=of)[1].shape == (3, 201)
    with pytest.raises(StudyError, match="has no history sed_kPa"):
        ensemble.history(of="sed_kPa")
    with pytest.raises(StudyError, match="has no condition text-O: text-C, text-G"):
        ensemble.results("text-O")


def test_other_people_do_not_go_into_the_folder(written):
    with pytest.raises(StudyError, match=r"people\.csv belongs to another ensemble"):
        run_people(people(Study(), 2), written)
    with pytest.raises(StudyError, match="holds no ensemble"):
        Ensemble.open(written / "person-001_text-C")


def test_a_finger_that_cannot_be_pressed_is_counted(tmp_path, small_finger, capsys):
    """Of three depths one is larger than the pad is thick."""
    study = Study(
        finger=Finger(mesh_file=small_finger),
        stimulus=Plate(friction=0.0),
        protocol=Protocol(depth_mm=0.1, distance_mm=0.0),
        receptors=Receptors(spacing_mm=2.5),
        output=Output(pictures=False),
        people=People(
            seed=32,
            fixed=("skin", "subcutaneous", "SA1.gain", "SA1.threshold_mV"),
            spread={"protocol.depth_mm": 30.0},
        ),
    )
    path, folder = tmp_path / "study.toml", tmp_path / "people"
    path.write_text(dump_study(study))
    command = ["people", str(path), "--number", "3", "--results", str(folder)]
    assert cli.main(command) == 0
    assert "1 of 3 scans failed" in capsys.readouterr().out
    ensemble = Ensemble.open(folder)
    ((name, why),) = ensemble.failed.items()
    assert name == "person-002" and "must be less than 5.24" in why
    assert ensemble.complete.tolist() == [True, False, True]
    rows = list(csv.DictReader((folder / "summary.csv").open()))
    assert [row["status"] for row in rows] == ["complete", "not complete", "complete"]
    depths = [results.trace["depth_mm"][-1] for results in ensemble.results()]
    assert depths == pytest.approx(0.1 * 30.0 ** ensemble.scores[[0, 2], 0], rel=1e-6)
    force = ensemble.numbers()["pressed_N"]
    assert (force[0] > force[1]) == (depths[0] > depths[1])
    before = (folder / "person-001" / "trace.npz").stat().st_mtime_ns
    assert cli.main(command) == 0  # nothing is repeated
    assert (folder / "person-001" / "trace.npz").stat().st_mtime_ns == before
