"""Small scans end to end: ranks, resuming, pressing to a force, failing well."""

from __future__ import annotations

import logging
import shutil
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import ufl
from matplotlib.font_manager import findfont

from tactile_fem.runtime import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip

from tactile_fem.errors import ConvergenceError, StudyError
from tactile_fem.finger import read_mesh, write_mesh
from tactile_fem.neuron import Drive, Population
from tactile_fem.neuron.fields import STANDARD
from tactile_fem.path import Path
from tactile_fem.results.columns import FELT, OF_RECEPTOR
from tactile_fem.results.fields import read_series
from tactile_fem.results.histories import at_time
from tactile_fem.results.results import Results
from tactile_fem.results.trace import Trace
from tactile_fem.simulation.parts import Parts
from tactile_fem.simulation.run import completed, resume, scan
from tactile_fem.simulation.scan_result import ScanResult
from tactile_fem.simulation.simulation import Simulation
from tactile_fem.stimulus import Distance
from tactile_fem.study import (
    Afferents,
    Finger,
    Follow,
    Hold,
    Lift,
    Neuron,
    Output,
    Plate,
    Press,
    Protocol,
    Slide,
    Solver,
    Study,
    Text,
    Tissue,
)
from tactile_fem.study.file import dump_study


class Stopped(Exception):
    """Raised by an observer in place of a kill."""


def test_a_scan_presses_slides_feels_and_keeps(finished, study):
    trace, folder = finished.trace, finished.folder
    assert trace.time_s[0] == pytest.approx(-0.5 / 20)
    assert trace.time_s[-1] == pytest.approx(0.4 / 20)
    assert trace.depth_mm[-1] == 0.5
    assert {0.2, 0.4} <= set(np.round(trace.displacement_mm, 12))
    np.testing.assert_allclose(trace.stimulator_mm[-1], [0, -0.4, 0.5], atol=1e-12)
    pressing = trace.displacement_mm == 0
    assert np.all(np.diff(trace.force_N[pressing, 2]) > -1e-12)
    assert trace.force_N[-1, 2] > 0.01
    # The plate drags the skin its own way, towards the palm.
    assert trace.force_N[-1, 1] < -0.1 * trace.force_N[-1, 2]
    assert np.all(trace.imbalance_N < 1e-5)
    assert 0.3 < trace.contact_area_mm2[-1] < 100 and -0.05 < trace.volume_change[-1] < 0
    work, heat = trace.work_mJ.sum(), trace.friction_mJ.sum()
    assert 0 < heat < work and 0 < trace.stored_mJ[-1] < work - heat
    assert np.all(trace.linear_iterations >= trace.newton_iterations)
    assert trace.newton_iterations.sum() > 20 and np.all(trace.wall_s[1:] > 0)
    assert trace.sed_kPa.shape == (len(trace.time_s), 5)
    assert np.all(trace.sed_kPa[0] == 0)
    assert trace.sed_kPa[-1].max() > 1e-4
    assert len(finished.response.spikes) == 5

    results = Results.open(folder)
    assert results.study == study
    assert results.run["status"] == "complete"
    assert results.run["mesh"]["tetrahedra"] > 1000
    assert results.run["mesh"]["layers_mm"]["epidermis"] == pytest.approx(0.65, rel=0.05)
    assert results.run["mesh"]["pad_thickness_mm"] == pytest.approx(5.3, rel=0.05)
    assert results.run["compiler"]["flags"] == list(study.solver.compiler_flags)
    assert results.run["compiler"]["version"] and results.run["compiler"]["processor"]
    np.testing.assert_array_equal(results.trace["sed_kPa"], trace.sed_kPa)
    times, files = read_series(results.fields)
    np.testing.assert_allclose(times[1:], [0.0, 0.01, 0.02], atol=1e-12)
    assert 0.2 <= trace.depth_mm[results.kept_rows[0]] < 0.3  # in the press, too
    assert all(path.is_file() for path in files)
    assert "unknowns" in results.log_file.read_text()


