"""Afferents that a model of another package lets fire, from samples at equal intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.population import Population
from tactile_fem.neuron.response import Response
from tactile_fem.neuron.settings import Neuron

Array = NDArray[Any]
# Takes samples of what is felt, (n, receptors), and their interval, s; returns which of them are
# spikes, (n, receptors).
Spiking = Callable[[Array, float], ArrayLike]
_ROUNDING = 1e-6  # of the number of samples


def no_spikes(felt: Array, step_s: float) -> ArrayLike:
    """Return that nothing fires; a population states its own model."""
    raise StudyError("SampledModel needs a model: a function of samples and their interval.")


@dataclass(frozen=True)
class SampledModel(Population):
    """Afferents whose spikes another model finds; all that follows from spikes is as usual.

    It takes the place of the population of the same name, in a scan as one of
    `tactile_fem.Parts.populations`, or on the histories of a finished one with `fire`.

    Attributes
    ----------
    model
        Called with samples of what the afferents feel, (n, receptors), in the unit of the drive,
        and with their interval, s. It returns which samples are spikes, (n, receptors), as
        booleans or as 0 and 1.
    rate_Hz
        Of the samples, from the first time of the history on; between its times it is linear.
    """

    model: Spiking = no_spikes
    rate_Hz: float = 10_000.0

    def __post_init__(self) -> None:
        """Raise StudyError for a rate that is none, and for what only our own neurons have."""
        if not (np.isfinite(self.rate_Hz) and self.rate_Hz > 0):
            raise StudyError(f"rate_Hz is {self.rate_Hz}; it must be positive.")
        if self.neuron != Neuron() or self.transduction:
            raise StudyError("neuron and transduction would have no effect beside a model.")

    def held(self, held_s: float) -> NoReturn:
        """Raise StudyError: a model begins as it does."""
        raise StudyError(f"The model of {self.name} afferents cannot begin adapted.")

    def accustomed(self, contact_s: float) -> NoReturn:
        """Raise StudyError, as `held`."""
        self.held(contact_s)

    def respond(self, time_s: Array, felt: Array, units: ArrayLike | None = None) -> Response:
        """Return the spikes that the model finds; a number of an afferent means nothing to it."""
        start, end = float(time_s[0]), float(time_s[-1])
        count = int((end - start) * self.rate_Hz + _ROUNDING) + 1
        times = start + np.arange(count) / self.rate_Hz
        sampled = np.empty((len(times), felt.shape[1]))
        for k, one in enumerate(felt.T):
            sampled[:, k] = np.interp(times, time_s, one)
        fired = np.asarray(self.model(sampled, 1 / self.rate_Hz))
        if fired.shape != sampled.shape:
            raise StudyError(
                f"The model of {self.name} afferents returned {fired.shape} values; it needs "
                f"{sampled.shape}, a row per sample and a column per receptor."
            )
        return Response([times[each] for each in fired.astype(bool).T], start, end)
