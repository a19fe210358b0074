"""What a fit knows of its parameters, values with their covariance, and forces that they predict.

The logarithm of a force F has the variance ``g C g``, with the covariance C of the parameters'
logarithms x and the slopes ``g = d ln F/dx``: exactly, if F is a product of their powers.
"""

from __future__ import annotations

import json
import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.parameters import Parameter, value_at
from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime.differences import brief
from tactile_fem.runtime.files import write_figure, write_table, write_text
from tactile_fem.runtime.logs import each_once
from tactile_fem.runtime.session import session
from tactile_fem.runtime.text import aligned, read_text
from tactile_fem.simulation import check
from tactile_fem.study import Stimulus, Study, dump_study, keep_files

Array = NDArray[np.float64]

SD_OF_95_PERCENT = float(ndtri(0.975))
_TOLERANCE = 1e-9  # of a covariance, relative: rounding
_PRESSES, _SEED = 4, 1  # which check a prediction, with values drawn from the posterior
_LARGE_ERROR = 0.5  # of a prediction, as a share of the half-width of its band


@dataclass(frozen=True)
class ForcePrediction:
    """Normal force of a fitted finger on a stimulus; print it for a report.

    Attributes
    ----------
    name
        Stimulus and speed of the press.
    depth_mm, force_N, low_N, high_N
        Depths, forces with the fitted values, and the band of 95 % of the posterior of this
        finger's mean force, (n,).
    pressed_N
        Forces with values drawn from the posterior, NaN where a press ended early, (presses, n).
    error
        Largest difference from the slopes' estimates, relative to the band's half-width, (n,).
    """

    name: str
    depth_mm: Array
    force_N: Array
    low_N: Array
    high_N: Array
    pressed_N: Array
    error: Array

    def __str__(self) -> str:
        """Return forces and bands in lines of text."""
        rows = [[self.name], ["depth", "force", "95 % band", "error of the band"]]
        columns = self.depth_mm, self.force_N, self.low_N, self.high_N, self.error
        for depth, force, low, high, error in zip(*columns, strict=True):
            band = f"{low:.4g} to {high:.4g} N"
            rows.append([f"{depth:.2f} mm", f"{force:.4g} N", band, f"{100 * error:.0f} %"])
        text = (
            "The band holds the mean force of this finger with 95 % probability, given the fit;\n"
            "the scatter of single measurements and the error of the model are not in it. Its\n"
            f"error is the largest difference between {len(self.pressed_N)} presses, with values "
            "drawn from the\nposterior, and estimates from the slopes, relative to its half-width."
        )
        if ended := np.isnan(self.pressed_N).any(axis=1).sum():
            text += f"\n{ended} of them ended early and count up to where they did."
        if (self.error > _LARGE_ERROR).any():
            text += "\nThe band is rough: fit fewer parameters, or measure with a second indenter."
        return "\n".join([*aligned(rows), text])


