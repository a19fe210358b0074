"""Spikes of all receptors: what is counted from them, files, the objects of neo, and NWB."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.runtime.files import atomic_write, write_text
from tactile_fem.runtime.version import this_version

if TYPE_CHECKING:
    import neo

Array = NDArray[Any]

# A simulation has no date, which NWB needs.
_NO_DATE = datetime(1970, 1, 1, tzinfo=UTC)


class Bundle(NamedTuple):
    """Spikes that follow one another closely: first and last, number, intervals over duration."""

    start_s: float
    end_s: float
    spikes: int
    rate_Hz: float


@dataclass(frozen=True)
class Response:
    """Spikes per receptor.

    Attributes
    ----------
    spikes
        Increasing times of the spikes, s, an array per receptor.
    start_s, end_s
        What the history covered.
    """

    spikes: list[Array]
    start_s: float
    end_s: float

    def of(self, which: ArrayLike) -> Response:
        """Return the response of some receptors, given by indices or a mask."""
        chosen = np.arange(len(self.spikes))[np.asarray(which)].tolist()
        return Response([self.spikes[k] for k in chosen], self.start_s, self.end_s)

    def counts(self) -> NDArray[np.int64]:
        """Return the number of spikes, (receptors,)."""
        return np.array([len(times) for times in self.spikes], dtype=np.int64)

    def events(self) -> tuple[NDArray[np.int64], Array]:
        """Return the receptor and the time, s, of every spike, by receptor: (spikes,) each."""
        counts = self.counts()
        times = np.concatenate([np.empty(0), *self.spikes])
        return np.repeat(np.arange(len(counts)), counts), times

    def latency(self, onset_s: float | None = None) -> Array:
        """Return the time from the onset to the first spike, s, (receptors,); nan without one.

        Spikes before the onset do not count; its default is the start.
        """
        onset = self.start_s if onset_s is None else onset_s
        late = (times[times >= onset] for times in self.spikes)
        return np.array([times[0] - onset if len(times) else np.nan for times in late])

    def intervals(self) -> list[Array]:
        """Return the intervals between spikes, s, an array per receptor."""
        return [np.diff(times) for times in self.spikes]

    def bundles(self, gap_s: float, least: int = 3) -> list[list[Bundle]]:
        """Return the bundles of each receptor: at least so many spikes, no longer gap in them."""
        found: list[list[Bundle]] = []
        for times in self.spikes:
            runs = np.split(times, np.flatnonzero(np.diff(times) > gap_s) + 1)
            found.append([_bundle(run.tolist()) for run in runs if len(run) >= max(least, 2)])
        return found

    def peak_rate(self, intervals: int = 3) -> Array:
        """Return the largest rate over so many successive intervals, spikes/s, (receptors,)."""
        lengths = (times[intervals:] - times[:-intervals] for times in self.spikes)
        return intervals / np.array([np.min(each, initial=np.inf) for each in lengths])

    def mean_rate(self, start_s: float, end_s: float) -> Array:
        """Return the number of spikes in [start, end) over its length, spikes/s, (receptors,)."""
        length = _positive("end_s - start_s", end_s - start_s)
        inside = [np.searchsorted(times, (start_s, end_s)) for times in self.spikes]
        return np.array([last - first for first, last in inside], dtype=float) / length

    def rate(self, times_s: ArrayLike, window_s: float) -> Array:
        """Return firing rates at some times, s, (times,), spikes/s, (times, receptors).

        They are smoothed by a Gaussian with the standard deviation `window_s`, s.
        """
        at, width = np.asarray(times_s, dtype=float), _positive("window_s", window_s)
        rates = np.zeros((len(at), len(self.spikes)))
        for k, times in enumerate(self.spikes):
            rates[:, k] = np.exp(-0.5 * ((at[:, None] - times) / width) ** 2).sum(axis=1)
        return rates / (width * np.sqrt(2 * np.pi))

    def psth(self, bin_s: float) -> tuple[Array, NDArray[np.int64]]:
        """Return edges, s, (bins + 1,), and counts, (bins, receptors), in bins of equal length.

        The first bin begins at the start; the last one may reach beyond the end.
        """
        width = _positive("bin_s", bin_s)
        bins = max(1, int(np.ceil((self.end_s - self.start_s) / width - 1e-9)))
        counts = np.zeros((bins, len(self.spikes)), dtype=np.int64)
        for k, times in enumerate(self.spikes):
            index = np.floor((times - self.start_s) / width).astype(np.int64)
            counts[:, k] = np.bincount(np.clip(index, 0, bins - 1), minlength=bins)
        return self.start_s + width * np.arange(bins + 1), counts


def _bundle(times: list[float]) -> Bundle:
    start, end, count = times[0], times[-1], len(times)
    return Bundle(start, end, count, (count - 1) / (end - start))


def _positive(name: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0):
        raise StudyError(f"{name} is {value}; it must be positive.")
    return float(value)


def save(response: Response, path: Path | str) -> None:
    """Write a response: all of it as ``.npz``, or its spikes as ``.csv``.

    A CSV file has the columns ``receptor,time_s`` and a row per spike, with all digits. Raises
    StudyError for another ending.
    """
    path = Path(path)
    receptor, time = response.events()
    match path.suffix:
        case ".npz":
            covered = np.array([response.start_s, response.end_s])
            with atomic_write(path) as part, part.open("wb") as stream:
                count = len(response.spikes)
                np.savez_compressed(
                    stream, receptors=count, receptor=receptor, time_s=time, covered_s=covered
                )
        case ".csv":
            rows = zip(receptor.tolist(), time.tolist(), strict=True)
            write_text(path, "\n".join(["receptor,time_s", *(f"{k},{t}" for k, t in rows), ""]))
        case other:
            raise StudyError(f'A response is kept as .npz or .csv, not "{other}".')


def load(path: Path | str) -> Response:
    """Return the response that `save` wrote as ``.npz``; StudyError for any other file."""
    try:
        with np.load(path, allow_pickle=False) as kept:
            receptor, time, covered = kept["receptor"], kept["time_s"], kept["covered_s"]
            count = int(kept["receptors"])
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise StudyError(f"{path} holds no response: {error}.") from None
    spikes = [time[receptor == number] for number in range(count)]
    return Response(spikes, *covered.tolist())


def to_neo(response: Response, **annotations: Sequence[Any]) -> neo.Segment:
    """Return a neo segment with a spike train per receptor.

    Parameters
    ----------
    response
        The spikes.
    annotations
        Of the spike trains: by name a value for each receptor, as in ``kind=["SA1", "RA"]``.

    Raises
    ------
    StudyError
        neo is not installed, or there are not as many values as receptors.
    """
    _check_columns(response, annotations)
    try:
        import neo
    except ImportError:
        raise StudyError('neo is not installed: pip install "tactile-fem[neo]".') from None
    segment = neo.Segment(name="afferents")
    for number, times in enumerate(response.spikes):
        limits = {"t_start": response.start_s, "t_stop": response.end_s}
        own = {name: values[number] for name, values in annotations.items()}
        train = neo.SpikeTrain(times, units="s", name=str(number), **limits, **own)
        segment.spiketrains.append(train)
    return segment


def to_nwb(response: Response, path: Path | str, **columns: Sequence[Any]) -> None:
    """Write an NWB file, whose table of units has a row per receptor and no electrodes.

    Time 0 of the response is the ``timestamps_reference_time`` of the file, and what the response
    covers the ``obs_intervals`` of each unit. The table has further `columns` as in `to_neo`.

    Raises StudyError if pynwb is not installed, the path does not end in ``.nwb``, or as `to_neo`.
    """
    _check_columns(response, columns)
    if Path(path).suffix != ".nwb":
        raise StudyError(f"{path}: the name of an NWB file ends in .nwb.")
    try:
        import h5py
        from pynwb import NWBHDF5IO, NWBFile
    except ImportError:
        raise StudyError('pynwb is not installed: pip install "tactile-fem[nwb]".') from None
    file = NWBFile(
        session_description="simulated tactile afferents (tactile-fem)",
        identifier=Path(path).stem,
        session_start_time=_NO_DATE,
        was_generated_by=[("tactile-fem", this_version())],
        timestamps_reference_time=_NO_DATE - timedelta(seconds=response.start_s),
    )
    for name in columns:
        file.add_unit_column(name, f"{name.replace('_', ' ')} of the receptor")
    for number, times in enumerate(response.spikes):
        own = {name: values[number] for name, values in columns.items()}
        file.add_unit(spike_times=times, obs_intervals=[[response.start_s, response.end_s]], **own)
    with atomic_write(Path(path)) as part, h5py.File(part, "w") as opened:
        NWBHDF5IO(file=opened, mode="w").write(file)


def _check_columns(response: Response, columns: Mapping[str, Sequence[Any]]) -> None:
    count = len(response.spikes)
    for name, values in columns.items():
        if len(values) != count:
            raise StudyError(f"{name} has {len(values)} values; it needs {count}, one a receptor.")
