"""Films: the shape of a finger in the frames of a scan or of a vibration, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.finger.joint import Joint
from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.finger.simplex import SOLID, simplex_of
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.annotations import is_soft
from tactile_fem.output.modes import Modes
from tactile_fem.output.quantities import Limits, Quantity, quantity_of
from tactile_fem.path.rotations import matrix, to_body, to_space, vector
from tactile_fem.results.fields import FieldState, read_series
from tactile_fem.results.histories import TIME, at_time, turns_at
from tactile_fem.results.results import Results
from tactile_fem.results.surfaces import columns_of
from tactile_fem.runtime.logs import counted
from tactile_fem.simulation.pose import Pose, turned_with_bone

Array = NDArray[np.floating]

# Frames from one saved state to the next, and in a period of a vibration.
FRAMES_PER_STATE, FRAMES_PER_PERIOD = 4, 24
# Largest amplitude of a vibration as drawn.
_LARGEST_AMPLITUDE_MM = 0.6
_ROUNDING_S, _LEAST_DEG = 1e-9, 0.05


@dataclass(frozen=True)
class Film:
    """Frames of a finger: displacement and colours of each are weighted sums of a few fields.

    The undeformed `mesh` has no facets; its cells are linear tetrahedra, or quadratic triangles.
    Displacements `moved_mm` (fields, n, 3) and the `values` that colours show, of cells (fields, m)
    or of nodes (fields, n), are combined by `weights` (frames, fields). The body is at
    `stimulator_mm` (frames, 3), seen from the bone, with the rotation vectors `stimulator_rad`
    (frames, 3) if it turns. Frames are sorted by `along` (frames,), with the name and unit `label`:
    those of a scan by their time, at which it has slid by `slid_mm` (frames,). They have `titles`.
    `shown` is what the values are, `limits` are the ends of their colours in all frames, and
    `strongest` is the number of the frame with the largest values. Receptors have deformed places
    (frames, r, 3) and may have `fired` since the frame before (frames, r), and the names of their
    `population` (r,).
    """

    mesh: FingerMesh
    moved_mm: Array
    values: Array
    weights: Array
    stimulator_mm: Array
    along: Array
    titles: list[str]
    label: str = ""
    shown: Quantity | None = None
    limits: Limits = (0.0, 1.0)
    strongest: int = 0
    receptors_mm: Array | None = None
    fired: NDArray[np.bool_] | None = None
    population: NDArray[np.str_] | None = None
    slid_mm: Array | None = None
    stimulator_rad: Array | None = None

    def __len__(self) -> int:
        return len(self.weights)

    def nearest(self, value: float) -> int:
        """Return the number of the frame nearest to a value of `along`."""
        return int(np.argmin(np.abs(self.along - value)))

    def nearest_mm(self, slid_mm: float) -> int:
        """Return the number of the frame of a scan nearest to a displacement.

        It stays 0 during the press: the frame at 0 is that at the end of the press.
        """
        assert self.slid_mm is not None
        apart = np.abs(self.slid_mm - slid_mm) + np.where(self.along < -_ROUNDING_S, np.inf, 0.0)
        return int(np.argmin(apart))

    def turn_rad(self, k: int) -> Array | None:
        """Return the rotation vector of the body in frame `k`, (3,); None if it does not turn."""
        return None if self.stimulator_rad is None else self.stimulator_rad[k]

    def in_space(self, points_mm: Array, k: int) -> Array:
        """Return where points (n, 3) of the body's frame are in space in frame `k`."""
        return to_space(points_mm, self.stimulator_mm[k], self.turn_rad(k))

    def in_body(self, points_mm: Array, k: int) -> Array:
        """Return where points (n, 3) of space are in the body's frame in frame `k`."""
        return to_body(points_mm, self.stimulator_mm[k], self.turn_rad(k))

    @classmethod
    def at_rest(
        cls,
        finger: FingerMesh,
        place_mm: ArrayLike = (0.0, 0.0, 0.0),
        turn_rad: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Film:
        """Return a single frame: the undeformed finger, and the body at a place, turned (3,)."""
        mesh, used = _drawn_mesh(finger.nodes, finger.cells, finger.tissue)
        still, place = np.zeros((1, len(used), 3)), np.reshape(place_mm, (1, 3))
        turn = np.reshape(turn_rad, (1, 3)) if np.any(turn_rad) else None
        one, at = np.ones((1, 1)), np.zeros(1)
        return cls(mesh, still, still[..., 0], one, place, at, [""], stimulator_rad=turn)

    @classmethod
    def of_scan(cls, results: Results, show: str = "sed") -> Film:
        """Return the saved states of a scan, and frames between them that are linear in time.

        They show a quantity by its name, see `tactile_fem.output.quantities`. Field files that are
        missing or cannot be read and an unknown quantity raise StudyError.
        """
        written_s, files = read_series(results.fields)
        if not files:
            raise StudyError(f"There are no field files in {results.fields}: nothing to view.")
        first, trace = FieldState.read(files[0]), results.trace
        mesh, used = _drawn_mesh(first.nodes, first.cells, first.tissue)
        shown = quantity_of(show, columns_of(first), f"the fields in {results.fields}")
        on_nodes = shown.column in first.of_nodes
        fields = []
        for state in map(FieldState.read, counted(files, "saved states to read")):
            values = shown.of(columns_of(state, shown.column)[shown.column])
            values = values[used] if on_nodes else values
            fields.append((state.of_nodes["displacement_mm"][used], values))
        moved, values = (np.array(arrays) for arrays in zip(*fields, strict=True))
        states = np.arange(len(files))
        per_state = 1 if shown.categories else FRAMES_PER_STATE  # there is nothing between them
        frames = np.arange(per_state * states[-1] + 1) / per_state
        weights = np.array([np.interp(frames, states, one) for one in np.eye(len(files))]).T
        times = weights @ written_s
        soft = values if on_nodes else values[:, is_soft(mesh.tissue)]
        sizes = [np.abs(shown.limits(one[None])).max() for one in soft]
        if shown.is_on_skin:
            sizes = np.abs(soft).mean(axis=1)
        places, turns = at_time(trace, "stimulator_mm", times).T, turns_at(trace, times)
        if joint := results.study.joint:
            angles = at_time(trace, "bone_rad", times)
            places, turns = _seen_from_bone(joint, places, turns, angles)
        return cls(
            mesh,
            moved,
            values,
            weights,
            stimulator_mm=places,
            along=times,
            titles=titles_of(trace, times),
            label=TIME,
            shown=shown,
            limits=shown.limits(soft),
            strongest=per_state * int(np.argmax(sizes)),
            receptors_mm=trace["receptors_mm"]
            + np.moveaxis(at_time(trace, "moved_mm", times), -1, 0),
            fired=_fired(results, times),
            population=trace["population"],
            slid_mm=at_time(trace, "displacement_mm", times),
            stimulator_rad=turns,
        )

    @classmethod
    def of_vibration(cls, modes: Modes, k: int, amplitude_mm: float) -> Film:
        """Return a period at the k-th frequency, displacements drawn larger than they are.

        Colours show the amplitude of the displacement, ``sqrt(sum_i |u_i|^2)``, per amplitude of
        the body or bone that vibrates; it is the same in all frames.
        """
        mesh, used = _drawn_mesh(modes.nodes_mm, modes.tets, modes.tissue)
        moved = modes.moved[k, used]
        amplitude = np.linalg.norm(moved, axis=1)
        top = max(float(amplitude[mesh.cells[is_soft(mesh.tissue)]].max()), 1e-6)
        factor = float(f"{_LARGEST_AMPLITUDE_MM / (amplitude_mm * top):.1g}")
        phase = np.arange(FRAMES_PER_PERIOD) * 360 / FRAMES_PER_PERIOD
        swing = factor * amplitude_mm * np.exp(1j * np.radians(phase))
        title = (
            f"{modes.frequency_Hz[k]:g} Hz, {1000 * amplitude_mm:g} µm, "
            f"drawn {factor:g} times larger, at "
        )
        largest = modes.largest_phase(k) / (2 * np.pi) * FRAMES_PER_PERIOD
        return cls(
            mesh,
            moved_mm=np.array([modes.still_mm[used], moved.real, moved.imag]),
            values=np.array([amplitude, 0 * amplitude, 0 * amplitude]),
            weights=np.column_stack([np.ones(len(phase)), swing.real, -swing.imag]),
            stimulator_mm=modes.stimulator_mm + np.outer(swing, modes.body).real,
            stimulator_rad=np.tile(modes.stimulator_rad, (len(phase), 1)),
            along=phase,
            titles=[f"{title}{angle:.0f}°" for angle in phase],
            label="Phase (°)",
            shown=Quantity("Amplitude (mm/mm)", "moved"),
            limits=(0.0, top),
            strongest=round(largest) % FRAMES_PER_PERIOD,
        )


def _seen_from_bone(
    joint: Joint, places_mm: Array, turns_rad: Array | None, angles_rad: Array
) -> tuple[Array, Array]:
    """Return places and turns (n, 3) of a body as seen from the bone at angles (n,)."""
    own = matrix(np.zeros_like(places_mm) if turns_rad is None else turns_rad)
    seen = [
        turned_with_bone(Pose(*pose), joint, -angle)
        for *pose, angle in zip(places_mm, own, angles_rad, strict=True)
    ]
    return np.array([pose.translation for pose in seen]), np.array(
        [vector(pose.rotation) for pose in seen]
    )


def _drawn_mesh(
    nodes: Array, cells: NDArray[np.integer], tissue: NDArray[np.integer]
) -> tuple[FingerMesh, NDArray[np.integer]]:
    """Return the mesh that is drawn, and which nodes it has.

    VTK cuts linear tetrahedra cleanly, quadratic ones not; triangles keep their mid-nodes.
    """
    if simplex_of(cells) is SOLID:
        cells = cells[:, :4]
    used, numbers = np.unique(cells, return_inverse=True)
    facets = np.empty((0, 0), dtype=np.int64), np.empty(0, dtype=np.int64)
    points = nodes[used].astype(float)
    return FingerMesh(points, numbers.reshape(cells.shape), tissue, *facets), used


def titles_of(trace: Mapping[str, NDArray[Any]], at_s: ArrayLike) -> list[str]:
    """Return the titles of frames: phase, time, displacement where there is any, and depth."""
    over, times_s = Abscissa.of(trace), np.asarray(at_s)
    slid, deep = (at_time(trace, name, times_s) for name in ("displacement_mm", "depth_mm"))
    turns = turns_at(trace, times_s)
    angles = 0 * times_s if turns is None else np.degrees(np.linalg.norm(turns, axis=1))
    titles = []
    for time, slid_mm, deep_mm, angle in zip(times_s, slid, deep, angles, strict=True):
        at = over.per_s * (time - _ROUNDING_S)
        phases = [phase for phase in over.phases if phase.end >= at] or over.phases[-1:]
        name = f"{phases[0].name.capitalize()}, " if phases else ""
        across = f"displacement {slid_mm:.2f} mm, " if np.ptp(trace["displacement_mm"]) else ""
        turned = f", turned {angle:.1f}°" if angle >= _LEAST_DEG else ""
        titles.append(f"{name}{time:.3f} s: {across}depth {deep_mm:.2f} mm{turned}")
    return titles


def _fired(results: Results, times_s: Array) -> NDArray[np.bool_]:
    """Return which receptors have fired since the frame before, (frames, r)."""
    spikes = results.spikes
    fired = np.zeros((len(times_s), len(results.trace["receptors_mm"])), dtype=bool)
    start = 2 * times_s[0] - times_s[1] if len(times_s) > 1 else -np.inf
    shown = (spikes.time_s > start) & (spikes.time_s <= times_s[-1])
    fired[np.searchsorted(times_s, spikes.time_s[shown]), spikes.receptor[shown]] = True
    return fired
