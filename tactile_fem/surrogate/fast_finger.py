"""A finger in milliseconds: contact on its own compliance, and a learnt map to receptors."""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path as File
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem import Path, RigidBody, Trace
from tactile_fem.errors import StudyError
from tactile_fem.neuron import STANDARD, Response, fire_all
from tactile_fem.runtime.files import write_arrays
from tactile_fem.runtime.threads import on_one_core
from tactile_fem.runtime.version import UNSTATED, this_version, why_unreadable
from tactile_fem.study import Study
from tactile_fem.surrogate.contact import (
    ACROSS,
    FINE_MM,
    TOLERANCE_MM,
    WHOLE,
    ContactPatch,
    NormalResponse,
    Pad,
    TangentialResponse,
)
from tactile_fem.surrogate.heights import Grid, HeightMap
from tactile_fem.surrogate.networks import (
    FELT_SIGNS,
    TAUGHT_MM,
    WHOLE_SIGNS,
    Network,
    Overview,
    View,
    columns_of,
    mirror_of_view,
)
from tactile_fem.surrogate.stepping import BodyState, along, trace_of

if TYPE_CHECKING:
    from tactile_fem.surrogate.rates import Rates

Array = NDArray[Any]
logger = logging.getLogger(__name__)

# Share of the range of what it was made from that a value may lie beyond it.
_BEYOND = 0.05
# A finger with one of these counts as one that is not its own mirror image.
_FILES = ("mesh_file", "skin_file", "bone_file", "nail_file")


