"""Field files, also for ParaView: one VTU for each kept state, and a series that lists them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.simplex import Indices, simplex_of
from tactile_fem.runtime.files import atomic_write, write_text

SERIES = "deformation.pvd"
# Components of a symmetric tensor in the order of VTK.
TENSOR = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FieldState:
    """A finger and its fields in one kept state.

    Attributes
    ----------
    nodes
        Undeformed, (n, 3) in mm.
    cells
        Nodes of each tetrahedron (m, 10), of a section of each triangle (m, 6), in gmsh's order.
    tissue
        Tags of the tissues, (m,).
    of_nodes, of_cells
        Fields by name and unit, (n,) or (m,) and components.
    """

    nodes: Array
    cells: Indices
    tissue: Indices
    of_nodes: Mapping[str, Array]
    of_cells: Mapping[str, Array]

    @classmethod
    def read(cls, path: Path) -> FieldState:
        """Return a saved state; StudyError if the file cannot be read or is not that of a scan."""
        import meshio  # takes a while

        try:
            mesh = meshio.vtu.read(path)
            of_cells = {name: arrays[0] for name, arrays in mesh.cell_data.items()}
            tissue, cells = of_cells.pop("tissue"), mesh.cells[0].data
            if "displacement_mm" in mesh.point_data and "sed_kPa" in of_cells:
                order = np.argsort(simplex_of(cells).vtk_order)
                return cls(mesh.points, cells[:, order], tissue, mesh.point_data, of_cells)
        except Exception:  # a damaged file fails in many ways
            pass
        raise StudyError(f"{path} cannot be read as a field file of a scan.")


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

    def write(
        self, time_s: float, of_nodes: Mapping[str, ArrayLike], of_cells: Mapping[str, ArrayLike]
    ) -> Path:
        """Write one state and add it to the series.

        Fields of the nodes are (n,) or (n, components), such as ``displacement_mm`` (n, 3), those
        of the cells (m,) or (m, components), such as ``sed_kPa``; the time is that of the trace.
        """
        import meshio  # takes a while

        path = self.folder / _name(len(self._times_s))
        mesh = meshio.Mesh(
            self.nodes,
            [(self._shape.meshio, self.cells)],
            point_data={name: _stored(field) for name, field in of_nodes.items()},
            cell_data={
                **{name: [_stored(field)] for name, field in of_cells.items()},
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


def _stored(field: ArrayLike) -> NDArray[np.generic]:
    """Return a field as it is written: numbers with seven digits, whole ones as they are."""
    values = np.asarray(field)
    return values.astype(np.float32) if values.dtype.kind == "f" else values.astype(np.int8)


def _name(number: int) -> str:
    return f"deformation_{number:04d}.vtu"


def read_series(folder: Path) -> tuple[NDArray[np.float64], list[Path]]:
    """Return times in s and files of the saved states, both empty if there are none.

    StudyError if the series cannot be read.
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
