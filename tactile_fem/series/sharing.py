"""Scans of a series that share their mechanics."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from tactile_fem.neuron import fields_of
from tactile_fem.results.results import Results
from tactile_fem.series.members import Member
from tactile_fem.study import AFTER_MECHANICS, Study

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


def begin_with(source: Path, folder: Path, study: Study) -> None:
    """Begin a scan at the end of another one with the same mechanics: only its spikes are left.

    The folder must not exist, and appears complete.
    """
    part = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    shutil.copytree(source, part, ignore=shutil.ignore_patterns(*_NOT_OF_MECHANICS))
    Results(part).save_study(study)
    part.rename(folder)