def test_the_skin_of_a_kept_state_carries_the_load(finished, study):
    results = Results.open(finished.folder)
    skin, force_N = results.skin(0.4), finished.trace.force_N[-1]
    pressure_N = skin.contact_pressure_kPa * skin.area_mm2 / 1000
    friction_N = skin.friction_kPa * skin.area_mm2[:, None] / 1000
    assert pressure_N.sum() == pytest.approx(np.linalg.norm(force_N), rel=0.15)  # flanks push aside
    assert friction_N[:, 1].sum() == pytest.approx(-0.3 * pressure_N.sum(), rel=0.1)
    area_mm2 = finished.trace.contact_area_mm2[-1]
    assert skin.contact_area_mm2.sum() == pytest.approx(area_mm2, rel=1e-4)
    assert area_mm2 < skin.area_mm2[skin.contact > 0].sum()  # that of whole facets
    assert set(skin.contact) == {0, 2}  # all slips
    assert skin.stretches.min() < 0.99 < 1.01 < skin.stretches.max()
    assert 0 < results.interface(0.4).sed_kPa.max() < results.trace["sed_kPa"].max() * 5
    with pytest.raises(
        StudyError, match=r"has no state near 3 mm: states were kept at 0, 0.2, 0.4 "
    ):
        results.skin(3.0)
    pressed = results.skin(at_s=float(finished.trace.time_s[results.kept_rows[0]]))
    assert pressed.contact_pressure_kPa.max() < skin.contact_pressure_kPa.max()


def test_a_finished_scan_is_read(finished, study, caplog, monkeypatch):
    monkeypatch.setattr(logging.getLogger("tactile_fem"), "propagate", True)
    monkeypatch.setattr("tactile_fem.simulation.run.Simulation", None)
    before = sorted((path, path.stat().st_mtime_ns) for path in finished.folder.rglob("*"))
    with caplog.at_level(logging.INFO, "tactile_fem"):
        again = scan(study, str(finished.folder))
    assert [record.message for record in caplog.records] == [
        f"{finished.folder} holds this scan, finished: its results are read"
    ]
    for name, array in finished.trace.arrays().items():
        np.testing.assert_array_equal(getattr(again.trace, name), array)
    assert again.response.counts().tolist() == finished.response.counts().tolist()
    for there, here in zip(finished.response.spikes, again.response.spikes, strict=True):
        np.testing.assert_allclose(here, there, atol=1e-6)
    assert (again.folder, again.study) == (finished.folder, study)
    assert completed(study, finished.folder).run == Results(finished.folder).run
    for changed, sentence in [
        ({"parts": Parts(body=Floor())}, r"holds this scan with a body that was the study's, now"),
        ({"parts": Parts(laws={"fat": None})}, '"fat" is no tissue; allowed'),
        ({"observers": [print]}, r"finished, so that observers would see none of its steps: leave"),
    ]:
        with pytest.raises(StudyError, match=sentence):
            scan(study, finished.folder, **changed)
    other = study.model_copy(update={"stimulus": Text(text="G")})
    with pytest.raises(StudyError, match=r"another study: stimulus\.text is FG there and G here; "):
        scan(other, finished.folder)
    assert before == sorted((path, path.stat().st_mtime_ns) for path in finished.folder.rglob("*"))


def assert_equal(several: Results, one: ScanResult) -> None:
    """Hold the results of several ranks against those of one."""
    trace = several.trace
    np.testing.assert_allclose(trace["time_s"], one.trace.time_s, atol=1e-12)
    for name in ("sed_kPa", "force_N", "friction_mJ", "work_mJ", "stored_mJ", "contact_area_mm2"):
        of_one = getattr(one.trace, name)
        assert np.abs(trace[name] - of_one).max() < 1e-6 * of_one.max(), name
    ours, theirs = several.skin(), Results.open(one.folder).skin()
    for name, column in theirs.columns.items():
        assert np.abs(ours.columns[name] - column).max() < 2e-6 * np.abs(column).max(), name
    counts = [int(np.sum(several.spikes.receptor == k)) for k in range(5)]
    assert counts == one.response.counts().tolist()


