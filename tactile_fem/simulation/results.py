"""The results folder: what a scan writes and plots read.

===================  =====================================================================
``study.toml``       the resolved study
``inputs/``          copies of the files that it names, and of its font
``run.json``         versions, mesh, options, ranks, timings, status
``trace.npz``        histories: see `Results.save_trace`
``spikes.csv``       ``receptor,time_s,displacement_mm,population``
``checkpoint.npz``   the state to go on from
``states/``          states that were kept, as ``checkpoint.npz``
``stimulator.npz``   shape of an own body or a part, for pictures
``fields/``          VTU files and ``deformation.pvd``, their index, for ParaView
``figures/``         pictures
``log.txt``          what was said on the way
===================  =====================================================================
"""

from __future__ import annotations

import csv
import json
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response, to_neo
from tactile_fem.runtime.files import atomic_write, write_text
from tactile_fem.simulation.states import choose_state
from tactile_fem.simulation.trace import Trace
from tactile_fem.stimulus.sampled import DistanceGrid
from tactile_fem.study import DEFAULT_NAME, Study
from tactile_fem.study.file import dump_study, load_study
from tactile_fem.study.kept import keep_files, usable, with_files

if TYPE_CHECKING:
    import neo

# Everything this package writes into the folder; nothing else is ever removed.
_OWN = (
    "study.toml",
    "run.json",
    "trace.npz",
    "spikes.csv",
    "checkpoint.npz",
    "stimulator.npz",
    "log.txt",
    "states/state_*.npz",
    "fields/deformation.pvd",
    "fields/deformation_*.vtu",
    "figures/sed.png",
    "figures/raster.png",
    "figures/firing.png",
    "figures/felt_*.png",
    "figures/raster_*.png",
    "figures/firing_*.png",
    "figures/force.png",
    "figures/finger.png",
    "figures/deformation_*.png",
    "vibration/spectrum.*",
    "vibration/modes.npz",
    "vibration/shape_*_Hz.png",
    ".*.part",
    "states/.*.part",
    "fields/.*.part",
    "figures/.*.part",
)
_VECTORS = ("stimulator_mm", "force_N", "moment_Nmm")
_TRACE = ("time_s", "displacement_mm", "depth_mm", "force_N", "receptors_mm", "sed_kPa")


class Spikes(NamedTuple):
    """Spikes of all receptors: one entry per spike, by receptor and time."""

    receptor: NDArray[np.int64]
    time_s: NDArray[np.float64]
    displacement_mm: NDArray[np.float64]
    population: NDArray[np.str_]


