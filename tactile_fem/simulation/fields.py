"""Field files for ParaView: one VTU per output and a time series that lists them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import meshio
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.simplex import simplex_of
from tactile_fem.runtime.files import atomic_write, write_text

SERIES = "deformation.pvd"


class FieldWriter:
    """Writes the deformed finger, one file per state: ``deformation_0000.vtu`` ... and their index.

    The folder is created when needed. Nodes are undeformed, (n, 3) in mm; cells are the nodes of
    each tetrahedron, (m, 10), or of each triangle of a section, (m, 6), in gmsh's order; the
    tissues are tags, (m,).
    """

    def __init__(self, folder: Path, nodes: ArrayLike, cells: ArrayLike, tissue: ArrayLike) -> None:
        self.folder = folder
        self.nodes = np.asarray(nodes, dtype=np.float32)
        self._shape = shape = simplex_of(np.asarray(cells))
        self.cells = np.asarray(cells)[:, shape.vtk_order]
        self.tissue = np.asarray(tissue, dtype=np.int32)
        self._times_s: list[float] = []

    def write(self, time_s: float, displacement_mm: ArrayLike, sed_kPa: ArrayLike) -> Path:
        """Write one state and add it to the series.

        Displacements are those of the nodes, (n, 3), densities those of the cells, (m,); the time
        is that of the trace.
        """
        path = self.folder / _name(len(self._times_s))
        mesh = meshio.Mesh(
            self.nodes,
            [(self._shape.meshio, self.cells)],
            point_data={"displacement_mm": np.asarray(displacement_mm, dtype=np.float32)},
            cell_data={
                "sed_kPa": [np.asarray(sed_kPa, dtype=np.float32)],
                "tissue": [self.tissue],
            },
        )
        self.folder.mkdir(exist_ok=True)
        with atomic_write(path) as part:
            meshio.write(part, mesh, file_format="vtu")
        self.set_times([*self._times_s, time_s])
        return path

    def set_times(self, times_s: ArrayLike) -> None:
        """Let the series be that of the folder's first states, at these times.

        They are counted from the end of the indentation, which moves on with its steps.
        """
        self._times_s = np.asarray(times_s, dtype=float).tolist()
        if not self._times_s:
            return
        root = ET.Element("VTKFile", type="Collection", version="0.1")
        collection = ET.SubElement(root, "Collection")
        for number, time in enumerate(self._times_s):
            entry = {"timestep": repr(time), "part": "0", "file": _name(number)}
            ET.SubElement(collection, "DataSet", entry)
        ET.indent(root)
        text = '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
        write_text(self.folder / SERIES, text)


def _name(number: int) -> str:
    return f"deformation_{number:04d}.vtu"


def read_series(folder: Path) -> tuple[NDArray[np.float64], list[Path]]:
    """Return times in s and files of the saved states; both empty if there are none.

    Raises
    ------
    StudyError
        The series cannot be read.
    """
    path = folder / SERIES
    if not path.exists():
        return np.empty(0), []
    try:
        entries = list(ET.parse(path).iter("DataSet"))
        times = np.array([float(entry.get("timestep", "nan")) for entry in entries])
    except (OSError, ET.ParseError, ValueError) as error:
        raise StudyError(f"{path} cannot be read: {error}.") from None
    return times, [folder / str(entry.get("file")) for entry in entries]
