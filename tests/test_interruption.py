"""Scans that are killed, stopped or cut off in their writes, and go on."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tactile_fem.runtime import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip

from tactile_fem import neuron
from tactile_fem.errors import StoppedError
from tactile_fem.results.fields import read_series
from tactile_fem.results.results import Results
from tactile_fem.runtime.ranks import raise_stopped, signal_handler
from tactile_fem.simulation.checkpoint import Checkpoints
from tactile_fem.simulation.run import resume, scan
from tactile_fem.study import Output, Protocol, Study
from tactile_fem.study.file import dump_study

PATIENCE_S = 300.0


@pytest.fixture
def whole(finished) -> Results:
    """The scan without interruption."""
    return Results(finished.folder)


def assert_equal(results: Results, whole: Results, tolerance: float) -> None:
    """Hold histories, spikes and fields against those of the scan without interruption."""
    assert results.run["status"] == "complete"
    for name, expected in whole.trace.items():
        if name in ("phase", "population"):
            np.testing.assert_array_equal(results.trace[name], expected)
        elif name not in ("wall_s", "imbalance_N", "newton_iterations", "linear_iterations"):
            error = np.abs(results.trace[name] - expected).max()
            assert error <= tolerance * np.abs(expected).max(), name
    assert len(whole.spikes.time_s) > 10
    np.testing.assert_array_equal(results.spikes.receptor, whole.spikes.receptor)
    np.testing.assert_allclose(results.spikes.time_s, whole.spikes.time_s, atol=1e-6)
    times, files = read_series(results.fields)
    np.testing.assert_allclose(times, read_series(whole.fields)[0], atol=1e-12)
    assert all(file.is_file() for file in files)


# --- kills -------------------------------------------------------------------------------------

KILLED = """
import os, signal, sys
from tactile_fem import scan
from tactile_fem.study.file import load_study
from mpi4py import MPI
study, folder, share, ranks = sys.argv[1:]
def kill(seen):
    if seen.step.fraction >= float(share) and str(MPI.COMM_WORLD.rank) in ranks:
        os.kill(os.getpid(), signal.SIGKILL)
