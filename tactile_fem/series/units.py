"""Which scans of a series one worker runs in turn, and what they share."""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from tactile_fem.neuron import fields_of
from tactile_fem.series.members import Member
from tactile_fem.simulation.results import Results
from tactile_fem.study import AFTER_MECHANICS, Study

# How far apart the stimulators of two scans are at most, so that one is guessed from the other.
_BESIDE_MM = 0.5
# Scans that are guessed one from the other; the first of them is a usual scan.
_LONGEST_UNIT = 26
_NOT_OF_MECHANICS = ("run.json", "spikes.csv", "log.txt", "figures", "vibration", ".*")


def of_same_mechanics(members: Sequence[Member]) -> list[list[Member]]:
    """Return groups of members that differ only in what follows the mechanics."""
    groups: dict[str, list[Member]] = {}
    for member in members:
        study = member.study
        felt = fields_of(each.population() for each in study.populations)
        names = ",".join(field.name for field in felt)
        key = names + study.model_dump_json(exclude=AFTER_MECHANICS)
        groups.setdefault(key, []).append(member)
    return list(groups.values())


def units_of(members: Sequence[Member], jobs: int) -> list[list[Member]]:
    """Divide members into units: equal mechanics, and scans beside each other, stay together.

    Scans beside each other are divided into as many equal units for each job.
    """
    chains: list[list[list[Member]]] = []
    for group in of_same_mechanics(members):
        if chains and are_beside(chains[-1][-1][0].study, group[0].study):
            chains[-1].append(group)
        else:
            chains.append([group])
    units = []
    for chain in chains:
        count = min(jobs * math.ceil(len(chain) / (jobs * _LONGEST_UNIT)), len(chain))
        ends = np.linspace(0, len(chain), count + 1).round().astype(int).tolist()
        for first, end in pairwise(ends):
            units.append([member for group in chain[first:end] for member in group])
    return units


def are_beside(one: Study, other: Study) -> bool:
    """Return whether the mechanics of two studies differs in protocol and a small shift only."""
    shift_mm = other.stimulus.shift_mm
    if math.dist(one.stimulus.shift_mm, shift_mm) > _BESIDE_MM:
        return False
    moved = one.stimulus.model_copy(update={"shift_mm": shift_mm})
    there = other.finger, other.tissue, other.stimulus, other.solver
    return (one.finger, one.tissue, moved, one.solver) == there


def begin_with(source: Path, folder: Path, study: Study) -> None:
    """Begin a scan at the end of another one with the same mechanics: only its spikes are left.

    The folder must not exist, and appears complete.
    """
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    shutil.copytree(source, part, ignore=shutil.ignore_patterns(*_NOT_OF_MECHANICS))
    Results(part).save_study(study)
    part.rename(folder)
