"""Fires afferents on surfaces that slide under the finger, from one kept period of what is felt.

The recorded rates, `measured/rates/textures.csv`, are means over 39 afferents of monkeys on a
rotating drum (digitized by third parties). The histories come from `texture_histories.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Self

import numpy as np
from felt_quantities import FELT
from recordings import CONTACT_S, SURFACES, Array, Kept

from tactile_fem import Population, Study
from tactile_fem.neuron import Drive

DRIVES = {
    "SA1": FELT["sed"],
    "RA": Drive("Shortening", "1", lambda kept: kept["shortening"]),
    "PC": Drive("Displacement", "mm", lambda kept: kept["moved_mm"]),
}
# Seconds of the slide, and of its beginning, which is not counted.
DURATION_S, NOT_COUNTED_S = 2.0, 0.5
STEP_S = {"SA1": 1e-3, "RA": 1e-3, "PC": 2.5e-4}
# Afferents at each place: those of RA and PC differ in gain.
COPIES = {"SA1": 1, "RA": 4, "PC": 6}
_FELT = Drive("Felt", "1", lambda histories: histories["felt"])


@dataclass(frozen=True)
class Condition:
    """Height of a surface and normal force."""

    height_mm: float
    force_N: float

    @classmethod
    def parsed(cls, text: str) -> Self:
        """Return the condition of ``height,force``."""
        return cls(*map(float, text.split(",")))

    def __str__(self) -> str:
        """Return height and force, as names of files have them."""
        return f"{self.height_mm:g}mm_{self.force_N:g}N"


@cache
def population(kind: str) -> Population:
    """Return the afferents of a kind with the package's constants, after minutes on a surface."""
    one = {"name": kind, "kind": kind}
    found = Study.model_validate({"afferents": [one]}).populations[0].population()
    return Population(kind, found.neuron, _FELT).accustomed(CONTACT_S)


def mean_rates(
    some: Sequence[Kept], kind: str, speed_mm_s: float, duration_s: float = DURATION_S
) -> Array:
    """Return the mean rates of afferents, spikes/s, (files, surfaces); nan for what is not kept.

    The same afferents feel all surfaces.

    Parameters
    ----------
    some
        Files of histories.
    kind
        SA1, RA or PC.
    speed_mm_s, duration_s
        Of the slide; the first half second is not counted.
    """
    time = np.arange(0.0, duration_s + 1e-9, STEP_S[kind])
    names = tuple(SURFACES)
    places = [(i, names.index(name)) for i, one in enumerate(some) for name in one.surfaces]
    columns, units = [], []
    for i, j in places:
        felt = some[i].felt(names[j], DRIVES[kind], speed_mm_s * time)
        columns.append(np.repeat(felt, COPIES[kind], axis=1))
        units.append(np.arange(columns[-1].shape[1]))
    drive = np.concatenate(columns, axis=1)
    fired = population(kind).fire({"time_s": time, "felt": drive}, np.concatenate(units))
    rates = fired.mean_rate(NOT_COUNTED_S, duration_s)
    found = np.full((len(some), len(names)), np.nan)
    ends = np.cumsum([len(numbers) for numbers in units])[:-1]
    for place, each in zip(places, np.split(rates, ends), strict=True):
        found[place] = each.mean()
    return found
