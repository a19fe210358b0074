"""Fits the constants of the transduction to firing rates that were measured."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from tactile_fem.errors import StudyError
from tactile_fem.neuron.drives import checked_sed
from tactile_fem.neuron.transduction import intercept_pA, transduction_of
from tactile_fem.study import Neuron

Array = NDArray[Any]
Constant = Literal[
    "static_gain_pA_per_kPa",
    "dynamic_gain_pA_s_per_kPa",
    "adaptation",
    "adaptation_time_s",
    "intercept_pA",
]
_BOUNDS: dict[str, tuple[float, float]] = {
    "static_gain_pA_per_kPa": (0.0, np.inf),
    "dynamic_gain_pA_s_per_kPa": (0.0, np.inf),
    "adaptation": (0.0, 1.0),
    "adaptation_time_s": (1e-3, 1e3),
    "intercept_pA": (-np.inf, np.inf),
}
_MOMENTS = 200  # per window, at which the current is taken
_CONFIDENCE = 0.95
# Relative step of derivatives: with a small one, a receptor that comes to its rheobase, where the
# rate rises vertically, would make up all of the derivative.
_STEP = 0.02
# Directions of the constants in which the rates change less than this, relatively, are none.
_SINGULAR = 2e-3


class FitWarning(UserWarning):
    """A constant that the data do not determine."""


class Window(NamedTuple):
    """A stretch of time and the mean rates in it.

    Attributes
    ----------
    start_s, end_s
        Begin and end, s.
    rate_Hz
        Spikes/s, (receptors,).
    """

    start_s: float
    end_s: float
    rate_Hz: ArrayLike


@dataclass(frozen=True)
class Estimate:
    """A fitted constant with its 95 % confidence interval.

    `doubt` says why the data do not determine it; empty if they do.
    """

    value: float
    low: float
    high: float
    doubt: str


@dataclass(frozen=True)
class Fit:
    """What a fit gives.

    Attributes
    ----------
    neuron
        The constants, the fitted ones in their places.
    estimates
        By name.
    residuals_Hz
        Model less measurement, (windows, receptors).
    r2
        Share of the variance of the rates that the model explains, per window and of all.
    correlation
        Of the estimates, (constants, constants).
    """

    neuron: Neuron
    estimates: dict[str, Estimate]
    residuals_Hz: Array
    r2: tuple[float, ...]
    correlation: Array


def fit(
    time_s: ArrayLike,
    sed_kPa: ArrayLike,
    windows: Sequence[Window],
    neuron: Neuron,
    free: Sequence[Constant] = ("static_gain_pA_per_kPa", "dynamic_gain_pA_s_per_kPa"),
) -> Fit:
    """Fit constants of "hamasaki2020" to mean rates.

    After Hamasaki et al. (2020): the rates of the last window are turned into currents by
    inverting the membrane's rate, and these, less the intercept, are regressed on the strain
    energy density: that is where the static gain starts from. Then all free constants follow
    from least squares on the rates of all windows.

    Parameters
    ----------
    time_s, sed_kPa
        History, s (t,) and kPa (t, receptors), as `tactile_fem.neuron.respond` takes it.
    windows
        Measured rates; the last window should lie in a hold.
    neuron
        Membrane, the constants that stay, and where the free ones start.
    free
        Names of the constants to fit.

    Raises
    ------
    StudyError
        Bad history, windows or names.

    Warns
    -----
    FitWarning
        A constant is not determined: it does nothing, stands at its limit, can be made up for
        by others, or its interval is wider than its value.
    """
    time, sed = checked_sed(time_s, sed_kPa)
    _check(windows, time, sed, neuron, free)
    measured = np.array([window.rate_Hz for window in windows], dtype=float)
    known = neuron.model_copy(update={"intercept_pA": intercept_pA(neuron)})
    start = {name: getattr(known, name) for name in free}
    if "static_gain_pA_per_kPa" in start:
        start["static_gain_pA_per_kPa"] = _regression(time, sed, windows[-1], neuron)
    scale = np.array([abs(value) or 1.0 for value in start.values()])

    def residuals(x: Array) -> Array:
        model = neuron.model_copy(update=dict(zip(free, (scale * x).tolist(), strict=True)))
        return (mean_rates(time, sed, windows, model) - measured).ravel()

    bounds = np.array([_BOUNDS[name] for name in free]).T / scale

    def jacobian(x: Array) -> Array:
        step = np.diag(_STEP * np.maximum(np.abs(x), 0.1))
        low, high = np.maximum(x - step, bounds[0]), np.minimum(x + step, bounds[1])
        ends = zip(low, high, (high - low).sum(axis=1), strict=True)
        return np.column_stack([(residuals(b) - residuals(a)) / width for a, b, width in ends])

    x = np.clip(np.array(list(start.values())) / scale, bounds[0], bounds[1])
    found = least_squares(residuals, x, jacobian, bounds=bounds, x_scale="jac", xtol=1e-10)
    found.x = np.where(found.active_mask, np.where(found.active_mask < 0, *bounds), found.x)
    estimates, correlation = _estimates(free, found, scale)
    for name, estimate in estimates.items():
        if estimate.doubt:
            warnings.warn(f"{name} is not determined: {estimate.doubt}", FitWarning, stacklevel=2)
    values = {name: estimate.value for name, estimate in estimates.items()}
    off = found.fun.reshape(measured.shape)
    r2 = tuple(_r2(o, m) for o, m in [*zip(off, measured, strict=True), (off, measured)])
    return Fit(neuron.model_copy(update=values), estimates, off, r2, correlation)


def mean_rates(time_s: Array, sed_kPa: Array, windows: Sequence[Window], neuron: Neuron) -> Array:
    """Return the model's mean rates, spikes/s, (windows, receptors).

    The membrane's steady rate at the present current, averaged over the window: what many
    trials with irregular spikes tend to.
    """
    share = (np.arange(_MOMENTS) + 0.5) / _MOMENTS
    at = np.concatenate([w.start_s + share * (w.end_s - w.start_s) for w in windows])
    order = np.argsort(at, kind="stable")
    rates = np.empty((len(at), sed_kPa.shape[1]))
    rates[order] = rate_of(current_at(at[order], time_s, sed_kPa, neuron), neuron)
    return rates.reshape(len(windows), _MOMENTS, -1).mean(axis=1)


def rate_of(current_pA: ArrayLike, neuron: Neuron) -> Array:
    """Return the rate, spikes/s, at which a constant current, pA, makes the membrane fire.

    f = 1 / (t_ref - tau ln(1 - V_th/(R I))) above the rheobase V_th/R, otherwise 0.
    """
    drive = np.asarray(current_pA, dtype=float) * neuron.resistance_GOhm
    with np.errstate(divide="ignore", invalid="ignore"):
        interval = neuron.refractory_s - neuron.time_constant_s * np.log1p(
            -neuron.threshold_mV / drive
        )
        return np.where(drive > neuron.threshold_mV, 1 / interval, 0.0)


def current_of(rate_Hz: ArrayLike, neuron: Neuron) -> Array:
    """Return the constant current, pA, that fires at a rate, spikes/s; the rheobase for 0.

    I = (V_th/R) / (1 - exp(-(1/f - t_ref)/tau)); infinite from 1/t_ref on.
    """
    with np.errstate(divide="ignore"):
        wait = np.maximum(1 / np.asarray(rate_Hz, dtype=float) - neuron.refractory_s, 0.0)
        charged = -np.expm1(-wait / neuron.time_constant_s)
        return neuron.threshold_mV / neuron.resistance_GOhm / charged


def current_at(at_s: Array, time_s: Array, sed_kPa: Array, neuron: Neuron) -> Array:
    """Return the transduction current, pA, (times, receptors), at times within a history.

    At a jump the later value counts. The history is as in `tactile_fem.neuron.respond`.
    """
    result = np.zeros((len(at_s), sed_kPa.shape[1]))
    columns = np.arange(sed_kPa.shape[1])
    for start, length, current, who in transduction_of(neuron).segments(time_s, sed_kPa):
        begin, end = np.broadcast_arrays(start, start + length)
        rows = np.flatnonzero((at_s >= np.min(begin)) & (at_s <= np.max(end)))
        if rows.size:
            at = at_s[rows, None]
            place = np.ix_(rows, columns[who])
            value = current.at(np.clip(at - begin, 0.0, length))
            result[place] = np.where((at >= begin) & (at <= end), value, result[place])
    return result


def _regression(time: Array, sed: Array, hold: Window, neuron: Neuron) -> float:
    """Return the slope of current less intercept on strain energy density, through zero."""
    excess = current_of(hold.rate_Hz, neuron) - intercept_pA(neuron)
    at = np.linspace(hold.start_s, hold.end_s, _MOMENTS)
    felt = np.mean([np.interp(at, time, column) for column in sed.T], axis=1)
    slope = felt @ excess / (felt @ felt)
    return float(slope) if np.isfinite(slope) and slope > 0 else neuron.static_gain_pA_per_kPa


def _estimates(
    free: Sequence[Constant], found: Any, scale: Array
) -> tuple[dict[str, Estimate], Array]:
    """Return values with intervals from the linearized model, and their correlations.

    The residuals' variances may differ (MacKinnon and White's HC3): ramp and hold do.
    """
    jacobian, count = found.jac, len(free)
    norms = np.linalg.norm(jacobian, axis=0)
    acting = norms > 1e-9 * max(norms.max(), 1e-300)
    freedom = max(len(found.fun) - count, 1)
    covariance = np.full((count, count), np.inf)
    unit = jacobian[:, acting] / norms[acting]
    singular = np.linalg.svd(unit, compute_uv=False)
    if singular.size and singular[-1] > _SINGULAR * singular[0]:
        pseudo = np.linalg.pinv(unit)
        leverage = np.einsum("ki,ik->i", pseudo, unit)
        spread = pseudo * found.fun / np.maximum(1 - leverage, 1e-6) / norms[acting, None]
        covariance[np.ix_(acting, acting)] = spread @ spread.T
    deviation = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(deviation, deviation)
    reach = student.ppf(0.5 + _CONFIDENCE / 2, freedom) * deviation
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
        return f"it stands at its limit, {value:g}."
    if not np.isfinite(half):
        return "other constants make up for it."
    if half > abs(value):
        return f"its 95 % interval is {value:.3g} ± {half:.3g}."
    return ""


def _r2(off: Array, measured: Array) -> float:
    spread = np.sum((measured - measured.mean()) ** 2)
    return float(1 - np.sum(off**2) / spread) if spread else float("nan")


def _check(
    windows: Sequence[Window], time: Array, sed: Array, neuron: Neuron, free: Sequence[Constant]
) -> None:
    if neuron.model != "hamasaki2020":
        raise StudyError(f"fit takes a neuron of the model hamasaki2020, not {neuron.model}.")
    unknown = [name for name in free if name not in _BOUNDS]
    if unknown or not free:
        raise StudyError(f"fit can free {', '.join(_BOUNDS)}, not {', '.join(unknown) or 'none'}.")
    if not windows:
        raise StudyError("fit needs a window with rates.")
    for k, window in enumerate(windows):
        rate = np.asarray(window.rate_Hz, dtype=float)
        if not time[0] <= window.start_s < window.end_s <= time[-1]:
            raise StudyError(
                f"window {k}, {window.start_s:g} to {window.end_s:g} s, is not within the history, "
                f"{time[0]:g} to {time[-1]:g} s."
            )
        if rate.shape != (sed.shape[1],) or not np.isfinite(rate).all() or (rate < 0).any():
            raise StudyError(f"window {k} needs {sed.shape[1]} finite rates from 0 on.")
        if neuron.refractory_s and rate.max() >= 1 / neuron.refractory_s:
            raise StudyError(
                f"window {k} has {rate.max():g} spikes/s, which neuron.refractory_s = "
                f"{neuron.refractory_s:g} s does not allow."
            )
