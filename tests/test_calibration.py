"""Measurements, parameters and the fit, on the small finger."""

from __future__ import annotations

import csv
import os
import re
import signal
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from needs import needs_gmsh

from tactile_fem.calibration.measurements import Experiment, read_measurements
from tactile_fem.calibration.parameters import parse_parameter, with_values
from tactile_fem.calibration.press import deflection
from tactile_fem.cli.app import main
from tactile_fem.errors import StoppedError, StudyError
from tactile_fem.runtime.ranks import raise_stopped, signal_handler
from tactile_fem.study import Cylinder, Dots, Finger, Joint, Plate, Solver, Study

FORCE = "indenter,speed_mm_s,depth_mm,force_N,sd_N\n"
PROFILE = "indenter,speed_mm_s,depth_mm,place_mm,deflection_mm,sd_mm\n"
MEASURED = Path(__file__).resolve().parents[1] / "demos" / "validation" / "measured"


def written(folder: Path, text: str, name: str = "data.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# --- measurements --------------------------------------------------------------------------------


def test_the_shipped_measurements():
    plate, probe, cylinder = read_measurements(
        [MEASURED / f"{name}.csv" for name in ("plate", "probe", "cylinder")]
    )
    assert isinstance(plate.indenter, Plate) and plate.is_force.all()
    assert isinstance(probe.indenter, Dots) and probe.indenter.radius_mm == 3.175
    assert isinstance(cylinder.indenter, Cylinder) and not cylinder.is_force.any()
    np.testing.assert_allclose(plate.mean, [0.037, 0.159, 0.395, 0.769])
    assert cylinder.depth_mm.tolist() == [1.0] * 11


def test_one_press_for_each_indenter_and_speed(tmp_path):
    forces = written(tmp_path, FORCE + "plate,0.2,1,0.2,0.1\nplate,5,1,0.3,0.1\n", "a.csv")
    profile = written(tmp_path, PROFILE + " plate , 0.2, 1, -2, 0.5, 0.1\n", "b.csv")
    slow, fast = read_measurements([forces, profile])
    assert (slow.speed_mm_s, fast.speed_mm_s) == (0.2, 5.0)
    np.testing.assert_array_equal(slow.is_force, [True, False])
    assert slow.place_mm[1] == 2.0  # both sides are averaged


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("indenter,b\nplate,2\n", "its columns are indenter, b but must be indenter,"),
        (FORCE + "plate,0.2,1,x,0.1\n", 'line 2: force_N is "x" but must be a number above 0.'),
        (FORCE + "plate,0.2,1,0.2,0\n", 'line 2: sd_N is "0" but must be a number above 0.'),
        (FORCE + "plate,0.2,1,0.2\n", 'line 2: sd_N is "" but must be a number above 0.'),
        (FORCE + "plate,0.2,1,0.2,0.1,7\n", "line 2: it has more cells than there are columns."),
        (FORCE + "flat,0.2,1,0.2,0.1\n", 'line 2: stimulus.kind is "flat", which is no kind'),
        (FORCE + "plate r,0.2,1,0.2,0.1\n", 'line 2: "r" is no key=value of an indenter.'),
        (FORCE + "sphere radius_mm=-1,0.2,1,0.2,0.1\n", "radius_mm is -1 but must be greater"),
        (FORCE + ",0.2,1,0.2,0.1\n", "line 2: indenter is empty but must be"),
        (FORCE, "There are no measurements"),
        (None, "cannot be read: No such file or directory."),
    ],
)
def test_bad_measurements_get_one_sentence(text, sentence, tmp_path, capsys):
    path = tmp_path / "none.csv" if text is None else written(tmp_path, text)
    assert main(["fit", str(path), "--results", str(tmp_path / "fit")]) == 2
    message = capsys.readouterr().err
    assert sentence in message and message.count("\n") == 1
    assert not (tmp_path / "fit").exists()


# --- parameters ----------------------------------------------------------------------------------