@dataclass(frozen=True)
class FastFinger:
    """A surrogate of one finger, which `reduce_finger` makes from scans of it.

    It needs neither DOLFINx nor a compiler. Contact is solved on the finger's compliance about a
    pressed state, with skin that friction drags along; small networks turn the pressures into what
    receptors feel, and into forces. How wrong it was in scans that it had not seen, `errors` says.

    Attributes
    ----------
    pad
        The undeformed pad and its compliance.
    felt, whole
        The networks of the receptors and of the whole finger.
    receptors_mm
        X, Y and Z of the study's receptors, (receptors, 3).
    ranges
        Least and largest values that it was made from, (2, values).
    made_from
        The study, and the numbers of the scans.
    errors
        Errors in scans that were held out, by name.
    """

    pad: Pad
    felt: Network
    whole: Network
    receptors_mm: Array
    ranges: Array
    made_from: Mapping[str, Any]
    errors: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Make what its mesh and its scans only nearly were symmetric in X."""
        if self.is_symmetric:
            sides = np.array([[-1], [1]]) * np.abs(self.ranges).max(axis=0)
            object.__setattr__(self, "ranges", np.where([*ACROSS, False], sides, self.ranges))
            object.__setattr__(self, "pad", self.pad.symmetric())

    @property
    def is_symmetric(self) -> bool:
        """Whether the finger, and so what it answers, is its own mirror image in X."""
        return is_symmetric(self.made_from["study"])

    @property
    def study(self) -> Study:
        """The study whose finger it is."""
        return Study.model_validate(self.made_from["study"])

    def write(self, file: File | str) -> None:
        """Write it as ``.npz``."""
        response, drag = self.pad.normal, self.pad.tangential
        grids = {"pad": self.pad.grid, "cells": response.grid}
        about = {
            "grids": {k: (*g.low_mm, g.spacing_mm, *g.shape) for k, g in grids.items()},
            "drag": (drag.compliance_mm_per_N, drag.exponent, drag.across),
            "version": this_version(),
            "made_from": self.made_from,
            "errors": self.errors,
        }
        arrays = {
            "about": np.array(json.dumps(about)),
            "skin_mm": self.pad.skin_mm,
            "cells": response.cells,
            "compliance_mm_per_MPa": response.compliance_mm_per_MPa,
            "receptors_mm": self.receptors_mm,
            "ranges": self.ranges,
        }
        networks = {**self.felt.arrays("felt"), **self.whole.arrays("whole")}
        write_arrays(File(file), {**arrays, **networks}, compressed=True)

    @classmethod
    def read(cls, file: File | str) -> Self:
        """Return the finger of a file; raise StudyError if there is none, or it holds no finger."""
        try:
            saved = File(file).read_bytes()
        except OSError as error:
            raise StudyError(f"{file} cannot be read: {error.strerror or error}.") from None
        written_by = None
        try:
            with np.load(io.BytesIO(saved), allow_pickle=False) as opened:
                arrays = dict(opened)
            about = json.loads(str(arrays["about"]))
            written_by = about.get("version", UNSTATED)
            grids = {
                name: Grid((x, y), spacing, (nx, ny))
                for name, (x, y, spacing, nx, ny) in about["grids"].items()
            }
            cells = grids["cells"], arrays["cells"], arrays["compliance_mm_per_MPa"]
            responses = NormalResponse(*cells), TangentialResponse(*about["drag"])
            pad = Pad(grids["pad"], arrays["skin_mm"], *responses)
            networks = Network.read("felt", arrays), Network.read("whole", arrays)
            rest = arrays["receptors_mm"], arrays["ranges"], about["made_from"], about["errors"]
            finger = cls(pad, *networks, *rest)
            count, places = len(cells[1]), len(pad.grid.points_mm)
            sizes = (count, count), (places,), (len(rest[0]), 3), (2, len(WHOLE) + 1)
            is_right = sizes == tuple(map(np.shape, (cells[2], arrays["skin_mm"], *rest[:2])))
            numbers = [array for name, array in arrays.items() if name != "about"]
            if not (is_right and all(np.isfinite(array).all() for array in numbers)):
                raise ValueError
            assert finger.study.populations
            plate = HeightMap.of_array(np.zeros((2, 2)), 1.0)
            finger.loop(plate, receptors_mm=[(0.0, 0.0)]).step((0.0, 0.0, 0.1), 1.0)
        except Exception:  # of the archive, its arrays, their sizes or the study
            why = why_unreadable(written_by)
            raise StudyError(f"{file} holds no reduced finger.{why}") from None
        return finger

    def loop(
        self,
        bodies: HeightMap | Sequence[HeightMap],
        *,
        friction: ArrayLike = 0.3,
        start_mm: ArrayLike = (0.0, 0.0, 0.0),
        receptors_mm: ArrayLike | None = None,
    ) -> Loop:
        """Return a loop that is stepped from outside, such as a simulator's.

        Raises StudyError if friction is negative or not finite, shapes do not fit, or a receptor
        lies beyond those that were taught.

        Parameters
        ----------
        bodies
            What is touched; several are touched side by side, each by itself.
        friction
            One coefficient, or one for each body.
        start_mm
            Where the bodies are at first, (3,) or (bodies, 3), clear of the finger: at 0 the
            highest plane just touches it.
        receptors_mm
            X and Y of receptors, (receptors, 2), up to 5.5 and 6 mm from 0; default those of the
            study. Z may follow but has no effect: it is at the study's depth below the skin.
        """
        return Loop(self, bodies, friction, start_mm, receptors_mm)

    def scan(
        self,
        body: RigidBody | HeightMap,
        path: Path,
        *,
        friction: float = 0.3,
        receptors_mm: ArrayLike | None = None,
    ) -> Trace:
        """Return what a full scan of a body along a path would return, in milliseconds.

        The trace has the names of a scan's; what it does not know is NaN, and ``is_outside`` is 1
        where the finger answers beyond what it was made from. Elsewhere its `errors` are stated:
        ``force_error_N`` (normal), ``sed_error_kPa``, and those of rates, as shares, on the worst
        kind of surface, ``rate_error`` (of an afferent) and ``mean_rate_error`` (of all).

        Raises
        ------
        StudyError
            The path is not valid, turns the body or holds a force; or see `loop`.
        ConvergenceError
            A press does not meet its force, or the pressures are not found.
        """
        return self.scan_all([body], path, friction=friction, receptors_mm=receptors_mm)[0]

    def scan_all(
        self,
        bodies: Sequence[RigidBody | HeightMap],
        path: Path,
        *,
        friction: ArrayLike = 0.3,
        receptors_mm: ArrayLike | None = None,
    ) -> list[Trace]:
        """Return the traces of many bodies along one path; see `scan`.

        They are stepped together, unless the path presses to a force, which each meets elsewhere.
        """
        path.check()
        reach = self.pad.meets(path.places_mm()[:, :2])
        maps = [
            body if isinstance(body, HeightMap) else HeightMap.of(body, *reach) for body in bodies
        ]
        to_force = any(motion.until_N is not None for _, motion in path.plan())
        tolerance_mm = FINE_MM if to_force else TOLERANCE_MM
        loop = Loop(self, maps, friction, path.start_mm, receptors_mm, tolerance_mm)
        if len(maps) > 1 and to_force:
            each = zip(maps, loop.friction.tolist(), strict=True)
            return [
                self.scan(body, path, friction=mu, receptors_mm=receptors_mm) for body, mu in each
            ]
        steps = list(along(path, loop))
        same = loop.receptors_mm, path, self.errors
        return [trace_of(steps, k, *same) for k in range(len(maps))]

    def respond(self, trace: Trace) -> Response:
        """Return the spikes of the study's afferents at the receptors of a trace."""
        populations = [afferents.population() for afferents in self.study.populations]
        return fire_all(populations, trace.arrays())

    def rates(self, traces: Mapping[str, Trace]) -> Rates:
        """Return the mean rates on surfaces by name, with their errors; warn of what is alike."""
        from tactile_fem.surrogate.rates import Rates  # Matplotlib takes a while

        found = Rates(traces, np.array([self.mean_rates(each) for each in traces.values()]))
        if said := found.alike():
            logger.warning("%s.", said)
        return found

    def mean_rates(self, trace: Trace) -> Array:
        """Return the rates of the afferents from the end of the indentation on, spikes/s."""
        response = self.respond(trace)
        return response.mean_rate(0.0 if response.end_s > 0 else response.start_s, response.end_s)