@pytest.mark.ranks
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="runs on several ranks")
def test_several_ranks_equal_one(study, tmp_path):
    one = scan(study, tmp_path / f"one_{MPI.COMM_WORLD.rank}", comm=MPI.COMM_SELF)
    scan(study, tmp_path / "several")
    assert_equal(Results.open(tmp_path / "several"), one)


@pytest.mark.slow
@pytest.mark.mpi
def test_three_ranks_of_the_command_equal_one(finished, study, tmp_path):
    file = tmp_path / "study.toml"
    file.write_text(dump_study(study))
    command = [ranks.launcher(), "-n", "3", sys.executable, "-m", "tactile_fem", "scan"]
    subprocess.run([*command, str(file), "--results", str(tmp_path / "three")], check=True)
    assert_equal(Results.open(tmp_path / "three"), finished)


def test_a_scan_cut_off_resumes_to_the_same_result(finished, study, tmp_path):
    def stop(seen):
        if seen.step.index == 9:  # seen before it is saved
            raise Stopped

    with pytest.raises(Stopped):
        scan(study, tmp_path / "cut", observers=[stop])
    steps = []
    resumed = resume(tmp_path / "cut", observers=[lambda seen: steps.append(seen.step)])
    assert steps[0].index == 9 and steps[0].phase == "slide"
    whole = finished.trace.arrays()
    for name, array in resumed.trace.arrays().items():
        if name in ("phase", "population"):
            np.testing.assert_array_equal(array, whole[name])
        elif name.endswith("_iterations"):
            assert np.abs(array - whole[name]).sum() <= 2, name
        elif name not in ("wall_s", "imbalance_N"):
            noise = 1e-10 * np.abs(whole[name]).max()
            np.testing.assert_allclose(array, whole[name], rtol=0, atol=noise, err_msg=name)
    run = Results.open(tmp_path / "cut").run
    assert run["status"] == "complete"
    kept, expected = Results(tmp_path / "cut").kept_rows, Results(finished.folder).kept_rows
    np.testing.assert_array_equal(kept, expected)
    steps_s = resumed.trace.wall_s  # of both parts, and so are the run's
    assert steps_s.sum() < run["wall_s"]
    assert 0 < steps_s.sum() - run["timers_s"]["solve"] < steps_s[:9].sum()


def test_a_scan_cut_off_and_moved_needs_no_file_of_its_study(study, tmp_path):
    away = tmp_path / "away"
    away.mkdir()
    font = shutil.copy(findfont("DejaVu Sans"), away / "mine.ttf")
    mesh = shutil.copy(study.finger.mesh_file, away / "mine.npz")
    brief = {
        "finger": Finger(mesh_file=mesh),
        "stimulus": Text(text="F", font=str(font)),
        "protocol": Protocol(depth_mm=0.15, distance_mm=0),
    }

    def stop(seen):
        if seen.step.index == 2:
            raise Stopped

    of_files = study.model_copy(update=brief)
    with pytest.raises(Stopped):
        scan(of_files, tmp_path / "r", observers=[stop])
    with pytest.raises(StudyError, match=r"finger.mesh_file is .*mine.npz there"):
        scan(study, tmp_path / "r")
    shutil.rmtree(away)
    shutil.move(tmp_path / "r", tmp_path / "moved")
    steps = []
    resume(tmp_path / "moved", observers=[lambda seen: steps.append(seen.step.index)])
    assert steps[0] == 2
    found = completed(of_files, tmp_path / "moved")
    assert found.complete and found.run["files"].keys() == {"finger.mesh_file", "stimulus.font"}
    assert len(list((found.folder / "inputs").iterdir())) == 2