scan(load_study(study), folder, observers=[kill])
"""
# Shares of the path at which ranks are killed: with no step kept, in the press, in the slide.
KILLS = [(0.0, "01"), (0.25, "1"), (0.7, "01")]


def kill_and_finish(study: Study, folder: Path, count: int) -> None:
    """Start the scan again and again, on so many ranks, and kill them; then let it end."""
    file = folder.with_suffix(".toml")
    file.write_text(dump_study(study))
    launch = [ranks.launcher(), "-n", str(count)] if count > 1 else []
    steps = []
    for share, killed in KILLS:
        moment = [str(share), killed if count > 1 else "0"]
        command = [*launch, sys.executable, "-c", KILLED, str(file), str(folder), *moment]
        code = subprocess.run(command, timeout=PATIENCE_S, capture_output=True).returncode
        assert code == -signal.SIGKILL if count == 1 else code != 0
        kept = (folder / "trace.npz").exists()
        steps.append(len(Results(folder).trace["time_s"]) if kept else 0)
    assert steps[0] <= 1 and steps[0] < steps[1] < steps[2]
    if count == 1:
        scan(study, folder)
    else:
        command = [*launch, sys.executable, "-m", "tactile_fem", "scan", str(file)]
        subprocess.run([*command, "--results", str(folder)], timeout=PATIENCE_S, check=True)


def test_killed_three_times_it_ends_the_same(study, whole, tmp_path):
    kill_and_finish(study, tmp_path / "r", 1)
    assert_equal(Results(tmp_path / "r"), whole, 1e-10)


@pytest.mark.slow
@pytest.mark.mpi
def test_two_ranks_killed_three_times_end_the_same(study, whole, tmp_path):
    """One rank is killed, which ends the other, or both."""
    kill_and_finish(study, tmp_path / "r", 2)
    assert_equal(Results(tmp_path / "r"), whole, 1e-8)


# --- real signals ------------------------------------------------------------------------------


def lines_of(file: Path) -> list[str]:
    return file.read_text().splitlines() if file.exists() else []


@pytest.mark.mpi
def test_two_ranks_stop_on_a_signal_and_one_goes_on(study, whole, tmp_path):
    folder, file, printed = (tmp_path / name for name in ("r", "study.toml", "printed"))
    file.write_text(dump_study(study))
    command = [ranks.launcher(), "-n", "2", sys.executable, "-m", "tactile_fem", "scan", str(file)]
    with printed.open("w") as log:
        run = subprocess.Popen([*command, "--results", str(folder)], stdout=log, stderr=log)
    end = time.monotonic() + PATIENCE_S
    while not any("step   2" in line for line in lines_of(folder / "log.txt")):
        assert run.poll() is None and time.monotonic() < end
        time.sleep(0.02)
    run.send_signal(signal.SIGTERM)
    code = run.wait(30)
    assert "Traceback" not in printed.read_text()
    if "Open MPI" in MPI.Get_library_version():  # its launcher kills the ranks at once
        assert code != 0
    else:
        assert code == 128 + signal.SIGTERM
        (sentence,) = [line for line in lines_of(printed) if "tactile-fem" in line]
        assert "stopped by SIGTERM" in sentence
        assert Results(folder).run["status"] == "stopped"
    resume(folder)
    assert_equal(Results(folder), whole, 1e-8)


def test_a_signal_is_heeded_within_a_step(study, tmp_path):
    def interrupt(seen):
        if seen.step.index == 5:
            signal.setitimer(signal.ITIMER_REAL, 0.05)

    def on_alarm(number, frame):
        os.kill(os.getpid(), signal.SIGINT)

    interrupted = signal.getsignal(signal.SIGINT)
    before = signal.signal(signal.SIGALRM, on_alarm)
    try:
        with pytest.raises(StoppedError) as caught:
            scan(study, tmp_path / "r", observers=[interrupt])
    finally:
        signal.signal(signal.SIGALRM, before)
    assert caught.value.exit_code == 130
    assert signal.getsignal(signal.SIGINT) is interrupted
    end = "stopped by SIGINT: everything up to the last step is saved; start it again to continue"
    assert str(caught.value) == end


# --- several signals ---------------------------------------------------------------------------


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


@pytest.fixture
def quick(study) -> Study:
    """A scan of two steps."""
    protocol = Protocol(depth_mm=0.1, distance_mm=0.05, output_mm=0.05)
    return study.model_copy(update={"protocol": protocol, "output": Output(pictures=False)})


def test_a_signal_before_the_first_step_is_the_scans_too(quick, tmp_path, monkeypatch):
    """Libraries that compile clean up after an Exception, which KeyboardInterrupt is not."""
    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr("tactile_fem.simulation.run.Simulation", lambda *_, **__: interrupt())
    with pytest.raises(StoppedError, match="stopped by SIGINT"):
        scan(quick, tmp_path / "r")
    assert signal.getsignal(signal.SIGINT) is before and not (tmp_path / "r").exists()


@pytest.mark.parametrize("last", [False, True])
def test_a_second_signal_does_not_cut_off_the_saving(quick, tmp_path, monkeypatch, last):
    """Also where another handler waits around the scan, as the command line's does."""

    def fire_all(*arguments):
        interrupt()
        return neuron.fire_all(*arguments)

    def observe(seen):
        if not last:
            interrupt()

    monkeypatch.setattr("tactile_fem.simulation.run.fire_all", fire_all)
    said = "the scan is complete" if last else "everything up to the last step is saved; start it"
    with pytest.raises(StoppedError, match=f"stopped by SIGINT: {said}"):
        with signal_handler(raise_stopped):
            scan(quick, tmp_path / "r", observers=[observe])
    results = Results(tmp_path / "r")
    assert results.run["status"] == ("complete" if last else "stopped")
    assert (results.folder / "spikes.csv").is_file()
    assert len(results.trace["time_s"]) >= 2