def test_a_tissue_scales_with_all_its_moduli():
    study = Study()
    skin = parse_parameter("skin:2", study)
    assert skin.of_tissue and skin.factor == 2.0
    doubled = with_values(study, [skin], [np.log(2.0)]).tissue
    for name in ("stratum_corneum", "epidermis", "dermis"):
        before, after = getattr(study.tissue, name), getattr(doubled, name)
        assert after.C10_MPa == pytest.approx(2 * before.C10_MPa, rel=1e-12)
        assert after.D1_per_MPa == pytest.approx(before.D1_per_MPa / 2, rel=1e-12)
    assert doubled.subcutaneous == study.tissue.subcutaneous


def test_a_length_and_a_constant():
    study = Study()
    length = parse_parameter("finger.pad_radius_mm", study)
    constant = parse_parameter("subcutaneous.D1_per_MPa:1.5", study)
    assert not length.of_tissue and constant.change == {("subcutaneous", "D1_per_MPa"): 1.0}
    other = with_values(study, [length, constant], [0.1, -0.2])
    assert other.finger.pad_radius_mm == pytest.approx(study.finger.pad_radius_mm * np.exp(0.1))
    assert constant.value(other) == pytest.approx(constant.value(study) * np.exp(-0.2))


def test_a_tissue_that_relaxes_scales_as_well():
    study = Study.model_validate({"tissue": {"relaxation": "fingerpad"}})
    for name in ("skin", "dermis", "bone"):
        parameter = parse_parameter(name, study)
        doubled = with_values(study, [parameter], [np.log(2.0)]).tissue.dermis
        factor = 1 if name == "bone" else 2
        assert doubled.C10_MPa == pytest.approx(factor * study.tissue.dermis.C10_MPa)
        assert (doubled.g, doubled.tau_s) == (study.tissue.dermis.g, study.tissue.dermis.tau_s)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("dermis.g", "it is () but must be a number above 0."),
        ("subcutaneous.C20", "did you mean subcutaneous.C20_MPa?"),
        ("fat", "there is no such value"),
        ("finger.model_dump", "there is no such value"),
        ("epidermis.C20_MPa", "it is 0.0 but must be a number above 0."),
        ("skin:0.5", 'the factor is "0.5" but must be a number above 1.'),
        ("skin:x", 'the factor is "x" but must be a number above 1.'),
        ("finger.epidermis_rows", "it is a whole number, which cannot be varied."),
        ("finger.papillae_aligned", "it is True but must be a number above 0."),
        ("finger.preset", "it is coarse but must be a number above 0."),
    ],
)
def test_bad_parameters_get_one_sentence(text, sentence):
    with pytest.raises(StudyError, match=r"^parameter ") as error:
        parse_parameter(text, Study.model_validate({"finger": {"epidermis_rows": 2}}))
    assert sentence in str(error.value)


def test_the_parameters_that_an_error_names_can_be_fitted():
    study = Study.model_validate({"tissue": {"relaxation": "fingerpad"}})
    with pytest.raises(StudyError, match="there is no such value; allowed: ") as error:
        parse_parameter("fat", study)
    names = str(error.value).split("allowed: ")[1].removesuffix(".").split(", ")
    assert "dermis.D1_per_MPa" in names and "finger.pad_radius_mm" in names
    for name in names:
        assert parse_parameter(name, study).name == name


@pytest.mark.parametrize("file", ["mesh_file", "skin_file"])
def test_a_length_that_a_file_replaces_cannot_be_fitted(file):
    study = Study.model_validate({"finger": {file: "a.stl"}})
    with pytest.raises(StudyError, match="it has no effect on a finger that comes from a file"):
        parse_parameter("finger.half_width_mm", study)
    if file == "skin_file":
        assert parse_parameter("finger.dermis_mm", study).value(study) == 0.8


def test_the_command_names_its_option(tmp_path, capsys):
    data = written(tmp_path, FORCE + "plate,0.2,1,0.2,0.1\n")
    assert main(["fit", str(data), "--fit", "fat", "--results", str(tmp_path / "r")]) == 2
    assert "tactile-fem: parameter fat: there is no such value" in capsys.readouterr().err


def test_a_saved_press_is_that_of_its_fingers_file(tmp_path):
    """Whatever the file's name: one that changed is pressed again."""
    from tactile_fem.calibration.task import Task  # which needs DOLFINx

    (experiment, *_) = read_measurements([written(tmp_path, FORCE + "plate,0.2,1,0.2,0.1\n")])
    names = []
    for name, content in (("a.msh", "one"), ("a.msh", "two"), ("b.msh", "one")):
        (tmp_path / name).write_text(content)
        study = Study(finger=Finger(mesh_file=tmp_path / name))
        names.append(Task(study, experiment, ()).name)
    assert names[0] == names[2] != names[1]