@dataclass(frozen=True)
class Posterior:
    """Parameters of a fit, jointly normal.

    Attributes
    ----------
    parameters
        What was fitted.
    start
        Values that x = 0 stands for, by their keys in the study.
    x
        Mean of the logarithms of the factors, (parameters,).
    covariance
        Covariance of `x`, (parameters, parameters).
    """

    parameters: tuple[Parameter, ...]
    start: dict[tuple[str, ...], float]
    x: Array
    covariance: Array

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

    def predict(
        self,
        study: Study,
        stimulus: Stimulus,
        folder: Path | str,
        *,
        depth_mm: ArrayLike,
        speed_mm_s: float | None = None,
        jobs: int = 1,
    ) -> ForcePrediction:
        """Predict forces of the fitted study's finger, see `Calibration.predict`."""
        from tactile_fem.calibration.model import FINGER_LOGGERS, Model
        from tactile_fem.calibration.press import study_of

        if not isinstance(stimulus, Stimulus):
            raise StudyError(f"stimulus is {stimulus!r} but must be a stimulus such as Plate().")
        depth = np.unique(np.asarray(depth_mm, dtype=float))
        speed = study.protocol.press_speed_mm_s if speed_mm_s is None else speed_mm_s
        for name, given in (("depth_mm", depth), ("speed_mm_s", np.array([speed]))):
            if not (given.size and ((given > 0) & (given < np.inf)).all()):
                raise StudyError(f"{name} is {given} but its numbers must be above 0.")
        fitted = {key: x for k in range(len(self.x)) for key, x in self.mean(k).items()}
        if wrong := [k for k, x in fitted.items() if not np.isclose(value_at(study, k) or 0, x)]:
            raise StudyError(f"{'.'.join(wrong[0])} of the study is not that of the posterior.")
        body = re.sub(r"\S*/", "", brief(stimulus, 200))  # without folders of its files
        name = f"{body} at {speed:g} mm/s".replace(" = ", "=")
        one, lower = np.ones_like(depth), np.linalg.cholesky(self.covariance)
        experiment = Experiment(name, stimulus, speed, depth, np.nan * one, one, one)
        pressed, place = study_of(study, experiment), Path(folder)
        draws = np.random.default_rng(_SEED).normal(size=(_PRESSES, len(lower))) @ lower.T
        with session() as run, each_once(*FINGER_LOGGERS):
            check(pressed)
            model = Model(study, [experiment], self.parameters, place, jobs, run.comm, 0)
            run.lock(place)
            force = model.predictions(here := 0 * self.x)[0].values
            if not (force > 0).all():
                raise TactileError(f"{name}: the fitted finger is not pressed to all the depths.")
            slopes = model.jacobian(here)[: len(depth)] / force[:, None]
            half = SD_OF_95_PERCENT * np.linalg.norm(slopes @ lower, axis=1)
            drawn = [p.values for p in model.predictions(*draws, with_derivatives=False)]
            off = np.nanmax(np.abs(drawn - force * np.exp(draws @ slopes.T)), axis=0)
            band = force * np.exp(-half), force * np.exp(half)
            found = ForcePrediction(
                name, depth, force, *band, np.array(drawn), off / (force * np.sinh(half))
            )
            run.on_root(lambda: self._write(found, pressed, place))
        return found

    def _write(self, found: ForcePrediction, pressed: Study, folder: Path) -> None:
        """Write table and figure of a prediction, and study and posterior that it is made from."""
        stem = re.sub(r"[^\w.=-]+", "_", found.name)[:120]
        write_text(folder / f"{stem}.toml", dump_study(pressed))
        keep_files(pressed, folder, afresh=False)
        self.save(folder / "posterior.json")
        columns = {"depth_mm": found.depth_mm, "force_N": found.force_N}
        columns |= {"least_95_percent": found.low_N, "largest_95_percent": found.high_N}
        columns |= {f"press_{k}_N": values for k, values in enumerate(found.pressed_N, 1)}
        rows = [[f"{x:.5g}" for x in row] for row in np.array([*columns.values()]).T]
        write_table(folder / f"{stem}.csv", [dict(zip(columns, r, strict=True)) for r in rows])
        drawing = Figure(figsize=(4.0, 3.5), layout="constrained")
        axes, ends = drawing.subplots(), np.abs([found.low_N, found.high_N] - found.force_N)
        label = "fitted finger, 95 % of the posterior"
        axes.errorbar(found.depth_mm, found.force_N, ends, fmt="o-", ms=3, capsize=3, label=label)
        dots = axes.plot(found.depth_mm, found.pressed_N.T, "C1.")
        dots[0].set_label("presses with drawn values")
        axes.set(xlabel="Indentation (mm)", ylabel="Normal force (N)")
        axes.set(xlim=(0, 1.05 * found.depth_mm[-1]), ylim=(0, None))
        axes.set_title(textwrap.fill(found.name, 40), fontsize="medium")
        axes.legend(loc="upper left", frameon=False, fontsize="small")
        write_figure(folder / f"{stem}.png", drawing, dpi=150)

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
        write_text(path, json.dumps({"parameters": entries, **rest}, indent=1) + "\n")

    @classmethod
    def load(cls, path: Path, what: str) -> Posterior:
        """Return that of a file; raise StudyError, which begins with `what`, if it has none."""
        text = read_text(path, what)
        try:
            saved = json.loads(text, parse_constant=_refuse)
            parameters, start = [], {}
            for entry in saved["parameters"]:
                powers, own = (_by_keys(entry[name]) for name in ("powers", "start"))
                parameters.append(Parameter(str(entry["name"]), powers, float(entry["factor"])))
                start.update(own)
            x, covariance = (np.array(saved[name], float) for name in ("x", "covariance"))
            if not parameters or any(p.factor <= 1 or not p.powers for p in parameters):
                raise ValueError
        except (ValueError, TypeError, KeyError, AttributeError):
            raise StudyError(f"{what} is no posterior.json as a fit writes it.") from None
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
    if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=_TOLERANCE * np.abs(matrix).max()):
        return False
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