def test_signals_after_the_stop_do_not_cut_off_what_unwinds():
    unwound = []
    with pytest.raises(StoppedError), signal_handler(raise_stopped):
        try:
            with signal_handler(lambda number: None):
                raise StoppedError(signal.SIGINT)
        finally:
            interrupt()
            unwound.append("all")
    assert unwound == ["all"]


def test_a_handler_raises_once():
    with pytest.raises(StoppedError, match=r"^stopped by SIGTERM$"), signal_handler(raise_stopped):
        try:
            os.kill(os.getpid(), signal.SIGTERM)
        finally:
            interrupt()


def test_what_was_not_saved_is_not_said_to_be(quick, tmp_path, monkeypatch):
    with pytest.raises(StoppedError, match="nothing is saved, because there is no results folder"):
        scan(quick, observers=[lambda seen: interrupt()])

    def fail(*arguments):
        raise OSError(28, "No space left on device", "spikes.csv")

    monkeypatch.setattr(Results, "save_spikes", fail)
    with pytest.raises(StoppedError, match=r"could not be saved \(.*No space left on device"):
        scan(quick, tmp_path / "r", observers=[lambda seen: interrupt()])


# --- checkpoints that are some steps old --------------------------------------------------------


class PowerCut(BaseException):
    """In place of a kill that hits a write."""


@pytest.fixture
def seldom(monkeypatch):
    """Let checkpoints be written with the first step and with fields only."""
    monkeypatch.setattr("tactile_fem.simulation.checkpoint._INTERVAL_S", math.inf)


@pytest.mark.usefixtures("seldom")
def test_steps_after_the_checkpoint_are_computed_again(study, whole, tmp_path):
    """After a kill, which has cut off the write of the last row."""

    def kill(seen):
        if seen.step.index == 6:
            raise PowerCut

    with pytest.raises(PowerCut):
        scan(study, tmp_path / "r", observers=[kill])
    results, file = Results(tmp_path / "r"), tmp_path / "r" / "trace.rows"
    file.write_bytes(file.read_bytes()[:-100])
    assert len(results.trace["time_s"]) == 5 and int(results.load_checkpoint()["rows"]) == 4
    resume(results.folder)
    assert not file.exists()
    assert_equal(Results(results.folder), whole, 1e-10)


@pytest.mark.usefixtures("seldom")
def test_a_scan_that_is_stopped_is_saved_as_it_was_at_the_last_step(study, whole, tmp_path):
    """Of the solve that is broken off nothing is left."""
    steps = []

    def interrupt_in_a_solve(seen):
        steps.append(seen.step.index)
        if seen.step.index == 5:
            seen.simulation.problem.solver.snes.setMonitor(lambda *_: interrupt())

    with pytest.raises(StoppedError):
        scan(study, tmp_path / "r", observers=[interrupt_in_a_solve])
    assert steps[-1] == 5
    results = Results(tmp_path / "r")
    assert len(results.trace["time_s"]) == int(results.load_checkpoint()["rows"]) == 6
    resume(results.folder)
    assert_equal(Results(results.folder), whole, 1e-10)


def test_writing_checkpoints_takes_a_small_share_of_the_time(monkeypatch):
    """Three seconds apart, or so far that writing takes 2 % of them; none is written twice."""
    now, saved, cost_s = 0.0, [], 0.01

    def write(state):
        nonlocal now
        saved.append(state["row"])
        now += cost_s

    monkeypatch.setattr("tactile_fem.simulation.checkpoint.time.perf_counter", lambda: now)
    checkpoints = Checkpoints(MPI.COMM_SELF)
    for row in range(300):
        if row == 100:
            cost_s = 0.5
        checkpoints.keep({"row": row})
        if checkpoints.is_due:
            checkpoints.save(write)
        now += 0.5
    early, late = (
        np.diff([row for row in saved if first <= row < last])
        for first, last in ((0, 100), (106, 300))
    )
    assert saved[0] == 0 and set(early) == {6} and set(late) == {50}
    checkpoints.save(write)
    checkpoints.save(write)
    assert saved[-1] == 299 and saved[-2] != 299