def test_two_populations_share_a_scan_that_is_cut_off(finished, study, tmp_path):
    """The SA1 are those of the study without names; the RA, of the other tissue, a user's own."""
    felt = Drive("Squeeze", "kPa", lambda h: np.abs(h["stresses_kPa"][..., 0]))
    ra = {"spacing_mm": 5.0, "side": "dermis"}
    two = study.model_copy(
        update={
            "afferents": (
                Afferents(name="SA1", receptors=study.receptors),
                Afferents(name="RA", receptors=study.receptors.model_copy(update=ra)),
            )
        }
    )

    def stop(seen):
        if seen.step.index == 9:  # seen before it is saved
            raise Stopped

    with pytest.raises(Stopped):
        scan(two, tmp_path / "two", observers=[stop])
    with pytest.raises(StudyError, match='no afferents "PC"'):
        resume(tmp_path / "two", parts=Parts(populations=(Population("PC"),)))
    squeezed = Neuron(model="hamasaki2020", static_gain_pA_per_kPa=1e3)
    result = resume(tmp_path / "two", parts=Parts(populations=(Population("RA", squeezed, felt),)))
    trace, one = result.trace, finished
    assert trace.population.tolist() == ["SA1"] * 5 + ["RA"] * 3
    np.testing.assert_allclose(trace.receptors_mm[5:, 0], [-5, 0, 5], atol=1e-12)
    for name in ("sed_kPa", "von_mises_kPa", "stretches"):
        whole = getattr(one.trace, name)
        own = getattr(trace, name)[:, :5]
        noise = 1e-10 * np.abs(whole).max()
        np.testing.assert_allclose(own, whole, rtol=0, atol=noise, err_msg=name)
    # Beside one another, but in other tissue.
    beside = trace.sed_kPa[-1, 5:] / trace.sed_kPa[-1, [0, 2, 4]]
    assert (beside > 0).all() and not np.allclose(beside, 1, atol=0.02)
    assert np.all(np.diff(trace.stresses_kPa, axis=-1) >= 0)
    assert trace.stresses_kPa[-1, 6, 0] < 0  # pressed
    results = Results.open(tmp_path / "two")
    np.testing.assert_array_equal(results.trace["population"], trace.population)
    counts = [int(np.sum(results.spikes.receptor == k)) for k in range(8)]
    assert counts == result.response.counts().tolist() and counts[6] > 0
    assert set(results.spikes.population[results.spikes.receptor >= 5]) == {"RA"}
    again = scan(two, tmp_path / "two").response  # finished, but now fires as the study says
    assert again.counts()[:5].tolist() == counts[:5] and again.counts()[6] != counts[6]


def test_a_users_finger_is_pressed_as_deep_as_it_is_thick(study, small_finger, tmp_path):
    """Half as thick, up to four fifths of its own thickness, not of the default's."""
    finger = read_mesh(small_finger)
    flat = replace(finger, nodes=finger.nodes * [1.0, 1.0, 0.5])
    write_mesh(tmp_path / "flat.npz", flat)
    pressed = {"finger": Finger(mesh_file=tmp_path / "flat.npz"), "stimulus": Plate()}
    hard = {**pressed, "protocol": Protocol(force_N=1e4, distance_mm=0)}
    deepest = Simulation(study.model_copy(update=hard)).path.places_mm()[:, 2].max()
    assert deepest == pytest.approx(0.8 * 0.5 * 5.3, abs=0.05)
    through = {**pressed, "protocol": Protocol(depth_mm=2.7, distance_mm=0)}
    with pytest.raises(StudyError, match=r"protocol\.depth_mm is 2\.7 but must be less than 2\.6"):
        Simulation(study.model_copy(update=through))


def test_a_press_that_meets_nothing_is_said(study, monkeypatch, caplog):
    monkeypatch.setattr(logging.getLogger("tactile_fem"), "propagate", True)
    between = study.model_copy(update={"protocol": Protocol(depth_mm=0.002, distance_mm=0.1)})
    assert not scan(between).trace.force_N.any()
    messages = [record.message for record in caplog.records if record.levelno == logging.WARNING]
    assert len(messages) == 2
    assert "the press ends at 0.002 mm without contact" in messages[0]
    assert "never touched the finger" in messages[1]


