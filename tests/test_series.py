"""Series of scans: which they are, and that each is run once."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from synthetic import SPEED, make_results, make_trace, refined

from tactile_fem.cli import app as cli
from tactile_fem.errors import StoppedError, StudyError, TactileError
from tactile_fem.results.columns import SUMMARY
from tactile_fem.results.histories import mean_over
from tactile_fem.results.results import Results
from tactile_fem.series import (
    Member,
    Outcome,
    numbers_of,
    run_all,
    run_series,
    single_fibre,
    sweep,
    write_summary,
)
from tactile_fem.study import Finger, Output, Protocol, Receptors, Study, Surface, Text


def test_passes_shift_the_stimulator_over_one_receptor():
    study = Study(stimulus=Text(shift_mm=(0.3, 1.0)))
    members = single_fibre(study)
    assert len(members) == 51
    shifts = np.array([member.study.stimulus.shift_mm for member in members])
    np.testing.assert_allclose(shifts[:, 0], 0.3 + np.arange(-25, 26) * 0.2, atol=1e-9)
    assert (shifts[:, 1] == 1.0).all()
    assert all(member.study.receptors.half_width_mm == 0 for member in members)
    assert len({member.name for member in members}) == 51
    assert members[25].name == "shift+0.000"
    with pytest.raises(StudyError, match="at most the half width"):
        single_fibre(study, spacing_mm=6.0)


def test_sweep_combines_its_axes():
    axes = ["stimulus.friction=0,0.1", "stimulus.text=C,D,G"]
    members = sweep(axes, overrides=["protocol.depth_mm=1.5"])
    assert [m.name for m in members[:3]] == [f"friction-0_text-{c}" for c in "CDG"]
    assert members[-1].study.stimulus.friction == 0.1
    assert members[-1].study.stimulus.text == "G"
    assert {m.study.protocol.depth_mm for m in members} == {1.5}
    assert members[0].values == {"stimulus.friction": "0", "stimulus.text": "C"}
    pairs = sweep(["stimulus.shift_mm=[0,1],[2,3]"])
    assert [m.study.stimulus.shift_mm for m in pairs] == [(0.0, 1.0), (2.0, 3.0)]


@pytest.mark.parametrize(
    ("listed", "names"),
    [
        ("Ä,Ö,C", ["text-Ä", "text-Ö", "text-C"]),
        ("Ψ,⠁,..", ["text-Ψ", "text-⠁", "text-.."]),
        ("!,?", ["text-_-", "text-_-"]),
        ('"/","a/b","a:b"', ["text-_-", "text-a_b-", "text-a_b-"]),
        ("c,C,D", ["text-c-", "text-C-", "text-D"]),  # one folder on some file systems
        (f"{'Ψ' * 40},{'Ψ' * 39}", [f"text-{'Ψ' * 40}", f"text-{'Ψ' * 39}"]),
    ],
)
def test_folders_of_a_sweep_differ_where_its_values_do(listed, names):
    members = sweep([f"stimulus.text={listed}"])
    found = [member.name for member in members]
    for name, expected in zip(found, names, strict=True):  # where it ends in "-", a hash follows
        assert re.fullmatch(re.escape(expected) + "[0-9a-f]{8}" * expected.endswith("-"), name)
    assert len({name.casefold() for name in found}) == len(names)
    if "c,C" not in listed:  # they are found again, whatever else is scanned
        for member in members:
            (alone,) = sweep(["stimulus.text=" + json.dumps(member.values["stimulus.text"])])
            assert alone.name == member.name


def test_folders_of_a_sweep_differ_by_the_folders_of_files(tmp_path):
    files = [tmp_path / ("sub/" * k) / "grain.csv" for k in (0, 60, 61)]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("0,0\n0,0.1\n")
    listed = ",".join(f'"{file}"' for file in files)
    members = sweep([f"stimulus.file={listed}"], overrides=["stimulus.kind=surface"])
    assert len({member.name for member in members}) == 3
    assert max(len(member.name.encode()) for member in members) < 140


def test_passes_closer_than_a_micrometre_have_folders_of_their_own():
    names = [m.name for m in single_fibre(Study(), spacing_mm=4e-4, half_width_mm=8e-4)]
    assert names[2:] == ["shift+0.000", "shift+0.000400000", "shift+0.000800000"]


@pytest.mark.parametrize(
    ("axes", "says"),
    [
        ([], "one or more different axes"),
        (["stimulus.friction"], "is no axis"),
        (["stimulus.friction="], "is no axis"),
        (["stimulus.friction=0,,1"], "is no axis"),
        (["stimulus.friction=0,1", "stimulus.friction=2"], "different axes"),
        (["stimulus.friction=0.1,0.1"], "name each value once"),
        (["stimulus.text=O\u0308,Ö"], "name each value once"),
        (["stimulus.friction=1,1.0"], "name each value once"),
        (['stimulus.text=1,"1"'], "name each value once"),
        (["stimulus.friction=-1"], "stimulus.friction is -1"),
        (["stimulus.colour=red"], "colour"),
    ],
)
def test_bad_axes_are_told(axes, says):
    with pytest.raises(StudyError, match=says):
        sweep(axes)


def test_all_scans_that_cannot_be_are_told_before_any_runs(tmp_path):
    with pytest.raises(StudyError) as found:
        run_series(sweep(["protocol.depth_mm=1,6,7"]), tmp_path / "r")
    lines = [line.partition(" but")[0] for line in str(found.value).splitlines()]
    assert lines == ["protocol.depth_mm is 6", "protocol.depth_mm is 7"]
    assert not (tmp_path / "r").exists()


def test_complete_scans_are_not_repeated_and_foreign_ones_refused(tmp_path):
    members = sweep(["stimulus.friction=0.1,0.2"], overrides=["finger.preset=coarse"])
    for member in members:
        make_results(tmp_path / member.name, member.study)
    outcomes = run_series(members, tmp_path)  # would take minutes if it ran
    assert [(o.member.name, o.problem, o.wall_s) for o in outcomes] == [
        (member.name, "", 0.0) for member in members
    ]
    rows = list(csv.DictReader(write_summary(members, tmp_path).open()))
    assert [row["stimulus.friction"] for row in rows] == ["0.1", "0.2"]
    assert float(rows[0]["pressed_N"]) == pytest.approx(0.6)
    assert rows[0]["status"] == "complete"
    others = sweep(["stimulus.friction=0.1,0.2"], overrides=["protocol.depth_mm=1"])
    with pytest.raises(StudyError, match="another series"):
        run_series(others, tmp_path)


def test_the_pressed_force_is_that_at_the_end_of_the_indentation(tmp_path):
    trace = make_trace()
    end = np.flatnonzero(trace["displacement_mm"] == 0)[-1]
    trace["depth_mm"][end + 10] += 0.3  # the body goes deeper where it holds a force
    trace["force_N"][end + 10, 2] = 0.9
    numbers = numbers_of(make_results(tmp_path / "r", Study(), trace))
    assert numbers["pressed_N"] == trace["force_N"][end, 2] == pytest.approx(0.6)


def test_the_numbers_of_a_scan_do_not_depend_on_its_steps(tmp_path):
    """Means over the slide's time, by hand of a force that rises from 0.6 to 1.6 N along it."""
    trace = make_trace()
    slid = trace["displacement_mm"]
    trace["force_N"][:, 2] += slid / slid[-1]
    trace["force_N"][:, 1] = -0.2 * slid
    trace["contact_area_mm2"] = 3 + slid**0
    trace["sed_kPa"] = trace["sed_kPa"] * np.exp(-slid)[:, None]  # largest as the slide begins
    found = numbers_of(make_results(tmp_path / "few", Study(), trace))
    assert found["normal_N"] == pytest.approx(1.1)
    assert found["tangential_N"] == pytest.approx(1.0)
    assert found["contact_area_mm2"] == pytest.approx(4.0)
    assert found["central_largest_sed_kPa"] == pytest.approx(trace["sed_kPa"][7, 10])
    more = refined(trace)
    assert len(more["time_s"]) > 2 * len(trace["time_s"])
    again = numbers_of(make_results(tmp_path / "many", Study(), more))
    for name in found.keys() - {"steps", "newton_iterations", "wall_s"}:
        assert again[name] == pytest.approx(found[name], rel=1e-9), name