# --- power cuts between the writes -------------------------------------------------------------


@pytest.fixture
def each_step(monkeypatch):
    """Let a checkpoint be written with each step."""
    monkeypatch.setattr("tactile_fem.simulation.checkpoint._INTERVAL_S", 0.0)
    monkeypatch.setattr("tactile_fem.simulation.checkpoint._SHARE", math.inf)


@pytest.mark.usefixtures("each_step")
@pytest.mark.parametrize("writes, renamed", [(3, False), (16, True)])
def test_cut_off_at_a_write_it_ends_the_same(study, whole, tmp_path, monkeypatch, writes, renamed):
    """The file is half written, or renamed just before."""
    real, count = os.replace, 0

    def replace(source, target):
        nonlocal count
        count += 1
        if count > writes:
            if renamed:
                real(source, target)
            raise PowerCut
        real(source, target)

    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(PowerCut):
        scan(study, tmp_path / "r")
    monkeypatch.undo()
    scan(study, tmp_path / "r")
    assert_equal(Results(tmp_path / "r"), whole, 1e-10)


def test_cut_off_between_field_and_checkpoint_the_field_is_not_listed_twice(
    study, whole, tmp_path, monkeypatch
):
    real = Results.save_checkpoint

    def save_checkpoint(results, **arrays):
        if len(arrays["fields"]) == 2:
            raise PowerCut
        real(results, **arrays)

    monkeypatch.setattr(Results, "save_checkpoint", save_checkpoint)
    with pytest.raises(PowerCut):
        scan(study, tmp_path / "r")
    monkeypatch.undo()
    assert len(read_series(tmp_path / "r" / "fields")[0]) == 2
    resume(tmp_path / "r")
    assert_equal(Results(tmp_path / "r"), whole, 1e-10)


# --- observers and populations of one's own -----------------------------------------------------


@pytest.mark.parametrize("end", [SystemExit("enough"), KeyboardInterrupt()])
def test_an_observer_that_exits_stops_the_scan(quick, tmp_path, end):
    def leave(seen):
        raise end

    with pytest.raises(type(end)):
        scan(quick, tmp_path / "r", observers=[leave])
    assert Results(tmp_path / "r").run["status"] == "stopped"
    assert scan(quick, tmp_path / "r").trace.depth_mm.max() == pytest.approx(0.1)
    assert Results(tmp_path / "r").run["status"] == "complete"


def test_a_scan_whose_neurons_fail_is_no_running_one(quick, tmp_path, monkeypatch):
    def fire_all(*arguments):
        raise ValueError("no such neuron")

    with monkeypatch.context() as patch, pytest.raises(ValueError, match="no such neuron"):
        patch.setattr("tactile_fem.simulation.run.fire_all", fire_all)
        scan(quick, tmp_path / "r")
    assert Results(tmp_path / "r").run["status"] == "failed: no such neuron"
    assert scan(quick, tmp_path / "r").response.spikes is not None
    assert Results(tmp_path / "r").run["status"] == "complete"


def test_observers_may_work_in_place(quick):
    kept = np.zeros(2)

    def spoil(seen):
        felt, step = seen.receptors, seen.step
        for array in (felt.sed_kPa, felt.moved_mm, step.load.force_N, step.stimulator_mm):
            array *= 0.0
        seen.simulation.layout.positions_mm[:] = 7.0
        seen.columns.pop("stretches")
        kept[:] += 1
        return {"kept": kept}

    def spoil_others(seen):
        assert seen.columns["kept"][0] == seen.step.index
        seen.columns["kept"] *= 0.0

    trace, whole = scan(quick, observers=[spoil, spoil_others]).trace, scan(quick).trace
    for name in ("sed_kPa", "moved_mm", "stretches", "force_N", "stimulator_mm", "receptors_mm"):
        np.testing.assert_array_equal(getattr(trace, name), getattr(whole, name), err_msg=name)
    np.testing.assert_array_equal(trace.kept[1:, 0], np.arange(1, len(trace)))
