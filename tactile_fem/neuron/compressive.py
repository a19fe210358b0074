"""Transduction of a compressed drive: a power or a logarithm of it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.neuron.currents import Segment
from tactile_fem.neuron.settings import Neuron
from tactile_fem.neuron.static import StaticDynamic, Stretch

Array = NDArray[Any]
# Largest distance of a compressed drive from the chords that replace it, in units of S, for a
# logarithm of S_0.
CHORD_ERROR = 0.002


class Compressive(StaticDynamic):
    """Static part of a compressed drive, with a second, fast adaptation.

    The drive is linear between the samples, the compressed one is not: a stretch is divided, for
    each receptor separately, into equal increments of a measure of the drive, so short that chords
    are off by at most 0.002 units of S.
    """

    def __init__(self, neuron: Neuron, chord: float) -> None:
        """Take the distance of a chord of S, in its units, over an increment of 1."""
        super().__init__(neuron, [(neuron.fast_adaptation, neuron.fast_adaptation_time_s)])
        self._longest = float(np.sqrt(CHORD_ERROR / chord))

    def _measure(self, drive: Array) -> Array:
        """Return the measure of a drive, of which equal increments have chords equally far off."""
        raise NotImplementedError

    def _drive(self, measure: Array) -> Array:
        """Return the drive of a measure."""
        raise NotImplementedError

    def _of_measure(self, measure: Array) -> Array:
        """Return S of a measure."""
        raise NotImplementedError

    def _compressed(self, drive: Array) -> Array:
        return self._of_measure(self._measure(drive))

    def _stretches(self, time_s: Array, drive: Array) -> Iterator[Stretch]:
        """Divide stretches into equal increments of the measure."""
        measure = self._measure(drive)
        for k, h in enumerate(np.diff(time_s)):
            start, away = measure[k], measure[k + 1] - measure[k]
            chords = np.maximum(np.abs(away) / self._longest, 1.0)
            if chords.max(initial=1.0) == 1.0:
                ends = self._of_measure(measure[k : k + 2])
                yield slice(None), time_s[k], h, *ends
                continue
            parts = 2 ** np.ceil(np.log2(chords)).astype(int)
            for count in np.unique(parts):
                mine = np.flatnonzero(parts == count)
                share = np.arange(count + 1)[:, None] / count
                levels = start[mine] + share * away[mine]
                risen = self._drive(levels) - self._drive(start[mine])
                at, S = h * (risen / risen[-1] if count > 1 else share), self._of_measure(levels)
                for j in range(count):
                    yield mine, time_s[k] + at[j], at[j + 1] - at[j], S[j], S[j + 1]


class Power(Compressive):
    """A power of the drive above a threshold.

    Proposed: with the power fitted to the rates of monkeys' afferents, as Stevens's law has one for
    what people feel::

        S = max(D - D_0, 0)^p

    for a drive D in its unit, such as kPa, of which S is taken to be as well. Where D is below the
    threshold D_0, it evokes nothing. A current that adaptation would make negative is zero:
    channels that close do not hyperpolarize the membrane. The measure is the square root of S, of
    which increments x have chords that are off by (1/p - 1)/2 x^2, and by x^2/4 at the threshold.
    """

    def __init__(self, neuron: Neuron) -> None:
        super().__init__(neuron, max(0.25, abs(1 / neuron.power - 1) / 2))
        self._threshold, self._half = neuron.drive_threshold_kPa, neuron.power / 2

    def segments(self, time_s: Array, drive: Array, contact_s: float = 0.0) -> Iterator[Segment]:
        """Yield the current, divided where it reaches or leaves zero."""
        for segment in super().segments(time_s, drive, contact_s):
            yield from rectified(segment)

    def current_at(self, at_s: Array, time_s: Array, drive: Array, contact_s: float = 0.0) -> Array:
        """Return the current, which is never negative."""
        return np.maximum(super().current_at(at_s, time_s, drive, contact_s), 0.0)

    def _measure(self, drive: Array) -> Array:
        above = drive - self._threshold
        return np.sign(above) * np.abs(above) ** self._half

    def _drive(self, measure: Array) -> Array:
        return self._threshold + np.sign(measure) * np.abs(measure) ** (1 / self._half)

    def _of_measure(self, measure: Array) -> Array:
        return np.maximum(measure, 0.0) ** 2


class Logarithmic(Compressive):
    """A logarithm of the drive.

    Proposed: currents grow with the logarithm of strain energy density, as the compressive stage
    of Loomis's tactile letters (1990) suggests::

        S = S_0 ln(1 + D/S_0)

    for a drive D, and -S(-D) where D is negative. S is D where D is much less than S_0. The measure
    is S/S_0, of which increments x have chords that are off by x^2/8 S_0.
    """

    def __init__(self, neuron: Neuron) -> None:
        super().__init__(neuron, 1 / 8)
        self._scale = neuron.compression_kPa

    def _measure(self, drive: Array) -> Array:
        return np.sign(drive) * np.log1p(np.abs(drive) / self._scale)

    def _drive(self, measure: Array) -> Array:
        return np.sign(measure) * self._scale * np.expm1(np.abs(measure))

    def _of_measure(self, measure: Array) -> Array:
        return self._scale * measure


def rectified(segment: Segment) -> Iterator[Segment]:
    """Yield a segment in parts, with zero in place of negative currents."""
    start, length, current, who = segment
    low, _ = current.bounds(length)
    if (low >= 0).all():
        yield segment
        return
    start, h = (np.broadcast_to(values, low.shape) for values in (start, length))
    numbers = np.arange(len(low)) if isinstance(who, slice) else who
    for begin, until in pairwise([np.zeros_like(h), *current.zeros(h), h]):
        (some,) = np.nonzero(until > begin)
        if some.size:
            part = current.of(some).from_(begin[some])
            left = (until - begin)[some]
            signed = part.scaled((part.at(0.5 * left) > 0).astype(float))
            yield Segment((start + begin)[some], left, signed, numbers[some])