def test_a_press_is_handed_to_a_process_whole(tmp_path):
    from tactile_fem.calibration.task import Task

    profile = "cylinder radius_mm=1.5,2,1,0.5,0.8,0.1\n"
    (experiment, *_) = read_measurements([written(tmp_path, PROFILE + profile)])
    changes = ({("dermis", "C10_MPa"): 1.0, ("dermis", "D1_per_MPa"): -1.0},)
    task = Task(Study(), experiment, changes)
    file = tmp_path / "presses" / f"{task.name}.npz"
    task.write(file)
    read = Task.read(file)
    assert (read.name, read.changes) == (task.name, changes)
    assert not read.experiment.is_force.any()


def test_a_saved_press_is_that_of_its_version(tmp_path, monkeypatch):
    """And of its code: what an earlier one pressed is pressed again."""
    from tactile_fem.calibration import task as tasks

    (experiment, *_) = read_measurements([written(tmp_path, FORCE + "plate,0.2,1,0.2,0.1\n")])
    task = tasks.Task(Study(), experiment, ())
    names = [task.name, task.name]
    monkeypatch.setattr(tasks, "this_version", lambda: "0.0.1")
    names.append(task.name)
    monkeypatch.setattr(tasks, "_hash_of_code", lambda: "another")
    names.append(task.name)
    assert names[0] == names[1] and len({*names}) == 3


def test_a_constant_cannot_be_fitted_twice(tmp_path, capsys):
    data = written(tmp_path, FORCE + "plate,0.2,1,0.2,0.1\n")
    command = ["fit", str(data), "--fit", "skin", "--fit", "dermis", "--results", str(tmp_path)]
    assert main(command) == 2
    assert "change the same constant: name it once." in capsys.readouterr().err


def test_a_section_is_fitted_to_no_measured_force(tmp_path, capsys):
    data = written(tmp_path, FORCE + "plate,0.2,1,0.2,0.1\n")
    command = ["fit", str(data), "--set", "finger.kind=section", "--results", str(tmp_path)]
    assert main(command) == 2
    assert 'finger.kind is "section" but must be "solid" for a fit' in capsys.readouterr().err


# --- the fit of a formula ------------------------------------------------------------------------

SLOPES = {"plate": np.array([0.02, 0.05]), "sphere": np.array([0.03])}
FORMULA = FORCE + "plate,0.2,0.5,0.04,0.01\nplate,0.2,1,0.12,0.02\nsphere,0.2,1,0.05,0.01\n"
NAMES = ["skin", "subcutaneous.C10_MPa:2", "subcutaneous.D1_per_MPa:1.5"]


def of_formula(study, experiment, changes=(), comm=None):
    """Return forces 0.05 + slope ln(C10 of the fat / usual), once the finger is loaded."""
    from tactile_fem.calibration.press import Prediction

    study.finger.mesh()
    slopes = SLOPES[experiment.indenter.kind]
    grown = np.log(study.tissue.subcutaneous.C10_MPa / Study().tissue.subcutaneous.C10_MPa)
    powers = [change.get(("subcutaneous", "C10_MPa"), 0.0) for change in changes]
    curve = np.array([[0.0, 0.0], [0.3, 0.01], [1.0, 0.05 + slopes[-1] * grown]])
    return Prediction(0.05 + slopes * grown, np.outer(slopes, powers), curve)


@pytest.fixture
def formula(tmp_path, monkeypatch, capsys):
    """Fit the formula from the command line; return the folder, what was printed and logged."""
    pytest.importorskip("tactile_fem.runtime.backend")
    monkeypatch.setattr("tactile_fem.calibration.task.press", of_formula)

    def run(text=FORMULA, *options):
        command = [
            "fit",
            str(written(tmp_path, text)),
            "--results",
            str(tmp_path / "fit"),
            *options,
        ]
        assert main([*command, *(word for name in NAMES for word in ("--fit", name))]) == 0
        return tmp_path / "fit", *capsys.readouterr()

    return run


