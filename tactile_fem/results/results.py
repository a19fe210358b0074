"""The results folder: what a scan writes and plots read.

Its files are listed in `demos/pages/reference/results.md`.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response, to_neo, to_nwb
from tactile_fem.results.columns import SPIKES
from tactile_fem.results.fields import FieldState, read_series
from tactile_fem.results.histories import choose_state
from tactile_fem.results.store import Store
from tactile_fem.results.surfaces import SurfaceFields, interface_of, skin_of
from tactile_fem.results.trace import Trace
from tactile_fem.runtime import html
from tactile_fem.runtime.files import atomic_write, write_arrays, write_text
from tactile_fem.runtime.text import read_rows
from tactile_fem.runtime.version import why_unreadable
from tactile_fem.stimulus.sampled import DistanceGrid
from tactile_fem.study import DEFAULT_NAME, Study
from tactile_fem.study.file import dump_study, load_study
from tactile_fem.study.input_copies import keep_files, usable, with_files

if TYPE_CHECKING:
    import neo

_PLACE = ("time_s", "displacement_mm")


class Spikes(NamedTuple):
    """Spikes of all receptors: one entry per spike, by receptor and time."""

    receptor: NDArray[np.int64]
    time_s: NDArray[np.float64]
    displacement_mm: NDArray[np.float64]
    population: NDArray[np.str_]


class Results(Store):
    """A results folder; use `create` to write a new one and `open` to read one.

    Attributes
    ----------
    folder
        All of it.
    fields, figures, states, vibration
        Subfolders, each made with the first file in it.
    log_file, checkpoint_file
        The log, and the state to go on from.
    """

    def __init__(self, folder: Path | str) -> None:
        super().__init__(folder)
        folder = self.folder
        self.fields, self.figures = folder / "fields", folder / "figures"
        self.states, self.vibration = folder / "states", folder / "vibration"
        self.log_file, self.checkpoint_file = folder / "log.txt", folder / "checkpoint.npz"

    # --- making and finding ---------------------------------------------------------------

    @classmethod
    def open(cls, folder: Path | str) -> Results:
        """Return the results of a scan, to read.

        Raises
        ------
        StudyError
            There is no such folder or no scan in it.
        """
        results = cls(folder)
        if not (results.folder / "study.toml").is_file():
            raise StudyError(f"{folder} holds no results: there is no study.toml in it.")
        return results

    def is_of(self, study: Study, *, though_changed: bool = False) -> bool:
        """Return whether this is the scan of a study.

        Files that are gone count as the same; those that have changed only with `though_changed`.
        """
        folder = self.folder
        same = with_files(study, lambda file: usable(file, folder, though_changed=though_changed))
        return self.study == same

    @property
    def complete(self) -> bool:
        """Whether the scan is complete."""
        return bool(self.run.get("status") == "complete")

    def __repr__(self) -> str:
        """Return how to open it again."""
        return f"Results.open({str(self.folder)!r})"

    def _repr_html_(self) -> str:
        """Show numbers and rasters in a notebook."""
        return html.shown_results(self)

    # --- writing --------------------------------------------------------------------------

    def save_study(self, study: Study) -> None:
        """Write ``study.toml``, and copy the files that it names."""
        text = dump_study(study)
        write_text(self.folder / "study.toml", text)
        keep_files(study, self.folder, afresh=True)
        self.__dict__.pop("study", None)

    def save_run(self, run: Mapping[str, Any]) -> None:
        """Write ``run.json``; NumPy's scalars and arrays and paths are taken as well."""
        text = json.dumps(run, indent=2, default=_plain, allow_nan=True)
        write_text(self.folder / "run.json", text + "\n")
        self.__dict__.pop("run", None)

    def save_checkpoint(self, **arrays: ArrayLike) -> None:
        """Write ``checkpoint.npz``."""
        write_arrays(self.checkpoint_file, arrays)

    def save_state(self, number: int, **arrays: ArrayLike) -> None:
        """Write ``states/state_<number>.npz``, which holds what a checkpoint does."""
        self.states.mkdir(exist_ok=True)
        write_arrays(self.states / f"state_{number:04d}.npz", arrays)

    def save_stimulator(self, grid: DistanceGrid) -> None:
        """Write ``stimulator.npz``."""
        write_arrays(self.folder / "stimulator.npz", vars(grid), compressed=True)
        self.__dict__.pop("stimulator", None)

    def save_spikes(self, spikes: Sequence[ArrayLike], trace: Trace) -> None:
        """Write ``spikes.csv``: spike times in s of each receptor of a trace."""
        time, displacement = trace.time_s, trace.displacement_mm
        with (
            atomic_write(self.folder / "spikes.csv") as part,
            part.open("w", newline="", encoding="utf-8") as stream,
        ):
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(column.name for column in SPIKES)
            for receptor, times in enumerate(spikes):
                name, moments = trace.population[receptor], np.asarray(times, dtype=float)
                for t, at in zip(moments, np.interp(moments, time, displacement), strict=True):
                    writer.writerow([receptor, f"{t:.7g}", f"{at:.7g}", name])
        self.__dict__.pop("spikes", None)

    # --- reading --------------------------------------------------------------------------

    @cached_property
    def study(self) -> Study:
        """The resolved study; files that are gone or have changed are the copies in the folder."""
        try:
            return load_study(self.folder / "study.toml", saved=True)
        except StudyError as error:
            why = why_unreadable(self._written_by())
            raise StudyError(f"The study of {self.folder} cannot be used: {error}{why}") from None

    def _written_by(self) -> object:
        """Return the version that wrote the folder, if it is known."""
        try:
            return self.run["versions"]["tactile_fem"]
        except (StudyError, KeyError, TypeError):
            return None

    @cached_property
    def run(self) -> dict[str, Any]:
        """Versions, mesh, options, ranks, timings, status; empty if not saved yet."""
        path = self.folder / "run.json"
        if not path.exists():
            return {}
        try:
            return dict(json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError) as error:
            raise StudyError(f"{path} cannot be read: {error}.") from None

    @cached_property
    def trace(self) -> dict[str, NDArray[Any]]:
        """Histories: `tactile_fem.results.columns.TRACE`; older folders have one population.

        Those of a scan that runs or was killed as well.
        """
        return self.load_trace()

    @cached_property
    def spikes(self) -> Spikes:
        """Spikes of all receptors; none if not saved yet."""
        path = self.folder / "spikes.csv"
        rows = [row for _, row in read_rows(path, str(path))[1:]] if path.exists() else []
        try:
            values = np.array([row[:3] for row in rows], dtype=float).reshape(len(rows), 3)
        except ValueError:
            columns = ",".join(Spikes._fields)
            raise StudyError(f"{path} cannot be read: its columns must be {columns}.") from None
        names = [row[3] if len(row) > 3 else DEFAULT_NAME for row in rows]
        population = np.array(names, dtype=np.str_)
        return Spikes(values[:, 0].astype(int), values[:, 1], values[:, 2], population)

    @property
    def response(self) -> Response:
        """Spikes as an array for each receptor, and the first and last time of the trace."""
        spikes, count = self.spikes, len(self.trace["receptors_mm"])
        ends = self.trace["time_s"][[0, -1]].tolist()
        time_s = np.clip(spikes.time_s, *ends)  # which the file's digits may pass
        return Response([np.sort(time_s[spikes.receptor == r]) for r in range(count)], *ends)

    def receptors_of(self, population: str) -> NDArray[np.intp]:
        """Return the indices of a population's receptors; StudyError if it has none."""
        indices = np.flatnonzero(self.trace["population"] == population)
        if not len(indices):
            names = ", ".join(dict.fromkeys(self.trace["population"].tolist()))
            raise StudyError(f"{self.folder} has no afferents {population}, only {names}.")
        return indices

    def to_neo(self) -> neo.Segment:
        """Return a neo segment with a spike train per receptor.

        Trains are annotated with the ``kind`` of afferent, its ``population`` and the undeformed
        place of its receptor, ``receptor_mm`` (3,).

        Raises
        ------
        StudyError
            neo is not installed.
        """
        places = list(self.trace["receptors_mm"])
        return to_neo(self.response, **self._classes(), receptor_mm=places)

    def to_nwb(self, path: Path | str) -> None:
        """Write the spikes to an NWB file with the columns kind, population, x_mm, y_mm and z_mm.

        Raises what `tactile_fem.neuron.to_nwb` raises.
        """
        x, y, z = self.trace["receptors_mm"].T.tolist()
        to_nwb(self.response, path, **self._classes(), x_mm=x, y_mm=y, z_mm=z)

    def _classes(self) -> dict[str, list[str]]:
        """Return population and kind of afferent of each receptor."""
        population = self.trace["population"].tolist()
        kind_of = {afferents.name: afferents.kind for afferents in self.study.populations}
        return {"population": population, "kind": [kind_of[name] for name in population]}

    @cached_property
    def stimulator(self) -> DistanceGrid | None:
        """The shape of an own body; None where the study states the body."""
        if not (self.folder / "stimulator.npz").exists():
            return None
        saved = self.load("stimulator.npz")
        return DistanceGrid(saved["origin_mm"], float(saved["step_mm"]), saved["gap_mm"])

    def load_checkpoint(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of ``checkpoint.npz``."""
        return self.load("checkpoint.npz")

    def load_state(
        self, at_mm: float | None = None, at_s: float | None = None
    ) -> dict[str, NDArray[Any]]:
        """Return a state that was kept, by its displacement or its time, or else the last one.

        Raises
        ------
        StudyError
            None was kept there, or several.
        """
        if at_mm is None and at_s is None:
            return self.load_checkpoint()
        names = [f"states/{path.name}" for path in sorted(self.states.glob("state_*.npz"))]
        rows = np.array([self.load(name, "rows")["rows"] - 1 for name in names], dtype=int)
        return self.load(names[self._number_of(rows, at_mm, at_s)])

    # --- fields -----------------------------------------------------------------------------

    @property
    def kept_rows(self) -> NDArray[np.intp]:
        """Rows of the trace at which the fields were kept, (states,): see `skin`."""
        times_s, rows_s = read_series(self.fields)[0], self.trace["time_s"]
        return np.abs(rows_s - times_s[:, None]).argmin(axis=1)

    def skin(self, at_mm: float | None = None, *, at_s: float | None = None) -> SurfaceFields:
        """Return displacement, contact, stretches, stress and SED on the skin in a kept state.

        Parameters
        ----------
        at_mm
            Displacement of the slide; the nearest kept state is taken.
        at_s
            Time of the state, as in ``trace.npz``: for states in a press or a hold. Without both
            it is the state with the largest normal force.

        Raises
        ------
        StudyError
            No state was kept there, or several with that displacement; or a file is damaged.
        """
        return skin_of(*self._kept(at_mm, at_s))

    def interface(
        self,
        at_mm: float | None = None,
        *,
        at_s: float | None = None,
        side: str = "epidermis",
        other: str | None = None,
    ) -> SurfaceFields:
        """Return displacement, stretches, stress and SED where two tissues meet, in a kept state.

        Stretches, stress and SED jump there: they are those of the tissue `side`. The `other` is
        dermis by default, to the dermis epidermis. For the state and errors see `skin`.
        """
        other = other or ("dermis" if side == "epidermis" else "epidermis")
        return interface_of(*self._kept(at_mm, at_s), side, other)

    def _kept(self, at_mm: float | None, at_s: float | None) -> tuple[FieldState, float, float]:
        """Return a kept state, its time and its displacement."""
        rows, files = self.kept_rows, read_series(self.fields)[1]
        if not files:
            raise StudyError(f"There are no field files in {self.fields}.")
        number = int(np.argmax(self.trace["force_N"][rows, 2]))
        if at_mm is not None or at_s is not None:
            number = self._number_of(rows, at_mm, at_s, self.study.output.states_mm)
        time_s, slid_mm = (float(self.trace[name][rows[number]]) for name in _PLACE)
        return FieldState.read(files[number]), time_s, slid_mm

    def _number_of(
        self, rows: NDArray[np.intp], at_mm: float | None, at_s: float | None, apart_mm: float = 0.0
    ) -> int:
        """Return which of the states that were kept at some rows of the trace is meant."""
        time_s, slid_mm = (self.trace[name][rows] for name in _PLACE)
        try:
            return choose_state(slid_mm, time_s, at_mm, at_s, apart_mm)
        except StudyError as error:
            raise StudyError(f"{self.folder} {error}") from None


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return str(value)
