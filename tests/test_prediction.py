"""What a fitted finger does under another stimulus, with the fit's uncertainty."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from test_calibration import SMALL, formula  # noqa: F401

from tactile_fem.calibration.parameters import parse_parameter, with_values
from tactile_fem.calibration.posterior import Posterior
from tactile_fem.calibration.prediction import predict
from tactile_fem.cli.app import main
from tactile_fem.errors import StudyError
from tactile_fem.series import sweep
from tactile_fem.study import Plate, Sphere, Study, dump_study, load_study

C10 = ("subcutaneous", "C10_MPa")
X, SD = 0.1, np.array([0.2, 0.1])


def table(path: Path) -> list[dict[str, float]]:
    rows = csv.DictReader(path.read_text(encoding="utf-8").splitlines())
    return [{name: float(cell) for name, cell in row.items()} for row in rows]


@pytest.fixture
def known(tmp_path) -> Path:
    """The folder of a fit that knows two parameters."""
    start = load_study(None, SMALL)
    parameters = tuple(parse_parameter(name, start) for name in ("skin", "subcutaneous.C10_MPa"))
    x, correlation = np.array([0.0, X]), np.array([[1.0, -0.5], [-0.5, 1.0]])
    Posterior.of(start, parameters, x, correlation * np.outer(SD, SD)).save(
        tmp_path / "posterior.json"
    )
    found = with_values(start, parameters, x)
    (tmp_path / "study.toml").write_text(dump_study(found, without=("stimulus", "protocol")))
    return tmp_path


@pytest.fixture
def law(monkeypatch):
    """Let a force be a given function of depth and of the logarithm of the fat's C10."""
    pytest.importorskip("tactile_fem.runtime.backend")
    from tactile_fem.calibration.press import Prediction

    def take(force):
        def press(study, experiment, changes=(), comm=None):
            x = np.log(study.tissue.subcutaneous.C10_MPa / Study().tissue.subcutaneous.C10_MPa) - X
            slope = (force(experiment.depth_mm, x + 1e-6) - force(experiment.depth_mm, x)) / 1e-6
            along = [change.get(C10, 0.0) for change in changes]
            return Prediction(force(experiment.depth_mm, x), np.outer(slope, along), np.zeros(2))

        monkeypatch.setattr("tactile_fem.calibration.task.press", press)

    return take


SPHERE = ["--set", "stimulus.kind=sphere", "--set", "stimulus.radius_mm=4"]
DEPTHS = ["--depth", "0.5", "--depth", "1"]


def test_a_force_that_is_a_power_of_a_constant_has_its_band(known, law, capsys):
    law(lambda depth, x: 0.1 * depth * np.exp(2 * x))
    assert main(["predict", str(known), *SPHERE, *DEPTHS]) == 0
    printed = capsys.readouterr().out
    assert "sphere radius_mm=4 at 20 mm/s" in printed and "The band is rough" not in printed
    assert re.search(r"0.50 mm +0.05 N +0.03379 to 0.074 N +0 %", printed)
    assert f"are in {known / 'predictions'}" in printed
    file = known / "predictions" / "sphere_radius_mm=4_at_20_mm_s"
    half = 1.959964 * 2 * SD[1]
    for row, force in zip(table(Path(f"{file}.csv")), (0.05, 0.1), strict=True):
        assert row["force_N"] == pytest.approx(force)
        assert row["least_95_percent"] == pytest.approx(force * np.exp(-half), rel=2e-5)
        assert row["largest_95_percent"] == pytest.approx(force * np.exp(half), rel=2e-5)
        assert len({row[f"press_{k}_N"] for k in range(1, 5)}) == 4
    # What it was made from is beside it, and the study can be scanned.
    pressed = load_study(f"{file}.toml")
    assert pressed.stimulus == Sphere(radius_mm=4.0) and pressed.protocol.depth_mm == 1.0
    assert pressed.tissue == load_study(known / "study.toml").tissue
    saved = known / "predictions" / "posterior.json"
    assert saved.read_text() == (known / "posterior.json").read_text()
    assert Path(f"{file}.png").stat().st_size > 5000


def test_the_stimulus_of_a_study_file_is_pressed_and_a_rough_band_is_called_so(
    known, law, tmp_path, capsys
):
    law(lambda depth, x: depth * np.exp(x + 30 * x**2))
    other = tmp_path / "other.toml"
    other.write_text('stimulus = { kind = "plate" }\nprotocol = { press_speed_mm_s = 2.0 }\n')
    command = ["predict", str(known), str(other), "--depth", "1", "--results", str(tmp_path / "p")]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("plate at 2 mm/s\n")
    assert "The band is rough: fit fewer parameters" in printed
    assert (tmp_path / "p" / "plate_at_2_mm_s.csv").is_file()


