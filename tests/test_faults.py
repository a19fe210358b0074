"""Faults of disk, cache, checkpoint, mechanics and ranks: one sentence, nothing lost."""

from __future__ import annotations

import fcntl
import os
import resource
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import meshio
import numpy as np
import pytest
from cffi import VerificationError

from tactile_fem.runtime import backend, ranks  # noqa: F401

from mpi4py import MPI  # isort: skip
from dolfinx import jit  # isort: skip

from tactile_fem.assembly.compile import clean_cache, jit_options
from tactile_fem.errors import ConvergenceError, StudyError, TactileError
from tactile_fem.finger import FingerMesh, read_mesh, write_mesh
from tactile_fem.mechanics.faults import compilation_errors
from tactile_fem.output.figures import draw_plots
from tactile_fem.results.columns import OF_RECEPTOR
from tactile_fem.results.fields import read_series
from tactile_fem.results.results import Results
from tactile_fem.results.trace import Trace
from tactile_fem.runtime.files import locked
from tactile_fem.simulation.run import resume, scan
from tactile_fem.study import (
    Finger,
    Neuron,
    Output,
    Plate,
    Polynomial,
    Protocol,
    Receptors,
    Solver,
    Study,
    Text,
    Tissue,
)
from tactile_fem.study.file import dump_study


@pytest.fixture(scope="module")
def study(small_finger) -> Study:
    return Study(
        finger=Finger(mesh_file=small_finger),
        stimulus=Text(text="FG"),
        protocol=Protocol(depth_mm=0.2, distance_mm=0.1, speed_mm_s=1.0),
        receptors=Receptors(spacing_mm=2.5),
        output=Output(pictures=False),
    )


class Stopped(Exception):
    """Raised by an observer in place of a kill."""


@pytest.fixture(scope="module")
def half_done(study, tmp_path_factory) -> Path:
    """A scan that was cut off after two steps."""
    folder = tmp_path_factory.mktemp("half") / "r"

    def stop(seen):
        if seen.step.index == 3:  # seen before it is kept
            raise Stopped

    with pytest.raises(Stopped):
        scan(study, folder, observers=[stop])
    return folder


@pytest.fixture
def cut(half_done, tmp_path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(half_done, tmp_path / "r"))


def contents(folder: Path) -> dict[str, bytes]:
    names = ("study.toml", "trace.npz", "checkpoint.npz", "run.json")
    return {name: (folder / name).read_bytes() for name in names if (folder / name).is_file()}


def change_checkpoint(folder: Path, **changes) -> None:
    results = Results(folder)
    saved = {**results.load_checkpoint(), **changes}
    results.save_checkpoint(**{name: array for name, array in saved.items() if array is not None})


# --- checkpoints -------------------------------------------------------------------------------


def of_an_older_version(folder: Path) -> None:
    change_checkpoint(folder, format=None, version=None, study=None, fields=None)


def of_a_newer_version(folder: Path) -> None:
    change_checkpoint(folder, format=99, version="7.0")


def foreign(folder: Path) -> None:
    np.savez(folder / "checkpoint.npz", x=np.zeros(3))


def half_written(folder: Path) -> None:
    path = folder / "checkpoint.npz"
    path.write_bytes(path.read_bytes()[:1000])


def pickled(folder: Path) -> None:
    np.savez(folder / "checkpoint.npz", format=np.array([{}], dtype=object))


def no_archive(folder: Path) -> None:
    np.save(folder / "x.npy", np.zeros(3))
    (folder / "x.npy").rename(folder / "checkpoint.npz")


def removed(folder: Path) -> None:
    (folder / "checkpoint.npz").unlink()


def of_another_study(folder: Path) -> None:
    path = folder / "study.toml"
    path.write_text(path.read_text().replace("depth_mm = 0.2", "depth_mm = 0.3"))


def of_another_mesh(folder: Path) -> None:
    change_checkpoint(folder, mesh="0123")


def with_another_surface(folder: Path) -> None:
    change_checkpoint(folder, files='{"stimulus.file": "0123"}')


def with_another_trace(folder: Path) -> None:
    results = Results(folder)
    results.save_trace(**{name: a for name, a in results.trace.items() if name != "work_mJ"})


