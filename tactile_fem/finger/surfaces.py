"""The surfaces that a finger is meshed from: what each must offer, and who reads those of files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

from tactile_fem.errors import StudyError
from tactile_fem.finger.plane import Array
from tactile_fem.finger.settings import FingerSettings
from tactile_fem.finger.shape import Capsule
from tactile_fem.finger.simplex import Triangles

if TYPE_CHECKING:
    import shapely
    from matplotlib.figure import Figure


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