def test_a_fit_of_a_formula_has_the_interval_of_its_closed_form(formula):
    folder, _, _ = formula()
    slopes, sd = np.concatenate(list(SLOPES.values())), np.array([0.01, 0.02, 0.01])
    measured, prior = np.array([0.04, 0.12, 0.05]), np.log(2.0)
    variance = 1 / (np.sum((slopes / sd) ** 2) + 1 / prior**2)
    x = variance * np.sum(slopes * (measured - 0.05) / sd**2)
    half = 1.959964 * np.sqrt(variance)
    usual = Study().tissue.subcutaneous
    skin, c10, d1 = table(folder / "parameters.csv")
    assert [row["unit"] for row in (skin, c10, d1)] == ["times its moduli", "MPa", "1/MPa"]
    for key, at in (("value", x), ("least_95_percent", x - half), ("largest_95_percent", x + half)):
        assert float(c10[key]) == pytest.approx(usual.C10_MPa * np.exp(at), rel=2e-5)
    # What the measurements do not depend on stays within what was expected before.
    for row, start, factor in ((skin, 1.0, 3.0), (d1, usual.D1_per_MPa, 1.5)):
        assert float(row["value"]) == pytest.approx(start)
        assert float(row["largest_95_percent"]) == pytest.approx(start * factor**1.959964, rel=1e-4)
        assert row["identified"] == "no"


def test_a_fit_s_constants_have_their_units_and_are_those_of_its_study(formula):
    folder, _, _ = formula()
    fitted = tomllib.loads((folder / "study.toml").read_text())
    rows = table(folder / "constants.csv")
    assert len(rows) == 3 * 3 + 2  # two moduli and D1 of each layer of the skin; C10 and D1
    for row in rows:
        section, tissue, name = row["constant"].split(".")
        assert row["unit"] == ("1/MPa" if "_per_" in name else "MPa")
        value = fitted[section][tissue][name]
        assert float(row["value"]) == pytest.approx(value, rel=1e-4)
        assert float(row["least_95_percent"]) < value < float(row["largest_95_percent"])
        assert row["parameter"] == ("skin" if tissue != "subcutaneous" else f"{tissue}.{name}")


def test_a_fit_has_one_sum_of_squares_and_one_finger(formula):
    folder, printed, logged = formula()
    of_numbers = sum(float(row["deviation_sd"]) ** 2 for row in table(folder / "predicted.csv"))
    changed = sum(
        (np.log(float(row["value"]) / float(row["start"])) / np.log(factor)) ** 2
        for row, factor in zip(table(folder / "parameters.csv"), (3.0, 2.0, 1.5), strict=True)
    )
    sentence = f"sum of squares {of_numbers + changed:.4g}"
    assert f"{sentence}, 3 numbers, " in printed and printed.count("squares") == 1
    assert f"{sentence}; " in logged.splitlines()[-1]
    assert logged.count("finger from coarse.npz") == 1
    c10 = float(table(folder / "parameters.csv")[1]["value"])
    assert f"subcutaneous.C10_MPa {c10:.3g} MPa" in logged.splitlines()[-1]
    assert re.search(rf" {c10:.4g} +MPa  ", printed) and "95 % interval" in printed
    assert "skin: moduli times 1 (0.116 to 8.61)" in printed  # and each of them in MPa
    assert "  stratum_corneum.C10_MPa" in printed
    assert "too narrow" not in printed


def test_a_raw_curve_is_fitted_and_drawn_with_the_fitted_finger_s_curve(formula, tmp_path):
    raw = "depth_mm,force_N\n" + "".join(f"{d},{0.05 * d}\n" for d in (0.7, -0.1, 0.5, 1.0))
    options = ["--indenter", "plate", "--speed", "0.2"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SLOPES, "plate", np.array([0.02, 0.03, 0.05]))
        folder, printed, _ = formula(raw, *options)
    assert "plate at 0.2 mm/s: 3 of 4 rows are deeper than 0, averaged to 3 points" in printed
    assert "sd not given, taken as 5 % of the force + 1 % of the largest" in printed
    assert [row["depth_mm"] for row in table(folder / "curves.csv")] == ["0.0", "0.3", "1.0"]


