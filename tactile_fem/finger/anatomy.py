"""What a finger is meshed from: its surfaces, analytic or scanned, its layers and edge lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from tactile_fem.errors import MeshError, PlaceError, StudyError
from tactile_fem.finger.layers import Layering, Ridges, Sizes, layering
from tactile_fem.finger.plane import Array
from tactile_fem.finger.settings import FingerSettings
from tactile_fem.finger.shape import Capsule, bone_shape, skin_shape
from tactile_fem.finger.simplex import Triangles
from tactile_fem.runtime.files import cached_by_content

if TYPE_CHECKING:
    import shapely
    from matplotlib.figure import Figure

_NAIL_FROM_TIP_MM, _NAIL_FROM_CUT_MM = 1.0, 2.0
_NAIL_SHARE = 0.97  # share of the width of the finger
_LEAST_GAP_MM = 0.15  # bone to dermis
_DEPTH_STEP_MM = 0.25  # between points of the skin, from which depths are measured
_BONE_STEP_MM = 0.4  # between points of the bone, whose depth is checked


class Skin(Protocol):
    """An outer skin: a capsule, or what it becomes when each of its points is moved."""

    @property
    def capsule(self) -> Capsule:
        """The capsule, whose triangles it has."""

    def place(self, reference: Array) -> tuple[Array, Array]:
        """Move points (n, 3) of the reference capsule onto the skin; return normals too."""

    def level(self, points: Array) -> Array:
        """Return a function of points (n, 3) that is negative inside and zero on the skin."""

    def sample(self, step_mm: float) -> tuple[Array, Array]:
        """Return points about `step_mm` apart and their normals."""


class ClosedBone(Protocol):
    """A bone that ends before the cut."""

    def sample(self, step_mm: float) -> tuple[Array, Array]:
        """Return points about `step_mm` apart and their normals."""

    def triangulated(self, size_mm: float) -> Triangles:
        """Return its surface in triangles with edges of at most `size_mm`."""


@dataclass(frozen=True)
class NailOutline:
    """Rounded rectangle in the XY plane (mm); the nail is its projection onto the dorsal side."""

    half_width: float
    start_y: float
    end_y: float

    @property
    def corner(self) -> float:
        """Radius of the corners."""
        return 0.9 * min(self.half_width, 0.5 * (self.end_y - self.start_y))

    @property
    def centres(self) -> tuple[float, float, float, float]:
        """Least X and Y, largest X and Y of the centres of the corners."""
        x, r = self.half_width - self.corner, self.corner
        return -x, self.start_y + r, x, self.end_y - r

    @property
    def polygon(self) -> shapely.Polygon:
        """The outline."""
        import shapely  # takes a while

        return shapely.box(*self.centres).buffer(self.corner, quad_segs=16)

    def ends(self, axis: int) -> tuple[float, float]:
        """Return its ends along X (0) or Y (1)."""
        return (self.start_y, self.end_y) if axis else (-self.half_width, self.half_width)


class SurfaceFiles:
    """Reads the files of a skin, bone or nail; the class below this one that was defined last does.

    Without one a finger is described by its lengths alone.
    """

    reader: ClassVar[type[SurfaceFiles]]

    def __init_subclass__(cls) -> None:
        SurfaceFiles.reader = cls

    def __init__(self, finger: FingerSettings) -> None:
        self.finger = finger

    def read(self) -> tuple[Skin | None, ClosedBone | None, NailOutline | None]:
        """Return skin, bone and nail in the finger's axes; None where no file is given.

        Raises
        ------
        StudyError
            A file cannot be read, or does not make a finger.
        """
        raise StudyError("finger.skin_file and finger.bone_file cannot be read: nothing reads them")

    def figure(self, place_mm: Sequence[float]) -> Figure:
        """Draw what the files show, and mark a place (3,) in the finger's axes."""
        raise NotImplementedError


SurfaceFiles.reader = SurfaceFiles


@dataclass(frozen=True)
class Anatomy:
    """A finger with its edge lengths and layers; its skin, bone and nail in its own axes."""

    finger: FingerSettings
    sizes: Sizes
    rows: Layering
    ridges: Ridges
    skin: Skin
    bone: Capsule | ClosedBone
    nail: NailOutline

    @staticmethod
    @cached_by_content(maxsize=1)
    def of(finger: FingerSettings) -> Anatomy:
        """Make what a study states; the last one is kept, since scans of a series often share it.

        Raises MeshError if lengths or scans do not make a finger, StudyError if a file cannot be
        read.
        """
        ridges, sizes = Ridges(finger), Sizes.of(finger)
        rows = layering(finger, sizes.epidermis_rows)
        scans = SurfaceFiles.reader(finger).read() if finger.is_scanned else (None, None, None)
        skin: Skin = scans[0] or skin_shape(finger)
        bone: Capsule | ClosedBone = scans[1] or bone_shape(finger, skin.capsule)
        _check_depth_of_bone(skin, bone, finger)
        end = skin.capsule.tip_y - _NAIL_FROM_TIP_MM
        own = NailOutline(finger.nail_width_mm / 2, end - finger.nail_length_mm, end)
        nail = scans[2] or own
        _check_nail(nail, skin.capsule)
        return Anatomy(finger, sizes, rows, ridges, skin, bone, nail)


def _check_nail(outline: NailOutline, skin: Capsule) -> None:
    """Raise MeshError if a nail is wider or longer than the back of the finger."""
    width, length = 2 * outline.half_width, outline.end_y - outline.start_y
    size = f"the nail ({width:.3g} mm wide, {length:.3g} mm long)"
    x, y = np.array(outline.polygon.exterior.coords).T
    room = skin.half_width * np.sqrt(skin.closing(y)[0])
    if np.any(np.abs(x) > _NAIL_SHARE * room):
        raise MeshError(f"{size} does not fit on the back of the finger")
    if outline.start_y < skin.cut_y + _NAIL_FROM_CUT_MM:
        raise MeshError(f"{size} comes too near to the proximal cut")


def _check_depth_of_bone(skin: Skin, bone: Capsule | ClosedBone, finger: FingerSettings) -> None:
    """Raise MeshError if a bone is closer to the skin than the layers allow."""
    bone_points, _ = bone.sample(_BONE_STEP_MM)
    depth = depth_below(skin, bone_points)
    need = finger.skin_thickness_mm + _LEAST_GAP_MM
    worst = int(np.argmin(depth))
    if depth[worst] < need:
        where = "outside the skin" if depth[worst] <= 0 else f"{depth[worst]:.2f} mm below the skin"
        raise PlaceError(
            f"the bone comes to lie {where} {{place}}, but the layers need {need:.2f} mm: use "
            "thinner layers, a smaller bone or a thicker finger",
            bone_points[worst],
        )


def depth_below(skin: Skin, points: Array) -> Array:
    """Return the depth of points (n, 3) below the skin in mm, negative outside (error < 0.02)."""
    from scipy.spatial import cKDTree  # takes 0.3 s

    surface, _ = skin.sample(_DEPTH_STEP_MM)
    distance, _ = cKDTree(surface).query(points)
    return np.where(skin.level(points) < 0, distance, -distance)
