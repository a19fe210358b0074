"""What a results folder holds when a scan is to be written there."""

from __future__ import annotations

import logging
from itertools import islice
from pathlib import Path
from typing import Literal

from tactile_fem.errors import StudyError
from tactile_fem.neuron import Response
from tactile_fem.results.results import Results
from tactile_fem.results.trace import Trace
from tactile_fem.runtime.differences import brief, differences
from tactile_fem.study import Study

logger = logging.getLogger(__name__)

Earlier = Literal["nothing", "unfinished", "finished"]

_MOST_KEYS = 3
ELSEWHERE = "choose another folder, or overwrite the scan in it"


def earlier_scan(folder: Path | str, study: Study, *, overwrite: bool = False) -> Earlier:
    """Return the state of the study's scan that the folder holds already.

    With `overwrite` it holds nothing that counts. StudyError if it holds the scan of another study
    or other files, cannot be written, or a file of the study has changed since that scan began.
    """
    results = Results(folder)
    there = None if overwrite else _study_of(results)
    if there is None:
        Results.check(folder, overwrite=overwrite)
        return "nothing"
    if not results.is_of(study, though_changed=True):
        raise StudyError(
            f"{folder} holds the scan of another study{_what_differs(study, there)}; {ELSEWHERE}."
        )
    if not results.is_of(study):
        raise StudyError(
            f"A file that the study names has changed since the scan in {folder} began: bring it "
            "back, or choose another folder."
        )
    return "finished" if results.complete else "unfinished"


def _study_of(results: Results) -> Study | None:
    """Return the study of a folder, if it has one that this version can read."""
    try:
        return Results.open(results.folder).study
    except StudyError:
        return None


def _what_differs(here: Study, there: Study) -> str:
    """Return the first keys that differ, and both values."""
    found = list(differences(here, there))
    words = [
        f"{key} is {brief(then, 30)} there and {brief(now, 30)} here"
        for key, now, then in islice(found, _MOST_KEYS)
    ]
    more = [f"{len(found) - _MOST_KEYS} more differ"] if len(found) > _MOST_KEYS else []
    return f": {', '.join([*words, *more])}" if words else ""


def read_finished(results: Results) -> tuple[Trace, Response]:
    """Return histories and spikes of a finished scan."""
    logger.info("%s holds this scan, finished: its results are read", results.folder)
    return Trace.read(results.trace), results.response


def has_checkpoint(results: Results) -> bool:
    """Return whether there is a state to continue from; StudyError if there are steps without."""
    if results.checkpoint_file.is_file():
        return True
    # The first step's row is written before its checkpoint.
    if (results.folder / "trace.npz").is_file() and len(results.trace["time_s"]) > 2:
        raise StudyError(f"{results.folder} has no checkpoint to continue from.")
    return False
