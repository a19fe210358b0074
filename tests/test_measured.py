"""A scan is compared with what was recorded, in all that its path did not take as input."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic import PRESS, SPEED, make_results, make_trace

from tactile_fem.errors import StudyError
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.figures import draw_plots
from tactile_fem.output.measured import measured
from tactile_fem.path import Follow, Press, Protocol
from tactile_fem.results.histories import DISPLACEMENT
from tactile_fem.results.measured import check_measured, compare
from tactile_fem.simulation.checkpoint import _check_origin, origin_of
from tactile_fem.simulation.parts import NO_PARTS
from tactile_fem.study import Output, Plate, Study
from tactile_fem.study.file import load_study

OFF_N = 0.01


def recording(folder, name="trial.csv", **columns):
    file = folder / name
    np.savetxt(
        file, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns),
        comments="", fmt="%.17g",
    )  # fmt: skip
    return file


def study_with(file, *path):
    """Return a study that names a recording; the path is that of the made-up trace by default."""
    protocol = Protocol(path=path) if path else Protocol()
    return Study(stimulus=Plate(), protocol=protocol, output=Output(measured=file))


def in_trace(trace, name, clock_s):
    values = trace[name].T
    return np.array([np.interp(clock_s, trace["clock_s"], column) for column in values])


@pytest.fixture
def trial(tmp_path):
    """A recording of forces that are too high by 0.01 N, on a clock of its own, and places."""
    trace, clock_s = make_trace(), np.linspace(0, 0.5, 200)
    fx, _, fz = in_trace(trace, "force_N", clock_s) + OFF_N
    z = -7.0 + in_trace(trace, "stimulator_mm", clock_s)[2]
    return recording(tmp_path, time_s=100 + clock_s, fz_N=fz, fx_N=fx, z_mm=z)


def test_a_recording_is_compared_from_the_start_of_the_path(trial):
    trace = make_trace()
    normal, across, depth = compare(study_with(trial), trace)
    assert [one.name for one in (normal, across, depth)] == ["fz_N", "fx_N", "z_mm"]
    assert normal.time_s == pytest.approx(np.linspace(0, 0.5, 200) - 1.97 / SPEED)
    assert normal.rms == pytest.approx(OFF_N) and normal.r == pytest.approx(1)
    assert normal.share == pytest.approx(OFF_N / np.ptp(normal.recorded))
    assert normal.recorded == pytest.approx(normal.model + OFF_N)
    assert across.rms == pytest.approx(OFF_N) and np.isnan([across.share, across.r]).all()
    assert depth.recorded[0] == depth.model[0] == 0 and depth.rms < 1e-12
    assert depth.model.max() == pytest.approx(1.97)
    assert normal.summary == "rms difference 0.01 N, 1.7% of range, r = 1.000"
    assert across.summary == "rms difference 0.01 N"


def test_a_scan_that_is_cut_off_is_compared_as_far_as_it_goes(trial):
    trace = make_trace()
    fixed = "receptors_mm"
    short = {name: v if name == fixed else v[:PRESS] for name, v in trace.items()}
    normal, *_ = compare(study_with(trial), short)
    assert normal.time_s[-1] <= short["time_s"][-1] < normal.time_s[-1] + 0.5 / 199
    assert normal.recorded == pytest.approx(normal.model + OFF_N)
    assert compare(study_with(trial), {**short, "clock_s": short["clock_s"] / 1e3}) == []
    assert compare(Study(), trace) == []


def test_what_the_path_takes_from_a_recording_is_not_compared(tmp_path):
    """It begins where its piece does: here after a press and another piece that follows a file."""
    trace = make_trace()
    trace["phase"] = np.where(trace["phase"] == "slide", "follow", trace["phase"])
    clock_s = np.linspace(0, 0.3, 50)
    before = recording(tmp_path, "before.csv", time_s=[0, 0.1], x_mm=[0, 1])
    begin_s = trace["clock_s"][PRESS - 1] + 0.1
    _, y, _ = in_trace(trace, "stimulator_mm", clock_s + begin_s)
    forces = in_trace(trace, "force_N", clock_s + begin_s)
    columns = dict(zip(("fx_N", "fy_N", "fz_N"), forces, strict=True))
    file = recording(tmp_path, time_s=clock_s, y_mm=y, z_mm=2 * y, rz_deg=y, **columns, tz_Nmm=y)
    press = Press(depth_mm=1)  # not as deep as the trace, which counts
    for hold, names in {
        (): ["fx_N", "fy_N", "fz_N", "tz_Nmm"],
        ("fz_N",): ["z_mm", "fx_N", "fy_N", "tz_Nmm"],
        ("tz_Nmm", "fy_N"): ["y_mm", "rz_deg", "fx_N", "fz_N"],
    }.items():
        follows = Follow(file=file, hold=hold)
        found = compare(study_with(file, press, Follow(file=before), follows), trace)
        assert [one.name for one in found] == names
        rms = {one.name: one.rms for one in found}
        assert all(rms[name] < 1e-12 for name in rms.keys() & {"fx_N", "fy_N", "fz_N", "y_mm"})
        assert found[0].time_s[0] == pytest.approx(0.1)


def test_torque_is_that_about_the_body_and_turns_may_exceed_half_a_round(tmp_path):
    trace = make_trace()
    clock_s, turn = trace["clock_s"], np.linspace(0, np.radians(250), len(trace["clock_s"]))
    vectors = np.where(turn > np.pi, turn - 2 * np.pi, turn)  # a trace has at most pi
    trace["stimulator_rad"] = np.outer(vectors, [0, 0, 1])
    trace["stimulator_mm"][:, 0] = 2.0
    x, y, _ = trace["stimulator_mm"].T
    fx, fy, _ = trace["force_N"].T
    trace["moment_Nmm"][:, 2] = 3 * turn + x * fy - y * fx
    rz, tz = np.degrees(turn) - 40, 3 * turn
    file = recording(tmp_path, time_s=clock_s, rz_deg=rz, tz_Nmm=tz)
    turned, torque = compare(study_with(file), trace)
    assert turned.model[-1] == pytest.approx(250) and turned.rms < 1e-9
    assert torque.rms < 1e-12 and np.ptp(torque.recorded) > 10


def test_the_figure_and_the_table_have_both(trial, tmp_path, caplog):
    results = make_results(tmp_path / "r", study_with(trial))
    caplog.set_level("INFO")
    figure = measured(results, Abscissa.of(results.trace))
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["Force Z (N)", "Force X (N)", "Z (mm)"]
    recorded, model = figure.axes[0].lines[-2:]
    assert (recorded.get_label(), model.get_label()) == ("recorded", "model")
    np.testing.assert_allclose(recorded.get_ydata(), model.get_ydata() + OFF_N)
    assert figure.axes[-1].get_xlabel() == DISPLACEMENT
    assert "fz_N: rms difference 0.01 N, " in caplog.text
    with (results.folder / "measured.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [*rows[0]] == ["time_s", *(
        f"{of}{name}" for name in ("fz_N", "fx_N", "z_mm") for of in ("", "model_")
    )]  # fmt: skip
    assert len(rows) == 200
    assert float(rows[9]["fz_N"]) == pytest.approx(float(rows[9]["model_fz_N"]) + OFF_N)


def test_a_folder_stands_alone_with_its_recording(trial, tmp_path):
    (tmp_path / "study.toml").write_text(
        '[stimulus]\nkind = "plate"\n[output]\nmeasured = "trial.csv"\n'
    )
    study = load_study(tmp_path / "study.toml")
    assert study == study_with(trial) and study.files() == {"output.measured": trial}
    results = make_results(tmp_path / "r", study)
    trial.unlink()
    assert results.figures / "measured.png" in draw_plots(results)
    assert "measured.png" not in [
        path.name for path in draw_plots(make_results(tmp_path / "s", Study(stimulus=Plate())))
    ]


def test_a_scan_goes_on_with_another_recording():
    def simulation(**files):
        study = Study(stimulus=Plate(), output=Output(measured=files.get("output.measured")))
        return SimpleNamespace(
            study=study, finger=SimpleNamespace(hash="h"), files=files, parts=NO_PARTS
        )

    saved = origin_of(simulation(**{"output.measured": "one"}))
    for files in ({"output.measured": "another"}, {}):
        _check_origin(saved, simulation(**files), "checkpoint.npz")
    with pytest.raises(StudyError, match=r"stimulus\.file names a file that has changed"):
        _check_origin(saved, simulation(**{"stimulus.file": "one"}), "checkpoint.npz")


def test_a_recording_has_to_have_something_to_compare(tmp_path):
    file = recording(tmp_path, time_s=[0, 9], z_mm=[0, 1], fz_N=[0, 1])
    assert compare_sentence(study_with(file, Follow(file=file))) is None  # as long as its piece
    assert compare_sentence(study_with(file)) == (
        f"output.measured: {file} lasts 9 s but the path 0.5985 s."
    )
    places = recording(tmp_path, "places.csv", time_s=[0, 1], z_mm=[0, 1])
    assert compare_sentence(study_with(places, Follow(file=places))) == (
        f"output.measured: the path takes every column of {places} as input, so none can be "
        "compared."
    )


def compare_sentence(study):
    try:
        check_measured(study, study.protocol.route(4.0))
    except StudyError as error:
        return str(error)
    return None