def with_a_shorter_trace(folder: Path) -> None:
    results = Results(folder)
    trace = results.trace
    steps = trace.keys() - {column.name for column in OF_RECEPTOR}
    short = {**trace, **{name: trace[name][:2] for name in steps}}
    results.save_trace(**short)


def of_no_study(folder: Path) -> None:
    (folder / "study.toml").unlink()


FAULTS = [
    (of_an_older_version, r"an older version\. This is tactile_fem"),
    (of_a_newer_version, r"checkpoint\.npz is from 7\.0\. This is tactile_fem .* another folder"),
    (foreign, "an older version"),
    (half_written, r"checkpoint\.npz cannot be read"),
    (pickled, r"checkpoint\.npz cannot be read"),
    (no_archive, r"checkpoint\.npz cannot be read"),
    (removed, "has no checkpoint to continue from"),
    (of_another_study, r"study\.toml has changed since .* was written \(protocol\)"),
    (of_another_mesh, "belongs to another mesh"),
    (with_another_surface, r"stimulus\.file names a file that has changed since"),
    (with_another_trace, "lacks columns work_mJ"),
    (with_a_shorter_trace, "lacks rows: 3 are needed"),
    (of_no_study, r"there is no study\.toml"),
]


@pytest.mark.parametrize("spoil, sentence", FAULTS)
def test_a_checkpoint_that_cannot_be_used_is_told_and_nothing_is_overwritten(cut, spoil, sentence):
    spoil(cut)
    before = contents(cut)
    with pytest.raises(StudyError, match=sentence) as caught:
        resume(cut)
    assert "\n" not in str(caught.value)
    assert contents(cut) == before


def test_another_mesh_file_of_the_same_name_is_told(study, cut, small_finger, tmp_path):
    finger = read_mesh(small_finger)
    moved = tmp_path / "moved.npz"
    path = cut / "study.toml"
    path.write_text(path.read_text().replace(str(small_finger), str(moved)))
    shrunk = FingerMesh(
        0.99 * finger.nodes, finger.cells, finger.tissue, finger.facets, finger.surface
    )
    write_mesh(moved, shrunk)
    with pytest.raises(StudyError, match="belongs to another mesh"):
        resume(cut)
    write_mesh(moved, finger)  # the same mesh may lie elsewhere
    assert len(resume(cut).trace.time_s) > 3


def test_what_comes_after_the_mechanics_may_change(cut):
    path = cut / "study.toml"
    gain = f"static_gain_pA_per_kPa = {Neuron().static_gain_pA_per_kPa}"
    assert gain in path.read_text()
    path.write_text(path.read_text().replace(gain, "static_gain_pA_per_kPa = 1e7"))
    assert resume(cut).response.counts().sum() > 0


def test_begun_and_not_come_to_a_step_it_begins_anew(study, cut):
    removed(cut)
    (cut / "trace.npz").unlink()
    indices = []
    resume(cut, observers=[lambda seen: indices.append(seen.step.index)])
    assert indices[0] == 1


def test_two_runs_into_one_folder(cut, study):
    before = contents(cut)
    with locked(cut):
        for start in (lambda: resume(cut), lambda: scan(study, cut, overwrite=True)):
            with pytest.raises(StudyError, match="Another run is writing into"):
                start()
    assert contents(cut) == before


# --- disk and cache ----------------------------------------------------------------------------


def test_a_full_disk_keeps_what_was_written(cut, study, capsys):
    """A limit on the size of files stands for it; both fail in the write."""
    before = contents(cut)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limit[1]))
    try:
        with pytest.raises(OSError, match=r"deformation_0000\.vtu"):
            resume(cut)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert contents(cut)["checkpoint.npz"] == before["checkpoint.npz"]
    assert capsys.readouterr().err == ""
    assert not list(cut.glob(".*.part"))
    assert len(resume(cut).trace.time_s) > 3
    assert Results(cut).run["status"] == "complete"


