"""The scan: from a study to what every receptor felt and fired."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from dolfinx import jit

from tactile_fem.errors import ConvergenceError, StoppedError, StudyError, TactileError
from tactile_fem.finger import FingerMesh, load_finger
from tactile_fem.finger.report import pad_thickness_mm
from tactile_fem.mechanics.compile import clean_cache
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.faults import last_line, preparing
from tactile_fem.mechanics.petsc_options import check_options
from tactile_fem.mechanics.problem import FingerProblem
from tactile_fem.mechanics.stepper import Step, Stepper
from tactile_fem.neuron import Population, Response, fire_all, populations_of
from tactile_fem.receptors import Layout, lay_out
from tactile_fem.receptors.probe import Probes, ReceptorState
from tactile_fem.runtime.folder_lock import locked
from tactile_fem.runtime.logs import log_to
from tactile_fem.runtime.parallel import ending_together, on_root
from tactile_fem.runtime.signals import StopRequest, answering
from tactile_fem.scan.checks import check_depth
from tactile_fem.scan.estimate import announce
from tactile_fem.scan.recorder import Recorder
from tactile_fem.scan.results import Results
from tactile_fem.scan.trace import Array, Histories, Trace
from tactile_fem.stimulus import RigidBody, make_body
from tactile_fem.study import Study

logger = logging.getLogger(__name__)

Observer = Callable[[Step], None]
# Pressing to a force is given up when this share of the pad is squeezed.
_DEEPEST = 0.8
_TOUCH_TOLERANCE_MM = 1e-3
# Mean distance of pressed skin from the body, as a share of the depth, that is worth a warning.
_GAP_ERROR = 0.01


@dataclass(frozen=True)
class ScanResult:
    """What a scan gives.

    Attributes
    ----------
    trace
        Histories of motion, forces and receptors.
    response
        Spikes of the receptors' afferents.
    folder
        The results folder, or None.
    """

    trace: Trace
    response: Response
    folder: Path | None


def scan(
    study: Study,
    folder: Path | str | None = None,
    *,
    overwrite: bool = False,
    comm: MPI.Comm | None = None,
    observers: Iterable[Observer] = (),
    populations: Sequence[Population] = (),
) -> ScanResult:
    """Press, slide, feel and fire, as the study says.

    Parameters
    ----------
    study
        What to do; ``Study()`` is the paper's.
    folder
        Results folder; None keeps the results in memory only. An unfinished scan of the same
        study in it is gone on with.
    overwrite
        Replace an earlier scan in the folder.
    comm
        Communicator; all its ranks must call. Default: all ranks.
    observers
        Called on every rank after each accepted step.
    populations
        Populations of your own, with another drive or transduction than a study can name, in
        the place of the study's of the same name.

    Raises
    ------
    StudyError
        Bad input, before any long work.
    ConvergenceError
        The mechanics diverged; everything up to there is kept in the folder.
    StoppedError
        SIGTERM or SIGINT came; likewise.
    OSError
        A file cannot be written; likewise.
    """
    comm = comm or MPI.COMM_WORLD
    with ending_together(comm), ExitStack() as held:
        scene = _Scene.of(study, comm, populations)
        if folder is None:
            return _run(scene, None, comm, observers, proceed=False)
        place = Path(folder)

        def begin() -> bool:
            if overwrite or not Results.unfinished(place, study):
                Results.check(place, overwrite=overwrite)
            held.enter_context(locked(place))
            if not overwrite and Results.unfinished(place, study):
                logger.info("going on with the scan in %s", place)
                return True
            Results.create(place, overwrite=overwrite).save_study(study)
            return False

        proceed = on_root(comm, begin)
        return _run(scene, Results(place), comm, observers, proceed=proceed)


def resume(
    folder: Path | str,
    *,
    comm: MPI.Comm | None = None,
    observers: Iterable[Observer] = (),
    populations: Sequence[Population] = (),
) -> ScanResult:
    """Go on with the scan in `folder` from its last accepted step, on any number of ranks.

    Populations of your own are handed in again, as to `scan`.

    Raises
    ------
    StudyError
        There is no scan, another run is at it, or what it left does not belong together.
    """
    comm = comm or MPI.COMM_WORLD
    with ending_together(comm), ExitStack() as held:
        results = on_root(comm, lambda: Results.open(folder))
        study = on_root(comm, lambda: results.study)
        scene = _Scene.of(study, comm, populations)
        on_root(comm, lambda: held.enter_context(locked(results.folder)), share=False)
        return _run(scene, results, comm, observers, proceed=True)


def completed(study: Study, folder: Path | str, *, comm: MPI.Comm | None = None) -> Results:
    """Return the study's finished scan in `folder`; run it or go on with it where needed.

    So a series of scans that was interrupted is started again, and does what is left.

    Raises
    ------
    StudyError
        The folder holds the scan of another study.
    """
    comm = comm or MPI.COMM_WORLD
    results = Results(folder)
    if not on_root(comm, lambda: (results.folder / "study.toml").exists()):
        scan(study, folder, comm=comm)
    elif on_root(comm, lambda: results.study) != study:
        raise StudyError(f"{folder} holds the scan of another study: choose another folder.")
    elif not on_root(comm, lambda: results.complete):
        resume(folder, comm=comm)
    return Results(folder)


@dataclass(frozen=True)
class _Scene:
    """Finger and receptors; `finger` is None on all ranks but the first."""

    study: Study
    finger: FingerMesh | None
    pad_thickness_mm: float
    layout: Layout
    populations: tuple[Population, ...]

    @classmethod
    def of(cls, study: Study, comm: MPI.Comm, own: Sequence[Population]) -> _Scene:
        """Set everything up that bad input could spoil."""
        populations = populations_of(study, own)
        check_options(study.solver)
        body = make_body(study.stimulus)
        finger = on_root(comm, lambda: load_finger(study.finger), share=False)
        thickness = on_root(comm, lambda: pad_thickness_mm(finger))
        check_depth(study.protocol, thickness)
        layout = on_root(comm, lambda: lay_out(study, finger))
        on_root(comm, lambda: _check_apart(body, finger))
        return cls(study, finger, thickness, layout, populations)


@dataclass(frozen=True)
class _Rig:
    """What moves, feels and records."""

    problem: FingerProblem
    probe: Probes
    stepper: Stepper
    recorder: Recorder | None

    @classmethod
    def of(cls, scene: _Scene, results: Results | None, comm: MPI.Comm) -> _Rig:
        """Compile and distribute all that the scan needs."""
        study = scene.study
        on_root(comm, lambda: clean_cache(jit.get_options()["cache_dir"]))
        with preparing():
            domain = create_domain(scene.finger, comm, study.solver.held)
            problem = FingerProblem.of(study, domain)
            _ = problem.load_cell  # compiled here, not in the first step
            probe = Probes(problem, scene.layout)
            deepest = _DEEPEST * scene.pad_thickness_mm
            stepper = Stepper(problem, study.protocol, study.solver, deepest)
            recorder = Recorder(results, study, problem, stepper, scene.finger) if results else None
        logger.info(
            "%d tetrahedra that deform, %d unknowns, %d receptors, %d ranks",
            len(domain.file_cells),
            problem.unknowns,
            len(scene.layout.positions_mm),
            comm.size,
        )
        return cls(problem, probe, stepper, recorder)

    def start(self, scene: _Scene, *, proceed: bool) -> Histories:
        """Return the histories so far; the stepper stands at their end."""
        if proceed and self.recorder:
            return self.recorder.restore()
        announce(scene.study, self.problem.unknowns, self.problem.domain.comm)
        histories = Histories(scene.layout.positions_mm, scene.layout.population)
        if self.recorder:
            self.recorder.begin(histories.trace())
        return histories

    def run(self, histories: Histories, observers: Iterable[Observer], stop: StopRequest) -> None:
        """Go to the end, adding each step to the histories."""
        for step in self.stepper:
            felt = self.probe.read()
            _check_sound(step, felt, histories.receptors_mm)
            histories.add(step, felt)
            if self.recorder:
                self.recorder.step(step, histories.trace())
            for observer in observers:
                observer(step)
            stop.check()


def _run(
    scene: _Scene,
    results: Results | None,
    comm: MPI.Comm,
    observers: Iterable[Observer],
    *,
    proceed: bool,
) -> ScanResult:
    if results and proceed:
        proceed = on_root(comm, lambda: _has_checkpoint(results))
    with log_to(results.log_file, comm.rank) if results else nullcontext():
        rig = _Rig.of(scene, results, comm)
        with closing(rig.problem):
            trace, response = _run_steps(rig, scene, comm, observers, proceed=proceed)
    return ScanResult(trace, response, results.folder if results else None)


def _run_steps(
    rig: _Rig,
    scene: _Scene,
    comm: MPI.Comm,
    observers: Iterable[Observer],
    *,
    proceed: bool,
) -> tuple[Trace, Response]:
    histories = rig.start(scene, proceed=proceed)
    try:
        with ending_together(comm), _stopping(rig.problem, comm) as stop:
            rig.run(histories, observers, stop)
    except Exception as error:
        if rig.recorder:
            with suppress(OSError, TactileError):  # writing may be what failed
                _conclude(rig.recorder, histories.trace(), scene.populations, _status(error))
        raise
    trace = histories.trace()
    _tell_contact(trace)
    return trace, _conclude(rig.recorder, trace, scene.populations, "complete")


def _conclude(
    recorder: Recorder | None, trace: Trace, populations: Sequence[Population], status: str
) -> Response:
    """Return the afferents' spikes up to here; keep them and say how it ended."""
    response = Response([np.empty(0)] * len(trace.receptors_mm), 0.0, 0.0)
    if len(trace.time_s) > 1:
        response = fire_all(populations, trace.arrays())
    if recorder:
        recorder.spikes(response)
        recorder.finish(status)
    return response


