"""Populations of afferents: what they feel, how they transduce it, and their membranes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.afferent import fire
from tactile_fem.neuron.drives import Drive, Histories, drive_of
from tactile_fem.neuron.response import Response
from tactile_fem.neuron.transduction import Transduction, transduction_of
from tactile_fem.study import DEFAULT_NAME, Afferents, Neuron, Study

Array = NDArray[Any]


@dataclass(frozen=True)
class Population:
    """Afferents of one kind.

    Attributes
    ----------
    name
        As in the study.
    neuron
        Constants of transduction and membrane, whose gains are per unit of what is felt.
    feels
        A drive, or the name of one, see `tactile_fem.neuron.drives.drive_of`.
    transduction
        A model of your own; default the one that `neuron` names. `gain_spread` multiplies the
        drive of an afferent by its factor.
    """

    name: str = DEFAULT_NAME
    neuron: Neuron = field(default_factory=Neuron)
    feels: str | Drive = "sed"
    transduction: Transduction | None = None

    @classmethod
    def of(cls, afferents: Afferents) -> Population:
        """Return the population that a study describes."""
        return cls(afferents.name, afferents.neuron, afferents.feels)

    @property
    def drive(self) -> Drive:
        """What it feels."""
        return drive_of(self.feels) if isinstance(self.feels, str) else self.feels

    def fire(self, histories: Histories) -> Response:
        """Return the spikes of the population's afferents.

        Parameters
        ----------
        histories
            Arrays of a trace. Where it has ``population`` (receptors,), names, the receptors of
            this name fire; otherwise all do. Their numbers, which random numbers belong to, count
            from 0 within the population, so it fires as it would alone.

        Raises
        ------
        StudyError
            As `tactile_fem.neuron.respond`, and of the drive.
        """
        time, felt = self.drive.of(histories)
        if "population" in histories:
            felt = felt[:, histories["population"] == self.name]
        return self.respond(time, felt)

    def respond(self, time_s: Array, felt: Array) -> Response:
        """Return the spikes that what is felt, (t, receptors), evokes at increasing times (t,)."""
        transduction = self.transduction or transduction_of(self.neuron)
        return fire(time_s, felt, self.neuron, transduction)


def fire_all(populations: Iterable[Population], histories: Histories) -> Response:
    """Return the spikes of the receptors of all populations, in the order of the receptors."""
    names, time = histories["population"], histories["time_s"]
    spikes: list[Array] = [np.empty(0)] * len(names)
    for population in populations:
        fired = population.fire(histories)
        for k, times in zip(np.flatnonzero(names == population.name), fired.spikes, strict=True):
            spikes[k] = times
    return Response(spikes, float(time[0]), float(time[-1]))


def populations_of(study: Study, own: Sequence[Population] = ()) -> tuple[Population, ...]:
    """Return the study's populations, those of your own in the place of their namesakes.

    Raises
    ------
    StudyError
        A population of your own is none of the study's, or a drive is not known.
    """
    found = {afferents.name: Population.of(afferents) for afferents in study.populations}
    for population in own:
        if population.name not in found:
            raise StudyError(
                f'The study has no afferents "{population.name}", only {", ".join(found)}.'
            )
        found[population.name] = population
    for population in found.values():
        try:
            _ = population.drive
        except StudyError as error:
            raise StudyError(f"afferents.{population.name}.feels: {error}") from None
    return tuple(found.values())
