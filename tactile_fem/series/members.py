"""Which scans a series has."""

from __future__ import annotations

import hashlib
import itertools
import math
import re
import tomllib
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from tactile_fem.errors import StudyError
from tactile_fem.study import Receptors, Study
from tactile_fem.study.file import load_study

# Of a folder, in bytes: longer ones leave no room for what stands before and after them.
_LONGEST_NAME = 120


@dataclass(frozen=True)
class Member:
    """One scan of a series."""

    name: str  # of its folder
    study: Study
    values: dict[str, Any]  # its varied values, by their names in the study


def single_fibre(
    study: Study, *, spacing_mm: float = 0.2, half_width_mm: float = 5.0
) -> list[Member]:
    """Return the passes of the classic protocol: one receptor, and a shifted stimulator in each.

    Only the study's receptor at X = Y = 0 is used. The shifts in X go from ``-half_width_mm`` to
    ``half_width_mm`` (paper: in steps of 0.2 to 5 mm).

    Raises
    ------
    StudyError
        The spacing is not positive or is wider than the half width.
    """
    if not 0 < spacing_mm <= half_width_mm < math.inf:
        raise StudyError(
            f"spacing {spacing_mm:g} mm, half width {half_width_mm:g} mm: the spacing must be "
            "positive and at most the half width."
        )
    receptors = _central(study.receptors)
    afferents = tuple(
        population.model_copy(update={"receptors": _central(population.receptors)})
        for population in study.afferents
    )
    across, along = study.stimulus.shift_mm
    count = math.floor(half_width_mm / spacing_mm + 1e-9)
    members = []
    for k in range(-count, count + 1):
        shift = float(np.round(k * spacing_mm, 9))
        stimulus = study.stimulus.model_copy(update={"shift_mm": (across + shift, along)})
        own = {"receptors": receptors, "afferents": afferents, "stimulus": stimulus}
        name = f"shift{shift:+.3f}" if shift == round(shift, 3) else f"shift{shift:+.9f}"
        members.append(Member(name, _without_pictures(study, own), {"shift_mm": shift}))
    return members


def _central(receptors: Receptors) -> Receptors:
    one = {"placement": "line", "half_width_mm": 0.0, "extra_mm": ()}
    return receptors.model_copy(update=one)


def sweep(
    axes: Sequence[str], path: Path | None = None, overrides: Sequence[str] = ()
) -> list[Member]:
    """Return the studies with every combination of the given values.

    Each axis is ``section.key=value,value,...``; `path` and `overrides` name the study to vary, as
    for `load_study`.

    Raises
    ------
    StudyError
        An axis has no values or is given twice, or a study is not valid.
    """
    names, values = zip(*map(_axis, axes), strict=True) if axes else ((), ())
    if not axes or len(set(names)) < len(names):
        raise StudyError("A sweep needs one or more different axes: section.key=value,value,...")
    members = []
    for combination in itertools.product(*values):
        own = [f"{name}={text}" for name, (text, _) in zip(names, combination, strict=True)]
        study = _without_pictures(load_study(path, [*overrides, *own]), {})
        plain = {name: value for name, (_, value) in zip(names, combination, strict=True)}
        members.append(Member(_folder_name(plain), study, plain))
    if len({member.study.model_dump_json() for member in members}) < len(members):
        raise StudyError("Two scans of the sweep have the same values: name each value once.")
    count = Counter(member.name.casefold() for member in members)
    return [
        replace(one, name=_folder_name(one.values, apart=count[one.name.casefold()] > 1))
        for one in members
    ]


def _folder_name(values: Mapping[str, str], *, apart: bool = False) -> str:
    """Return the values as the name of a folder, with Unicode's letters, digits and Braille cells.

    Where it does not show them whole, or is to be told `apart` from the same one in other cases, a
    hash of the values follows. It depends on them alone, so that a series finds its folders again.
    """
    whole = "_".join(f"{name.split('.')[-1]}-{value}" for name, value in values.items())
    name = re.sub(r"[^\w.+\u2800-\u28ff-]+", "_", unicodedata.normalize("NFC", whole))
    name = name.encode()[:_LONGEST_NAME].decode(errors="ignore")
    numbers = re.sub(r"[\[\], ]+", "_", whole)  # lists of numbers stay as they are
    if not apart and name in (whole, numbers):
        return name
    return f"{name}-{hashlib.sha256(repr(sorted(values.items())).encode()).hexdigest()[:8]}"


def _without_pictures(study: Study, changes: dict[str, Any]) -> Study:
    output = study.output.model_copy(update={"pictures": False})
    return study.model_copy(update={**changes, "output": output})


def _axis(text: str) -> tuple[str, list[tuple[str, str]]]:
    """Return name and values of an axis, each as TOML, or as it is if it is none, and plainly."""
    name, equals, listed = text.partition("=")
    try:
        entries = tomllib.loads(f"values = [{listed}]")["values"]
        texts = [tomlkit.item(value).as_string() for value in entries]
        plain = [v if isinstance(v, str) else t for v, t in zip(entries, texts, strict=True)]
    except tomllib.TOMLDecodeError:
        texts = plain = [part.strip() for part in listed.split(",")]
    if not equals or not listed.strip() or not all(texts):
        raise StudyError(f'"{text}" is no axis of a sweep: write section.key=value,value,...')
    return name.strip(), list(zip(texts, plain, strict=True))