class Results:
    """A results folder; use `create` to write a new one and `open` to read one."""

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)

    # --- making and finding ---------------------------------------------------------------

    @classmethod
    def create(cls, folder: Path | str, *, overwrite: bool = False) -> Results:
        """Make the folder ready to be written.

        Parameters
        ----------
        folder
            Created with its parents if needed.
        overwrite
            Remove what an earlier scan left there; other files stay, and `save_study` replaces
            the files that its study named.

        Raises
        ------
        StudyError
            It is a file, is not writable, or is not empty and `overwrite` is false.
        """
        results = cls(folder)
        cls.check(folder, overwrite=overwrite)
        try:
            results.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=results.folder):
                pass
            for pattern in _OWN:
                for path in results.folder.glob(pattern):
                    path.unlink()
            for emptied in (results.fields, results.figures, results.states, results.vibration):
                with suppress(OSError):  # what is not its own stays there
                    emptied.rmdir()
        except OSError as error:
            raise StudyError(
                f"The results folder {folder} is not writable: {error.strerror}."
            ) from None
        return results

    @staticmethod
    def check(folder: Path | str, *, overwrite: bool = False) -> None:
        """Raise what `create` would raise, as far as this is known without writing."""
        path = Path(folder)
        try:
            if path.is_dir():
                if _has_files(path) and not overwrite:
                    raise StudyError(
                        f"The results folder {folder} is not empty: choose another one, or "
                        "overwrite the scan in it."
                    )
            elif path.exists() or path.is_symlink():
                raise StudyError(f"The results folder {folder} is a file: choose another name.")
            parent = path.absolute()
            while not parent.exists():
                parent = parent.parent
            if not parent.is_dir():
                raise StudyError(f"The results folder {folder} cannot be made: {parent} is a file.")
            if not os.access(parent, os.W_OK | os.X_OK):
                raise StudyError(f"The results folder {folder} is not writable.")
        except OSError as error:
            raise StudyError(
                f"The results folder {folder} cannot be used: {error.strerror}."
            ) from None

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

    @classmethod
    def unfinished(cls, folder: Path | str, study: Study) -> bool:
        """Return whether the folder holds an incomplete scan of this study.

        Raises
        ------
        StudyError
            A file that the study names has changed since that scan began.
        """
        results = cls(folder)
        try:
            if results.complete or not results.is_of(study, though_changed=True):
                return False
        except StudyError:
            return False
        results.check_files(study)
        return True

    def check_files(self, study: Study) -> None:
        """Raise StudyError if a file that its study names has changed since the scan began."""
        if not self.is_of(study):
            raise StudyError(
                f"A file that the study names has changed since the scan in {self.folder} began: "
                "bring it back, or choose another folder."
            )

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

    @property
    def fields(self) -> Path:
        """Folder of the field files, made with the first of them."""
        return self.folder / "fields"

    @property
    def figures(self) -> Path:
        """Folder of the pictures, made with the first of them."""
        return self.folder / "figures"

    @property
    def states(self) -> Path:
        """Folder of the states that were kept, made with the first of them."""
        return self.folder / "states"

    @property
    def vibration(self) -> Path:
        """Folder of what `vibrate` finds."""
        return self.folder / "vibration"

    @property
    def log_file(self) -> Path:
        """The log."""
        return self.folder / "log.txt"

    @property
    def checkpoint_file(self) -> Path:
        """The state to go on from."""
        return self.folder / "checkpoint.npz"

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

    def save_trace(self, **arrays: ArrayLike) -> None:
        """Write ``trace.npz``.

        Parameters
        ----------
        **arrays
            ``time_s`` and ``displacement_mm`` (steps; the slide from 0, the indentation at
            negative times), ``stimulator_mm``, ``force_N`` and ``moment_Nmm`` (steps, 3; on the
            finger), ``receptors_mm`` (receptors, 3), ``population`` (receptors,), names,
            ``sed_kPa`` (steps, receptors), and further fields and observers' columns, a row for
            each step.
        """
        trace = {name: np.asarray(array) for name, array in arrays.items()}
        _check_trace(trace)
        self._save_npz("trace.npz", trace)
        self.__dict__.pop("trace", None)

    def save_checkpoint(self, **arrays: ArrayLike) -> None:
        """Write ``checkpoint.npz``."""
        self._save_npz("checkpoint.npz", arrays)

    def save_state(self, number: int, **arrays: ArrayLike) -> None:
        """Write ``states/state_<number>.npz``, which holds what a checkpoint does."""
        self.states.mkdir(exist_ok=True)
        self._save_npz(f"states/state_{number:04d}.npz", arrays)

    def save_stimulator(self, grid: DistanceGrid) -> None:
        """Write ``stimulator.npz``."""
        self._save_npz("stimulator.npz", vars(grid), np.savez_compressed)
        self.__dict__.pop("stimulator", None)

    def save_spikes(self, spikes: Sequence[ArrayLike], trace: Trace) -> None:
        """Write ``spikes.csv``.

        Parameters
        ----------
        spikes
            Spike times in s of each receptor.
        trace
            Gives displacements and populations.
        """
        time, displacement = trace.time_s, trace.displacement_mm
        population = trace.population.tolist()
        with (
            atomic_write(self.folder / "spikes.csv") as part,
            part.open("w", newline="", encoding="utf-8") as stream,
        ):
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(Spikes._fields)
            for receptor, times in enumerate(spikes):
                for t in np.asarray(times, dtype=float):
                    # The paper's slide starts at time 0; before, the displacement stays 0.
                    at = np.interp(t, time, displacement)
                    writer.writerow([receptor, f"{t:.7g}", f"{at:.7g}", population[receptor]])
        self.__dict__.pop("spikes", None)

    def _save_npz(
        self, name: str, values: Mapping[str, ArrayLike], save: Callable[..., None] = np.savez
    ) -> None:
        """Write arrays; what each step writes is not compressed, which takes ten times as long."""
        arrays = {name: np.asarray(value) for name, value in values.items()}
        if any(array.dtype.hasobject for array in arrays.values()):
            raise ValueError(f"{name} takes arrays of numbers and text only")
        with atomic_write(self.folder / name) as part, part.open("wb") as stream:
            save(stream, **arrays)

    # --- reading --------------------------------------------------------------------------

    @cached_property
    def study(self) -> Study:
        """The resolved study; files that are gone or have changed are the copies in the folder."""
        try:
            return load_study(self.folder / "study.toml", saved=True)
        except StudyError as error:
            raise StudyError(f"The study of {self.folder} cannot be used: {error}") from None

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
        """Histories: see `save_trace`; older folders have one population."""
        trace = self._load_npz("trace.npz")
        missing = [name for name in _TRACE if name not in trace]
        try:
            if missing:
                raise ValueError(f"it lacks {', '.join(missing)}")
            _check_trace(trace)
        except ValueError as error:
            path = self.folder / "trace.npz"
            raise StudyError(f"{path} is no trace of a scan: {error}.") from None
        only = np.full(len(trace["receptors_mm"]), DEFAULT_NAME)
        return {"population": only, **trace}

    @cached_property
    def spikes(self) -> Spikes:
        """Spikes of all receptors; none if not saved yet."""
        path = self.folder / "spikes.csv"
        rows: list[list[str]] = []
        try:
            if path.exists():
                with path.open(newline="", encoding="utf-8") as stream:
                    rows = list(csv.reader(stream))[1:]
            values = np.array([row[:3] for row in rows], dtype=float).reshape(len(rows), 3)
        except (OSError, ValueError, csv.Error):
            columns = ",".join(Spikes._fields)
            raise StudyError(f"{path} cannot be read: its columns must be {columns}.") from None
        names = [row[3] if len(row) > 3 else DEFAULT_NAME for row in rows]
        population = np.array(names, dtype=np.str_)
        return Spikes(values[:, 0].astype(int), values[:, 1], values[:, 2], population)

    def receptors_of(self, population: str) -> NDArray[np.intp]:
        """Return the indices of a population's receptors.

        Raises
        ------
        StudyError
            It has none.
        """
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
        population = self.trace["population"].tolist()
        kind_of = {afferents.name: afferents.kind for afferents in self.study.populations}
        start, end = self.trace["time_s"][[0, -1]].tolist()
        time_s = np.clip(self.spikes.time_s, start, end)  # the file's digits round
        each = [np.sort(time_s[self.spikes.receptor == r]) for r in range(len(population))]
        return to_neo(
            Response(each, start, end),
            population=population,
            kind=[kind_of[name] for name in population],
            receptor_mm=list(self.trace["receptors_mm"]),
        )

    @cached_property
    def stimulator(self) -> DistanceGrid | None:
        """The shape of an own body; None where the study states the body."""
        if not (self.folder / "stimulator.npz").exists():
            return None
        saved = self._load_npz("stimulator.npz")
        return DistanceGrid(saved["origin_mm"], float(saved["step_mm"]), saved["gap_mm"])

    def load_checkpoint(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of ``checkpoint.npz``."""
        return self._load_npz("checkpoint.npz")

    def load_state(
        self, at_mm: float | None = None, at_s: float | None = None
    ) -> dict[str, NDArray[Any]]:
        """Return a state that was kept, by its displacement or its time, or else the last one.

        Raises
        ------
        StudyError
            None was kept there, or several, see `tactile_fem.simulation.states.choose_state`.
        """
        if at_mm is None and at_s is None:
            return self.load_checkpoint()
        names = [f"states/{path.name}" for path in sorted(self.states.glob("state_*.npz"))]
        rows = np.array([self._load_npz(name, "rows")["rows"] - 1 for name in names], dtype=int)
        slid_mm, time_s = (self.trace[name][rows] for name in ("displacement_mm", "time_s"))
        try:
            number = choose_state(slid_mm, time_s, at_mm, at_s)
        except StudyError as error:
            raise StudyError(f"{self.folder} {error}") from None
        return self._load_npz(names[number])

    def _load_npz(self, name: str, *only: str) -> dict[str, NDArray[Any]]:
        """Return the arrays of a file, or only some of them."""
        path = self.folder / name
        try:
            with np.load(path, allow_pickle=False) as arrays:
                return {key: arrays[key] for key in only or arrays}
        except FileNotFoundError:
            raise StudyError(f"There is no {path}: it has not been written yet.") from None
        except Exception as error:  # a damaged archive fails in many ways
            raise StudyError(f"{path} cannot be read: {error}.") from None


def _has_files(folder: Path) -> bool:
    """Return whether a folder has files other than hidden ones, also in its subfolders."""
    return any(path.is_file() and not path.name.startswith(".") for path in folder.rglob("*"))


def _check_trace(trace: dict[str, NDArray[Any]]) -> None:
    """Raise ValueError unless all histories have the same steps and receptors."""
    steps = trace["time_s"].shape
    receptors = len(trace.get("receptors_mm", ()))
    if len(steps) != 1:
        raise ValueError(f"time_s has shape {steps}, not (steps,)")
    shapes = {"population": (receptors,), "receptors_mm": (receptors, 3)}
    shapes |= {"sed_kPa": (*steps, receptors)} | {name: (*steps, 3) for name in _VECTORS}
    for name, array in trace.items():
        expected = shapes.get(name, steps)
        if array.shape[: len(expected)] != expected:
            raise ValueError(f"{name} has shape {array.shape}, not {expected}")


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return str(value)