def test_means_are_over_time_or_way():
    assert mean_over([0, 1, 10], [[0, 4], [2, 4], [2, 4]]) == pytest.approx([1.9, 4])
    assert mean_over([2], [[5, 6]]).tolist() == [5, 6]
    assert mean_over([1, 1], [3, 4]) == 4


def test_a_hold_after_a_slide_counts_by_its_time(tmp_path):
    """As long as the slide, in one step, at twice the force."""
    trace = make_trace()
    rows = {k: v if k == "receptors_mm" else np.concatenate([v, v[-1:]]) for k, v in trace.items()}
    for name in ("time_s", "clock_s"):
        rows[name][-1] += 10.0 / SPEED
    rows["force_N"][-2:, 2] = 1.2
    found = numbers_of(make_results(tmp_path / "r", Study(), rows))
    assert found["normal_N"] == pytest.approx(0.9, abs=0.005)


@pytest.mark.parametrize(
    "members", [sweep(["stimulus.friction=0.1"]), single_fibre(Study(), spacing_mm=5.0)]
)
def test_the_table_of_the_summary_is_that_of_its_columns(tmp_path, members):
    for member in members:
        make_results(tmp_path / member.name, member.study)
    columns = next(csv.reader(write_summary(members, tmp_path).open()))
    columns.remove(*members[0].values)
    assert columns == [column.name for column in SUMMARY]


