"""The analytic finger: skin and bone with their normals.

Both are capsules: an elliptic cylinder along Y with a half-ellipsoidal tip, whose palmar and
dorsal halves differ in height. Proximal of the contact point both rise along an arc, so
that the pad lifts off a plate before the cut. Distal of it the palmar contour starts with the
same curvature. This shape is proposed by this project.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tactile_fem.errors import MeshError
from tactile_fem.finger.plane import Array
from tactile_fem.finger.settings import FingerSettings

ARC_END = math.radians(30.0)  # the arc of the pad ends at this slope and continues straight


@dataclass(frozen=True)
class Capsule:
    """A smooth closed-tip body along Y, cut at its proximal end (lengths in mm).

    `half_width`, `below` and `above` are the semi-axes of the cross-section: across, palmar and
    dorsal; `axis_z` is the height of the axis at Y >= 0. `fullness` is the second derivative of the
    palmar tip contour at Y = 0, divided by that of an ellipse that starts there; with None the
    palmar contour closes like the dorsal one.
    """

    half_width: float
    below: float
    above: float
    axis_z: float
    tip_y: float
    tip_length: float
    cut_y: float
    pad_radius: float  # of the contour along Y for Y < 0
    fullness: float | None = None

    @property
    def capsule(self) -> Capsule:
        """The body itself, as a scanned skin has one."""
        return self

    @property
    def shoulder_y(self) -> float:
        """Y at which the rounded tip begins."""
        return self.tip_y - self.tip_length

    def rise(self, y: ArrayLike) -> tuple[Array, Array]:
        """Return the rise of the body at y and its slope: an arc, then its tangent."""
        back = np.maximum(-np.asarray(y, dtype=float), 0.0)
        end = self.pad_radius * math.sin(ARC_END)
        on_arc = np.minimum(back, end)
        root = np.sqrt(self.pad_radius**2 - on_arc**2)
        slope = on_arc / root
        return self.pad_radius - root + slope * (back - on_arc), -slope

    def closing(self, y: Array) -> tuple[Array, Array]:
        """Return the squared section factor (1 in the shaft, 0 at the tip) and its derivative."""
        t = np.clip((y - self.shoulder_y) / self.tip_length, 0.0, 1.0)
        return 1.0 - t**2, -2.0 * t / self.tip_length

    def _palmar(self, y: Array) -> tuple[Array, Array]:
        """Return the squared palmar height over that of the closing, and its derivative."""
        # The height closes as (1 - s^2)(1 + (1 - a) s^2) with s = y/tip_y, a the fullness.
        if self.fullness is None:
            return np.ones_like(y), np.zeros_like(y)
        s = np.clip(y / self.tip_y, 0.0, 1.0)
        b = 1.0 - self.fullness
        short = (1.0 - s**2) * (1.0 + b * s**2)
        dshort = (-2.0 * s * (1.0 + b * s**2) + (1.0 - s**2) * 2.0 * b * s) / self.tip_y
        t = np.maximum((y - self.shoulder_y) / self.tip_length, 0.0)
        ratio = self.tip_length / self.tip_y
        top = (1.0 + s) * (1.0 + b * s**2)
        dtop = ((1.0 + b * s**2) + (1.0 + s) * 2.0 * b * s) / self.tip_y
        tip = ratio * top / (1.0 + t)
        dtip = ratio * (dtop / (1.0 + t) - top / ((1.0 + t) ** 2 * self.tip_length))
        in_tip = y > self.shoulder_y
        return np.where(in_tip, tip, short), np.where(in_tip, dtip, dshort)

    def place(self, reference: Array) -> tuple[Array, Array]:
        """Move points (n, 3) of the reference capsule onto the body.

        They are u, y, v with u^2 + v^2 = 1 in the shaft, and are projected onto the capsule first.
        Return positions in mm and outward unit normals, (n, 3), exact.
        """
        u, y, v = np.asarray(reference, dtype=float).T
        y = np.clip(y, self.cut_y, self.tip_y)
        closing, dclosing = self.closing(y)
        length = np.hypot(u, v)
        scale = np.where(length > 1e-9, np.sqrt(closing) / np.maximum(length, 1e-9), 0.0)
        u, v = u * scale, v * scale
        palmar, dpalmar = self._palmar(y)
        under = v < 0
        height = np.where(under, self.below * np.sqrt(palmar), self.above)
        x, zeta = self.half_width * u, height * v
        rise, slope = self.rise(y)
        gradient = np.column_stack(
            [
                2.0 * x / self.half_width**2,
                -dclosing - np.where(under, v**2 * dpalmar / palmar, 0.0),
                2.0 * zeta / height**2,
            ]
        )
        gradient[:, 1] -= slope * gradient[:, 2]
        points = np.column_stack([x, y, self.axis_z + zeta + rise])
        return points, gradient / np.linalg.norm(gradient, axis=1, keepdims=True)

    def level(self, points: Array) -> Array:
        """Return a function of (n, 3) points that is negative inside and zero on the body."""
        x, y, z = np.asarray(points, dtype=float).T
        closing, _ = self.closing(y)
        palmar, _ = self._palmar(y)
        zeta = z - self.axis_z - self.rise(y)[0]
        height2 = np.where(zeta < 0, self.below**2 * palmar, self.above**2)
        return (x / self.half_width) ** 2 + zeta**2 / height2 - closing

    def sample(self, step_mm: float) -> tuple[Array, Array]:
        """Return points about `step_mm` apart and their normals."""
        return self.place(self.reference(step_mm))

    def reference(self, step_mm: float) -> Array:
        """Return points (n, 3) of the reference capsule that lie about `step_mm` apart."""
        shaft = np.arange(self.cut_y, self.shoulder_y, step_mm)
        angle = np.linspace(0.0, np.pi / 2, int(np.ceil(2 * self.tip_length / step_mm)))
        y = np.concatenate([shaft, self.shoulder_y + self.tip_length * np.sin(angle)])
        turn = np.arange(0.0, 2 * np.pi, step_mm / max(self.half_width, self.below, self.above))
        grid_y, grid_turn = np.meshgrid(y, turn, indexing="ij")
        return np.column_stack(
            [np.cos(grid_turn).ravel(), grid_y.ravel(), np.sin(grid_turn).ravel()]
        )


def skin_shape(finger: FingerSettings) -> Capsule:
    """Return the outer skin; raise MeshError if the lengths do not form a finger."""
    tip = finger.contact_from_tip_mm
    cut = tip - finger.tip_length_mm - finger.straight_length_mm
    if finger.tip_length_mm > tip:
        raise MeshError(
            f"finger.tip_length_mm = {finger.tip_length_mm:g} is longer than contact_from_tip_mm "
            f"= {tip:g}: the contact point must lie proximal of the rounded tip"
        )
    if cut > -3.0:
        raise MeshError(
            f"the finger is cut {max(-cut, 0.0):g} mm proximal of the contact point; lengthen "
            "finger.straight_length_mm so that it is at least 3 mm"
        )
    fullness = tip**2 / (finger.palmar_height_mm * finger.pad_radius_mm)
    if fullness > 1.9:
        raise MeshError(
            f"finger.pad_radius_mm = {finger.pad_radius_mm:g} is too small for a tip of {tip:g} "
            f"mm: it must exceed {tip**2 / (1.9 * finger.palmar_height_mm):.3g} mm"
        )
    return Capsule(
        half_width=finger.half_width_mm,
        below=finger.palmar_height_mm,
        above=finger.dorsal_height_mm,
        axis_z=finger.palmar_height_mm,
        tip_y=tip,
        tip_length=finger.tip_length_mm,
        cut_y=cut,
        pad_radius=finger.pad_radius_mm,
        fullness=fullness,
    )


def bone_shape(finger: FingerSettings, skin: Capsule) -> Capsule:
    """Return the bone, pad_thickness_mm above the contact point; it rises like the skin."""
    tip = skin.tip_y - finger.bone_tip_gap_mm
    if tip < 1.0:
        raise MeshError(
            f"finger.bone_tip_gap_mm = {finger.bone_tip_gap_mm:g} leaves no bone over the contact "
            f"point: it must be at most {skin.tip_y - 1.0:.3g}"
        )
    return Capsule(
        half_width=finger.bone_half_width_mm,
        below=finger.bone_half_height_mm,
        above=finger.bone_half_height_mm,
        axis_z=finger.pad_thickness_mm + finger.bone_half_height_mm,
        tip_y=tip,
        tip_length=min(finger.bone_half_width_mm, tip),
        cut_y=skin.cut_y,
        pad_radius=skin.pad_radius,
    )