def test_presses_that_end_early_are_counted(known, law):
    law(lambda depth, x: np.where((depth > 0.9) & (x > 0.02), np.nan, depth * np.exp(x)))
    posterior, study = (
        Posterior.load(known / "posterior.json", "a"),
        load_study(known / "study.toml"),
    )
    found = predict(posterior, study, Plate(), known / "p", depth_mm=[0.5, 1.0])
    assert np.isfinite(found.error).all()
    ended = int(np.isnan(found.pressed_N[:, 1]).sum())
    assert 0 < ended < 4 and f"{ended} of them ended early" in str(found)


def test_the_fitted_condition_itself_is_as_the_fit_has_it(formula):  # noqa: F811
    folder, _, _ = formula()
    of_fit = list(csv.DictReader((folder / "predicted.csv").read_text().splitlines()))
    plate = ["--set", "stimulus.kind=plate", "--set", "protocol.press_speed_mm_s=0.2"]
    assert main(["predict", str(folder), *plate, *DEPTHS]) == 0
    rows = table(folder / "predictions" / "plate_at_0.2_mm_s.csv")
    forces = [float(row["model"]) for row in of_fit if row["indenter"].startswith("plate")]
    assert [row["force_N"] for row in rows] == pytest.approx(forces, rel=1e-4)
    # The fitted study states neither stimulus nor protocol: another kind, or a force, can be set.
    text = (folder / "study.toml").read_text()
    assert "[tissue.dermis]" in text and "[stimulus]" not in text and "[protocol]" not in text
    other = load_study(folder / "study.toml", ["stimulus.kind=plate", "protocol.force_N=0.2"])
    assert other.stimulus == Plate() and other.protocol.force_N == 0.2


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--depth", "9"], "protocol.depth_mm is 9 but must be less than 5.3"),
        (["--depth", "0"], "--depth"),
        (["--depth", "1", "--set", "tissue.set=plate"], '"tissue.set=plate" has no effect'),
        (["--depth", "1", "--set", "stimulus.kind=flat"], 'stimulus.kind is "flat"'),
    ],
)
def test_bad_options_get_one_sentence(known, options, sentence, capsys):
    pytest.importorskip("tactile_fem.runtime.backend")
    assert main(["predict", str(known), *options]) == 2
    assert sentence in capsys.readouterr().err
    assert not (known / "predictions").exists()


def test_what_is_no_fit_is_refused(known, law, capsys):
    law(lambda depth, x: depth)
    fit = known / "posterior.json"
    text = fit.read_text()
    other = load_study(known / "study.toml", ["tissue.subcutaneous.C10_MPa=0.01"])
    for change, sentence in (
        (lambda: fit.write_text(text.replace("-0.01", "-9.01")), "positive definite"),
        (lambda: fit.unlink(), "is not the folder of a fit: it has no posterior.json."),
        (
            lambda: (fit.write_text(text), (known / "study.toml").write_text(dump_study(other))),
            "tissue.subcutaneous.C10_MPa of the study is not that of the posterior.",
        ),
        (lambda: (known / "study.toml").unlink(), "There is no study file"),
    ):
        change()
        assert main(["predict", str(known), "--depth", "1"]) == 2
        message = capsys.readouterr().err
        assert sentence in message and message.count("\n") == 1


def test_bad_arguments_get_one_sentence(known):
    pytest.importorskip("tactile_fem.runtime.backend")
    posterior, study = (
        Posterior.load(known / "posterior.json", "a"),
        load_study(known / "study.toml"),
    )
    for stimulus, numbers, sentence in (
        ("plate", {"depth_mm": 1}, "stimulus is 'plate' but must be a stimulus"),
        (Plate(), {"depth_mm": [1, -1]}, "depth_mm is .* but its numbers must be above 0"),
        (Plate(), {"depth_mm": []}, "depth_mm is .* but its numbers must be above 0"),
        (Plate(), {"depth_mm": "deep"}, "depth_mm is .deep. but must be a number or several"),
        (Plate(), {"depth_mm": 1, "speed_mm_s": 0}, "speed_mm_s is .* must be above 0"),
    ):
        with pytest.raises(StudyError, match=sentence):
            predict(posterior, study, stimulus, known / "p", **numbers)
    assert not (known / "p").exists()


@pytest.mark.parametrize("text", [dump_study(Study()), '[stimulus]\ntext = "EFG"\n'])
def test_another_kind_can_be_set_of_a_study_that_states_one(text, tmp_path):
    """Its keys that the new kind does not have are those of the former; the others stay."""
    file = tmp_path / "study.toml"
    file.write_text(text.replace("friction = 0.3", "friction = 0.4"))
    friction = 0.4 if "friction" in text else 0.3
    assert load_study(file, ["stimulus.kind=plate"]).stimulus == Plate(friction=friction)
    members = sweep(["stimulus.kind=plate,sphere"], file, ["stimulus.friction=0.5"])
    assert [m.study.stimulus for m in members] == [Plate(friction=0.5), Sphere(friction=0.5)]
    assert load_study(file, ["stimulus.kind=text"]).stimulus.text in text
    with pytest.raises(StudyError, match=r"stimulus\.pitch_mm is not a key of a stimulus"):
        load_study(file, ["stimulus.kind=plate", "stimulus.pitch_mm=3"])
