"""Fires afferents on surfaces that slide under the finger, from one kept period of what is felt.

The recorded rates, `measured/rates/textures.csv`, are means over 39 afferents of monkeys on a
rotating drum (digitized by third parties); nothing here is fitted to them. The histories come from
`texture_histories.py`. What each drive of SA1 afferents needs of gain and compression is fitted to
bar and spheres, as in `compare_laws.py`.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Self

import numpy as np
import recordings
from calibrate import LAWS, Law, explained
from compare_laws import COMPARED, started
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from tactile_fem import Population, Study
from tactile_fem.neuron import Drive
from tactile_fem.study import Neuron

Array = NDArray[Any]

SURFACES = {
    **{f"grating_{period}": float(period) for period in (12, 8, 5, 3)},
    **{f"dots_{period}": float(period) for period in (6, 4, 3, 2)},
}
HISTORIES = recordings.HISTORIES / "textures"
KINDS = {"SA1": "sed_kPa", "RA": "shortening", "PC": "moved_mm"}
# Seconds: of a slide before, to whose mean the afferents have adapted (assumed); of the slide; of
# its beginning, which is not counted.
BEFORE_S, DURATION_S, NOT_COUNTED_S = 5.0, 2.0, 0.5
STEP_S = {"SA1": 1e-3, "RA": 1e-3, "PC": 2.5e-4}
# Afferents at each place: those of RA and PC differ in gain.
COPIES = {"SA1": 1, "RA": 4, "PC": 6}
APART_MM = 0.5
_FELT = Drive("Felt", "1", lambda histories: histories["felt"])


@dataclass(frozen=True)
class Condition:
    """Height of a surface and normal force, N, of a section N/mm."""

    height_mm: float
    force_N: float

    @classmethod
    def parsed(cls, text: str) -> Self:
        """Return the condition of ``height,force``."""
        return cls(*map(float, text.split(",")))

    def __str__(self) -> str:
        """Return height and force, as names of files have them."""
        return f"{self.height_mm:g}mm_{self.force_N:g}N"


# %%
@dataclass(frozen=True)
class Kept:
    """One period of what is felt on some surfaces, from a file."""

    name: str
    arrays: dict[str, Array]

    @classmethod
    def of(cls, path: Path) -> Self:
        """Read a file of `texture_histories.py`; one that does not exist holds no surface."""
        if not path.exists():
            return cls(path.stem, {})
        with np.load(path) as stored:
            return cls(path.stem, {key: stored[key] for key in stored.files})

    @property
    def surfaces(self) -> tuple[str, ...]:
        """The surfaces, in the order of the table."""
        return tuple(name for name in SURFACES if f"{name}.slide_mm" in self.arrays)

    def serves(self, kind: str) -> bool:
        """Return whether the rates of a kind can be trusted.

        PC afferents answer to the facets of a coarse mesh, and SED of a section is too low.
        """
        if kind == "PC":
            return not self.name.startswith("solid_coarse")
        return self.name.startswith("solid") and self.name.count("_") == 3

    def get(self, surface: str, key: str) -> Array:
        """Return what is felt on a surface, (rows, receptors)."""
        return self.arrays[f"{surface}.{key}"]

    def replayed(self, surface: str, key: str, slide_mm: Array) -> Array:
        """Return what is felt anywhere on the way, by a periodic cubic spline."""
        at, values = (self.get(surface, name).astype(float) for name in ("slide_mm", key))
        period = SURFACES[surface]
        # What is left of the run-in is taken away, so that the period ends as it begins.
        values += (1 - at / at[-1])[:, None] * (values[-1] - values[0])
        values[-1] = values[0]
        at *= period / at[-1]
        return CubicSpline(at, values, bc_type="periodic")(np.mod(slide_mm, period))


def recorded() -> dict[str, Array]:
    """Return the recorded rates of each kind, spikes/s, on all surfaces in their order."""
    with (recordings.MEASURED / "textures.csv").open(newline="", encoding="utf-8") as stream:
        rows = {row["surface"]: row for row in csv.DictReader(stream)}
    return {kind: np.array([float(rows[s][f"{kind}_Hz"]) for s in SURFACES]) for kind in KINDS}


@cache
def population(kind: str) -> Population:
    """Return the afferents of a kind with the package's constants."""
    one = {"name": kind, "kind": kind}
    return Study.model_validate({"afferents": [one]}).populations[0].population()


