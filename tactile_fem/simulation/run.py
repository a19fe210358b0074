"""The scan: from a study to histories and spikes of all receptors."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike

from tactile_fem.errors import StoppedError, StudyError, TactileError
from tactile_fem.mechanics.faults import stopping
from tactile_fem.mechanics.state import State
from tactile_fem.mechanics.stepper import Step, stopped
from tactile_fem.neuron import Population, Response, fire_all
from tactile_fem.receptors.probe import ReceptorState
from tactile_fem.runtime.files import locked
from tactile_fem.runtime.logs import log_to, shown
from tactile_fem.runtime.parallel import abort_if_one_fails, on_root
from tactile_fem.runtime.signals import StopRequest, signal_handler
from tactile_fem.simulation.checkpoint import Origin
from tactile_fem.simulation.estimate import announce
from tactile_fem.simulation.parts import Parts
from tactile_fem.simulation.progress import progress
from tactile_fem.simulation.recorder import Recorder
from tactile_fem.simulation.results import Results
from tactile_fem.simulation.setup import Instruments, Setup
from tactile_fem.simulation.trace import Array, Trace
from tactile_fem.study import Study

logger = logging.getLogger(__name__)

# Mean distance of pressed skin from the body, as a share of the depth, that is worth a warning.
_GAP_ERROR = 0.01
_NO_PARTS = Parts()
_NOTHING_KEPT = "nothing is saved, because there is no results folder"


@dataclass(frozen=True)
class Observation:
    """An accepted step as an observer sees it.

    Attributes
    ----------
    step
        Place of the body, forces, cost.
    receptors
        State of the receptors.
    state
        Displacement (`state.u`) and all other history variables; read only.
    """

    step: Step
    receptors: ReceptorState
    state: State


# Called on every rank; what it returns joins the trace, a column by each name.
Observer = Callable[[Observation], Mapping[str, ArrayLike] | None]


@dataclass(frozen=True)
class ScanResult:
    """Result of a scan.

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


@shown()
def scan(
    study: Study,
    folder: Path | str | None = None,
    *,
    overwrite: bool = False,
    comm: MPI.Comm | None = None,
    observers: Iterable[Observer] = (),
    parts: Parts = _NO_PARTS,
) -> ScanResult:
    """Run a study: move the body along its path, evaluate the receptors, compute the spikes.

    Its log and progress appear on stderr, a bar on a terminal and in a notebook that has
    ipywidgets, else some lines; but if logging is configured, they only go to its handlers, each
    step as DEBUG (see `tactile_fem.runtime.logs.shown`).

    Parameters
    ----------
    study
        The input; ``Study()`` is the paper's.
    folder
        Results folder; None keeps the results in memory only. An unfinished scan of the same
        study in it is continued.
    overwrite
        Replace an earlier scan in the folder.
    comm
        Communicator; all its ranks must call. Default: all ranks.
    observers
        Called in turn on every rank after each accepted step, see `Observation`. What one
        returns, numbers or arrays by name, becomes columns of the trace.
    parts
        Own parts in place of the study's.

    Raises
    ------
    StudyError
        Bad input, before any long work.
    ConvergenceError
        The mechanics diverged; everything up to there is saved in the folder.
    StoppedError
        SIGTERM or SIGINT came; likewise.
    OSError
        A file cannot be written; likewise.
    """
    comm = comm or MPI.COMM_WORLD
    with abort_if_one_fails(comm), ExitStack() as held:
        setup = Setup.of(study, parts, comm)
        if folder is None:
            return _run(setup, None, comm, observers, proceed=False)
        place = Path(folder)

        def begin() -> bool:
            if overwrite or not Results.unfinished(place, study):
                Results.check(place, overwrite=overwrite)
            held.enter_context(locked(place))
            if not overwrite and Results.unfinished(place, study):
                logger.info("continuing the scan in %s", place)
                return True
            Results.create(place, overwrite=overwrite).save_study(study)
            return False

        proceed = on_root(comm, begin)
        return _run(setup, Results(place), comm, observers, proceed=proceed)


@shown()
def resume(
    folder: Path | str,
    *,
    comm: MPI.Comm | None = None,
    observers: Iterable[Observer] = (),
    parts: Parts = _NO_PARTS,
) -> ScanResult:
    """Continue the scan in `folder` from its last checkpoint, on any number of ranks.

    It is at most one accepted step old. Own parts and observers must be given again, see `scan`.

    Raises
    ------
    StudyError
        There is no scan, another run is at it, or what it left does not belong together.
    """
    comm = comm or MPI.COMM_WORLD
    with abort_if_one_fails(comm), ExitStack() as held:
        results = on_root(comm, lambda: Results.open(folder))
        study = on_root(comm, lambda: results.study)
        setup = Setup.of(study, parts, comm)
        on_root(comm, lambda: held.enter_context(locked(results.folder)), share=False)
        return _run(setup, results, comm, observers, proceed=True)


