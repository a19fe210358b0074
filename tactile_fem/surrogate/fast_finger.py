"""A finger in milliseconds: contact on its own compliance, and a learnt map to receptors."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as File
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response, fire_all
from tactile_fem.neuron.fields import STANDARD
from tactile_fem.path.motion import Path
from tactile_fem.runtime.files import write_arrays
from tactile_fem.simulation.trace import Trace
from tactile_fem.stimulus.body import RigidBody
from tactile_fem.study import Study
from tactile_fem.surrogate.course import Moment, Row, along, trace_of
from tactile_fem.surrogate.cushion import Cushion
from tactile_fem.surrogate.drag import Drag
from tactile_fem.surrogate.grid import Grid
from tactile_fem.surrogate.heights import HeightMap
from tactile_fem.surrogate.network import Network
from tactile_fem.surrogate.touch import Pad, Touch
from tactile_fem.surrogate.view import Overview, View

Array = NDArray[Any]

_WIDTHS = tuple(np.size(each.rest) for each in STANDARD)
# Share of the range of what it was made from that a value may lie beyond it.
_BEYOND = 0.05


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
        Of scans that were held out, by name.
    """

    pad: Pad
    felt: Network
    whole: Network
    receptors_mm: Array
    ranges: Array
    made_from: Mapping[str, Any]
    errors: Mapping[str, float] = field(default_factory=dict)

    @property
    def study(self) -> Study:
        """The study whose finger it is."""
        return Study.model_validate(self.made_from["study"])

    def write(self, file: File | str) -> None:
        """Write it as ``.npz``."""
        cushion, drag = self.pad.cushion, self.pad.drag
        grids = {"pad": self.pad.grid, "cells": cushion.grid}
        about = {
            "grids": {k: (*g.low_mm, g.spacing_mm, *g.shape) for k, g in grids.items()},
            "drag": (drag.compliance_mm_per_N, drag.exponent, drag.across),
            "made_from": self.made_from,
            "errors": self.errors,
        }
        arrays = {
            "about": np.array(json.dumps(about)),
            "skin_mm": self.pad.skin_mm,
            "cells": cushion.cells,
            "compliance_mm_per_MPa": cushion.compliance_mm_per_MPa,
            "receptors_mm": self.receptors_mm,
            "ranges": self.ranges,
        }
        networks = {**self.felt.arrays("felt"), **self.whole.arrays("whole")}
        write_arrays(File(file), {**arrays, **networks}, compressed=True)

    @classmethod
    def read(cls, file: File | str) -> Self:
        """Return the finger of a file.

        Raises
        ------
        StudyError
            There is none, or it holds no reduced finger.
        """
        try:
            with np.load(file, allow_pickle=False) as saved:
                arrays = dict(saved)
            about = json.loads(str(arrays["about"]))
            grids = {
                name: Grid((x, y), spacing, (nx, ny))
                for name, (x, y, spacing, nx, ny) in about["grids"].items()
            }
            cushion = Cushion(grids["cells"], arrays["cells"], arrays["compliance_mm_per_MPa"])
            pad = Pad(grids["pad"], arrays["skin_mm"], cushion, Drag(*about["drag"]))
            networks = Network.read("felt", arrays), Network.read("whole", arrays)
            rest = arrays["receptors_mm"], arrays["ranges"], about["made_from"], about["errors"]
        except OSError as error:
            raise StudyError(f"{file} cannot be read: {error.strerror or error}.") from None
        except (KeyError, ValueError, TypeError, EOFError):
            raise StudyError(f"{file} holds no reduced finger.") from None
        return cls(pad, *networks, *rest)

    def loop(
        self,
        bodies: HeightMap | Sequence[HeightMap],
        *,
        friction: ArrayLike = 0.3,
        start_mm: ArrayLike = (0.0, 0.0, 0.0),
        receptors_mm: ArrayLike | None = None,
    ) -> Loop:
        """Return a loop that is stepped from outside, such as a simulator's.

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
            X and Y of receptors, (receptors, 2); default those of the study.

        Raises
        ------
        StudyError
            Friction is negative or not finite, or shapes do not fit.
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
        where the finger answers beyond what it was made from.

        Raises
        ------
        StudyError
            The path turns the body or holds a force; or see `loop`.
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
        """Return the traces of many bodies along one path, stepped together; see `scan`.

        A press to a force ends for all when the first body reaches it.
        """
        reach = self.pad.meets(path.places_mm()[:, :2])
        maps = [
            body if isinstance(body, HeightMap) else HeightMap.of(body, *reach) for body in bodies
        ]
        loop = self.loop(maps, friction=friction, start_mm=path.start_mm, receptors_mm=receptors_mm)
        rows: list[Row] = []
        moments: list[Moment] = []
        for row in along(path, lambda: float(moments[-1].force_N[:, 2].max())):
            rows.append(row)
            moments.append(loop.step(row.place_mm, row.dt_s))
        return [trace_of(rows, moments, k, loop.receptors_mm, path) for k in range(len(maps))]

    def respond(self, trace: Trace) -> Response:
        """Return the spikes of the study's afferents at the receptors of a trace."""
        populations = [afferents.population() for afferents in self.study.populations]
        return fire_all(populations, trace.arrays())


