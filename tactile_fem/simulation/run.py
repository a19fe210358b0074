"""The scan: from a study to histories and spikes of all receptors."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI

import numpy as np

from tactile_fem.errors import StoppedError, StudyError, TactileError
from tactile_fem.mechanics.faults import stopping
from tactile_fem.neuron import Population, Response, fire_all
from tactile_fem.results.previous import (
    ELSEWHERE,
    Earlier,
    earlier_scan,
    has_checkpoint,
    read_finished,
)
from tactile_fem.results.results import Results
from tactile_fem.results.trace import Trace
from tactile_fem.runtime.ranks import abort_if_one_fails
from tactile_fem.runtime.session import Session, session
from tactile_fem.simulation.checkpoint import read_checkpoint
from tactile_fem.simulation.checks import check_parts
from tactile_fem.simulation.estimate import announce
from tactile_fem.simulation.parts import NO_PARTS, Parts, changed_part
from tactile_fem.simulation.progress import progress
from tactile_fem.simulation.recorder import Recorder
from tactile_fem.simulation.scan_result import ScanResult
from tactile_fem.simulation.simulation import Observer, Simulation
from tactile_fem.study import Study

logger = logging.getLogger(__name__)

# Mean distance of pressed skin from the body, as a share of the depth, that is worth a warning.
_GAP_ERROR = 0.01
# Spikes of RA and PC within this time of the start are evoked by the jump of the body's speed.
_START_S = 0.01
_NOTHING_SAVED = "nothing is saved, because there is no results folder"


def scan(
    study: Study,
    folder: Path | str | None = None,
    *,
    overwrite: bool = False,
    comm: MPI.Comm | None = None,
    observers: Iterable[Observer] = (),
    parts: Parts = NO_PARTS,
) -> ScanResult:
    """Run a study: move the body along its path, evaluate the receptors, compute the spikes.

    A scan of the same study in `folder` is continued if it was interrupted, and read if it is
    finished. Log and progress appear on stderr, as a bar on a terminal or in a notebook, otherwise
    as lines; if logging is configured, they go only to its handlers, each step as DEBUG (see
    `tactile_fem.runtime.logs.shown`). The folder's ``log.txt`` has them, too.

    Parameters
    ----------
    study
        The input; ``Study()`` is the default: the letters F G H of the paper, the default finger.
    folder
        Results folder; None keeps the results in memory only.
    overwrite
        Replace an earlier scan in the folder.
    comm
        Communicator; all its ranks must call. Default: all ranks.
    observers
        Called in turn on every rank after each accepted step, see `Observation`. What one
        returns, numbers or arrays by name, becomes columns of the trace.
    parts
        Own parts in place of the study's.

    Returns
    -------
    ScanResult
        ``trace`` with the histories, ``response`` with the spikes, ``folder`` and ``study``.
        `Results` reads these from a folder, and fields of the whole finger.

    Raises
    ------
    StudyError
        Bad input, before any long work; or the folder holds other files, the scan of another study
        or with other parts, or a complete scan, whose steps observers can no longer see.
    ConvergenceError
        The mechanics diverged; everything up to there is saved in the folder.
    StoppedError
        SIGTERM or SIGINT (Ctrl-C, or a notebook's stop button) was received; likewise.
    OSError
        A file cannot be written; likewise.
    """
    with session(comm) as run:
        if folder is None:
            simulation = Simulation(study, parts, run.comm)
            return _run(run, simulation, None, observers)
        results, watching = Results(folder), list(observers)

        def earlier() -> Earlier:
            return earlier_scan(results.folder, study, overwrite=overwrite)

        found = run.on_root(earlier)
        if found == "finished" and run.on_root(lambda: _is_as_asked(results, watching, parts)):
            trace, response = run.on_root(lambda: read_finished(results))
            return ScanResult(trace, response, results.folder, study, parts)
        if found != "nothing":  # read where the files that the study names may be gone
            study = run.on_root(lambda: results.study)
        simulation = Simulation(study, parts, run.comm)
        run.lock(results.folder)

        def begin() -> None:
            if earlier() == "nothing":
                Results.create(results.folder, overwrite=overwrite).save_study(study)

        run.on_root(begin)
        return _run(run, simulation, results, watching)


def resume(
    folder: Path | str,
    *,
    comm: MPI.Comm | None = None,
    observers: Iterable[Observer] = (),
    parts: Parts = NO_PARTS,
) -> ScanResult:
    """Continue the scan in `folder` from its last checkpoint, on any number of ranks.

    A scan that was stopped or failed continues from its last step, one that was killed from its
    last checkpoint: they are written every 3 s, or more rarely, so that they take 2 % of the time.
    Your own parts and observers must be given again, see `scan`.

    Returns
    -------
    ScanResult
        The result of the whole scan, as from `scan`.

    Raises
    ------
    StudyError
        There is no scan, another run is working on it, or its files do not match.
    """
    with session(comm) as run:
        results = run.on_root(lambda: Results.open(folder))
        simulation = Simulation(run.on_root(lambda: results.study), parts, run.comm)
        run.lock(results.folder)
        return _run(run, simulation, results, observers)


def completed(study: Study, folder: Path | str, *, comm: MPI.Comm | None = None) -> Results:
    """Run or continue the scan of a study where needed, as `scan` does, and read its folder.

    Returns
    -------
    Results
        The folder, opened.
    """
    scan(study, folder, comm=comm)
    return Results(folder)


def _is_as_asked(results: Results, observers: list[Observer], parts: Parts) -> bool:
    """Return whether a finished scan has the spikes asked for.

    It need not if there are, or were, own populations.

    Raises
    ------
    StudyError
        A part is not valid or not the one that it had; or there are observers, who would see none
        of its steps.
    """
    check_parts(parts)
    before, now = dict(results.run.get("own_parts", {})), parts.listed()
    fire = [own.pop("populations", None) for own in (before, now)]
    if changed := changed_part(before, now):
        raise StudyError(f"{results.folder} holds this scan with {changed}: {ELSEWHERE}.")
    if observers:
        raise StudyError(
            f"{results.folder} holds this scan, finished, so that observers would see none of its "
            f"steps: leave them out to read it, {ELSEWHERE}."
        )
    return not any(fire)


def _run(
    run: Session,
    simulation: Simulation,
    results: Results | None,
    observers: Iterable[Observer],
) -> ScanResult:
    """Run or continue a scan; save what was computed if that fails or is stopped."""
    run.open(closing(simulation))
    saved = None
    if results:
        if run.on_root(lambda: has_checkpoint(results)):
            saved = read_checkpoint(simulation, results)
        run.log_to(results.log_file)
    trace = Trace.of(simulation)
    recorder = Recorder(results, simulation, trace) if results else None
    if recorder and saved:
        recorder.restore(saved)
        logger.info("continuing after %d steps", len(trace) - 1)
    else:
        announce(simulation)
        if recorder:
            recorder.begin()
    # A signal while the end is saved is heeded afterwards.
    with run.heeding("the scan is complete" if recorder else _NOTHING_SAVED) as end:
        try:
            with (
                abort_if_one_fails(run.comm),
                stopping(simulation.problem.solver.snes, run.comm) as stop,
                progress(run.comm.rank) as show,
            ):
                own: list[Observer] = [trace, *([recorder] if recorder else []), stop.check]
                for _ in simulation.observed([show, *observers, *own]):
                    pass
            _log_contact(trace)
            response = _conclude(simulation, trace, recorder, "complete")
            _log_start(simulation.populations, trace, response)
        except (Exception, SystemExit, KeyboardInterrupt) as error:  # also an observer's
            kept = _keep(simulation, trace, recorder, error)
            if isinstance(error, StoppedError):
                raise StoppedError(error.number, kept) from None
            logger.info("%s", kept)
            raise
        end.check()
    folder = results.folder if results else None
    return ScanResult(trace, response, folder, simulation.study, simulation.parts)


def _conclude(
    simulation: Simulation, trace: Trace, recorder: Recorder | None, status: str
) -> Response:
    """Return the afferents' spikes so far; save them, the steps and the status."""
    if recorder:
        recorder.save()
    response = Response([np.empty(0)] * len(trace.receptors_mm), 0.0, 0.0)
    try:
        if len(trace) > 1:
            response = fire_all(simulation.populations, trace.arrays())
    except Exception:
        if status == "complete":
            raise
        logger.warning("the spikes of these steps are not saved: the afferents cannot fire")
    if recorder:
        recorder.finish(status, response)
    return response


def _keep(
    simulation: Simulation, trace: Trace, recorder: Recorder | None, error: BaseException
) -> str:
    """Save a scan that an error, an exit or a signal ends; return in words what is kept."""
    if not recorder:
        return _NOTHING_SAVED
    is_stopped = isinstance(error, StoppedError) or not isinstance(error, Exception)
    status = "stopped" if is_stopped else f"failed: {error}"
    try:
        _conclude(simulation, trace, recorder, status)
    except (OSError, TactileError) as failure:  # writing may be what failed
        return f"how the scan ended could not be saved ({failure})"
    saved = "everything up to the last step is saved"
    return f"{saved}; start it again to continue" if is_stopped else saved


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
    logger.info("contact at full depth: mean distance between skin and body %.4f mm", gap)
    if gap > _GAP_ERROR * depth:
        logger.warning(
            "the skin's distance from the stimulator's surface is more than a hundredth of the "
            "depth: forces may be wrong by several percent; use a finer mesh or a larger "
            "solver.nitsche_gamma"
        )


def _log_start(populations: Iterable[Population], trace: Trace, response: Response) -> None:
    """Warn if most afferents with a band-pass fire because the body starts at full speed."""
    late_s = response.latency()
    for one in populations:
        own = late_s[np.asarray(trace.population) == one.name]
        early = int(np.sum(own < _START_S))
        if one.neuron.model == "band_pass" and 2 * early > len(own):
            logger.warning(
                "%d of %d %s afferents fire in the first %.0f ms, because the body starts at full "
                "speed: do not count these spikes, or let a recording or a script start it slowly",
                *(early, len(own), one.name, 1000 * _START_S),
            )
