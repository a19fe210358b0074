"""Fits of the transduction to measured rates."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.drives import checked
from tactile_fem.neuron.rates import Recording, Window, modelled_rates
from tactile_fem.neuron.settings import Neuron
from tactile_fem.neuron.static import intercept_pA

Array = NDArray[Any]
_GAIN, _SHARE, _TIME_S, _FACTOR = (0.0, np.inf), (0.0, 1.0), (1e-3, 1e3), (1e-3, 1e3)
# Constants that may be free, and their bounds.
_BOUNDS: dict[str, tuple[float, float]] = {
    "static_gain_pA_per_kPa": _GAIN,
    "dynamic_gain_pA_s_per_kPa": _GAIN,
    "adaptation": _SHARE,
    "adaptation_time_s": _TIME_S,
    "fast_adaptation": _SHARE,
    "fast_adaptation_time_s": _TIME_S,
    "compression_kPa": (1e-6, np.inf),
    "power": (0.05, 4.0),
    "drive_threshold_kPa": (0.0, np.inf),
    "intercept_pA": (-np.inf, np.inf),
    **{f"generator_gains_pA_per_kPa[{k}]": _GAIN for k in range(4)},
    **{f"generator_times_s[{k}]": _TIME_S for k in range(3)},
}
_GAIN_FACTORS = np.logspace(-2, 2, 17)  # tried before the fit
# Of a named afferent, tried before the fit.
_GAINS, _THRESHOLDS = np.logspace(-2, 1, 10), np.logspace(-0.5, 1, 7)
_CONFIDENCE = 0.95
# Relative step of derivatives. With a small one, a receptor that reaches its rheobase, where the
# rate increases vertically, would dominate the derivative.
_RELATIVE_STEP = 0.02
_LEAST_LEFT = 0.01  # of a current that adapts, for these steps
# Constants are not determined in directions with relatively smaller singular values.
_SMALLEST_SINGULAR_RATIO = 2e-3


class FitWarning(UserWarning):
    """A constant that the data do not determine."""


@dataclass(frozen=True)
class Estimate:
    """A fitted constant with its 95 % interval.

    `doubt` says why the data do not determine it; empty if they do.
    """

    value: float
    low: float
    high: float
    doubt: str = ""


def r_squared(model: NDArray[Any], measured: NDArray[Any]) -> float:
    """Return the coefficient of determination; NaN if all measured values are equal."""
    spread = np.sum((measured - measured.mean()) ** 2)
    return float(1 - np.sum((model - measured) ** 2) / spread) if spread else float("nan")


@dataclass(frozen=True)
class RateFit:
    """Result of `fit`.

    Attributes
    ----------
    neuron
        The constants, fitted ones included.
    estimates
        Estimates by name; of an afferent ``gain of A`` and ``threshold of A``.
    residuals_Hz
        Model less measurement, (receptors,) for each window of each recording.
    r2
        Share of the variance of the rates that the model explains, per window and of all.
    correlation
        Correlation of the estimates, (constants, constants).
    """

    neuron: Neuron
    estimates: dict[str, Estimate]
    residuals_Hz: list[Array]
    r2: tuple[float, ...]
    correlation: Array


def fit(
    recordings: Sequence[Recording],
    neuron: Neuron,
    free: Sequence[str] = ("static_gain_pA_per_kPa", "dynamic_gain_pA_s_per_kPa"),
) -> RateFit:
    """Fit constants of a transduction to mean rates.

    Gain and threshold of each afferent that recordings name are fitted, too. All gains are first
    scaled by one common factor, the best of several; then everything free follows from least
    squares on the deviations in all windows. A `FitWarning` names a constant that has no effect, is
    at its limit, that others can compensate for, or whose interval is wider than its value.

    Parameters
    ----------
    recordings
        Histories and rates.
    neuron
        Model, membrane, the constants that are not fitted, and where the free ones start.
    free
        Names of the constants to fit; of a tuple, ``name[0]``. Bad ones, and bad histories or
        windows, raise StudyError.
    """
    from scipy.optimize import least_squares

    cases = _checked(recordings, neuron, free)
    named = tuple(dict.fromkeys(case.afferent for case in cases if case.afferent))
    varied = _Varied(neuron, tuple(free), named)
    start = varied.start(cases)
    scale = np.where(start == 0, 1.0, np.abs(start))
    bounds = varied.bounds() / scale

    def residuals(x: Array) -> Array:
        return varied.deviations(cases, scale * x)

    def jacobian(x: Array) -> Array:
        step = np.diag(varied.steps(x, scale))
        low, high = np.maximum(x - step, bounds[0]), np.minimum(x + step, bounds[1])
        pairs = zip(low, high, (high - low).sum(axis=1), strict=True)
        return np.column_stack([(residuals(b) - residuals(a)) / width for a, b, width in pairs])

    x = np.clip(start / scale, bounds[0], bounds[1])
    found = least_squares(residuals, x, jacobian, bounds=bounds, x_scale="jac", xtol=1e-10)
    found.x = np.where(found.active_mask, np.where(found.active_mask < 0, *bounds), found.x)
    estimates, correlation = _estimates(varied.names, found, scale)
    for name, estimate in estimates.items():
        if estimate.doubt:
            warnings.warn(f"{name} is not determined: {estimate.doubt}", FitWarning, stacklevel=2)
    windows = [window for case in cases for window in case.windows]
    rates = [np.asarray(window.rate_Hz, dtype=float) for window in windows]
    model = [one for case in cases for one in varied.rates(case, scale * found.x)]
    pairs = [*zip(model, rates, strict=True), (np.concatenate(model), np.concatenate(rates))]
    r2 = tuple(r_squared(*pair) for pair in pairs)
    away = [a - b for a, b in zip(model, rates, strict=True)]
    return RateFit(varied.neuron_with(scale * found.x), estimates, away, r2, correlation)


@dataclass(frozen=True)
class _Varied:
    """What a fit varies: constants of the neuron, then gain and threshold of named afferents."""

    neuron: Neuron
    free: tuple[str, ...]
    afferents: tuple[str, ...]

    @property
    def names(self) -> list[str]:
        own = [f"{what} of {one}" for one in self.afferents for what in ("gain", "threshold")]
        return [*self.free, *own]

    def start(self, cases: Sequence[Recording]) -> Array:
        """Return the best of some common factors of the gains, then of those of each afferent."""
        known = self.neuron.model_copy(update={"intercept_pA": intercept_pA(self.neuron)})
        own = [1.0, 1.0] * len(self.afferents)
        values = np.array([*(_get(known, name) for name in self.free), *own])
        gains = np.array([name in self.free and "gain" in name for name in self.names])
        if gains.any():
            tries = [np.where(gains, factor * values, values) for factor in _GAIN_FACTORS]
            values = self._best(cases, tries)
        for name in self.afferents:
            place = self._place(name)
            parts = values[:place], values[place + 2 :]
            pairs = product(_GAINS, _THRESHOLDS)
            tries = [np.concatenate([parts[0], pair, parts[1]]) for pair in pairs]
            values = self._best([case for case in cases if case.afferent == name], tries)
        return values

    def _best(self, cases: Sequence[Recording], tries: Sequence[Array]) -> Array:
        return min(tries, key=lambda values: float(np.sum(self.deviations(cases, values) ** 2)))

    def _place(self, afferent: str) -> int:
        return len(self.free) + 2 * self.afferents.index(afferent)

    def deviations(self, cases: Sequence[Recording], values: Array) -> Array:
        """Return model less measurement in all windows, in standard deviations."""
        return np.concatenate(
            [
                (model - window.rate_Hz) / window.sd_Hz
                for case in cases
                for model, window in zip(self.rates(case, values), case.windows, strict=True)
            ]
        )

    def bounds(self) -> Array:
        """Return the lower and upper bounds, (2, names)."""
        own = [_FACTOR] * 2 * len(self.afferents)
        return np.array([*(_BOUNDS[name] for name in self.free), *own]).T

    def steps(self, x: Array, scale: Array) -> Array:
        """Return the steps of derivatives by x, (names,): of a share, relative to what is left.

        A current that hardly lasts changes much with a small share of it.
        """
        left = max(self.neuron_with(scale * x).lasting_share, _LEAST_LEFT)
        shares = np.array([_BOUNDS.get(name) == _SHARE for name in self.names])
        return _RELATIVE_STEP * np.where(shares, left / scale, np.maximum(np.abs(x), 0.1))

    def neuron_with(self, values: Array) -> Neuron:
        """Return the median afferent."""
        changed: dict[str, Any] = {}
        for name, value in zip(self.free, values.tolist(), strict=False):
            key, _, place = name.partition("[")
            if place:
                parts = list(changed.get(key, getattr(self.neuron, key)))
                parts[int(place[:-1])] = value
            changed[key] = tuple(parts) if place else value
        return self.neuron.model_copy(update=changed)

    def rates(self, case: Recording, values: Array) -> Array:
        """Return the model's rates in the windows of a recording, (windows, receptors)."""
        gain = threshold = 1.0
        if case.afferent:
            place = self._place(case.afferent)
            gain, threshold = values[place : place + 2].tolist()
        return modelled_rates(case, self.neuron_with(values), gain, threshold)