@pytest.fixture(scope="module")
def small_study(small_finger) -> Study:
    return Study(
        finger=Finger(mesh_file=small_finger),
        stimulus=Text(text="G"),
        protocol=Protocol(depth_mm=0.2, distance_mm=0.1, output_mm=0.1),
        receptors=Receptors(spacing_mm=2.5),
        output=Output(pictures=False),
    )


def test_a_failed_scan_loses_no_other(small_study, tmp_path):
    members = single_fibre(small_study, spacing_mm=1.0, half_width_mm=1.0)
    # A folder that is in use by something else: this pass cannot run.
    blocked = tmp_path / members[1].name
    blocked.mkdir(parents=True)
    (blocked / "notes.txt").write_text("mine")
    outcomes = run_series(members, tmp_path, jobs=2)
    assert [bool(outcome.problem) for outcome in outcomes] == [False, True, False]
    assert "is not empty" in outcomes[1].problem
    rows = list(csv.DictReader(write_summary(members, tmp_path).open()))
    assert [row["status"] for row in rows] == ["complete", "not complete", "complete"]
    assert ["is not empty" in row["failed"] for row in rows] == [False, True, False]
    (blocked / "notes.txt").unlink()
    before = (tmp_path / members[0].name / "trace.npz").stat().st_mtime_ns
    again = run_series(members, tmp_path)
    assert not any(outcome.problem for outcome in again)
    assert not list(tmp_path.glob("*.failed.txt"))
    assert (tmp_path / members[0].name / "trace.npz").stat().st_mtime_ns == before
    shapes = {Results.open(tmp_path / m.name).trace["sed_kPa"].shape[1] for m in members}
    assert shapes == {1}


def test_a_series_with_a_file_that_changed_is_another_one(tmp_path):
    heights = tmp_path / "map.csv"
    np.savetxt(heights, np.zeros((9, 9)), delimiter=",")
    surface = Surface(file=heights, spacing_mm=1.0, unit_mm=0.001)
    members = single_fibre(Study(stimulus=surface), spacing_mm=5.0)
    for member in members:
        make_results(tmp_path / "series" / member.name, member.study)
    for _ in range(2):
        assert {outcome.wall_s for outcome in run_series(members, tmp_path / "series")} == {0.0}
    np.savetxt(heights, np.ones((9, 9)), delimiter=",")
    with pytest.raises(StudyError, match="a file that it names has changed"):
        run_series(members, tmp_path / "series")