def completed(study: Study, folder: Path | str, *, comm: MPI.Comm | None = None) -> Results:
    """Return the study's finished scan in `folder`; run or continue it if needed.

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
    elif not on_root(comm, lambda: results.is_of(study, though_changed=True)):
        raise StudyError(f"{folder} holds the scan of another study: choose another folder.")
    else:
        on_root(comm, lambda: results.check_files(study))
        if not on_root(comm, lambda: results.complete):
            resume(folder, comm=comm)
    return Results(folder)


def _run(
    setup: Setup,
    results: Results | None,
    comm: MPI.Comm,
    observers: Iterable[Observer],
    *,
    proceed: bool,
) -> ScanResult:
    origin, saved = on_root(comm, lambda: Origin.of(setup)), None
    if results and proceed and on_root(comm, lambda: _has_checkpoint(results)):
        saved = on_root(comm, lambda: origin.read(results))
    with log_to(results.log_file, comm.rank) if results else nullcontext():
        instruments = setup.instruments(comm)
        with closing(instruments.problem):
            recorder = Recorder(results, setup, origin, instruments) if results else None
            if recorder and saved:
                trace = recorder.restore(saved)
            else:
                trace = _begin(setup, instruments, recorder)
            response = _run_steps(instruments, trace, recorder, observers, setup.populations)
    return ScanResult(trace, response, results.folder if results else None)


def _begin(setup: Setup, instruments: Instruments, recorder: Recorder | None) -> Trace:
    problem, layout = instruments.problem, setup.layout
    announce(setup.study, setup.path, problem.unknowns, problem.domain.comm)
    trace = Trace(
        layout.positions_mm, layout.population, setup.path.start_mm, instruments.probe.fields
    )
    if recorder:
        recorder.begin(trace)
    return trace


def _run_steps(
    instruments: Instruments,
    trace: Trace,
    recorder: Recorder | None,
    observers: Iterable[Observer],
    populations: Sequence[Population],
) -> Response:
    """Step to the end of the path; save what was computed if that fails or is stopped."""
    problem = instruments.problem
    comm = problem.domain.comm
    # A signal while the end is saved is heeded afterwards.
    end = StopRequest(comm, "the scan is complete" if recorder else _NOTHING_KEPT)
    with signal_handler(end.request):
        try:
            with (
                abort_if_one_fails(comm),
                stopping(problem.snes, comm) as stop,
                progress(comm.rank) as show,
            ):
                observers = (show, *observers)
                for step in instruments.stepper:
                    seen = Observation(step, instruments.probe.read(), problem.state)
                    _check_sound(step, seen.receptors, trace.receptors_mm)
                    trace.add(step, seen.receptors, _observed(observers, seen))
                    if recorder:
                        recorder.step(step, trace)
                    stop.check()
        except Exception as error:
            kept = _keep(recorder, trace, populations, error)
            if isinstance(error, StoppedError):
                raise StoppedError(error.number, kept) from None
            logger.info("%s", kept)
            raise
        _log_contact(trace)
        response = _conclude(recorder, trace, populations, "complete")
        end.check()
    return response


def _observed(observers: Iterable[Observer], seen: Observation) -> dict[str, ArrayLike]:
    """Return what the observers add to the trace."""
    columns: dict[str, ArrayLike] = {}
    for observer in observers:
        found = observer(seen) or {}
        twice = sorted(columns.keys() & found.keys())
        if twice:
            raise StudyError(f"observers: two of them return {twice[0]}: choose another name.")
        columns.update(found)
    return columns


def _conclude(
    recorder: Recorder | None, trace: Trace, populations: Sequence[Population], status: str
) -> Response:
    """Return the afferents' spikes so far; save them and the status."""
    response = Response([np.empty(0)] * len(trace.receptors_mm), 0.0, 0.0)
    if len(trace) > 1:
        response = fire_all(populations, trace.arrays())
    if recorder:
        recorder.spikes(response)
        recorder.finish(status)
    return response


def _keep(
    recorder: Recorder | None, trace: Trace, populations: Sequence[Population], error: Exception
) -> str:
    """Save a scan that an error or a signal ends; return in words what is kept."""
    if not recorder:
        return _NOTHING_KEPT
    stopped_ = isinstance(error, StoppedError)
    try:
        _conclude(recorder, trace, populations, "stopped" if stopped_ else f"failed: {error}")
    except (OSError, TactileError) as failure:  # writing may be what failed
        return f"how the scan ended could not be saved ({failure})"
    saved = "everything up to the last step is saved"
    return f"{saved}; start it again to continue" if stopped_ else saved


def _check_sound(step: Step, felt: ReceptorState, positions: Array) -> None:
    """Raise ConvergenceError where a receptor feels no number: a cell is turned inside out there.

    The quadrature points that the solver sees may still be right way round.
    """
    lost = ~np.isfinite(felt.sed_kPa + felt.von_mises_kPa + felt.stretches.sum(axis=1))
    if lost.any():
        x, y, _ = positions[lost][0]
        raise stopped(
            step.phase,
            step.stimulator_mm,
            step.displacement_mm,
            f"there the tissue at the receptor at X {x:.1f}, Y {y:.1f} mm is turned inside out",
            "less depth, stiffer tissue or a finer mesh",
        )


def _has_checkpoint(results: Results) -> bool:
    """Return whether there is a state to continue from; False before the first accepted step.

    Raises
    ------
    StudyError
        There are steps but no state.
    """
    if results.checkpoint_file.is_file():
        return True
    if (results.folder / "trace.npz").is_file() and len(results.trace["time_s"]) > 1:
        raise StudyError(f"{results.folder} has no checkpoint to continue from.")
    return False


def _log_contact(trace: Trace) -> None:
    """Log the contact error at full depth; warn if it is large or there was no contact."""
    if not trace.force_N.any():
        logger.warning(
            "the stimulator never touched the finger: press deeper (protocol.depth_mm), or let a "
            "raised part lie under the pad (stimulus.start_mm, stimulus.shift_mm)"
        )
        return
    depth = trace.depth_mm.max()
    gap = trace.gap_error_mm[trace.depth_mm == depth].max()
    logger.info(
        "contact at full depth: mean distance of the skin from the body's surface %.4f mm", gap
    )
    if gap > _GAP_ERROR * depth:
        logger.warning(
            "the skin's distance from the stimulator's surface is more than a hundredth of the "
            "depth: forces may be wrong by several percent; use a finer mesh or a larger "
            "solver.nitsche_gamma"
        )
