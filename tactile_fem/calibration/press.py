"""What the model predicts for an experiment, and how that changes with the tissues' constants."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx or says how)

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from tactile_fem import Parts, Simulation
from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.sensitivity import Change, Sensitivities
from tactile_fem.errors import StoppedError, TactileError
from tactile_fem.finger import SkinSurface
from tactile_fem.mechanics import stopping
from tactile_fem.path import Motion, Path, straight
from tactile_fem.runtime.ranks import on_root
from tactile_fem.simulation import Bone
from tactile_fem.study import Protocol, Study

logger = logging.getLogger(__name__)

Array = NDArray[np.float64]

_BEYOND_MM, _PROFILE_POINTS = 1.0, 321  # of the line of skin that is read, beyond the farthest


@dataclass(frozen=True)
class Prediction:
    """What the model gives for an experiment."""

    values: Array  # in place of the measured numbers, (n,); NaN beyond where the press ended
    derivatives: Array  # along each change of the constants, (n, changes)
    curve: Array  # depth in mm and normal force in N at each step of the press, (steps + 1, 2)


def study_of(study: Study, experiment: Experiment) -> Study:
    """Return the study of an experiment's press: its indenter, its depth, its speed."""
    depth = float(experiment.depth_mm.max())
    protocol = Protocol(depth_mm=depth, press_speed_mm_s=experiment.speed_mm_s, distance_mm=0.0)
    return study.model_copy(update={"stimulus": experiment.indenter, "protocol": protocol})


def press(
    study: Study,
    experiment: Experiment,
    changes: Sequence[Change] = (),
    comm: MPI.Comm | None = None,
) -> Prediction:
    """Press the indenter to the measured depths; all ranks of `comm`, by default all, call.

    A press that ends before, because the mechanics diverges, is logged. Derivatives are those
    along the `changes` of the constants at a fixed bone: on a joint they are NaN.
    """
    comm = comm or MPI.COMM_WORLD
    depths = np.unique(experiment.depth_mm)
    parts = Parts(path=Path((lambda start: _press(start, depths, experiment.speed_mm_s),)))
    simulation = Simulation(study_of(study, experiment), parts, comm)
    skin = on_root(comm, lambda: _line_of_skin(simulation, experiment))
    values = np.full(len(experiment.mean), np.nan)
    derivatives, curve = np.full((len(values), len(changes)), np.nan), [(0.0, 0.0)]
    with closing(simulation):
        problem = simulation.problem
        known = () if study.joint else changes  # sensitivities hold the bone
        sensitivities = Sensitivities(problem, known)
        try:
            with stopping(problem.solver.snes, comm) as stop:
                for step in simulation.steps():
                    sensitivities.follow()
                    curve.append((step.depth_mm, float(step.load.force_N[2])))
                    here = np.isclose(experiment.depth_mm, step.depth_mm)
                    if here.any():
                        read = _reading(simulation, experiment, here, skin)
                        values[here] = read()
                        if known:
                            derivatives[here] = sensitivities.derivative(read).T
                    stop.check()
        except StoppedError:
            raise
        except TactileError as error:  # also: no sensitivities where the skin is about to snap
            logger.warning("%s: %s", experiment.name, error)
    return Prediction(values, derivatives, np.array(curve))


def _press(start_mm: Array, depths_mm: Array, speed_mm_s: float) -> Motion:
    """Press to the last of the depths, with a step that ends at each."""
    end = np.array([start_mm[0], start_mm[1], depths_mm[-1]])
    return straight("press", start_mm, end, speed_mm_s, depths_mm / speed_mm_s)


def _axis(experiment: Experiment) -> int:
    """Return the axis along which the profile lies: across a bar, else along the finger."""
    return 0 if getattr(experiment.indenter, "along", "x") == "y" else 1


def _line_of_skin(simulation: Simulation, experiment: Experiment) -> SkinSurface | None:
    """Return the points of the profile; None if only forces were measured."""
    if experiment.is_force.all():
        return None
    xy = np.zeros((_PROFILE_POINTS, 2))
    reach = np.nanmax(np.abs(experiment.place_mm)) + _BEYOND_MM
    xy[:, _axis(experiment)] = np.linspace(-reach, reach, _PROFILE_POINTS)
    return SkinSurface(simulation.finger, xy)


def _reading(
    simulation: Simulation,
    experiment: Experiment,
    here: NDArray[np.bool_],
    skin: SkinSurface | None,
) -> Callable[[], Array]:
    """Return a function that gives the chosen numbers of the present state, in space."""
    is_force, places = experiment.is_force[here], experiment.place_mm[here]
    axis, problem = _axis(experiment), simulation.problem

    def read() -> Array:
        values = np.empty(len(places))
        if is_force.any():
            values[is_force] = simulation.load().force_N[2]
        if skin is not None and not is_force.all():
            u = simulation.comm.bcast(problem.order.gather(problem.u))
            moved, joint = skin.deformed_mm(u), simulation.study.joint
            if joint:
                moved = Bone(joint, angle_rad=simulation.bone_rad).places_in_space(moved)
            values[~is_force] = deflection(moved, skin.rest_mm, places[~is_force], axis)
        return values

    return read


def deflection(moved_mm: Array, rest_mm: Array, places_mm: Array, axis: int) -> Array:
    """Return the deflection of the skin at distances from the indenter, the mean of both sides.

    `moved_mm` and `rest_mm` are deformed and undeformed points of a line across the indenter,
    (points, 3); the distances (k,) are measured along an axis, along which skin that folds over
    need not follow the line.
    """
    order = np.argsort(moved_mm[:, axis], kind="stable")
    along, up = moved_mm[order, axis], (moved_mm - rest_mm)[order, 2]
    sides = [np.interp(sign * places_mm, along, up) for sign in (-1, 1)]
    return np.mean(sides, axis=0)
