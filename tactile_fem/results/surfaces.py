"""Fields on the skin and on surfaces between tissues, as arrays, in one kept state of a scan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import TISSUES, FingerMesh
from tactile_fem.finger.simplex import Indices, facets_of, simplex_of, volumes
from tactile_fem.results.contact_fields import ON_SKIN, vertex_areas
from tactile_fem.results.fields import TENSOR, FieldState
from tactile_fem.runtime.files import atomic_write, write_arrays

if TYPE_CHECKING:
    import pyvista as pv

Array = NDArray[np.float64]

ENDINGS = (".csv", ".npz", ".vtu")
_AXES = "xyz"
# What the components of a column are called, by their number; principal values are counted.
_COMPONENTS = {3: tuple(_AXES), 6: tuple(_AXES[i] + _AXES[j] for i, j in TENSOR)}
_NO_FACETS = np.empty((0, 0), dtype=np.int64), np.empty(0, dtype=np.int64)


@dataclass(frozen=True)
class SurfaceFields:
    """Fields at the corners of the facets of a surface, in one kept state.

    Columns are attributes: ``displacement_mm`` (n, 3); ``stretches`` (n, 3), principal ones in
    increasing order; ``sed_kPa`` (n,) and the Cauchy stress ``stress_kPa`` (n, 6), components xx,
    yy, zz, xy, yz, xz, which are means over the cells around a point; ``area_mm2`` (n,), the
    deformed area that belongs to a point, in a section its length. On the skin also
    ``contact_pressure_kPa`` (n,), ``friction_kPa`` (n, 3), the traction on the finger, and
    ``contact`` (n,): 0 without contact, 1 where the skin sticks to the stimulator, 2 where it
    slips. Sums of pressure or friction times area are forces. ``contact_area_mm2`` (n,) is the part
    of ``area_mm2`` that touches; its sum is that of ``trace.npz``, while the area of all points
    with contact reaches half a facet beyond its rim.

    Attributes
    ----------
    time_s, at_mm
        Time and displacement of the state, as in ``trace.npz``.
    points_mm
        Undeformed places, (n, 3).
    facets
        Points of each triangle (k, 3), of a section of each line (k, 2).
    columns
        The fields by name.
    """

    time_s: float
    at_mm: float
    points_mm: Array
    facets: Indices
    columns: Mapping[str, Array]

    def __getattr__(self, name: str) -> Array:
        """Return a column."""
        columns = self.__dict__.get("columns", {})
        if name in columns:
            return columns[name]
        raise AttributeError(f"the surface has no {name}, only {', '.join(columns)}")

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points_mm)

    def to_pyvista(self) -> pv.PolyData:
        """Return the deformed surface with the columns as fields of its points.

        Raises
        ------
        StudyError
            PyVista is not installed.
        """
        try:
            import pyvista as pv
        except ImportError:
            raise StudyError(
                'PyVista is not installed: pip install "tactile-fem[pictures]".'
            ) from None
        sizes = np.full((len(self.facets), 1), self.facets.shape[1])
        kind = "lines" if self.facets.shape[1] == 2 else "faces"
        connections: dict[str, Any] = {kind: np.hstack([sizes, self.facets]).ravel()}
        mesh = pv.PolyData(self.points_mm + self.displacement_mm, **connections)
        for name, values in self.columns.items():
            mesh.point_data[name] = values
        return mesh

    def table(self) -> dict[str, Array]:
        """Return columns of numbers (n,), also the places: ``x_mm``, ``displacement_x_mm``, ...

        Names have the component before the unit: ``stress_xy_kPa``, ``stretches_3``.
        """
        found = dict(zip((f"{axis}_mm" for axis in _AXES), self.points_mm.T, strict=True))
        return found | components(self.columns)

    def save(self, path: Path | str) -> None:
        """Write a table, .csv, NumPy arrays, .npz, or the undeformed surface for ParaView, .vtu.

        Raises
        ------
        StudyError
            The name ends otherwise.
        """
        path = Path(path)
        match path.suffix:
            case ".csv":
                table = self.table()
                values, names = np.column_stack(list(table.values())), ",".join(table)
                with atomic_write(path) as part:
                    np.savetxt(part, values, "%.7g", ",", header=names, comments="")
            case ".npz":
                own = {"time_s": self.time_s, "at_mm": self.at_mm}
                places = {"points_mm": self.points_mm, "facets": self.facets}
                write_arrays(path, {**own, **places, **self.columns})
            case ".vtu":
                cell = "line" if self.facets.shape[1] == 2 else "triangle"
                import meshio  # takes a while

                mesh = meshio.Mesh(self.points_mm, [(cell, self.facets)], dict(self.columns))
                with atomic_write(path) as part:
                    meshio.write(part, mesh, file_format="vtu")
            case _:
                raise StudyError(f"{path} must end in {', '.join(ENDINGS)}.")


def components(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Return columns of numbers (n,), those of vectors and tensors (n, k) split."""
    found = dict[str, Array]()
    for name, values in columns.items():
        if values.ndim == 1:
            found[name] = values
        elif name == "stretches":
            found |= {f"stretches_{k + 1}": column for k, column in enumerate(values.T)}
        else:
            base, unit = name.rsplit("_", 1)
            parts = zip(_COMPONENTS[values.shape[1]], values.T, strict=True)
            found |= {f"{base}_{part}_{unit}": column for part, column in parts}
    return found