def _status(error: Exception) -> str:
    return "stopped" if isinstance(error, StoppedError) else f"failed: {error}"


def _check_sound(step: Step, felt: ReceptorState, positions: Array) -> None:
    """Raise ConvergenceError where a receptor feels no number: a cell is turned inside out there.

    The quadrature points that the solver sees may still be right way round.
    """
    lost = ~np.isfinite(felt.sed_kPa + felt.von_mises_kPa + felt.stretches.sum(axis=1))
    if lost.any():
        x, y, _ = positions[lost][0]
        reason = f"the tissue at the receptor at X {x:.1f}, Y {y:.1f} mm is turned inside out"
        what, place = "slide", step.displacement_mm
        if step.phase == "press":
            what, place = "indentation", step.depth_mm
        raise ConvergenceError(
            f"the {what} stopped before {place:.4f} mm ({reason}); everything up to there is kept; "
            "try less depth, stiffer tissue or a finer mesh",
            place - step.size_mm,
            reason,
        )


@contextmanager
def _stopping(problem: FingerProblem, comm: MPI.Comm) -> Iterator[StopRequest]:
    """Heed signals between steps and Newton iterations; explain what PETSc stumbles over."""
    stop = StopRequest(comm)
    problem.snes.setMonitor(stop.check)
    try:
        with answering(stop.note):
            yield stop
    except PETSc.Error as error:
        if error.__cause__:  # a monitor's or an assembly's own
            raise error.__cause__ from None
        raise TactileError(
            f"PETSc failed ({last_line(error)}): everything up to the last step is kept."
        ) from error
    finally:
        problem.snes.cancelMonitor()


