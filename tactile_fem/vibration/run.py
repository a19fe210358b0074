"""Vibration about a state that a scan left: one linear solve for each frequency."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike

from tactile_fem.errors import StudyError
from tactile_fem.runtime.logs import shown
from tactile_fem.runtime.ranks import StopRequest, abort_if_one_fails, on_root, signal_handler
from tactile_fem.simulation.checkpoint import Origin
from tactile_fem.simulation.parts import NO_PARTS, Parts
from tactile_fem.simulation.results import Results
from tactile_fem.simulation.simulation import Simulation
from tactile_fem.vibration.felt import Felt
from tactile_fem.vibration.harmonic import Harmonic, Response
from tactile_fem.vibration.spectrum import Spectrum

logger = logging.getLogger(__name__)

Moves = Literal["body", "bone"]


@dataclass(frozen=True)
class About:
    """What vibrates.

    Attributes
    ----------
    simulation
        In the state about which it vibrates.
    body, bone
        How the body and what is held vibrate, (3,): one is a unit vector, the other 0.
    """

    simulation: Simulation
    body: np.ndarray
    bone: np.ndarray


# Called on all ranks with the answer to each frequency.
Observer = Callable[[About, Response], None]


@shown()
def vibrate(
    folder: Path | str,
    frequencies_Hz: ArrayLike,
    *,
    at_mm: float | None = None,
    at_s: float | None = None,
    moves: Moves = "body",
    direction: Sequence[float] = (0.0, 0.0, 1.0),
    density_kg_m3: float | None = None,
    comm: MPI.Comm | None = None,
    parts: Parts = NO_PARTS,
    observers: Sequence[Observer] = (),
) -> Spectrum:
    """Return how the finger of a scan answers to vibrations about one of its states.

    Parameters
    ----------
    folder
        Of the scan, complete or not.
    frequencies_Hz
        Positive, (f,).
    at_mm, at_s
        Displacement of the slide, or time, at which `output.states` kept the state; default the
        last state.
    moves
        What vibrates: the body, or the bone with all that is held, while the body rests.
    direction
        Of the vibration, (3,).
    density_kg_m3
        Of all tissues, in place of the study's; 0 is without inertia.
    comm
        Communicator; all its ranks must call. Default: all ranks.
    parts
        The scan's own parts, see `tactile_fem.simulation.scan`.
    observers
        Called with the answer to each frequency, such as
        `tactile_fem.vibration.keeper.ModeKeeper`.

    Raises
    ------
    StudyError
        No such state or scan; a frequency, a direction or a density that is none.
    TactileError
        The linear equations could not be solved.
    StoppedError
        SIGTERM or SIGINT came.
    """
    comm = comm or MPI.COMM_WORLD
    frequencies, along = _checked(frequencies_Hz, direction)
    if density_kg_m3 is not None and not 0 <= density_kg_m3 < np.inf:
        raise StudyError(f"density_kg_m3 is {density_kg_m3:g} but must not be negative.")
    with abort_if_one_fails(comm):
        results = on_root(comm, lambda: Results.open(folder))
        if on_root(comm, lambda: results.study.finger.is_section):
            raise StudyError(f"{folder} is the scan of a section: only a solid finger can vibrate.")
        simulation = Simulation(on_root(comm, lambda: results.study), parts, comm)
        saved = on_root(comm, lambda: Origin.of(simulation).read(results, at_mm, at_s))
        with closing(simulation):
            simulation.restore(saved)
            own = simulation.study.tissue.density_kg_m3
            harmonic = Harmonic(simulation.problem, own if density_kg_m3 is None else density_kg_m3)
            body, bone = (along, 0 * along) if moves == "body" else (0 * along, along)
            about = About(simulation, body, bone)
            stop = StopRequest(comm, "nothing of the vibration is saved")
            with signal_handler(stop.request):
                observers = (*observers, lambda *_: stop.check())
                return _spectrum(harmonic, frequencies, about, observers)


def _spectrum(
    harmonic: Harmonic, frequencies: np.ndarray, about: About, observers: Sequence[Observer]
) -> Spectrum:
    problem, probe = about.simulation.problem, about.simulation.receptors
    harmonic.freeze(None)
    still, felt = probe.read(), Felt(problem, probe, harmonic)
    answers, forces = [], []
    for number, frequency in enumerate(frequencies, 1):
        response = harmonic.respond(frequency, about.body, about.bone)
        answers.append(felt.amplitudes(response))
        forces.append(response.force_N)
        for observer in observers:
            observer(about, response)
        logger.info(
            "%.4g Hz (%d of %d), %d iterations",
            frequency,
            number,
            len(frequencies),
            response.iterations,
        )
    moved, sed, stretches = (np.array(values) for values in zip(*answers, strict=True))
    layout = about.simulation.layout
    return Spectrum(
        frequencies,
        about.body + about.bone,
        layout.positions_mm,
        layout.population,
        moved,
        sed,
        stretches,
        np.array(forces),
        still.moved_mm,
        still.sed_kPa,
        still.stretches,
    )


def _checked(
    frequencies_Hz: ArrayLike, direction: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies and the direction's unit vector, or raise StudyError."""
    frequencies = np.atleast_1d(np.asarray(frequencies_Hz, dtype=float))
    wrong = frequencies[~(np.isfinite(frequencies) & (frequencies > 0))]
    if wrong.size:
        raise StudyError(f"frequencies_Hz has {wrong[0]:g} but must be greater than 0.")
    along = np.asarray(direction, dtype=float)
    length = np.linalg.norm(along)
    if along.shape != (3,) or not np.isfinite(length) or length == 0:
        raise StudyError(f"direction is {tuple(direction)} but must be three numbers, not all 0.")
    return frequencies, along / length