def test_a_step_has_the_traces_names(study):
    steps = []
    brief = study.model_copy(update={"protocol": Protocol(depth_mm=0.3, distance_mm=0)})
    trace = scan(brief, observers=[lambda seen: steps.append(seen.step)]).trace.arrays()
    of_receptors = {column.name for column in (*OF_RECEPTOR, *FELT)}
    for name in trace.keys() - of_receptors - {"time_s"}:
        values = [getattr(step if hasattr(step, name) else step.load, name) for step in steps]
        np.testing.assert_array_equal(values, trace[name][1:], err_msg=name)


def test_a_scan_in_a_script_shows_and_logs_its_steps(study, tmp_path, monkeypatch, capsys):
    for name in ("", "tactile_fem"):  # as pytest configures logging, and no script need
        monkeypatch.setattr(logging.getLogger(name), "handlers", [])
    brief = study.model_copy(update={"protocol": Protocol(depth_mm=0.2, distance_mm=0)})
    steps = len(scan(brief, tmp_path / "r").trace) - 1
    shown = capsys.readouterr()
    assert shown.out == "" and "step   1  press" in shown.err and "100 %" in shown.err
    logged = Results(tmp_path / "r").log_file.read_text()
    assert all(f"step {number:3d}  press" in logged for number in range(1, steps + 1))
    monkeypatch.setattr(logging.getLogger("tactile_fem"), "handlers", [logging.NullHandler()])
    scan(brief, tmp_path / "r", overwrite=True)
    assert capsys.readouterr() == ("", "")


def test_seconds_are_of_the_scan_alone(finished, study, tmp_path):
    """DOLFINx's timers go on from scan to scan of a process."""
    del finished
    brief = study.model_copy(update={"protocol": Protocol(depth_mm=0.1, distance_mm=0)})
    scan(brief, tmp_path / "brief")
    run = Results.open(tmp_path / "brief").run
    assert 0 < run["timers_s"]["solve"] < run["wall_s"]


def test_divergence_keeps_what_came_before_and_says_where(study, tmp_path):
    """Two Newton iterations are too few for a whole step."""
    hopeless = Solver(min_step_mm=0.02, petsc={"snes_max_it": 2})
    where = r"the press stopped at a depth of .* mm, 0\.0000 mm across"
    with pytest.raises(ConvergenceError, match=where) as error:
        scan(study.model_copy(update={"solver": hopeless}), tmp_path / "failed")
    assert error.value.exit_code == 3
    assert "diverged" in error.value.reason
    assert Results.open(tmp_path / "failed").run["status"].startswith("failed")


# --- paths, observers' columns, own parts ---------------------------------------------------------


@pytest.fixture(scope="module")
def held(study) -> Study:
    """A press to a force that is then held, in rest and in motion."""
    pieces = (
        Press(force_N=0.03),
        Hold(time_s=0.02, output_s=0.01, force_N=0.03),
        Slide(by_mm=(0.0, -0.1), output_mm=0.05, force_N=0.03),
        Lift(depth_mm=-0.05),
    )
    return study.model_copy(update={"protocol": Protocol(path=pieces)})


def middle_pressed(seen):
    """Return columns of one's own: a number for each step, one for each receptor, a vector."""
    felt = seen.receptors.sed_kPa
    number = {"mean_kPa": felt.mean(), "twice_kPa": 2 * felt, "pull_N": seen.step.load.force_N[:2]}
    return number if seen.step.index > 1 else {}


@pytest.fixture(scope="module")
def held_whole(held):
    return scan(held, observers=[middle_pressed]).trace


def test_a_held_normal_force_stays(held_whole):
    trace = held_whole
    assert list(dict.fromkeys(trace.phase)) == ["rest", "press", "hold", "slide", "lift"]
    at_force = np.isin(trace.phase, ["hold", "slide"])
    at_force[np.flatnonzero(trace.phase == "press")[-1]] = True
    assert at_force.sum() >= 6
    np.testing.assert_allclose(trace.force_N[at_force, 2], 0.03, rtol=2e-3)
    assert np.ptp(trace.depth_mm[at_force]) > 1e-3  # skin relaxes, letters come and go
    assert trace.time_s[trace.phase == "press"][-1] == 0
    np.testing.assert_allclose(trace.time_s[trace.phase == "slide"][-1], 0.02 + 0.1 / 20)
    np.testing.assert_allclose(trace.stimulator_mm[-1], [0, -0.1, -0.05], atol=1e-12)
    assert abs(trace.force_N[-1, 2]) < 1e-4 and np.all(trace.imbalance_N < 1e-5)