def _get(neuron: Neuron, name: str) -> float:
    key, _, place = name.partition("[")
    value = getattr(neuron, key)
    return value[int(place[:-1])] if place else value


def _estimates(free: Sequence[str], found: Any, scale: Array) -> tuple[dict[str, Estimate], Array]:
    """Return values with intervals from the linearized model, and their correlations.

    Variances of the residuals may differ, as those of ramp and hold do (MacKinnon and White's HC3).
    """
    from scipy.special import stdtrit

    jacobian, count = found.jac, len(free)
    norms = np.linalg.norm(jacobian, axis=0)
    acting = norms > 1e-9 * max(norms.max(), 1e-300)
    freedom = max(len(found.fun) - count, 1)
    covariance = np.full((count, count), np.inf)
    unit = jacobian[:, acting] / norms[acting]
    singular = np.linalg.svd(unit, compute_uv=False)
    if singular.size and singular[-1] > _SMALLEST_SINGULAR_RATIO * singular[0]:
        pseudo = np.linalg.pinv(unit)
        leverage = np.einsum("ki,ik->i", pseudo, unit)
        spread = pseudo * found.fun / np.maximum(1 - leverage, 1e-6) / norms[acting, None]
        covariance[np.ix_(acting, acting)] = spread @ spread.T
    deviation = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(deviation, deviation)
    reach = stdtrit(freedom, 0.5 + _CONFIDENCE / 2) * deviation
    estimates = {}
    for k, name in enumerate(free):
        value, half = scale[k] * found.x[k], scale[k] * reach[k]
        doubt = _doubt(acting[k], found.active_mask[k], value, half)
        estimates[name] = Estimate(float(value), float(value - half), float(value + half), doubt)
    return estimates, correlation


