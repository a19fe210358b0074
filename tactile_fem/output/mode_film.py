"""Frames of a vibration: the finger cut open along its middle, over one period.

Import it only if `tactile_fem.output.pictures.can_draw` allows it: VTK may crash otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyvista as pv
from numpy.typing import NDArray

from tactile_fem.finger.simplex import SOLID
from tactile_fem.output import drawing
from tactile_fem.output.colours import is_soft
from tactile_fem.output.film import Piece
from tactile_fem.simulation.results import Results
from tactile_fem.vibration.modes import Modes

_FRAMES = 24
_DRAWN_MM = 0.6  # the largest amplitude in a picture
_CUT = {"normal": "x", "origin": (-1e-4, 0.0, 0.0)}
_RIM_SHIFT_MM = (0.03, 0.0, 0.0)


class ModeFilm:
    """Frames of the finger's vibration at one frequency, displacements drawn larger than they are.

    Surfaces are coloured by the displacement's amplitude, ``sqrt(sum_i |u_i|^2)``, per amplitude of
    what vibrates; it is the same in all frames.

    Parameters
    ----------
    results
        The scan.
    modes, k
        Its vibration, and the number of the frequency.
    amplitude_mm
        Of what vibrates.

    Attributes
    ----------
    factor
        How many times larger displacements are drawn.
    strongest
        Number of the frame in which the finger moves most.
    label, along, bar, camera
        See `tactile_fem.output.view.Frames`; frames are sorted by phase, degrees.
    """

    label = "Phase (°)"
    camera = (30.0, -6.0, 18.2), (0.0, 3.0, 4.2), 11.0

    def __init__(self, results: Results, modes: Modes, k: int, amplitude_mm: float) -> None:
        self._frequency_Hz, self._amplitude_mm = float(modes.frequency_Hz[k]), amplitude_mm
        self.along = np.arange(_FRAMES) * 360.0 / _FRAMES
        self._body = modes.body
        self._surface = drawing.stimulator_surface(results).translate(modes.stimulator_mm)
        solid = _solid(modes, k)
        soft = modes.tets[is_soft(modes.tissue), :4]
        felt = solid["amplitude"][np.unique(soft)]
        self._top = max(float(felt.max()), 1e-6)
        self.factor = float(f"{_DRAWN_MM / (amplitude_mm * self._top):.1g}")
        self._cut = list(_cut(solid))
        coloured = next(name for name, _ in self._cut if name.endswith("face"))
        self.bar = coloured, "Amplitude\n(mm/mm)"
        self.strongest = self.nearest(np.degrees(modes.largest_phase(k)) % 360)

    def __len__(self) -> int:
        return _FRAMES

    def nearest(self, value: float) -> int:
        """Return the number of the frame nearest to a phase in degrees."""
        return int(np.argmin(np.abs(self.along - value)))

    def title(self, k: int) -> str:
        """Return what is written over frame `k`."""
        return (
            f"{self._frequency_Hz:g} Hz, {1000 * self._amplitude_mm:g} µm, "
            f"drawn {self.factor:g} times larger, at {self.along[k]:.0f}°"
        )

    @property
    def legend(self) -> dict[str, str]:
        """Colours by what they mean."""
        return {name: drawing.COLOURS[name] for name in drawing.RIGID}

    def pieces(self, k: int) -> Iterator[Piece]:
        """Yield everything to be drawn of frame `k`: a name, a mesh and its style."""
        swing = self.factor * self._amplitude_mm * np.exp(1j * np.radians(self.along[k]))
        colours = {"scalars": "amplitude", "cmap": drawing.SCALE, "clim": (0.0, self._top)}
        for name, part in self._cut:
            tissue, what = name.rsplit(" ", 1)
            rigid = tissue in drawing.RIGID
            style = {"color": drawing.COLOURS[tissue]} if rigid else colours
            moved = part.copy()
            moved.points = part.points + part["still"] + _real(swing, part["real"], part["imag"])
            light = {"lighting": False} if what == "face" else {"ambient": 0.3}
            yield name, moved, {**style, **light}
            if what == "face":
                yield f"{tissue} rim", drawing.rim(moved, _RIM_SHIFT_MM), drawing.RIM_STYLE
        body = self._surface.translate(np.real(swing * self._body))
        yield "stimulator", body, drawing.RELIEF_STYLE


def _solid(modes: Modes, k: int) -> pv.UnstructuredGrid:
    """Return the undeformed tetrahedra with what moves them as point data."""
    cells = {pv.CellType.QUADRATIC_TETRA: modes.tets[:, SOLID.vtk_order]}
    grid = pv.UnstructuredGrid(cells, modes.nodes_mm)
    grid.cell_data["tissue"] = modes.tissue
    solid = drawing.linear(grid, grid.points)
    moved = modes.moved[k]
    solid.point_data["still"] = modes.still_mm
    solid.point_data["real"], solid.point_data["imag"] = moved.real, moved.imag
    solid.point_data["amplitude"] = np.linalg.norm(moved, axis=1)
    return solid


def _cut(solid: pv.UnstructuredGrid) -> Iterator[tuple[str, pv.PolyData]]:
    """Yield for each tissue what is behind the cut and its face on it, undeformed."""
    for name, part in drawing.parts(solid):
        shell = part.extract_surface(algorithm=None).clip(**_CUT)
        if shell.n_points:
            yield f"{name} shell", shell
        face = part.slice(**_CUT)
        if face.n_points:
            yield f"{name} face", face


def _real(
    swing: complex, real: NDArray[np.floating], imag: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Return the real part of a product."""
    return swing.real * real - swing.imag * imag