def mean_rates(
    some: Sequence[Kept],
    kind: str,
    speed_mm_s: float,
    *,
    key: str = "",
    neuron: Neuron | None = None,
    duration_s: float = DURATION_S,
) -> Array:
    """Return the mean rates of afferents, spikes/s, (files, surfaces); nan for what is not kept.

    The same afferents feel all surfaces, after some seconds on each.

    Parameters
    ----------
    some
        Files of histories.
    kind
        SA1, RA or PC.
    speed_mm_s
        Of the slide.
    key
        What they feel, by default what the kind does.
    neuron
        By default that of the kind.
    duration_s
        Of the slide; the first half second is not counted.
    """
    time = np.arange(0.0, duration_s + 1e-9, STEP_S[kind])
    names = tuple(SURFACES)
    places = [(i, names.index(name)) for i, one in enumerate(some) for name in one.surfaces]
    columns, units = [], []
    for i, j in places:
        felt = some[i].replayed(names[j], key or KINDS[kind], speed_mm_s * time)
        columns.append(np.repeat(felt, COPIES[kind], axis=1))
        units.append(np.arange(columns[-1].shape[1]))
    drive = np.concatenate(columns, axis=1)
    if kind == "SA1":
        drive = np.maximum(drive, 0.0)  # a spline may go below
    drive[0] = drive.mean(axis=0)
    afferents = Population(kind, neuron or population(kind).neuron, _FELT).held(BEFORE_S)
    fired = afferents.fire({"time_s": time, "felt": drive}, np.concatenate(units))
    rates = fired.mean_rate(NOT_COUNTED_S, duration_s)
    found = np.full((len(some), len(names)), np.nan)
    ends = np.cumsum([len(numbers) for numbers in units])[:-1]
    for place, each in zip(places, np.split(rates, ends), strict=True):
        found[place] = each.mean()
    return found


# %%
@dataclass(frozen=True)
class Felt:
    """What SA1 afferents may respond to.

    Attributes
    ----------
    key
        Of the kept arrays.
    calibrated
        The drive under bar and spheres to which gain, compression and adaptation are fitted.
    spheres
        Whether the spheres are fitted, too: under their middle a difference is zero.
    """

    key: str
    calibrated: Drive
    spheres: bool = True

    def fitted(self, linear: bool = False) -> tuple[Neuron, float, float]:
        """Return the neuron of the law, or of one without compression, and R2 of bar and spheres.

        Equal drives are fitted once.
        """
        return _fitted(self.calibrated, self.spheres, linear)


@cache
def _fitted(drive: Drive, with_spheres: bool, linear: bool) -> tuple[Neuron, float, float]:
    bar, spheres = [recordings.bar(drive)], recordings.spheres(drive)
    known = bar + spheres if with_spheres else bar
    law = started(LAWS["logarithmic"], spheres if with_spheres else bar)
    neuron = (without_compression(law) if linear else law).fitted_quietly(known)[0].neuron
    return neuron, explained(bar, neuron), explained(spheres, neuron)


def without_compression(law: Law) -> Law:
    """Return a law whose compression begins far above all drives, with about the same currents."""
    scale = 1e4 * law.neuron.compression_kPa
    changes = {
        "compression_kPa": scale,
        "static_gain_pA_per_kPa": 30 * law.neuron.static_gain_pA_per_kPa / 1e3,
    }
    free = tuple(name for name in law.free if name != "compression_kPa")
    return Law(law.neuron.model_copy(update=changes), free)


def difference(label: str, unit: str, of: Callable[[Any], Array]) -> Drive:
    """Return the difference of a quantity over 0.5 mm along the finger, without its sign."""

    def value(histories: Any) -> Array:
        y, values = histories["y_mm"], of(histories)
        order = np.argsort(y, kind="stable")
        low, high = y - APART_MM / 2, y + APART_MM / 2
        rows = (
            np.interp(high, y[order], row) - np.interp(low, y[order], row)
            for row in values[:, order]
        )
        return np.abs(np.array(list(rows)))

    return Drive(label, unit, value)


def drives() -> dict[str, Felt]:
    """Return all drives by name; end organs of a cluster share the constants of the average."""
    sed, von_mises, stretch, compression = (
        COMPARED[name][0]
        for name in ("SED", "von Mises stress", "largest stretch", "largest compression")
    )
    of_stretch = difference("Difference of stretch", "1", lambda h: h["stretches"][..., -1])
    of_sed = difference("Difference of SED", "kPa", lambda h: h["sed_kPa"])
    return {
        "SED": Felt("sed_kPa", sed),
        "von Mises stress": Felt("von_mises_kPa", von_mises),
        "largest stretch": Felt("stretch", stretch),
        "largest compression": Felt("compression_kPa", compression),
        "difference of stretch": Felt("stretch_difference", of_stretch, spheres=False),
        "difference of SED": Felt("sed_difference_kPa", of_sed, spheres=False),
        "cluster's SED": Felt("cluster_sed_kPa", sed),
        "cluster's von Mises stress": Felt("cluster_von_mises_kPa", von_mises),
        "cluster's compression": Felt("cluster_compression_kPa", compression),
    }
