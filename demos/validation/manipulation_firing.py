"""Afferents of a fingertip in manipulation: the protocol, what was felt in it, and how they fire.

The protocol is that of Saal, Birznieks and Johansson (eLife 89616). The histories come from
`manipulation_histories.py`, and `manipulation.py` compares and draws. Nothing is fitted to their
recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from tactile_fem import Population, Study
from tactile_fem.neuron import Drive, Response, fire_all

Array = NDArray[Any]

# Force along the skin in X and Y, N; radial is to +X, as in the right hand.
LOADS = {
    "normal": (0.0, 0.0),
    "distal": (0.0, 1.4),
    "proximal": (0.0, -1.4),
    "radial": (1.4, 0.0),
    "ulnar": (-1.4, 0.0),
}
TANGENTIAL = tuple(LOADS)[1:]
# Every load follows another one in the other order; before the first comes the last.
ORDERS = {
    "one": ("normal", "distal", "proximal", "radial", "ulnar"),
    "two": ("normal", "radial", "distal", "ulnar", "proximal"),
}
BACKGROUND_N, NORMAL_N = 0.2, 4.0
SETTLING_S, RISE_S, PLATEAU_S, BACK_S, PAUSE_S = 0.5, 0.125, 0.25, 0.125, 0.25
LOAD_S = RISE_S + PLATEAU_S + BACK_S + PAUSE_S
COUNTED_S = RISE_S + PLATEAU_S
COUNTS = {"RA": 60, "SA1": 73, "SA2": 41}
OTHERWISE = 2  # spikes by which a response differs; one may be due to the phase
STEP_S, AT_REST_S = 2e-3, 3.0
FELT = Drive("Felt", "1", lambda histories: histories["felt"])


def afferents() -> list[dict[str, Any]]:
    """Return the populations of the study, at random on pad, sides and end."""
    return [
        {
            "name": kind,
            "kind": kind,
            "receptors": {
                "placement": "random",
                "region": "phalanx",
                "count": count,
                "seed": number,
            },
            "neuron": {"seed": number},
        }
        for number, (kind, count) in enumerate(COUNTS.items(), 1)
    ]


@dataclass(frozen=True)
class Kept:
    """What was felt in one order of the loads, from a file of `manipulation_histories.py`.

    Attributes
    ----------
    order
        Its name.
    loads
        Their names, (n,), with the one before the first.
    arrays
        ``time_s`` (t,), the first load begins at 0; ``force_N``, ``stimulator_mm`` (t, 3);
        ``receptors_mm`` (r, 3), ``population`` (r,); ``felt`` (t, r), the drive of each afferent.
    """

    order: str
    loads: tuple[str, ...]
    arrays: dict[str, Array]

    @classmethod
    def of(cls, folder: Path, order: str) -> Self:
        """Read the file of an order."""
        with np.load(folder / f"{order}.npz") as stored:
            arrays = {key: stored[key] for key in stored.files}
        return cls(order, sequence(order), arrays)

    def start_s(self, load: str) -> float:
        """Return when a load begins, after another one."""
        return LOAD_S * (1 + self.loads[1:].index(load))

    def at(self, name: str, time_s: float) -> Array:
        """Return force or place of the plate at a time, (3,)."""
        values = self.arrays[name].T
        return np.array([np.interp(time_s, self.arrays["time_s"], each) for each in values])

    def within(self, name: str, start_s: float, end_s: float) -> Array:
        """Return the values between two times, (rows, ...)."""
        time = self.arrays["time_s"]
        return self.arrays[name][(time >= start_s - 1e-9) & (time <= end_s + 1e-9)]

    def pause_Hz(self, number: int) -> Array:
        """Return the mean rate of each afferent in the pause after a load, spikes/s, (r,)."""
        end = LOAD_S * (number + 1)
        return self.noisy.mean_rate(end - PAUSE_S, end)

    @cached_property
    def noisy(self) -> Response:
        """The spikes."""
        return self._fired(populations())

    @cached_property
    def quiet(self) -> Response:
        """The spikes without noise: what differs between two responses is what they felt."""
        return self._fired(populations(threshold_noise=0.0))

    def _fired(self, some: Sequence[Population]) -> Response:
        """Return the spikes, with what is felt smooth between the steps of the mechanics."""
        time, felt = (self.arrays[name].astype(float) for name in ("time_s", "felt"))
        fine = np.append(np.arange(time[0], time[-1] - STEP_S / 2, STEP_S), time[-1])
        smooth = PchipInterpolator(time, felt)(fine)
        histories = {"time_s": fine, "felt": smooth, "population": self.arrays["population"]}
        return fire_all(some, histories)


def sequence(order: str) -> tuple[str, ...]:
    """Return the loads of an order, with the one before the first."""
    return (ORDERS[order][-1], *ORDERS[order])


def populations(**changed: float) -> list[Population]:
    """Return the afferents, with other constants where they are given."""
    study = Study.model_validate({"afferents": afferents()})
    return [
        Population(one.name, one.neuron.model_copy(update=changed), FELT)
        for one in study.populations
    ]


@dataclass(frozen=True)
class Responses:
    """Spikes that each load evoked in both orders, without noise.

    Attributes
    ----------
    kept
        Histories of both orders.
    spikes
        Number from the beginning of a load to the end of its plateau, by load, (orders, r).
    """

    kept: Sequence[Kept]
    spikes: Mapping[str, NDArray[np.int64]]

    @classmethod
    def of(cls, kept: Sequence[Kept]) -> Self:
        """Fire both orders."""
        spikes = {}
        for load in LOADS:
            starts = [one.start_s(load) for one in kept]
            rates = [
                one.quiet.mean_rate(start, start + COUNTED_S)
                for one, start in zip(kept, starts, strict=True)
            ]
            spikes[load] = np.round(np.array(rates) * COUNTED_S).astype(int)
        return cls(kept, spikes)

    def own(self, kind: str) -> NDArray[np.bool_]:
        """Return which afferents are of a kind, (r,)."""
        return np.asarray(self.kept[0].arrays["population"] == kind)

    @cached_property
    def responding(self) -> NDArray[np.bool_]:
        """Which afferents fired under any load, (r,)."""
        return np.sum(list(self.spikes.values()), axis=(0, 1)) > 0

    @cached_property
    def tuning(self) -> Array:
        """Preferred directions, (r, 2), as long as the afferent is tuned, at most 1; or NaN."""
        along = np.array([LOADS[load] for load in TANGENTIAL]) / 1.4
        counts = np.array([self.spikes[load].sum(axis=0) for load in TANGENTIAL])
        with np.errstate(invalid="ignore"):
            return np.asarray(counts.T @ along / counts.sum(axis=0)[:, None])

    def share_towards(self, kind: str, load: str) -> float:
        """Return the share of tuned afferents whose direction is nearest to that of a load."""
        own = self.tuning[self.own(kind)]
        own = own[np.linalg.norm(own, axis=1) > 0]
        nearest = (own @ np.array([LOADS[each] for each in TANGENTIAL]).T).argmax(axis=1)
        return float(np.mean(nearest == TANGENTIAL.index(load))) if len(own) else np.nan

    def otherwise(self, kind: str) -> tuple[float, float]:
        """Return shares that the load before changes: of responses, of afferents; of responding."""
        own = self.own(kind) & self.responding
        differ = [abs(np.diff(self.spikes[load][:, own], axis=0)[0]) for load in LOADS]
        found = np.array(differ) >= OTHERWISE
        return (float(found.mean()), float(found.any(axis=0).mean())) if own.any() else (0.0, 0.0)


def at_rest(population: Array) -> NDArray[np.int64]:
    """Return the spikes of afferents, by the names of their populations, without a load, (r,)."""
    time_s, felt = np.array([0.0, AT_REST_S]), np.zeros((2, len(population)))
    still = {"time_s": time_s, "felt": felt, "population": population}
    return fire_all(populations(), still).counts()
