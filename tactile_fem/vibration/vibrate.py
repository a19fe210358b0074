"""Vibration about a state of a scan: one linear solve for each frequency."""

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
from dolfinx import fem
from numpy.typing import ArrayLike

from tactile_fem import Parts, Results, Simulation
from tactile_fem.errors import StudyError
from tactile_fem.output import Modes
from tactile_fem.path import matrix, vector
from tactile_fem.runtime.session import session
from tactile_fem.simulation import NO_PARTS, read_checkpoint
from tactile_fem.vibration.harmonic import Harmonic, HarmonicResponse
from tactile_fem.vibration.spectrum import Spectrum

logger = logging.getLogger(__name__)

Array = np.ndarray
Moves = Literal["body", "bone"]
# Largest displacement of the central differences: small against strains that matter, large against
# rounding.
_DIFFERENCE_MM = 1e-5


@dataclass(frozen=True)
class OperatingPoint:
    """State about which a finger vibrates, and how it is moved.

    `body` and `bone`, with everything that is held, move along the vectors (3,) of these names:
    one is a unit vector, the other 0. They are in the axes of the bone, in which the mechanics is
    computed; `axes` (3, 3) turns them into those of space.
    """

    simulation: Simulation
    body: Array
    bone: Array
    axes: Array


# Called on all ranks with the response at each frequency.
ResponseObserver = Callable[[OperatingPoint, HarmonicResponse], None]


class ModeKeeper:
    """An observer of `vibrate` that keeps the displacement of all nodes at some frequencies."""

    def __init__(self, frequencies_Hz: ArrayLike) -> None:
        self._wanted = np.asarray(frequencies_Hz)
        self._kept: dict[float, Array] = {}
        self._point: OperatingPoint | None = None

    def __call__(self, point: OperatingPoint, response: HarmonicResponse) -> None:
        """Keep the displacement, on the first rank, if it is wanted here; all ranks call."""
        if response.frequency_Hz not in self._wanted:
            return
        problem = point.simulation.problem
        if self._point is None:
            self._point = point
            self._still = problem.order.gather(problem.u).astype(np.float32)
        values = fem.Function(problem.u.function_space)

        def gathered(of_space: ArrayLike) -> Array:
            values.x.array[:] = of_space
            return problem.order.gather(values)

        inside = gathered(1.0) != 0  # rigid tissues are outside the space
        moved = gathered(response.u.real) + 1j * gathered(response.u.imag)
        joint, finger = point.simulation.study.joint, point.simulation.finger
        rigid = point.bone
        if joint and finger is not None:
            rigid = rigid + response.turn_rad * joint.arms(finger.nodes)
        kept = np.where(inside, moved, rigid).astype(np.complex64)
        self._kept[response.frequency_Hz] = kept

    def modes(self) -> Modes | None:
        """Return what was kept, on the first rank; None on the others or if there is nothing."""
        if self._point is None or self._point.simulation.finger is None:
            return None
        finger, state = self._point.simulation.finger, self._point.simulation.state
        return Modes(
            np.array(list(self._kept)),
            np.array(list(self._kept.values())),
            self._still,
            finger.nodes.astype(np.float32),
            finger.cells.astype(np.int32),
            finger.tissue.astype(np.int32),
            state.translation_old.value.copy(),
            self._point.body,
            vector(state.rotation_old),
        )


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
    observers: Sequence[ResponseObserver] = (),
) -> Spectrum:
    """Return the response of a scan's finger to vibrations about one of its states.

    Parameters
    ----------
    folder
        Folder of the scan, complete or not.
    frequencies_Hz
        Positive, (f,).
    at_mm, at_s
        Displacement of the slide, or time, at which `output.restarts` kept the state; default the
        last state.
    moves
        What vibrates: the body, or the bone with everything that is held, while the body rests.
        A bone on its joint turns with a body that vibrates; it is not moved itself.
    direction
        Direction of the vibration, (3,).
    density_kg_m3
        Density of all tissues, in place of the study's; with 0 there is no inertia.
    comm
        Communicator; all its ranks must call. Default: all ranks.
    parts
        The scan's own parts, see `tactile_fem.scan`.
    observers
        Called with the response at each frequency, such as
        `ModeKeeper`.

    Returns
    -------
    Spectrum
        Force and what receptors feel, for each mm of the amplitude, at each frequency.

    Raises
    ------
    StudyError
        No such state or scan; an invalid frequency, direction or density; a bone on its joint
        cannot be vibrated.
    TactileError
        The linear equations could not be solved.
    StoppedError
        SIGTERM or SIGINT was received.
    """
    frequencies, along = _checked(frequencies_Hz, direction)
    if density_kg_m3 is not None and not 0 <= density_kg_m3 < np.inf:
        raise StudyError(f"density_kg_m3 is {density_kg_m3:g} but must not be negative.")
    with session(comm) as run:
        results = run.on_root(lambda: Results.open(folder))
        run.on_root(lambda: results.study.finger.require_solid(f"a vibration of {folder}"))
        run.on_root(lambda: _require_clamped(results, moves))
        simulation = Simulation(run.on_root(lambda: results.study), parts, run.comm)
        saved = read_checkpoint(simulation, results, at_mm, at_s)
        run.open(closing(simulation))
        simulation.restore(saved)
        study = simulation.study
        density = study.tissue.density_kg_m3 if density_kg_m3 is None else density_kg_m3
        harmonic = Harmonic(simulation.problem, density, study.joint)
        axes = matrix([simulation.bone_rad, 0.0, 0.0])
        seen = along @ axes
        body, bone = (seen, 0 * seen) if moves == "body" else (0 * seen, seen)
        point = OperatingPoint(simulation, body, bone, axes)
        with run.heeding("nothing of the vibration is saved") as stop:
            observers = (*observers, lambda *_: stop.check())
            return _spectrum(harmonic, frequencies, point, observers)


