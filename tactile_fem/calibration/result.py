"""What a calibration has found: constants with intervals, agreement, and both in words."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc

from tactile_fem.calibration.measurements import Experiment, deviations
from tactile_fem.calibration.parameters import Parameter, unit_of, value_at
from tactile_fem.calibration.posterior import SD_OF_95_PERCENT, Posterior
from tactile_fem.neuron import Estimate, r_squared
from tactile_fem.runtime.text import aligned
from tactile_fem.study import Stimulus, Study

if TYPE_CHECKING:
    from tactile_fem.calibration.prediction import ForcePrediction

Array = NDArray[np.float64]

# Share of the variance that the measurements must take away to call a parameter identified.
_IDENTIFIED_SHARE = 0.5
# Probability below which the deviations are not only the measurements'.
_SMALLEST_PROBABILITY = 0.01
_STRONG_CORRELATION = 0.7


@dataclass(frozen=True)
class Calibration:
    """Result of `tactile_fem.fit`.

    Attributes
    ----------
    start, study
        The study before, and with the fitted values.
    parameters, experiments
        What was fitted to what.
    x
        Logarithm of the ratio of each parameter to its start, (parameters,).
    predicted
        The model's numbers at `x`, an array for each experiment.
    curves
        Depth in mm and normal force in N at each step of the fitted finger's presses, (steps, 2).
    jacobian
        Derivatives of all numbers, in their standard deviations, (numbers, parameters).
    evaluations, converged
        Points that the optimizer tried; whether it ended before their limit.
    folder
        Folder of the fit.
    """

    start: Study
    study: Study
    parameters: tuple[Parameter, ...]
    experiments: tuple[Experiment, ...]
    x: Array
    predicted: tuple[Array, ...]
    curves: tuple[Array, ...]
    jacobian: Array
    evaluations: int
    converged: bool
    folder: Path

    @property
    def deviations(self) -> Array:
        """Model less measurement, in standard deviations, (numbers,)."""
        return deviations(self.experiments, self.predicted)

    @property
    def squares(self) -> float:
        """The sum that was minimized: of the numbers' deviations and the parameters' changes."""
        return float(np.sum(self.deviations**2) + np.sum((self.x / self._prior_sd) ** 2))

    @property
    def probability(self) -> float:
        """Probability of so large a sum if the standard deviations of the input are right.

        The least sum of a linear model follows chi squared with one degree of freedom for each
        measured number: each parameter adds a square and removes a degree.
        """
        return float(chdtrc(len(self.deviations), self.squares))

    @property
    def _prior_sd(self) -> Array:
        return np.array([parameter.sd for parameter in self.parameters])

    @property
    def covariance(self) -> Array:
        """Of `x`, (parameters, parameters).

        It assumes independent deviations, which those of one finger are not, with known and normal
        distributions.
        """
        return np.linalg.inv(self.jacobian.T @ self.jacobian + np.diag(1 / self._prior_sd**2))

    @property
    def sd(self) -> Array:
        """Standard deviation of `x`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def learnt(self) -> Array:
        """Share of the variance that the measurements take away: 0 nothing, 1 all is known."""
        return 1 - (self.sd / self._prior_sd) ** 2

    @property
    def correlation(self) -> Array:
        """Of the parameters, (parameters, parameters)."""
        return self.covariance / np.outer(self.sd, self.sd)

    @property
    def posterior(self) -> Posterior:
        """What is known of the parameters, to be written into a file."""
        return Posterior.of(self.start, self.parameters, self.x, self.covariance)

    @property
    def influence(self) -> Array:
        """Change of `x`, in its deviations, by one of a measured number, (numbers, parameters)."""
        return (self.jacobian @ self.covariance) / self.sd

    def estimate(self, k: int, start: float, power: float = 1.0) -> Estimate:
        """Return the estimate of a value that parameter k multiplies by ``exp(power x)``."""
        ends = self.x[k] + SD_OF_95_PERCENT * self.sd[k] * np.array([-1, 0, 1])
        low, value, high = np.sort(start * np.exp(power * ends)).tolist()
        known = self.learnt[k] >= _IDENTIFIED_SHARE
        return Estimate(value, low, high, "" if known else "not identified")

    def constants(self) -> dict[str, Estimate]:
        """Return the estimate of each value of the study that a parameter changes, by its key."""
        return {
            ".".join(keys): self.estimate(k, value_at(self.start, keys), power)
            for k, parameter in enumerate(self.parameters)
            for keys, power in parameter.powers.items()
        }

    def predict(
        self, stimulus: Stimulus, *, depth_mm: ArrayLike, **options: Any
    ) -> ForcePrediction:
        """Predict forces of this finger on another stimulus, with the uncertainty of the fit.

        Parameters
        ----------
        stimulus
            Any, such as ``Sphere(radius_mm=4.0)``.
        depth_mm
            One or more depths of a press.
        **options
            ``speed_mm_s``, default that of the study's protocol; ``folder`` for presses, table and
            figure, default ``predictions`` in that of the fit; ``jobs`` as of a fit.
        """
        from tactile_fem.calibration.prediction import predict  # imports this module

        options.setdefault("folder", self.folder / "predictions")
        return predict(self.posterior, self.study, stimulus, depth_mm=depth_mm, **options)

    def __str__(self) -> str:
        """Return the result in lines of text."""
        rows = [["constant", "value", "unit", "95 % interval", "start"]]
        for k, parameter in enumerate(self.parameters):
            rows += self._rows_of(k, parameter)
        lines = aligned(rows)
        names = [p.name for p in self.parameters]
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
            if abs(r := self.correlation[i, j]) > _STRONG_CORRELATION:
                lines.append(f"correlation of {names[i]} and {names[j]} {r:+.2f}")
        for experiment, values in zip(self.experiments, self.predicted, strict=True):
            lines += _agreement(experiment, values)
        lines.append(
            f"sum of squares {self.squares:.4g}, {len(self.deviations)} numbers, "
            f"{self.evaluations} points"
        )
        if not self.converged:
            lines.append("not converged: allow more points; no press is repeated")
        if self.probability < _SMALLEST_PROBABILITY:
            lines.append(
                "the model is farther from the measurements than their standard deviations allow: "
                "the intervals are too narrow"
            )
        return "\n".join(lines)

    def _rows_of(self, k: int, parameter: Parameter) -> list[list[str]]:
        """Return the constants of a parameter; before several of them, their factor."""
        rows, indent = [], ""
        if len(parameter.powers) > 1:
            factor, indent = self.estimate(k, 1.0), "  "
            words = f"{parameter.name}: {parameter.multiplied} times {factor.value:.3g}"
            rows.append([f"{words} ({factor.low:.3g} to {factor.high:.3g})"])
        for keys, power in parameter.powers.items():
            start = value_at(self.start, keys)
            e = self.estimate(k, start, power)
            name = indent + ".".join(keys).removeprefix("tissue.")
            interval = f"{e.low:.3g} to {e.high:.3g}"
            rows.append([name, f"{e.value:.4g}", unit_of(keys), interval, f"{start:.4g}", e.doubt])
        return rows


def _agreement(experiment: Experiment, values: Array) -> list[str]:
    force, error = experiment.is_force, values - experiment.mean
    lines = [experiment.name + (f": {experiment.origin}" if experiment.origin else "")]
    for k in np.flatnonzero(force):
        lines.append(
            f"{experiment.depth_mm[k]:8.2f} mm  {values[k]:7.4f} N  measured "
            f"{experiment.mean[k]:.4f} ({experiment.sd[k]:.4f})  "
            f"{error[k] / experiment.sd[k]:+.2f} sd"
        )
    if not force.all():
        r2, off = r_squared(values[~force], experiment.mean[~force]), error[~force]
        rms, worst = np.sqrt(np.mean(off**2)), off[np.argmax(np.abs(off))]
        lines.append(f"   profile: R2 {r2:.4f}, rms {rms:.4f} mm, worst {worst:+.3f} mm")
    return lines