def test_command_line_tells_what_is_wrong(capsys, tmp_path):
    folder = ["--results", str(tmp_path)]
    assert cli.main(["sweep", "--over", "stimulus.friction=x", *folder]) == 2
    assert 'stimulus.friction is "x"' in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def python(monkeypatch, tmp_path, script: str) -> None:
    """Put a script of the shell in the place of Python."""
    stand_in = tmp_path / "python"
    stand_in.write_text(f"#!/bin/sh\n{script}\n")
    stand_in.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(stand_in))


def test_each_scan_is_the_command_of_the_package(tmp_path, monkeypatch):
    python(monkeypatch, tmp_path, f"echo $* >> {tmp_path}/told")
    members = sweep(["stimulus.friction=0.1,0.2"])
    assert not any(outcome.problem for outcome in run_series(members, tmp_path / "series"))
    told = (tmp_path / "told").read_text().splitlines()
    assert told == [
        f"-m tactile_fem scan {tmp_path}/series/{m.name}.toml --results {tmp_path}/series/{m.name}"
        for m in members
    ]


def test_a_scan_that_is_killed_fails_alone_with_its_last_words(tmp_path, monkeypatch):
    killed = f"[ -e {tmp_path}/told ] || {{ touch {tmp_path}/told; kill -9 $$; }}"
    python(monkeypatch, tmp_path, f"echo step 3 >&2; {killed}")
    members = single_fibre(Study(), spacing_mm=0.5, half_width_mm=1.0)
    problems = [outcome.problem for outcome in run_series(members, tmp_path / "series")]
    assert problems == ["exit code -9; its last words: step 3", "", "", "", ""]
    (kept,) = (tmp_path / "series").glob("*.failed.txt")
    assert "its last words: step 3" in kept.read_text()


def test_scans_of_the_same_mechanics_are_begun_with_it(small_study, tmp_path, monkeypatch):
    """Of two whose first is there only spikes are left; of two others one waits for the other."""
    python(monkeypatch, tmp_path, f"echo $4 >> {tmp_path}/told; sleep 0.3")
    gains = [1.0, 2.0]
    members = [
        Member(
            f"{friction}-{gain:g}",
            small_study.model_copy(
                update={
                    "stimulus": Text(text="G", friction=friction),
                    "neuron": small_study.neuron.model_copy(update={"gain_spread": gain}),
                }
            ),
            {},
        )
        for friction in (0.1, 0.2)
        for gain in gains
    ]
    folder = tmp_path / "series"
    first = make_results(folder / members[0].name, members[0].study)
    run_series(members, folder, jobs=3)
    told = [line.rpartition("/")[2] for line in (tmp_path / "told").read_text().splitlines()]
    assert told[0] == "0.2-1.toml"  # then, when it has ended, what shares mechanics
    assert sorted(told[1:]) == ["0.1-2.toml", "0.2-2.toml"]
    begun = Results(folder / members[1].name)
    np.testing.assert_array_equal(begun.trace["sed_kPa"], first.trace["sed_kPa"])
    assert begun.study == members[1].study
    assert not (begun.folder / "spikes.csv").exists()


def test_a_signal_ends_the_scans_that_run_as_well(tmp_path, monkeypatch):
    # A scan that asks for the end, twice, and tells that it was asked.
    answer = f"trap 'echo > {tmp_path}/told; kill $!; exit 143' TERM"
    ask = "kill -TERM $PPID"
    python(monkeypatch, tmp_path, f"{answer}\n{ask}\n{ask}\nsleep 60 >/dev/null 2>&1 &\nwait")
    members = sweep(["stimulus.friction=0.1,0.2,0.3"])
    with pytest.raises(StoppedError):
        run_series(members, tmp_path / "series", jobs=2)
    assert (tmp_path / "told").exists()


def test_a_series_of_which_all_is_needed_ends_with_what_failed(tmp_path, monkeypatch):
    member = Member("one", Study(), {})
    failed = [Outcome(member, "it did not converge", 1.0)]
    monkeypatch.setattr("tactile_fem.series.run.run_series", lambda *_, **__: failed)
    with pytest.raises(TactileError, match="it did not converge"):
        run_all([member], tmp_path)