class Loop:
    """A finger that touches bodies, step by step; see `FastFinger.loop`.

    Attributes
    ----------
    receptors_mm
        X, Y and Z, (receptors, 3).
    friction
        Coefficients, (bodies,).
    """

    def __init__(
        self,
        finger: FastFinger,
        bodies: HeightMap | Sequence[HeightMap],
        friction: ArrayLike,
        start_mm: ArrayLike,
        receptors_mm: ArrayLike | None,
        tolerance_mm: float = TOLERANCE_MM,
    ) -> None:
        maps = [bodies] if isinstance(bodies, HeightMap) else list(bodies)
        problem = f"friction and start_mm must be those of one or of all {len(maps)} bodies."
        mu = _of_bodies(friction, (len(maps),), problem)
        start = _of_bodies(start_mm, (len(maps), 3), problem)
        if not (np.isfinite(mu).all() and (mu >= 0).all()):
            raise StudyError(f"friction is {friction!r}; it must be 0 or more.")
        if not maps or not np.isfinite(start).all():
            raise StudyError("a fast finger needs one body or more, and finite start_mm.")
        self._finger, self._count, self.friction = finger, len(maps), mu
        self.receptors_mm = _in_space(finger, receptors_mm)
        self._patch = ContactPatch(finger.pad, maps, mu, start, tolerance_mm)
        self._view = View.of(finger.pad, self.receptors_mm[:, :2])
        self._overview = Overview(finger.pad)
        mirrors = mirror_of_view(), self._overview.mirror()
        self._mirrors = mirrors if finger.is_symmetric else (None, None)

    @on_one_core()
    def step(self, place_mm: ArrayLike, dt_s: float) -> BodyState:
        """Move the bodies to a place, (3,) or (bodies, 3), within a time; return what is felt.

        Raises
        ------
        StudyError
            The time is not positive, or a place is not finite or has another shape.
        ConvergenceError
            The pressures are not found.
        """
        if not (np.isfinite(dt_s) and dt_s > 0):
            raise StudyError(f"dt_s is {dt_s}; it must be positive.")
        problem = f"place_mm must be (3,) or ({self._count}, 3)."
        places = _of_bodies(place_mm, (self._count, 3), problem)
        if not np.isfinite(places).all():
            raise StudyError("place_mm: all places must be finite.")
        patch, finger = self._patch, self._finger
        patch.move(places, dt_s)
        touches = patch.normal_N > 0
        of_view, of_overview = self._mirrors
        values = finger.felt.mirrored_mean(np.concatenate(self._view(patch)), of_view, FELT_SIGNS)
        whole = finger.whole.mirrored_mean(self._overview(patch), of_overview, WHOLE_SIGNS)
        force = np.where(touches[:, None], whole[:, :3] * patch.normal_N[:, None], 0.0)
        area = np.where(touches, np.maximum(whole[:, 3], 0.0), 0.0)
        force[:, 2] = np.maximum(force[:, 2], 0.0)
        values = values.astype(float).reshape(self._count, len(self.receptors_mm), -1)
        felt = columns_of(values)
        for each in STANDARD:
            felt[each.name][~touches] = each.at_rest(len(self.receptors_mm))
        is_outside = (touches & self._is_outside()) | patch.is_off
        return BodyState(force, area, felt, is_outside)

    def ahead(self, place_mm: ArrayLike, dt_s: float) -> BodyState:
        """Return what `step` would, and stay."""
        other = copy(self)
        other._patch = copy(self._patch)
        return other.step(place_mm, dt_s)

    def _is_outside(self) -> NDArray[np.bool_]:
        values, (least, largest) = self._patch.measures(), self._finger.ranges
        allowed = _BEYOND * (largest - least)
        beyond = ((values < least - allowed) | (values > largest + allowed)).any(axis=1)
        # A fifth of the training is across: friction is then too small, by half at first.
        x, y = (np.abs(values[:, WHOLE.index(name)]) for name in ("slip_x", "slip_y"))
        return beyond | (x > y)