def test_a_held_force_and_observers_columns_survive_an_interruption(held, held_whole, tmp_path):
    cut = tmp_path / "cut"

    def stop(seen):
        if seen.step.phase == "slide" and seen.step.displacement_mm > 0.05:
            raise Stopped

    with pytest.raises(Stopped):
        scan(held, cut, observers=[middle_pressed, stop])
    resumed = resume(cut, observers=[middle_pressed]).trace
    whole, kept = held_whole.arrays(), Results.open(cut).trace
    assert kept.keys() == whole.keys()
    for name, array in resumed.arrays().items():
        np.testing.assert_array_equal(kept[name], array, err_msg=name)
        if name in ("phase", "population"):
            np.testing.assert_array_equal(array, whole[name])
        elif name not in ("wall_s", "imbalance_N", "newton_iterations", "linear_iterations"):
            # Where the skin first touches, rounding grows to what Newton's method leaves.
            most = 1e-6 * np.nanmax(np.abs(whole[name]))
            np.testing.assert_allclose(array, whole[name], rtol=0, atol=most, err_msg=name)
    # Of the first two rows it told nothing.
    assert np.isnan(kept["mean_kPa"][:2]).all() and np.isnan(kept["pull_N"][:2]).all()
    np.testing.assert_array_equal(kept["twice_kPa"][2:], 2 * kept["sed_kPa"][2:])
    np.testing.assert_array_equal(kept["pull_N"][2:], kept["force_N"][2:, :2])


@pytest.mark.parametrize(
    "pieces",
    [
        pytest.param(
            (
                Press(depth_mm=0.1),
                Press(depth_mm=0.2),
                Press(depth_mm=0.3),
                Hold(time_s=0.01, output_s=0.01),
                Press(depth_mm=0.35),
                Slide(by_mm=(0.0, -0.1), output_mm=0.1),
            ),
            marks=pytest.mark.slow,
            id="presses",
        ),
        pytest.param((Follow(file="down.csv", output_s=0.002), Press(depth_mm=0.3)), id="places"),
    ],
)
def test_fields_and_states_have_the_times_of_their_steps(study, pieces, tmp_path):
    """Several pieces indent: time 0 is known only at the end of the last."""
    file = tmp_path / "down.csv"
    file.write_text("time_s,x_mm,y_mm,z_mm\n0,0,0,0\n0.01,0,0,0.2\n")
    if isinstance(pieces[0], Follow):
        pieces = pieces[0].model_copy(update={"file": file}), *pieces[1:]
    output = Output(pictures=False, states_mm=0.1, restarts=True)
    changed = {"stimulus": Plate(), "protocol": Protocol(path=pieces), "output": output}
    pressed = study.model_copy(update=changed)

    def check(folder, trace):
        times, files = read_series(folder / "fields")
        states = [np.load(path) for path in sorted((folder / "states").glob("*.npz"))]
        rows = [int(state["rows"]) - 1 for state in states]
        np.testing.assert_array_equal(times, trace.time_s[rows])
        assert len(files) == len(states) and np.all(np.diff(times) > 0)
        depths = [float(state["translation"][2]) for state in states]
        np.testing.assert_allclose(at_time(trace.arrays(), "depth_mm", times), depths, atol=1e-12)
        return rows

    whole = scan(pressed, tmp_path / "whole").trace
    ends = np.flatnonzero(whole.phase[1:] != whole.phase[:-1])[1:]
    rows = check(tmp_path / "whole", whole)
    assert {*ends.tolist(), len(whole) - 1} <= set(rows)

    def stop(seen):
        if seen.step.index == rows[1] + 2:  # within the indentation, after two fields
            raise Stopped

    with pytest.raises(Stopped):
        scan(pressed, tmp_path / "cut", observers=[stop])
    saved = Results(tmp_path / "cut").trace
    cut = Trace(saved["receptors_mm"], saved["population"])
    cut.restore(saved, rows[1] + 2)
    check(tmp_path / "cut", cut)
    assert check(tmp_path / "cut", resume(tmp_path / "cut").trace) == rows


