"""The plane in which a section of the finger deforms, or space, in which a solid finger does.

Outside the mechanics a section lies in the axes X, Y and Z of the finger as a solid finger does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
AXES = "XYZ"


@dataclass(frozen=True)
class Plane:
    """An upright plane through the contact point, or the whole of space.

    Parameters
    ----------
    axes
        Axes of the finger in it, the upright one last: (1, 2) for Y and Z, (0, 2) for X and Z,
        (0, 1, 2) for space.
    """

    axes: tuple[int, ...]

    @property
    def is_space(self) -> bool:
        """Whether it is all of space."""
        return len(self.axes) == 3

    @property
    def kind(self) -> str:
        """The kind of a finger that deforms in it."""
        return "solid" if self.is_space else "section"

    @property
    def force_unit(self) -> str:
        """Forces of a section are per width."""
        return "N" if self.is_space else "N/mm"

    @property
    def outside(self) -> list[int]:
        """The axes that are not in it."""
        return sorted({0, 1, 2} - {*self.axes})

    @property
    def across(self) -> int:
        """The axis across it."""
        (axis,) = self.outside
        return axis

    @property
    def equation(self) -> str:
        """For example "X = 0"; of a plane only."""
        return f"{AXES[self.across]} = 0"

    def within(self, vectors: ArrayLike) -> Array:
        """Return the components in the plane, (..., 2), of vectors or points (..., 3)."""
        return np.asarray(vectors)[..., list(self.axes)]

    def vectors(self, within: ArrayLike) -> Array:
        """Return vectors or points (..., 3) of the plane from their components in it."""
        own = np.asarray(within)
        found = np.zeros((*own.shape[:-1], 3), dtype=own.dtype)
        found[..., list(self.axes)] = own
        return found

    def rotation(self, in_space: Array) -> Array:
        """Return a rotation (3, 3) about the axis across it as one of the plane, (2, 2)."""
        return in_space[np.ix_(self.axes, self.axes)]

    def rotation_in_space(self, within: Array) -> Array:
        """Return a rotation of the plane, (2, 2), as one of space, (3, 3)."""
        found = np.eye(3)
        found[np.ix_(self.axes, self.axes)] = within
        return found

    def distance_mm(self, points: Array) -> float:
        """Return the largest distance of points (n, 3) from the plane; 0 in space."""
        return float(np.abs(points[:, self.outside]).max(initial=0.0))

    def cuts(self, bounds: Sequence[float]) -> bool:
        """Return whether it cuts a box, given by its least X and Y and its largest X and Y."""
        return self.is_space or bounds[self.across] < 0 < bounds[self.across + 2]

    def moment(self, within: ArrayLike) -> Array:
        """Return a moment as a vector (3,); in a plane (1,) is given, about its third axis.

        About it the first axis of the plane turns counterclockwise into the second.
        """
        if self.is_space:
            return np.asarray(within)
        i, j = self.axes
        found = np.zeros(3)
        found[self.across] = np.asarray(within)[0] * (1 if (j - i) % 3 == 1 else -1)
        return found


SPACE = Plane((0, 1, 2))
# The planes of a section.
PLANES = {"sagittal": Plane((1, 2)), "transverse": Plane((0, 2))}