def _doubt(acts: bool, at_limit: int, value: float, half: float) -> str:
    if not acts:
        return "the rates do not depend on it."
    if at_limit:
        return f"it is at its limit, {value:g}."
    if not np.isfinite(half):
        return "other constants compensate for it."
    if half > abs(value):
        return f"its 95 % interval is {value:.3g} ± {half:.3g}."
    return ""


def _checked(
    recordings: Sequence[Recording], neuron: Neuron, free: Sequence[str]
) -> list[Recording]:
    """Return the recordings as arrays; raise StudyError if there is anything invalid."""
    unknown = [name for name in free if name not in _BOUNDS]
    if unknown or not (free or any(recording.afferent for recording in recordings)):
        raise StudyError(f"fit can free {', '.join(_BOUNDS)}, not {', '.join(unknown) or 'none'}.")
    if not recordings:
        raise StudyError("fit needs a recording.")
    if neuron.threshold_jump_mV:
        raise StudyError("neuron.threshold_jump_mV must be 0: with it the rate has no formula.")
    found = []
    for number, recording in enumerate(recordings):
        name = f"recording {number}"
        time, values = checked(recording.time_s, recording.drive, f"{name}: its drive")
        count = 1 if recording.pooled else values.shape[1]
        if not recording.windows:
            raise StudyError(f"{name} needs a window with rates.")
        for k, window in enumerate(recording.windows):
            if problem := _invalid(window, time, count, neuron):
                raise StudyError(f"{name}, window {k}{problem}")
        found.append(recording._replace(time_s=time, drive=values))
    return found


def _invalid(window: Window, time: Array, count: int, neuron: Neuron) -> str:
    """Return what is wrong with a window, the end of a sentence; empty if it is valid."""
    rate, sd = (np.asarray(values, dtype=float) for values in window[2:])
    if not time[0] <= window.start_s < window.end_s <= time[-1]:
        return (
            f", {window.start_s:g} to {window.end_s:g} s, is not within the history, {time[0]:g} "
            f"to {time[-1]:g} s."
        )
    if rate.shape != (count,) or not np.isfinite(rate).all() or (rate < 0).any():
        return f" needs {count} finite rates from 0 on."
    if sd.shape not in ((), rate.shape) or not np.isfinite(sd).all() or (sd <= 0).any():
        return " needs one sd_Hz above 0, or one for each receptor."
    if neuron.refractory_s and rate.max() >= 1 / neuron.refractory_s:
        return (
            f" has {rate.max():g} spikes/s, which neuron.refractory_s = {neuron.refractory_s:g} s "
            "does not allow."
        )
    return ""