@pytest.mark.slow
def test_a_scan_with_inertia_holds_a_force_and_survives_an_interruption(study, tmp_path):
    pieces = Press(force_N=0.02), Slide(by_mm=(0.0, -0.1), output_mm=0.05, force_N=0.02)
    solver = study.solver.model_copy(update={"inertia": True})
    changed = {"protocol": Protocol(path=pieces), "solver": solver}
    moving = study.model_copy(update=changed)

    def stop(seen):
        if seen.step.phase == "slide" and seen.step.output:
            raise Stopped

    whole = scan(moving, tmp_path / "whole").trace
    with pytest.raises(Stopped):
        scan(moving, tmp_path / "cut", observers=[stop])
    trace = resume(tmp_path / "cut").trace
    for name in ("force_N", "sed_kPa", "moved_mm", "depth_mm"):
        array, expected = getattr(trace, name), getattr(whole, name)
        most = np.abs(expected).max()
        np.testing.assert_allclose(array, expected, rtol=0, atol=1e-6 * most, err_msg=name)
    slid = trace.phase == "slide"
    np.testing.assert_allclose(trace.force_N[slid, 2], 0.02, rtol=2e-3)
    assert slid.sum() >= 2 and np.all(trace.imbalance_N < 1e-5)


@pytest.mark.parametrize(
    ("column", "sentence"),
    [
        ({"force_N": 1.0}, "observers: the trace has a column force_N: choose another name."),
        ({"x": "much"}, "observers: x must be numbers but is 'much'."),
        ({"y": [1.0, 2.0]}, r"observers: y has the shape \(2,\), before it had \(3,\)\."),
    ],
)
def test_a_column_that_cannot_be(column, sentence):
    trace = Trace(np.zeros((2, 3)), np.array(["SA1", "SA1"]))
    step = SimpleNamespace(**{name: 0.0 for name in trace.arrays()}, indenting=True)
    felt = {field.name: 0.0 for field in STANDARD}
    trace(SimpleNamespace(step=step, columns={**felt, "y": np.zeros(3)}))
    with pytest.raises(StudyError, match=sentence):
        trace(SimpleNamespace(step=step, columns={**felt, **column}))
    assert len(trace) == 2 and np.isnan(trace.y[0]).all() and not trace.y[1].any()


class Floor:
    """The half-space below a height."""

    def __init__(self, height_mm: float = 0.0) -> None:
        self.height_mm = height_mm

    def distance(self, points):
        count = len(points)
        up = np.tile([0.0, 0.0, 1.0], (count, 1))
        return Distance(points[:, 2] - self.height_mm, up, np.zeros((count, 3, 3)))