def _require_clamped(results: Results, moves: Moves) -> None:
    """Raise StudyError if a bone that is to vibrate is on its joint."""
    if moves == "bone" and results.study.joint:
        raise StudyError(
            f'moves is "bone" but must be "body" for {results.folder}, whose bone is on its joint.'
        )


def _spectrum(
    harmonic: Harmonic,
    frequencies: Array,
    point: OperatingPoint,
    observers: Sequence[ResponseObserver],
) -> Spectrum:
    """Return what the receptors feel at each frequency."""
    harmonic.freeze(None)
    still, layout = point.simulation.receptors.read(), point.simulation.layout
    amplitudes, forces = [], []
    for number, frequency in enumerate(frequencies, 1):
        response = harmonic.respond(frequency, point.body, point.bone)
        amplitudes.append(_amplitudes(point.simulation, harmonic, response))
        forces.append(point.axes @ response.force_N)
        for observer in observers:
            observer(point, response)
        logger.info(
            "%.4g Hz (%d of %d), %d iterations",
            *(frequency, number, len(frequencies), response.iterations),
        )
    felt = np.array(amplitudes)
    return Spectrum(
        frequency_Hz=frequencies,
        motion=point.axes @ (point.body + point.bone),
        receptors_mm=layout.positions_mm,
        population=layout.population,
        moved=felt[..., :3],
        sed_kPa=felt[..., 3],
        stretches=felt[..., 4:],
        force_N=np.array(forces),
        still_moved_mm=still.moved_mm,
        still_sed_kPa=still.sed_kPa,
        still_stretches=still.stretches,
    )


def _amplitudes(simulation: Simulation, harmonic: Harmonic, response: HarmonicResponse) -> Array:
    """Return displacement, SED in kPa and stretches, complex, per mm, (receptors, 3 + 1 + 3).

    With `q` a quantity, ``dq = q_u û + sum_j c_j (dq_j - dq_0)``: like the tangent, the value with
    all delays frozen and the contribution of each delay, see `tactile_fem.vibration.harmonic`.
    """
    frozen = _change(simulation, response.u)
    total = frozen.copy()
    for delay in harmonic.delays:
        harmonic.freeze(delay)
        amount = delay.amount(2 * np.pi * response.frequency_Hz)
        total += amount * (_change(simulation, response.u) - frozen)
    harmonic.freeze(None)
    return total


def _change(simulation: Simulation, u: Array) -> Array:
    """Return the change of the receptors' quantities with a complex displacement."""
    return _directional(simulation, u.real) + 1j * _directional(simulation, u.imag)


def _directional(simulation: Simulation, direction: Array) -> Array:
    """Return the derivative of the receptors' quantities, by a central difference."""
    largest = simulation.comm.allreduce(np.abs(direction).max(initial=0.0), MPI.MAX)
    if not largest:
        return np.zeros((len(simulation.layout.positions_mm), 7))
    size, u = _DIFFERENCE_MM / largest, simulation.state.u.x.array
    saved, found = u.copy(), []
    for step in (size, -size):
        u[:] = saved + step * direction
        felt = simulation.receptors.read()
        found.append(np.column_stack([felt.moved_mm, felt.sed_kPa, felt.stretches]))
    u[:] = saved
    return (found[0] - found[1]) / (2 * size)


def _checked(frequencies_Hz: ArrayLike, direction: Sequence[float]) -> tuple[Array, Array]:
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
