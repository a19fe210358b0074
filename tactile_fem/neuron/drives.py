"""What an afferent feels: a drive, made from the histories of its receptors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.afferent import checked_history, checked_signed

Array = NDArray[Any]
Histories = Mapping[str, Array]


@dataclass(frozen=True)
class Drive:
    """A quantity that afferents answer to.

    Attributes
    ----------
    label, unit
        What figures call it, and its unit.
    value
        Takes the arrays of a trace, ``time_s`` (t,) and those of the receptors (t, receptors, ...)
        among them, and returns the quantity, (t, receptors).
    """

    label: str
    unit: str
    value: Callable[[Histories], Array]

    def of(self, histories: Histories) -> tuple[Array, Array]:
        """Return times, s, (t,), and the quantity, (t, receptors).

        Raises
        ------
        StudyError
            The histories lack what it is made from, or it is not finite or not of that shape.
        """
        try:
            value = self.value(histories)
        except KeyError as missing:
            raise StudyError(f"{self.label}: the histories have no {missing.args[0]}.") from None
        return checked_signed(histories["time_s"], value, self.label)

    def rate(self) -> Drive:
        """Return its rate of change, see `rate_of_change`."""

        def value(histories: Histories) -> Array:
            return rate_of_change(histories["time_s"], self.value(histories))

        return Drive(f"Rate of {self.label[0].lower()}{self.label[1:]}", f"{self.unit}/s", value)


class _StrainEnergyDensity(Drive):
    """Strain energy density, of which nothing but rounding may be negative."""

    def of(self, histories: Histories) -> tuple[Array, Array]:
        return checked_history(histories["time_s"], self.value(histories))


def rate_of_change(time_s: Array, values: Array) -> Array:
    """Return d(values)/dt at the samples, (t, ...).

    By differences of second order, one-sided at the ends: exact for parabolas, whatever the
    distances of the samples. The rate is then linear between the samples, as every drive is.
    """
    return np.gradient(values, time_s, axis=0, edge_order=min(2, len(time_s) - 1))


# Drives by name; one of your own may join. Principal values rise; tension is positive.
DRIVES: dict[str, Drive] = {
    "sed": _StrainEnergyDensity("Strain energy density", "kPa", lambda h: h["sed_kPa"]),
    "von_mises": Drive("Von Mises stress", "kPa", lambda h: h["von_mises_kPa"]),
    "largest_stretch": Drive("Largest stretch - 1", "1", lambda h: h["stretches"][..., -1] - 1),
    "smallest_stretch": Drive("Smallest stretch - 1", "1", lambda h: h["stretches"][..., 0] - 1),
    "largest_stress": Drive("Largest stress", "kPa", lambda h: h["stresses_kPa"][..., -1]),
    "smallest_stress": Drive("Smallest stress", "kPa", lambda h: h["stresses_kPa"][..., 0]),
    "pressure": Drive("Pressure", "kPa", lambda h: -h["stresses_kPa"].mean(axis=-1)),
}


def drive_of(name: str) -> Drive:
    """Return the drive of a name: one of `DRIVES`, or ``_rate`` behind it for its rate.

    Raises
    ------
    StudyError
        There is none.
    """
    if name in DRIVES:
        return DRIVES[name]
    base = name.removesuffix("_rate")
    if base == name or base not in DRIVES:
        known = ", ".join(DRIVES)
        raise StudyError(f'There is no drive "{name}"; there are {known}, and their "_rate".')
    return DRIVES[base].rate()