def test_a_folder_removed_under_the_run(study, tmp_path):
    def remove(seen):
        shutil.rmtree(tmp_path / "r", ignore_errors=True)

    with pytest.raises(FileNotFoundError, match=r"trace\.npz"):
        scan(study, tmp_path / "r", observers=[remove])
    assert not (tmp_path / "r").exists()


@pytest.fixture
def run_with_cache(study, tmp_path):
    """Return a function that runs a scan with a cache of its own and returns its complaint."""

    def run(cache: Path, *settings: str) -> str:
        (tmp_path / "s.toml").write_text(dump_study(study))
        command = [sys.executable, "-m", "tactile_fem", "scan", "s.toml", *settings]
        environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 1 and "Traceback" not in done.stderr
        assert "Exception ignored" not in done.stderr
        (line,) = [x for x in done.stderr.splitlines() if x.startswith("tactile-fem: ")]
        return line

    return run


def test_a_cache_that_cannot_be_written(run_with_cache, tmp_path):
    (tmp_path / "cache").write_text("a file in its place")
    sentence = run_with_cache(tmp_path / "cache")
    assert f"The cache of compiled forms, {tmp_path}/cache/fenics, cannot be used" in sentence
    assert "XDG_CACHE_HOME" in sentence


def test_compiler_flags_that_the_compiler_refuses(run_with_cache, tmp_path):
    sentence = run_with_cache(tmp_path / "cache", "--set", 'solver.compiler_flags=["-nonsense"]')
    assert "The C compiler failed (CompileError: its command " in sentence
    assert "solver.compiler_flags" in sentence and len(sentence) < 300


def test_a_program_of_the_compiler_that_is_missing_is_named():
    error = VerificationError("LinkError: [Errno 2] No such file or directory: '/none/ld'")
    with pytest.raises(TactileError, match=r"compiler failed \(LinkError: .* '/none/ld'\); .* CC,"):
        with compilation_errors():
            raise error


@pytest.mark.parametrize("others", [True, False])
def test_forms_whose_compilation_was_interrupted_are_removed(tmp_path, others):
    cache = tmp_path / "tactile_fem"
    cache.mkdir()
    old, new, ready, empty, foreign = sources = [
        *(cache / f"libffcx_{name}.c" for name in ("old", "new", "ready", "empty")),
        tmp_path / "libffcx_foreign.c",
    ]
    for path in sources:
        path.touch()
    os.utime(old, (time.time() - 700,) * 2)
    os.utime(new, (time.time() - 500,) * 2)
    for path, library in ((ready, b"ELF"), (empty, b"")):
        path.with_suffix(".c.cached").touch()
        path.with_suffix(".abi3.so").write_bytes(library)
    new.with_suffix(".abi3.so").touch()  # as while it is linked
    with (cache / "tactile_fem.lock").open("a") as another_run:
        if others:  # they may be compiling
            fcntl.flock(another_run, fcntl.LOCK_SH)
        clean_cache(tmp_path)
    assert sorted(cache.glob("*.c")) == sorted([new, ready] if others else [ready])
    assert list(cache.glob("*.cached")) == [ready.with_suffix(".c.cached")]
    assert foreign.exists()