def test_the_figure_of_a_curve_has_its_rows_its_averages_and_the_fitted_finger():
    from tactile_fem.calibration.tables import figure

    experiment = Experiment.of_curve("plate", 0.2, np.linspace(0, 1, 50), np.linspace(0, 0.1, 50))
    curve = np.column_stack([np.linspace(0, 1, 20), np.linspace(0, 0.1, 20)])
    found = SimpleNamespace(
        experiments=(experiment,), predicted=(experiment.mean,), curves=(curve,)
    )
    (axes,) = figure(found).axes
    _, labels = axes.get_legend_handles_labels()
    assert labels == ["measured rows", "fitted finger", "mean ± sd"]
    assert [len(line.get_xdata()) for line in axes.lines[:1]] == [50]
    assert axes.get_title() == "plate at 0.2 mm/s"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Indentation (mm)", "Normal force (N)")


def test_a_model_that_misses_the_measurements_by_far_is_said(formula):
    _, printed, _ = formula(FORMULA.replace("0.05,0.01", "0.02,0.001"))
    assert "the intervals are too narrow" in printed and "not converged" not in printed


def test_a_fit_that_ran_out_of_points_says_so(formula):
    _, printed, _ = formula(FORMULA.replace("0.12,0.02", "0.5,0.0001"), "--evaluations", "2")
    assert "2 points\nnot converged" in printed


# --- the fit -------------------------------------------------------------------------------------