class Loop:
    """A finger that touches bodies, step by step; see `FastFinger.loop`.

    Attributes
    ----------
    receptors_mm
        X, Y and Z, (receptors, 3).
    """

    def __init__(
        self,
        finger: FastFinger,
        bodies: HeightMap | Sequence[HeightMap],
        friction: ArrayLike,
        start_mm: ArrayLike,
        receptors_mm: ArrayLike | None,
    ) -> None:
        maps = [bodies] if isinstance(bodies, HeightMap) else list(bodies)
        try:
            mu = np.broadcast_to(np.asarray(friction, dtype=float), (len(maps),))
            start = np.broadcast_to(np.asarray(start_mm, dtype=float), (len(maps), 3))
        except ValueError:
            raise StudyError(
                f"friction and start_mm must be those of one or of all {len(maps)} bodies."
            ) from None
        if not (np.isfinite(mu).all() and (mu >= 0).all()):
            raise StudyError(f"friction is {friction!r}; it must be 0 or more.")
        self._finger, self._count = finger, len(maps)
        self.receptors_mm = _in_space(finger, receptors_mm)
        self._touch = Touch(finger.pad, maps, mu, start)
        self._view = View.of(finger.pad, self.receptors_mm[:, :2])
        self._overview = Overview(finger.pad)

    def step(self, place_mm: ArrayLike, dt_s: float) -> Moment:
        """Move the bodies to a place, (3,) or (bodies, 3), within a time; return what is felt.

        Raises
        ------
        StudyError
            The time is not positive, or a place is not finite or has another shape.
        """
        if not (np.isfinite(dt_s) and dt_s > 0):
            raise StudyError(f"dt_s is {dt_s}; it must be positive.")
        try:
            places = np.broadcast_to(np.asarray(place_mm, dtype=float), (self._count, 3))
        except ValueError:
            raise StudyError(f"place_mm must be (3,) or ({self._count}, 3).") from None
        if not np.isfinite(places).all():
            raise StudyError("place_mm: all places must be finite.")
        touch, finger = self._touch, self._finger
        touch.move(places, dt_s)
        touches = touch.normal_N > 0
        whole = finger.whole(self._overview(touch)).astype(float)
        force = np.where(touches[:, None], whole[:, :3] * touch.normal_N[:, None], 0.0)
        area = np.where(touches, np.maximum(whole[:, 3], 0.0), 0.0)
        force[:, 2] = np.maximum(force[:, 2], 0.0)
        values = finger.felt(np.concatenate(self._view(touch))).astype(float)
        felt = columns_of(values.reshape(self._count, len(self.receptors_mm), -1))
        for each in STANDARD:
            felt[each.name][~touches] = each.at_rest(len(self.receptors_mm))
        return Moment(force, area, felt, self._is_outside() & touches)

    def _is_outside(self) -> NDArray[np.bool_]:
        values, (least, largest) = measures(self._touch), self._finger.ranges
        allowed = _BEYOND * (largest - least)
        return ((values < least - allowed) | (values > largest + allowed)).any(axis=1)


def _in_space(finger: FastFinger, receptors_mm: ArrayLike | None) -> Array:
    """Return receptors (n, 3), by default those of the study; Z of others is not known."""
    if receptors_mm is None:
        return finger.receptors_mm
    places = np.asarray(receptors_mm, dtype=float)
    if places.ndim != 2 or places.shape[1] not in (2, 3) or not np.isfinite(places).all():
        raise StudyError(
            f"receptors_mm has the shape {places.shape}; it needs (receptors, 2), all finite."
        )
    unknown = np.full((len(places), 3 - places.shape[1]), np.nan)
    return np.concatenate([places, unknown], axis=1)


def measures(touch: Touch) -> Array:
    """Return the values that must lie within `FastFinger.ranges`, (bodies, values)."""
    largest = touch.pressure_MPa.max(axis=1, keepdims=True)
    return np.concatenate([touch.whole(), largest], axis=1)


def columns_of(values: Array) -> dict[str, Array]:
    """Return the columns of every trace from outputs (..., outputs) of the receptors' network."""
    found, parts = {}, np.split(values, np.cumsum(_WIDTHS)[:-1], axis=-1)
    for each, part in zip(STANDARD, parts, strict=True):
        found[each.name] = part[..., 0] if np.ndim(each.rest) == 0 else part
    # The network's first output is the root of the energy density, which is nearly linear.
    found["sed_kPa"] = np.maximum(found["sed_kPa"], 0.0) ** 2
    return found


def outputs_of(trace: Mapping[str, Array]) -> Array:
    """Return the outputs (rows, receptors, outputs) that the receptors' network should give."""
    columns = [np.asarray(trace[each.name], dtype=float) for each in STANDARD]
    columns[0] = np.sqrt(np.maximum(columns[0], 0.0))
    wide = [
        c[..., None] if np.ndim(each.rest) == 0 else c
        for c, each in zip(columns, STANDARD, strict=True)
    ]
    return np.concatenate(wide, axis=-1)
