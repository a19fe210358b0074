"""The receptors of all populations of a study."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.receptors.placement import Samples, place, sample
from tactile_fem.study import Afferents, Study


@dataclass(frozen=True)
class Layout:
    """Receptors, one population after the other.

    Attributes
    ----------
    positions_mm
        (receptors, 3).
    population
        Name of each receptor's population, (receptors,).
    samples
        Points to be averaged, by the tissue that they lie in.
    """

    positions_mm: np.ndarray
    population: np.ndarray
    samples: dict[str, Samples]


def place_all(study: Study, finger: FingerMesh) -> list[np.ndarray]:
    """Return the receptors' positions (n, 3) in mm of each population.

    Raises
    ------
    StudyError
        As `place`, with the name of the population if the study names any.
    """
    positions = []
    for afferents in study.populations:
        with _of(afferents, study):
            positions.append(place(afferents.receptors, finger))
    return positions


def lay_out(study: Study, finger: FingerMesh) -> Layout:
    """Place the receptors of all populations and find the points that they average.

    Raises
    ------
    StudyError
        As `place` and `sample`, with the name of the population if the study names any.
    """
    placed = place_all(study, finger)
    names: list[str] = []
    samples: dict[str, list[Samples]] = {}
    for afferents, positions in zip(study.populations, placed, strict=True):
        receptors = afferents.receptors
        with _of(afferents, study):
            points = sample(receptors, positions, finger)
        own = replace(points, receptor=points.receptor + len(names))
        samples.setdefault(receptors.side, []).append(own)
        names += [afferents.name] * len(positions)
    together = {side: _joined(found) for side, found in samples.items()}
    return Layout(np.concatenate(placed), np.array(names), together)


@contextmanager
def _of(afferents: Afferents, study: Study) -> Iterator[None]:
    """Say which population is wrong."""
    try:
        yield
    except StudyError as error:
        if not study.afferents:
            raise
        raise StudyError(f"afferents.{afferents.name}.{error}") from None


def _joined(samples: list[Samples]) -> Samples:
    columns = zip(*(vars(one).values() for one in samples), strict=True)
    return Samples(*map(np.concatenate, columns))
