"""Keeps responses: CSV and NPZ files, and the objects of neo."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.neuron.response import Response
from tactile_fem.runtime.files import atomic_write, write_text

if TYPE_CHECKING:
    import neo


def save(response: Response, path: Path | str) -> None:
    """Write a response: all of it as ``.npz``, or its spikes as ``.csv``.

    The columns of a CSV file are ``receptor,time_s``; it has a row per spike, with all digits.

    Raises
    ------
    StudyError
        Another ending.
    """
    path = Path(path)
    receptor, time = response.events()
    match path.suffix:
        case ".npz":
            covered = np.array([response.start_s, response.end_s])
            with atomic_write(path) as part, part.open("wb") as stream:
                count = len(response.spikes)
                arrays = {"receptor": receptor, "time_s": time, "covered_s": covered}
                np.savez_compressed(stream, receptors=count, **arrays)
        case ".csv":
            rows = zip(receptor.tolist(), time.tolist(), strict=True)
            write_text(path, "\n".join(["receptor,time_s", *(f"{k},{t}" for k, t in rows), ""]))
        case other:
            raise StudyError(f'A response is kept as .npz or .csv, not "{other}".')


def load(path: Path | str) -> Response:
    """Return the response that `save` wrote as ``.npz``.

    Raises
    ------
    StudyError
        The file is not one of them.
    """
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
    count = len(response.spikes)
    for name, values in annotations.items():
        if len(values) != count:
            raise StudyError(f"{name} has {len(values)} values; it needs {count}, one a receptor.")
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