# --- surfaces of a state -------------------------------------------------------------------------


def skin_of(state: FieldState, time_s: float, at_mm: float) -> SurfaceFields:
    """Return the fields on the skin of a state; StudyError if an older version wrote no contact."""
    if "skin" not in state.of_nodes:
        raise StudyError(
            "The fields of this scan have no contact pressure, as an older version wrote them: "
            "run it again."
        )
    corners, first, second = facets_of(state.cells)
    on_skin = state.of_nodes["skin"] == 1
    outside = np.flatnonzero((second < 0) & on_skin[corners].all(axis=1))
    # A facet of the nail may have its corners on the border of the skin, but not its middles.
    outside = outside[on_skin[_middles(state, corners[outside])].all(axis=1)]
    return _fields(state, corners[outside], first[outside], time_s, at_mm)


def interface_of(
    state: FieldState, time_s: float, at_mm: float, side: str, other: str
) -> SurfaceFields:
    """Return the fields of one tissue where it meets another; StudyError if it does not."""
    for name in (side, other):
        if name not in TISSUES:
            raise StudyError(f"{name} is no tissue: choose among {', '.join(TISSUES)}.")
    corners, first, second = facets_of(state.cells)
    one, beyond = state.tissue[first], np.where(second < 0, 0, state.tissue[second])
    at_first = (one == TISSUES[side]) & (beyond == TISSUES[other])
    at_second = (one == TISSUES[other]) & (beyond == TISSUES[side])
    chosen = at_first | at_second
    if not chosen.any():
        raise StudyError(f"{side} and {other} do not meet in this finger.")
    owner = np.where(at_first, first, second)[chosen]
    found = _fields(state, corners[chosen], owner, time_s, at_mm)
    skin = *ON_SKIN, "contact_area_mm2"
    columns = {name: values for name, values in found.columns.items() if name not in skin}
    return SurfaceFields(time_s, at_mm, found.points_mm, found.facets, columns)


def _middles(state: FieldState, corners: Indices) -> Indices:
    """Return the nodes in the middles of the edges of facets, (k, edges)."""
    shape, count = simplex_of(state.cells), len(state.nodes)

    def keys(edges: Indices) -> Indices:
        return edges.min(axis=-1) * count + edges.max(axis=-1)

    known, first = np.unique(keys(state.cells[:, shape.edges]).ravel(), return_index=True)
    middles = state.cells[:, shape.corners :].ravel()[first]
    return middles[np.searchsorted(known, keys(corners[:, shape.facet_edges]))]