SMALL = ["finger.pad_size_mm=3", "finger.far_size_mm=6", "solver.max_press_step_mm=0.5"]
TRUE = {"dermis": 0.7, "finger.pad_radius_mm": 1.08}


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A fit of known constants to what the model itself gives."""
    from tactile_fem.calibration.press import press
    from tactile_fem.study.file import load_study

    folder = tmp_path_factory.mktemp("fit")
    study = load_study(None, SMALL)
    parameters = [parse_parameter(name, study) for name in TRUE]
    truth = with_values(study, parameters, np.log(list(TRUE.values())))
    wanted = written(
        folder,
        FORCE
        + "".join(f"plate,0.2,{depth},1,1\n" for depth in (0.5, 1.0))
        + "".join(f"sphere radius_mm=3,0.2,{depth},1,1\n" for depth in (0.5, 1.0)),
    )
    rows = []
    for experiment in read_measurements([wanted]):
        kind = experiment.name.split(" at")[0]
        forces = press(truth, experiment).values.tolist()
        for depth, force in zip(experiment.depth_mm.tolist(), forces, strict=True):
            rows.append(f"{kind},0.2,{depth},{force},{0.02 * force}\n")
    data = written(folder, FORCE + "".join(rows))
    command = ["fit", str(data), "--results", str(folder / "fit"), "--jobs", "2"]
    command += ["--evaluations", "3"]
    command += [word for setting in SMALL for word in ("--set", setting)]
    command += [word for name in TRUE for word in ("--fit", f"{name}:2")]
    assert main(command) == 0
    return folder / "fit", command


def table(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_a_signal_is_not_taken_for_a_press_that_diverges(small_finger, tmp_path, monkeypatch):
    from tactile_fem.calibration import press

    def interrupted(*arguments):
        os.kill(os.getpid(), signal.SIGINT)
        return reading(*arguments)

    reading = press._reading
    monkeypatch.setattr(press, "_reading", interrupted)
    study = Study(finger=Finger(mesh_file=small_finger))
    (experiment,) = read_measurements([written(tmp_path, FORCE + "plate,0.2,0.1,0.2,0.1\n")])
    with pytest.raises(StoppedError), signal_handler(raise_stopped):
        press.press(study, experiment)


def test_a_fit_knows_how_a_finger_on_its_joint_yields(small_finger, tmp_path):
    """At a fixed bone the force would depend on the fat by 70 % more, and profiles have no sign."""
    from mpi4py import MPI

    from tactile_fem.calibration.model import Model

    study = Study(
        finger=Finger(mesh_file=small_finger),
        joint=Joint(stiffness_Nmm_rad=10.0),
        solver=Solver(first_step_mm=0.2),
    )
    files = (
        written(tmp_path, FORCE + "plate,5,0.2,1,1\n", "a.csv"),
        written(tmp_path, PROFILE + "plate,5,0.2,2,1,1\nplate,5,0.2,5,1,1\n", "b.csv"),
    )
    (experiment,) = read_measurements(files)
    parameter = parse_parameter("subcutaneous", study)
    model = Model(study, [experiment], [parameter], tmp_path, 1, MPI.COMM_SELF, 2)
    (found,), (softer,) = (model.predictions(np.array([x])) for x in (0.0, -0.05))
    assert found.values[0] == found.curve[-1, 1]
    wanted = (found.values - softer.values) / 0.05
    jacobian = model.jacobian(np.zeros(1))
    np.testing.assert_allclose(jacobian[:-1, 0], wanted / experiment.sd, rtol=0.1)
    assert found.values[1] == pytest.approx(0.102, abs=0.005)  # in space; 0.051 mm to the bone


@pytest.mark.slow
@needs_gmsh
def test_known_constants_lie_in_their_intervals(fitted):
    folder, _ = fitted
    rows = table(folder / "parameters.csv")
    assert [row["parameter"] for row in rows] == list(TRUE)
    for row in rows:
        true = TRUE[row["parameter"]] * float(row["start"])
        assert float(row["least_95_percent"]) < true < float(row["largest_95_percent"]), row
        assert row["identified"] == "yes"
        wide = float(row["largest_95_percent"]) / float(row["least_95_percent"])
        assert wide < 2.5  # it does say something
    for row in table(folder / "predicted.csv"):
        assert abs(float(row["deviation_sd"])) < 0.5, row
    assert (folder / "fit.png").stat().st_size > 10_000


@pytest.mark.slow
@needs_gmsh
def test_its_study_goes_on(fitted):
    folder, _ = fitted
    study = Study.model_validate(tomllib.loads((folder / "study.toml").read_text()))
    dermis, radius = (float(row["value"]) for row in table(folder / "parameters.csv"))
    assert study.tissue.dermis.C20_MPa == pytest.approx(
        dermis * Study().tissue.dermis.C20_MPa, rel=1e-4
    )
    assert study.finger.pad_radius_mm == pytest.approx(radius, rel=1e-4)
    assert study.finger.pad_size_mm == 3.0


@pytest.mark.slow
@needs_gmsh
def test_again_it_presses_nothing(fitted, capsys):
    folder, command = fitted
    before = {path: path.stat().st_mtime_ns for path in (folder / "presses").glob("*.npz")}
    result = (folder / "parameters.csv").read_text()
    assert main(command) == 0
    told = capsys.readouterr().err
    assert "of at most 3, pressed before: sum of squares" in told and "left" not in told
    assert (folder / "parameters.csv").read_text() == result
    after = {path: path.stat().st_mtime_ns for path in (folder / "presses").glob("*.npz")}
    assert after == before


@pytest.mark.slow
@needs_gmsh
def test_its_finger_presses_as_predicted(fitted, capsys):
    folder, _ = fitted
    plate = ["--set", "stimulus.kind=plate", "--set", "protocol.press_speed_mm_s=0.2"]
    depths = ["--depth", "0.5", "--depth", "1", "--jobs", "2"]
    assert main(["predict", str(folder), *plate, *depths]) == 0
    rows = table(folder / "predictions" / "plate_at_0.2_mm_s.csv")
    for row, own in zip(rows, table(folder / "predicted.csv"), strict=False):
        assert float(row["force_N"]) == pytest.approx(float(own["model"]), rel=1e-3)
        # Two depths of two indenters, each known to 2 %, determine two parameters.
        assert 0.01 < float(row["largest_95_percent"]) / float(row["force_N"]) - 1 < 0.06
    assert "The band is rough" not in capsys.readouterr().out


def test_the_deflection_of_skin_does_not_depend_on_the_order_of_its_points():
    along = np.linspace(-4.0, 4.0, 41)
    rest = np.column_stack([along, 0 * along, 0.1 * along**2])
    moved = rest + np.column_stack([0 * along, 0 * along, 1 - np.abs(along) / 4])
    places = np.array([0.0, 1.0, 3.0])
    folded = np.r_[:30, 31, 30, 32:41]  # beside the indenter the skin turns back
    for order in (slice(None), slice(None, None, -1), folded):
        found = deflection(moved[order], rest[order], places, axis=0)
        np.testing.assert_allclose(found, [1.0, 0.75, 0.25], atol=1e-12)
