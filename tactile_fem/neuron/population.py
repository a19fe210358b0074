"""Afferents: the drive is transduced to a current, and the membrane fires."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.currents import Transduction
from tactile_fem.neuron.drives import (
    DRIVES,
    Drive,
    Histories,
    checked,
    checked_sed,
    drive_of,
    histories_of,
)
from tactile_fem.neuron.fields import STANDARD, Field
from tactile_fem.neuron.membrane import Membrane, Variability
from tactile_fem.neuron.response import Response
from tactile_fem.neuron.settings import DEFAULT_NAME, Neuron
from tactile_fem.neuron.transduction import Varied, accustomed, held, transduction_of
from tactile_fem.runtime.threads import on_one_core

Array = NDArray[Any]


def respond(
    time_s: ArrayLike,
    sed_kPa: ArrayLike,
    neuron: Neuron | None = None,
    units: ArrayLike | None = None,
    *,
    feels: str | Drive = "sed",
) -> Response:
    """Return the spikes that a history of strain energy density, or of another drive, evokes.

    The history is linear between the samples. Current and potential are then exact, and spikes are
    found to rounding: samples that add nothing to the history change nothing.

    Parameters
    ----------
    time_s
        Increasing times of the samples, s, (t,); the indentation may have negative times.
        Receptors are unadapted and membranes at rest at the first.
    sed_kPa
        Strain energy density, kPa, or another drive in its unit, (t, receptors).
    neuron
        Constants of transduction and membrane; default ``Neuron()``.
    units
        Numbers of the afferents, (receptors,), which select their random numbers; default 0, 1,
        2 ... Thus parts of a population fire as the whole does.
    feels
        What the history is: a drive, or the name of one. All but strain energy density may be
        negative, which inhibits.

    Raises
    ------
    StudyError
        Shapes that do not match, values that are not finite, times that do not increase, negative
        strain energy density, or an unknown drive.
    """
    felt = drive_of(feels) if isinstance(feels, str) else feels
    own = felt is not DRIVES["sed"]
    time, drive = checked(time_s, sed_kPa, felt.label) if own else checked_sed(time_s, sed_kPa)
    return fire(time, drive, neuron or Neuron(), units=units)


@on_one_core()
def fire(
    time: Array,
    drive: Array,
    neuron: Neuron,
    transduction: Transduction | None = None,
    units: ArrayLike | None = None,
) -> Response:
    """Return the spikes that a checked history evokes, by default with the model of the neuron."""
    variability = Variability(neuron, _numbered(units, drive.shape[1]))
    membrane = Membrane(neuron, variability)
    if neuron.gain_spread:
        drive = drive * variability.gains()
    own = transduction or transduction_of(neuron)
    if neuron.resting_pA or neuron.resting_spread_pA or neuron.threshold_spread:
        own = Varied(own, variability.thresholds(), variability.resting_pA())
    for segment in own.segments(time, drive):
        membrane.advance(segment)
    return Response(membrane.spikes(), float(time[0]), float(time[-1]))


def _numbered(units: ArrayLike | None, count: int) -> NDArray[np.int64]:
    numbers = np.arange(count) if units is None else np.asarray(units)
    whole = numbers.shape == (count,) and np.issubdtype(numbers.dtype, np.integer)
    if not whole or (numbers < 0).any():
        raise StudyError(f"units must be {count} whole numbers from 0 on, one per receptor.")
    return numbers


@dataclass(frozen=True)
class Population:
    """Afferents of one kind.

    Attributes
    ----------
    name
        As in the study.
    neuron
        Constants of transduction and membrane; gains are per unit of the drive.
    feels
        A drive, or the name of one, see `tactile_fem.neuron.drive_of`.
    transduction
        Your own model; default the one that `neuron` names. The random factors of `gain_spread`
        multiply the drive.
    """

    name: str = DEFAULT_NAME
    neuron: Neuron = field(default_factory=Neuron)
    feels: str | Drive = "sed"
    transduction: Transduction | None = None

    @property
    def drive(self) -> Drive:
        """The drive that `feels` names; StudyError if there is none."""
        if isinstance(self.feels, Drive):
            return self.feels
        try:
            return drive_of(self.feels)
        except StudyError as error:
            raise StudyError(f"afferents.{self.name}.feels: {error}") from None

    def felt(self, histories: Histories) -> tuple[Array, Array]:
        """Return times, s, (t,), and what the afferents feel, (t, receptors of the population).

        With ``population`` in the histories, the drive sees only the receptors of this name.
        Raises what `Drive.of` raises.
        """
        if "population" in histories:
            histories = histories_of(self.name, histories)
        return self.drive.of(histories)

    def held(self, held_s: float) -> Population:
        """Return the afferents as if the first state of a history had been held before, `held_s`.

        Their transduction has adapted to it; their membranes are at rest.
        """
        own = self.transduction or transduction_of(self.neuron)
        return replace(self, transduction=held(own, held_s))

    def accustomed(self, contact_s: float) -> Population:
        """Return the afferents as if they had met the like of a history before, `contact_s` long.

        So textures are felt that have slid for some time: adaptations begin near the mean of the
        history, as long as they are slow. Membranes are at rest. A band-pass does not adapt.
        StudyError for a generator function and your own transduction.
        """
        own = self.transduction or transduction_of(self.neuron)
        return replace(self, transduction=accustomed(own, contact_s))

    def fire(self, histories: Histories, units: ArrayLike | None = None) -> Response:
        """Return the spikes of the afferents; raises what `respond` raises.

        Parameters
        ----------
        histories
            Arrays of a trace. With ``population`` (receptors,), names, only the receptors of this
            name are felt and fire. Their numbers, which select random numbers, count from 0 within
            the population, so it fires as it would alone.
        units
            Other numbers of the afferents, as in `respond`.
        """
        return self.respond(*self.felt(histories), units)

    def respond(self, time_s: Array, felt: Array, units: ArrayLike | None = None) -> Response:
        """Return the spikes that what they feel evokes, (t,) and (t, receptors), see `felt`."""
        return fire(time_s, felt, self.neuron, self.transduction, units)


def fire_all(populations: Iterable[Population], histories: Histories) -> Response:
    """Return the spikes of the receptors of all populations, in the order of the receptors."""
    names, time = histories["population"], histories["time_s"]
    spikes: list[Array] = [np.empty(0)] * len(names)
    for population in populations:
        fired = population.fire(histories)
        for k, times in zip(np.flatnonzero(names == population.name), fired.spikes, strict=True):
            spikes[k] = times
    return Response(spikes, float(time[0]), float(time[-1]))


def fields_of(populations: Iterable[Population]) -> tuple[Field, ...]:
    """Return the fields of every trace and those that the drives of populations need.

    Raises StudyError if two fields have the same name.
    """
    found = {field.name: field for field in STANDARD}
    for population in populations:
        for wanted in population.drive.fields:
            if found.setdefault(wanted.name, wanted) != wanted:
                raise StudyError(
                    f"{population.drive.label}: there is another field {wanted.name}: choose "
                    "another name."
                )
    return tuple(found.values())


def replaced(
    populations: Iterable[Population], own: Iterable[Population]
) -> tuple[Population, ...]:
    """Return the populations, with own ones in place of those of the same name.

    Raises StudyError if an own one has no namesake.
    """
    found = {population.name: population for population in populations}
    for population in own:
        if population.name not in found:
            raise StudyError(
                f'The study has no afferents "{population.name}", only {", ".join(found)}.'
            )
        found[population.name] = population
    return tuple(found.values())
