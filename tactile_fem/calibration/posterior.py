"""What a fit knows of its parameters: values with their covariance, and the file of both."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from tactile_fem.calibration.parameters import Parameter, value_at
from tactile_fem.errors import StudyError
from tactile_fem.runtime.files import write_text
from tactile_fem.runtime.text import read_text
from tactile_fem.runtime.version import UNSTATED, this_version, why_unreadable
from tactile_fem.study import Study

Array = NDArray[np.float64]

SD_OF_95_PERCENT = NormalDist().inv_cdf(0.975)
_TOLERANCE = 1e-9  # of a covariance, relative: rounding


@dataclass(frozen=True)
class Posterior:
    """Parameters of a fit, jointly normal."""

    parameters: tuple[Parameter, ...]  # what was fitted
    start: dict[tuple[str, ...], float]  # values that x = 0 stands for, by their keys in the study
    x: Array  # mean of the logarithms of the factors, (parameters,)
    covariance: Array  # (parameters, parameters)

    @classmethod
    def of(cls, start: Study, parameters: tuple[Parameter, ...], x: Array, cov: Array) -> Posterior:
        """Return that of a fit which began with the study `start`."""
        values = {keys: float(value_at(start, keys)) for p in parameters for keys in p.powers}
        return cls(parameters, values, x, cov)

    def mean(self, parameter: int) -> dict[tuple[str, ...], float]:
        """Return the fitted values of a parameter, by their keys."""
        powers, x = self.parameters[parameter].powers, self.x[parameter]
        return {keys: self.start[keys] * float(np.exp(p * x)) for keys, p in powers.items()}

    @property
    def sd(self) -> Array:
        """Standard deviation of `x`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Of the parameters, (parameters, parameters)."""
        return self.covariance / np.outer(self.sd, self.sd)

    def save(self, path: Path) -> None:
        """Write it as JSON; keys are joined by dots."""
        entries = [
            {
                "name": parameter.name,
                "factor": parameter.factor,
                "powers": {".".join(keys): power for keys, power in parameter.powers.items()},
                "start": {".".join(keys): self.start[keys] for keys in parameter.powers},
            }
            for parameter in self.parameters
        ]
        rest = {"x": self.x.tolist(), "covariance": self.covariance.tolist()}
        write_text(
            path,
            json.dumps({"version": this_version(), "parameters": entries, **rest}, indent=1) + "\n",
        )

    @classmethod
    def load(cls, path: Path, what: str) -> Posterior:
        """Return that of a file; raise StudyError, which begins with `what`, if it has none."""
        text, written_by = read_text(path, what), None
        try:
            saved = json.loads(text, parse_constant=_refuse)
            written_by = saved.get("version", UNSTATED)
            parameters, start = [], {}
            for entry in saved["parameters"]:
                powers, own = (_by_keys(entry[name]) for name in ("powers", "start"))
                parameters.append(Parameter(str(entry["name"]), powers, float(entry["factor"])))
                start.update(own)
            x, covariance = (np.array(saved[name], float) for name in ("x", "covariance"))
            if not parameters or any(p.factor <= 1 or not p.powers for p in parameters):
                raise ValueError
        except (ValueError, TypeError, KeyError, AttributeError):
            why = why_unreadable(written_by)
            raise StudyError(f"{what} is no posterior.json as a fit writes it.{why}") from None
        count = len(parameters)
        if x.shape != (count,) or covariance.shape != (count, count):
            raise StudyError(f"{what} has {count} parameters, but x or covariance of another size.")
        if not _is_covariance(covariance):
            raise StudyError(f"{what}: its covariance is not symmetric and positive definite.")
        if missing := {key for p in parameters for key in p.powers} - start.keys():
            raise StudyError(f"{what} lacks the start of {'.'.join(min(missing))}.")
        return cls(tuple(parameters), start, x, covariance)


def _refuse(constant: str) -> None:
    raise ValueError(constant)


def _by_keys(values: dict[str, float]) -> dict[tuple[str, ...], float]:
    return {tuple(dotted.split(".")): float(value) for dotted, value in values.items()}


def _is_covariance(matrix: Array) -> bool:
    rounding = _TOLERANCE * np.abs(matrix).max()
    is_symmetric = np.allclose(matrix, matrix.T, rtol=1e-6, atol=rounding)
    return is_symmetric and bool(np.linalg.eigvalsh(matrix)[0] > 0)