def _has_checkpoint(results: Results) -> bool:
    """Tell whether there is a state to go on from; False where no step was accepted yet.

    Raises
    ------
    StudyError
        There are steps but no state.
    """
    if results.checkpoint_file.is_file():
        return True
    if (results.folder / "trace.npz").is_file() and len(results.trace["time_s"]) > 1:
        raise StudyError(f"{results.folder} has no checkpoint to go on from.")
    return False


def _tell_contact(trace: Trace) -> None:
    """Say how exact the contact was at full depth; warn where it was not, or was none."""
    if not trace.force_N.any():
        logger.warning(
            "the stimulator never touched the finger: press deeper (protocol.depth_mm), or let a "
            "raised part lie under the pad (stimulus.start_mm, stimulus.shift_mm)"
        )
        return
    deep = trace.depth_mm == trace.depth_mm.max()
    gap, depth = trace.gap_error_mm[deep].max(), trace.depth_mm.max()
    logger.info("contact at full depth: skin off the body's surface by %.4f mm on average", gap)
    if gap > _GAP_ERROR * depth:
        logger.warning(
            "the skin is off the stimulator's surface by more than a hundredth of the depth: "
            "forces may be several percent off; a finer mesh or a larger solver.nitsche_gamma helps"
        )


def _check_apart(body: RigidBody, finger: FingerMesh) -> None:
    """Raise StudyError if the body starts inside the finger."""
    gap = body.distance(finger.nodes).gap
    worst = int(np.argmin(gap))
    if gap[worst] < -_TOUCH_TOLERANCE_MM:
        x, y, z = finger.nodes[worst]
        raise StudyError(
            f"stimulus: it starts {-gap[worst]:.3g} mm inside the finger, at X {x:.1f}, Y {y:.1f}, "
            f"Z {z:.1f} mm; the finger must lie above its highest plane, Z = 0"
        )