def _of_bodies(values: ArrayLike, shape: tuple[int, ...], problem: str) -> Array:
    """Return numbers of bodies; raise StudyError if they are none or have another shape."""
    try:
        return np.broadcast_to(np.asarray(values, dtype=float), shape)
    except (ValueError, TypeError):
        raise StudyError(problem) from None


def is_symmetric(study: Mapping[str, Any]) -> bool:
    """Return whether the finger of a study's tables is its own mirror image in X."""
    return not any(study.get("finger", {}).get(name) for name in _FILES)


def check_taught(places_mm: Array) -> None:
    """Raise StudyError for a receptor (n, 2 or more) beyond those of the scans that teach."""
    off = np.flatnonzero((np.abs(places_mm[:, :2]) > TAUGHT_MM + 1e-6).any(axis=1))
    if len(off):
        x, y = places_mm[off[0], :2]
        raise StudyError(
            f"receptors_mm: receptor {off[0]} is at X {x:g}, Y {y:g} mm; a fast finger knows those "
            "from X -{0:g} to {0:g} and Y -{1:g} to {1:g} mm.".format(*TAUGHT_MM)
        )


def _in_space(finger: FastFinger, receptors_mm: ArrayLike | None) -> Array:
    """Return receptors (n, 3), by default those of the study; Z of others is not known."""
    try:
        given = finger.receptors_mm if receptors_mm is None else receptors_mm
        places = np.asarray(given, dtype=float)
    except (ValueError, TypeError):
        raise StudyError("receptors_mm must be numbers, (receptors, 2).") from None
    if places.ndim != 2 or places.shape[1] not in (2, 3) or not np.isfinite(places).all():
        raise StudyError(
            f"receptors_mm has the shape {places.shape}; it needs (receptors, 2), all finite."
        )
    check_taught(places)
    unknown = np.full((len(places), 3 - places.shape[1]), np.nan)
    return np.concatenate([places, unknown], axis=1)