def test_a_process_that_compiles_without_a_scan_is_known_to_others(tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "get_options", lambda: {"cache_dir": tmp_path})
    assert jit_options(())["cache_dir"] == tmp_path / "tactile_fem"
    lock = tmp_path / "tactile_fem" / "tactile_fem.lock"
    with lock.open("a") as another_run, pytest.raises(BlockingIOError):
        fcntl.flock(another_run, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_options_that_petsc_refuses(study, tmp_path):
    wrong = study.model_copy(update={"solver": Solver(petsc={"pc_type": "nonsense"})})
    with pytest.raises(StudyError, match=r"\(.*PC type nonsense\): look at \[solver\.petsc\]"):
        scan(wrong)


# --- mechanics ---------------------------------------------------------------------------------


def kept_of(folder: Path, error: ConvergenceError) -> dict[str, np.ndarray]:
    """Return the trace that a diverged scan has left, which goes as far as the error says."""
    results = Results(folder)
    assert results.run["status"] == f"failed: {error}"
    assert "try a finer mesh" in str(error) and error.reason in str(error)
    assert tuple(results.trace["stimulator_mm"][-1]) == error.stimulator_mm
    assert (folder / "spikes.csv").is_file()
    assert {"force.png", "sed.png", "raster.png"} <= {path.name for path in draw_plots(results)}
    return results.trace


@pytest.mark.slow
def test_a_stimulus_driven_through_the_bone(study, tmp_path):
    through = study.model_copy(
        update={
            "stimulus": Plate(),
            "protocol": Protocol(depth_mm=5.1, distance_mm=0.1),
            "solver": Solver(first_step_mm=0.5, max_press_step_mm=0.5, min_step_mm=0.4),
        }
    )
    with pytest.raises(ConvergenceError, match="the press stopped at a depth of") as caught:
        scan(through, tmp_path / "r")
    # The pad has nearly been pressed flat, ever more stiffly, and every step of it is there.
    assert 3.0 < caught.value.stimulator_mm[2] < study.finger.pad_thickness_mm
    trace = kept_of(tmp_path / "r", caught.value)
    np.testing.assert_allclose(np.diff(trace["depth_mm"]), 5.1 / 11)
    assert np.all(np.diff(trace["force_N"][:, 2], n=2) > 0)
    assert np.all(np.diff(trace["stored_mJ"]) > 0)
    assert int(Results(tmp_path / "r").load_checkpoint()["rows"]) == len(trace["time_s"])


def with_fat(study: Study, C10_MPa: float) -> Study:
    fat = Polynomial(C10_MPa=C10_MPa, D1_per_MPa=48.0)
    tissue = Tissue.model_validate({"subcutaneous": fat.model_dump()})
    return study.model_copy(update={"tissue": tissue, "solver": Solver(min_step_mm=0.05)})


@pytest.mark.slow
def test_fat_that_resists_no_shear_leaves_the_load_to_the_skin(study):
    soft, usual = (scan(s).trace for s in (with_fat(study, 1e-30), study))
    assert soft.displacement_mm[-1] == 0.1
    assert np.all(soft.imbalance_N < 1e-7)
    pressed = np.flatnonzero(soft.displacement_mm == 0)[-1]
    assert 0.6 < soft.force_N[pressed, 2] / usual.force_N[pressed, 2] < 0.9


def test_fat_of_an_absurd_stiffness_stops_the_scan_where_it_is_touched(study, tmp_path):
    with pytest.raises(ConvergenceError, match="the press stopped at a depth of") as caught:
        scan(with_fat(study, 1e300), tmp_path / "r")
    assert caught.value.stimulator_mm[2] < study.protocol.depth_mm
    trace = kept_of(tmp_path / "r", caught.value)
    for name in ("force_N", "sed_kPa", "stored_mJ", "newton_iterations"):
        assert not trace[name].any(), name


def slid(study: Study, folder: Path, friction: float) -> tuple[Trace, np.ndarray]:
    """Slide a plate by 0.1 mm; return the slide's history, and how far the pressed nodes went."""
    changed = {
        "stimulus": Plate(friction=friction),
        "protocol": Protocol(depth_mm=0.2, distance_mm=0.1, speed_mm_s=1.0, output_mm=0.02),
        "output": Output(pictures=False, states_mm=0.1),
    }
    trace = scan(study.model_copy(update=changed), folder).trace
    *_, before, after = (
        meshio.read(file).point_data["displacement_mm"]
        for file in read_series(Results(folder).fields)[1]
    )
    finger = read_mesh(study.finger.mesh_file)
    pressed = finger.nodes[:, 2] + after[:, 2] < 0.2  # the plate's height
    return trace, (after - before)[pressed, 1]


@pytest.mark.slow
def test_at_a_friction_of_five_the_skin_sticks(study, tmp_path):
    trace, went = slid(study, tmp_path / "sticky", 5.0)
    usual, slipped = slid(study, tmp_path / "usual", 0.3)
    assert len(went) == len(slipped) >= 3
    np.testing.assert_allclose(went, -0.1, atol=0.005)
    assert np.all(slipped > -0.05)
    # What sticks is pulled ever more, as far as it goes, and next to nothing becomes heat.
    slide = trace.displacement_mm > 0
    grown = -np.diff(trace.force_N[slide, 1])
    np.testing.assert_allclose(grown, grown.mean(), rtol=0.05)
    assert trace.force_N[-1, 1] < 4 * usual.force_N[-1, 1] < 0
    assert 0 < trace.friction_mJ[slide].sum() < 0.1 * trace.work_mJ[slide].sum()


# --- ranks -------------------------------------------------------------------------------------

ONE_RANK_FAILS = """
import logging, sys
from tactile_fem.errors import StudyError
from tactile_fem.runtime.ranks import abort_if_one_fails
from mpi4py import MPI
logging.basicConfig(format="%(message)s")
comm = MPI.COMM_WORLD
with abort_if_one_fails(comm):
    if comm.rank == 1 or "all" in sys.argv:
        raise StudyError("the sentence")
    comm.Barrier()
"""


ABORTING = """
import fcntl, logging, sys, termios
from tactile_fem.runtime import ranks
class Comm:  # of two, the other of which never comes
    rank, size = 1, 2
    Dup = Ibarrier = lambda self: self
    Test = lambda self: False
    def Abort(self, code):
        unread = fcntl.ioctl(2, termios.FIONREAD, bytes(4))
        print(code, "unread" if any(unread) else "read", flush=True)
ranks._WAIT_S = float(sys.argv[1])
logging.basicConfig(format="%(message)s")
with ranks.abort_if_one_fails(Comm()):
    raise OSError("the sentence")
"""


@pytest.mark.parametrize(("patience_s", "read"), [(3.0, True), (0.1, False)])
def test_what_a_rank_says_is_read_before_it_ends_all(patience_s, read):
    """An abort overtakes it on the way to the terminal; a reader that hangs delays nothing long."""
    command = [sys.executable, "-c", ABORTING, str(patience_s)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        select.select([process.stderr], [], [])  # it has been said
        if read:
            time.sleep(0.3)
            assert process.stderr.read() == b"rank 1 ends all: the sentence\n"
        assert process.stdout.read() == (b"1 read\n" if read else b"1 unread\n")
        assert process.wait() == 1


@pytest.mark.mpi
@pytest.mark.parametrize("failing", ["one", "all"])
def test_an_error_on_one_rank_ends_all(failing):
    command = [ranks.launcher(), "-n", "2", sys.executable, "-c", ONE_RANK_FAILS, failing]
    started = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert time.monotonic() - started < 10 + 20  # and the start of Python on a busy machine
    if failing == "one":
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
        ours = [line for line in done.stderr.splitlines() if "MPI_Abort" not in line]
        if "Open MPI" in MPI.Get_library_version():  # which adds a paragraph
            ours = [line for line in ours if "sentence" in line]
        assert ours == ["rank 1 ends all: the sentence"]
    else:
        assert done.returncode == 1 and done.stderr.count("StudyError: the sentence") == 2


FAILING = """
import pytest
from tactile_fem.runtime import backend
from mpi4py import MPI
@pytest.mark.ranks
def test_on_two(tmp_path):
    folders = MPI.COMM_WORLD.allgather(str(tmp_path))
    assert len(folders) == 2 and folders[0] == folders[1] and tmp_path.is_dir()
@pytest.mark.ranks
def test_on_one():
    assert MPI.COMM_WORLD.rank == 0, "the sentence"
    MPI.COMM_WORLD.Barrier()
"""


@pytest.mark.mpi
@pytest.mark.parametrize(("chosen", "code"), [("on_two", 0), ("on_one", 1)])
def test_a_test_on_two_ranks_is_reported_once_and_waits_for_none_that_failed(
    tmp_path, chosen, code
):
    (tmp_path / "test_it.py").write_text(FAILING)
    folder = Path(__file__).parent
    options = ["-p", "conftest", "-p", "no:cacheprovider", "-k", chosen]
    done = subprocess.run(
        [sys.executable, str(folder / "on_two_ranks.py"), *options],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path])},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == code, done.stderr
    assert done.stdout.count("1 passed") == (chosen == "on_two")
    assert ("rank 1 ends all: the sentence" in done.stderr) == (chosen == "on_one")
