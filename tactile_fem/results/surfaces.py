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
    slips. Sums of pressure or friction times area are forces.

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
        for name, values in self.columns.items():
            if values.ndim == 1:
                found[name] = values
            elif name == "stretches":
                found |= {f"stretches_{k + 1}": column for k, column in enumerate(values.T)}
            else:
                base, unit = name.rsplit("_", 1)
                parts = zip(_COMPONENTS[values.shape[1]], values.T, strict=True)
                found |= {f"{base}_{part}_{unit}": column for part, column in parts}
        return found

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


# --- surfaces of a state -------------------------------------------------------------------------


def skin_of(state: FieldState, time_s: float, at_mm: float) -> SurfaceFields:
    """Return the fields on the skin of a state.

    Raises
    ------
    StudyError
        A scan of an older version wrote it, without contact.
    """
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
    """Return the fields of one tissue where it meets another.

    Raises
    ------
    StudyError
        There is no such tissue, or the two do not meet.
    """
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
    columns = {name: values for name, values in found.columns.items() if name not in ON_SKIN}
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
    """Return the fields at the corners of facets, as the tissues of their owners have them."""
    used, facets = np.unique(corners, return_inverse=True)
    nodes = state.nodes.astype(float)
    own = np.isin(state.tissue, np.unique(state.tissue[owner]))
    around = _Around(state, used, own)
    columns = {
        name: np.asarray(values[used], dtype=float)
        for name, values in state.of_nodes.items()
        if name != "skin"
    }
    deformed = nodes + state.of_nodes["displacement_mm"]
    columns["area_mm2"] = vertex_areas(deformed, corners)[used]
    columns["stretches"] = around.stretches()
    columns |= {name: around.mean(values) for name, values in state.of_cells.items()}
    return SurfaceFields(time_s, at_mm, nodes[used], facets.reshape(corners.shape), columns)


class _Around:
    """Means at nodes over the cells of some tissues that have them as corners, by volume."""

    def __init__(self, state: FieldState, used: Indices, own: NDArray[np.bool_]) -> None:
        self._state = state
        self._finger = finger = FingerMesh(
            state.nodes.astype(float), state.cells, state.tissue, *_NO_FACETS
        )
        shape = finger.simplex
        number = np.full(len(state.nodes), -1)
        number[used] = np.arange(len(used))
        self._count = len(used)
        cells = np.flatnonzero(own)
        at = number[state.cells[cells, : shape.corners]]
        row, self._corner = np.nonzero(at >= 0)
        self._cell, self._at = cells[row], at[row, self._corner]
        nodes = finger.plane.within(finger.nodes)
        self._weight = np.abs(volumes(nodes, state.cells[self._cell]))

    def mean(self, of_cells: Array) -> Array:
        """Return the means (points, ...) of values of all cells, (m, ...)."""
        return self._average(of_cells[self._cell])

    def stretches(self) -> Array:
        """Return the principal stretches of the mean right Cauchy-Green tensor, (points, 3)."""
        finger, within = self._finger, self._finger.plane.within
        cells = self._state.cells[self._cell]
        places = within(finger.nodes)[cells]
        moved = within(self._state.of_nodes["displacement_mm"])[cells].astype(float)
        gradients = np.array([finger.simplex.gradients(w) for w in np.eye(finger.simplex.corners)])
        local = gradients[self._corner]
        J = np.einsum("cni,cnj->cij", places, local)
        F = np.tile(np.eye(3), (len(cells), 1, 1))
        dim = finger.simplex.dim
        F[:, :dim, :dim] += np.einsum("cni,cnj->cij", moved, local) @ np.linalg.inv(J)
        C = self._average(np.swapaxes(F, 1, 2) @ F)
        return np.sqrt(np.linalg.eigvalsh(C))

    def _average(self, values: Array) -> Array:
        sums = np.zeros((self._count, *values.shape[1:]))
        weight = self._weight.reshape(-1, *[1] * (values.ndim - 1))
        np.add.at(sums, self._at, weight * values)
        total = np.bincount(self._at, self._weight, minlength=self._count)
        return sums / total.reshape(-1, *[1] * (values.ndim - 1))