def _fields(
    state: FieldState, corners: Indices, owner: Indices, time_s: float, at_mm: float
) -> SurfaceFields:
    """Return the fields at the corners of facets, as the tissues of their owners have them.

    Those of cells are means over the cells around a corner, weighted by their volume; stretches are
    those of the mean right Cauchy-Green tensor.
    """
    used, facets = np.unique(corners, return_inverse=True)
    nodes = state.nodes.astype(float)
    finger = FingerMesh(nodes, state.cells, state.tissue, *_NO_FACETS)
    own = np.isin(state.tissue, np.unique(state.tissue[owner]))
    number = np.full(len(nodes), -1)
    number[used] = np.arange(len(used))
    at = number[state.cells[:, : finger.simplex.corners]]
    cell, corner = np.nonzero((at >= 0) & own[:, None])
    at = at[cell, corner]
    volume = np.abs(volumes(finger.plane.within(nodes), state.cells[cell]))

    def mean(values: Array) -> Array:
        """Return the means (points, ...) of values in each cell at each of its corners."""
        sums = np.zeros((len(used), *values.shape[1:]))
        np.add.at(sums, at, (volume * values.T).T)
        return (sums.T / np.bincount(at, volume, minlength=len(used))).T

    moved = state.of_nodes["displacement_mm"]
    columns = {
        name: np.asarray(values[used], dtype=float)
        for name, values in state.of_nodes.items()
        if name != "skin"
    }
    columns["area_mm2"] = vertex_areas(nodes + moved, corners)[used]
    at_corners = np.array([finger.simplex.gradients(at) for at in np.eye(finger.simplex.corners)])
    F = _gradients(finger, moved, cell, at_corners[corner])
    columns["stretches"] = np.sqrt(np.linalg.eigvalsh(mean(np.swapaxes(F, 1, 2) @ F)))
    of_cells = dict(state.of_cells)
    if (touching := of_cells.pop("contact_area_mm2", None)) is not None:
        each = touching[owner] / np.bincount(owner)[owner] / corners.shape[1]
        columns["contact_area_mm2"] = np.bincount(
            facets.ravel(), np.repeat(each, corners.shape[1]), minlength=len(used)
        )
    columns |= {name: mean(values[cell]) for name, values in of_cells.items()}
    return SurfaceFields(time_s, at_mm, nodes[used], facets.reshape(corners.shape), columns)


def columns_of(state: FieldState, column: str = "") -> dict[str, Array]:
    """Return the fields of nodes and cells by name; ``stretches`` (m, 3) are 1 if not asked for."""
    fields, F = {**state.of_nodes, **state.of_cells}, np.tile(np.eye(3), (len(state.cells), 1, 1))
    if column == "stretches":  # in the middles of the cells
        finger = FingerMesh(state.nodes.astype(float), state.cells, state.tissue, *_NO_FACETS)
        middle = np.full(finger.simplex.corners, 1 / finger.simplex.corners)
        moved, every = state.of_nodes["displacement_mm"], np.arange(len(state.cells))
        F = _gradients(finger, moved, every, finger.simplex.gradients(middle))
    others = {name: of for name, of in fields.items() if name not in ("skin", "contact_area_mm2")}
    return {**others, "stretches": np.sqrt(np.linalg.eigvalsh(np.swapaxes(F, 1, 2) @ F))}


def _gradients(finger: FingerMesh, moved: Array, cell: Indices, local: Array) -> Array:
    """Return the deformation gradients (k, 3, 3) of cells (k,), at a point of each.

    `local` (k, nodes, dim) has the gradients of the shape functions there, or (nodes, dim) of all.
    """
    ends = finger.nodes, finger.nodes + moved
    J, j = (np.swapaxes(finger.plane.within(x)[finger.cells[cell]], 1, 2) @ local for x in ends)
    F, dim = np.tile(np.eye(3), (len(cell), 1, 1)), finger.simplex.dim
    F[:, :dim, :dim] = j @ np.linalg.inv(J)
    return F