def test_parts_that_do_what_the_studys_do_give_the_same(study, tmp_path):
    flat = {"stimulus": Plate(), "protocol": Protocol(depth_mm=0.2, distance_mm=0.1)}
    of_study = scan(study.model_copy(update=flat)).trace
    law = study.tissue.dermis
    path = Path((Press(depth_mm=0.2), Slide(by_mm=(0.0, -0.1))))
    parts = Parts(laws={"dermis": law}, body=Floor(), path=path)

    def stop(seen):
        if seen.step.index == 3:
            raise Stopped

    with pytest.raises(Stopped):
        scan(study, tmp_path / "own", observers=[stop], parts=parts)
    for other, sentence in [
        (Parts(), r"with a law of dermis that was .*, now it is the study's"),
        (
            replace(parts, body=None),
            r"with a body that was \S+Floor \w+, now it is the study's: give",
        ),
        (
            replace(parts, body=Floor(-0.1)),
            r"with a body that was \S+Floor \w+, now it is \S+Floor",
        ),
        (replace(parts, path=Path((Press(depth_mm=0.2),))), "with a path that was"),
        (replace(parts, laws={**parts.laws, "epidermis": law}), "with a law of epidermis that was"),
    ]:
        with pytest.raises(StudyError, match=sentence) as caught:
            resume(tmp_path / "own", parts=other)
        assert "\n" not in str(caught.value)
    own = resume(tmp_path / "own", parts=replace(parts, body=Floor())).trace
    for name in ("force_N", "sed_kPa", "von_mises_kPa", "stored_mJ", "time_s", "stimulator_mm"):
        expected = getattr(of_study, name)
        largest = np.abs(expected).max()
        np.testing.assert_allclose(getattr(own, name), expected, atol=1e-6 * largest, err_msg=name)
    kept = Results.open(tmp_path / "own").stimulator  # for pictures
    assert kept is not None
    height = kept.origin_mm[2] + kept.step_mm * np.arange(len(kept.gap_mm))
    np.testing.assert_allclose(kept.gap_mm[:, 3, 5], np.clip(height, -0.5, 0.5), atol=1e-6)


def test_an_own_path_through_the_bone_is_the_parts_fault(study):
    with pytest.raises(
        StudyError, match=r"parts\.path \(piece 1\) goes 9 mm deep but must be less"
    ):
        scan(study, parts=Parts(path=Path((Press(depth_mm=9.0),))))


class Bent:
    """A body whose normal is no vector."""

    def distance(self, points):
        found = Floor().distance(points)
        return replace(found, normal=found.normal[:, :2])


class Steep(Floor):
    """A body whose distance counts three times as fast as the way."""

    def distance(self, points):
        found = super().distance(points)
        return replace(found, gap=3 * found.gap, normal=3 * found.normal)


class Walled(Floor):
    """A body that has no normal where it is farther than a millimetre."""

    def distance(self, points):
        found = super().distance(points)
        return replace(found, normal=found.normal * (found.gap < 1)[:, None])


@pytest.mark.parametrize(
    ("parts", "sentence"),
    [
        (Parts(laws={"fat": None}), '"fat" is no tissue; allowed: stratum_corneum, epidermis'),
        (Parts(body=Bent()), r"parts.body: .* must give .* but gives .*4900, 2"),
        (Parts(body=Floor(np.nan)), "parts.body: its distance, .* is not finite"),
        (Parts(body=Steep(-0.1)), r"parts.body: its distance changes by .* over 0.1 mm"),
        (Parts(body=Walled(-0.1)), "parts.body: its normal is zero at X -6.00, Y -12.00, Z 1.50"),
        (Parts(body=Floor(0.5)), r"starts 0\.4\d+ mm inside the finger"),
        (Parts(path=Path(())), "parts.path: it has no pieces but needs one or more"),
        (
            Parts(populations=(Population(feels=Drive("Sum", "kPa", lambda h: h["sed"])),)),
            "Sum: the histories have no sed",
        ),
        (
            Parts(populations=(Population(feels=Drive("Log", "1", lambda h: h["time_s"])),)),
            "Log has shape",
        ),
    ],
)
def test_bad_parts_are_found_before_any_long_work(study, parts, sentence, tmp_path, monkeypatch):
    monkeypatch.setattr("tactile_fem.simulation.simulation.create_domain", None)
    with pytest.raises(StudyError, match=sentence):
        scan(study, tmp_path / "results", parts=parts)
    assert not (tmp_path / "results").exists()


class Soft:
    """A law of one's own that does not tell its energy in shear."""

    def energy(self, F, at):
        return 1e-3 * ufl.tr(F.T * F)


def test_an_own_law_of_a_tissue_that_relaxes_must_know_shear(study, monkeypatch):
    monkeypatch.setattr("tactile_fem.simulation.simulation.create_domain", None)
    relaxing = study.model_copy(update={"tissue": Tissue(relaxation="fingerpad")})
    with pytest.raises(StudyError, match=r"dermis relaxes .* needs a method in_shear"):
        scan(relaxing, parts=Parts(laws={"dermis": Soft()}))
