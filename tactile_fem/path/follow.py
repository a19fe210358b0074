"""A piece that follows measured places, or measured forces."""

from __future__ import annotations

import logging
from functools import partial
from typing import Literal

import numpy as np
from pydantic import Field, PrivateAttr

from tactile_fem.errors import StudyError
from tactile_fem.path.loads import NORMAL, HeldLoads
from tactile_fem.path.motion import Array, Motion, multiples
from tactile_fem.path.pieces import Piece
from tactile_fem.path.recording import COLUMNS, LOADS, PLACES, TURNS, Frame, Recording
from tactile_fem.path.rotations import angle_rad, since_first
from tactile_fem.runtime.settings import File, Positive

logger = logging.getLogger(__name__)

_OUTPUT_SHARE = 0.01  # of the whole, between two outputs
_MOST_DEG = 90.0  # between two rows: what lies between would be a guess
_DEEPEST_MM = 10.0  # deeper than any pad


class _OfFile(Piece):
    kind: Literal["follow"]
    file: File = Field(
        description="a CSV file with the column time_s and some of x_mm, y_mm, z_mm, rx_deg, "
        "ry_deg, rz_deg, fx_N, fy_N, fz_N, tz_Nmm"
    )


class Follow(Frame, _OfFile):
    """Follow places or forces in a file.

    Its columns are ``time_s`` and some of ``x_mm,y_mm,z_mm`` (places of the body),
    ``rx_deg,ry_deg,rz_deg`` (its rotation vector, axis times angle) and ``fx_N,fy_N,fz_N,tz_Nmm``
    (forces on the finger, and torque about Z through the body's origin), linear in between; of a
    moving finger all are in the frame of the body at rest. The first row of a path's first piece is
    where the body starts; later pieces go on from where it is. Forces in `hold` are met by moving
    the body, beginning with those at the piece's start.
    """

    kind: Literal["follow"] = "follow"
    smooth_s: Positive | None = Field(
        None, description="smooths places and held forces: halves waves of this period"
    )
    hold: tuple[Literal["fx_N", "fy_N", "fz_N", "tz_Nmm"], ...] = Field(
        (), description="columns of forces to be met by moving the body, instead of its places"
    )
    output_s: Positive | None = Field(
        None, description="time between two outputs; not set: a hundredth of the whole"
    )

    _known: Recording | None = PrivateAttr(None)

    @property
    def recorded(self) -> Recording:
        """What the file held when the piece was resolved, or holds now."""
        return self._known or self.read(self.file, "protocol.path", self.smooth_s)

    def first_pose(self) -> tuple[Array, Array]:
        """Return the first place, (3,) in mm, and rotation vector, (3,) in rad."""
        recorded = self.recorded
        depth_mm, is_turned = recorded.pressed_mm(), {*TURNS} & {*recorded.names}
        if not is_turned and (depth_mm < 0 or depth_mm > _DEEPEST_MM):
            raise StudyError(
                f"protocol.path: where fz_N in {self.file} presses, the body is {depth_mm:.3g} mm "
                f'deep: change moves, which is "{self.moves}", if z_mm has the wrong sign; set '
                "contact_N or contact_s if it is not 0 at the first touch."
            )
        if not (is_turned or "z_mm" in recorded.names or "fz_N" in self.hold):
            raise StudyError(
                f"protocol.path: {self.file} has no column z_mm along Z, and hold no fz_N: the "
                "body would never press the finger."
            )
        return recorded.of(PLACES)[0], np.radians(recorded.of(TURNS)[0])

    def announce(self) -> None:
        """Log what smoothing removes and when contact begins; warn of forces against friction."""
        recorded, file = self.recorded, self.file.name
        if self.smooth_s:
            noise = dict(zip(COLUMNS, (recorded.values - recorded.smooth).std(axis=0), strict=True))
            names = [name for name in recorded.names if name in (*PLACES, *self.hold)]
            words = ", ".join(f"{name} {noise[name]:.2g}" for name in names)
            logger.info("smoothing of %s removes (rms): %s", file, words)
        if np.isfinite(recorded.contact_s):
            logger.info("contact in %s begins at %.4g s", file, recorded.contact_s)
        if names := recorded.against_motion():
            told = "%s of %s: against the motion, while friction takes the finger along; reversed?"
            logger.warning(told, " and ".join(names), file)

    def resolved(self, deepest_mm: float) -> Follow:
        """Return the piece with what the file holds now."""
        known = self.model_copy()
        known._known = self.read(self.file, "protocol.path", self.smooth_s)
        return known

    def motion(self, start_mm: Array) -> Motion:
        """Return the motion, shifted to begin at the start."""
        recorded = self.recorded
        times, places = recorded.time_s - recorded.time_s[0], recorded.of(PLACES)
        way = start_mm + (places - places[0])
        held, turns = self._held(recorded, times), self._turns(recorded)
        outputs = multiples(self.output_s or _OUTPUT_SHARE * times[-1], times[-1])
        place = partial(_at, times, way)
        turn = None if turns is None else partial(_at, times, turns)
        return Motion("follow", float(times[-1]), place, outputs, times, held=held, turn=turn)

    def _turns(self, recorded: Recording) -> Array | None:
        """Return rotation vectors in rad since the first row, (n, 3); None without a turn."""
        if not {*TURNS} & {*recorded.names}:
            return None
        turns = np.radians(recorded.of(TURNS))
        angles = np.degrees(angle_rad(turns[:-1], turns[1:]))
        k = int(angles.argmax())
        if angles[k] > _MOST_DEG:
            raise StudyError(
                f"protocol.path: the body in {self.file} turns by {angles[k]:.3g} degrees from "
                f"{recorded.time_s[k]:g} to {recorded.time_s[k + 1]:g} s but may turn by "
                f"{_MOST_DEG:g} between two rows."
            )
        return since_first(turns)

    def _held(self, recorded: Recording, times: Array) -> HeldLoads | None:
        for missing in [name for name in self.hold if name not in recorded.names]:
            raise StudyError(f"protocol.path: {self.file} has no column {missing}, named in hold.")
        if not self.hold:
            return None
        loads = recorded.of(LOADS)
        if "fz_N" in self.hold and (least_N := loads[1:, NORMAL].min()) <= 0:
            raise StudyError(
                f"protocol.path: fz_N in {self.file} goes down to {least_N:.3g} but is named in "
                "hold: press first, and keep only the rows in contact."
            )
        held = tuple(k for k, name in enumerate(LOADS) if name in self.hold)
        return HeldLoads(held, lambda t, start: _at(times, np.vstack([start, loads[1:]]), t))


def _at(times: Array, rows: Array, t: float) -> Array:
    """Return a row at a time, linear between those given, (columns,)."""
    return np.array([np.interp(t, times, column) for column in rows.T])
