"""Makes a fast finger: scans of random bodies, the compliance, the networks."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from tactile_fem import Results
from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime.logs import shown
from tactile_fem.series import Member, Outcome, collected, run_series
from tactile_fem.study import Study
from tactile_fem.surrogate.compliance import pad_of
from tactile_fem.surrogate.fast_finger import FastFinger, check_taught, is_symmetric
from tactile_fem.surrogate.learning import Lesson, errors_of, learn_felt, learn_whole, with_drag
from tactile_fem.surrogate.lessons import DEEPEST_MM, lesson

logger = logging.getLogger(__name__)

# One scan in so many is held out, to state the errors.
_HELD_OUT = 8
LEAST_SCANS = 2 * _HELD_OUT
_REACH_MM = 0.05  # pressed skin beyond the deepest place


@shown()
def reduce_finger(
    study: Study, folder: Path | str, *, scans: int = 100, jobs: int = 1
) -> FastFinger:
    """Return the surrogate of a study's finger, made from scans of random bodies.

    The scans are kept in a folder: started again, with more of them too, it goes on. Stimulus and
    protocol of the study have no effect.

    Parameters
    ----------
    scans
        At least 16; some 100 are needed to reach a few per cent.
    jobs
        Scans side by side.

    Raises
    ------
    StudyError
        Bad input, before anything runs.
    TactileError
        Fewer than 16 scans succeeded, or scikit-learn is missing.
    """
    outcomes = run_series(lessons(study, scans), folder, jobs=jobs)
    return learn(study, _complete(outcomes, Path(folder)))


def collect_finger(study: Study, folder: Path | str, *, scans: int = 100) -> FastFinger:
    """Return the surrogate from scans that have run elsewhere; see `reduce_finger`."""
    return learn(study, _complete(collected(lessons(study, scans), folder), Path(folder)))


def lessons(study: Study, scans: int) -> list[Member]:
    """Return the scans of random bodies; raise what `reduce_finger` does before anything runs."""
    check_reducible(study, scans)
    if find_spec("sklearn") is None:
        raise TactileError(
            'Reducing a finger needs scikit-learn: pip install "tactile-fem[reduce]".'
        )
    mesh = study.finger.check()
    assert mesh is not None, "this process reads the mesh"
    check_taught(study.lay_out(mesh).positions_mm)
    return [lesson(study, number) for number in range(scans)]


def check_reducible(study: Study, scans: int) -> None:
    """Raise StudyError for a finger that cannot be reduced, or too few scans."""
    if scans < LEAST_SCANS:
        raise StudyError(f"scans is {scans}; it must be {LEAST_SCANS} or more.")
    if study.finger.is_section:
        raise StudyError('finger.kind is "section"; only a solid finger can be reduced.')
    if study.joint or study.afferents:
        table = "joint" if study.joint else "afferents"
        raise StudyError(f"a finger with the table {table} cannot be reduced; leave it out.")


def learn(study: Study, scans: Sequence[Results]) -> FastFinger:
    """Return the surrogate learnt from complete scans of a study's finger."""
    tables = study.model_dump(mode="json")
    pad, symmetric = pad_of(study, DEEPEST_MM + _REACH_MM), is_symmetric(tables)
    pad = with_drag(pad.symmetric() if symmetric else pad, scans)
    learnt = [Lesson.of(pad, scan) for scan in scans]
    held_out = learnt[::_HELD_OUT]
    taught = [each for k, each in enumerate(learnt) if k % _HELD_OUT]
    felt = learn_felt(taught, is_symmetric=symmetric)
    whole = learn_whole(pad, taught, is_symmetric=symmetric)
    mesh = study.finger.check()
    assert mesh is not None, "this process reads the mesh"
    measures = np.concatenate([each.measures for each in taught])
    finger = FastFinger(
        pad=pad,
        felt=felt,
        whole=whole,
        receptors_mm=study.lay_out(mesh).positions_mm,
        ranges=np.array([measures.min(axis=0), measures.max(axis=0)]),
        made_from={"study": tables, "scans": [s.folder.name for s in scans]},
        errors=errors_of(felt, whole, held_out),
    )
    logger.info("of %d scans that were held out: %s", len(held_out), finger.errors)
    return finger


def _complete(outcomes: Sequence[Outcome], folder: Path) -> list[Results]:
    found = [Results(folder / outcome.member.name) for outcome in outcomes if not outcome.problem]
    if len(found) < LEAST_SCANS:
        raise TactileError(
            f"only {len(found)} of {len(outcomes)} scans succeeded; {LEAST_SCANS} are needed."
        )
    return found
