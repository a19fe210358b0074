"""Mean firing rates without spikes, and fits of the transduction to measured rates."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_fem.errors import StudyError
from tactile_fem.neuron.drives import checked
from tactile_fem.neuron.settings import Neuron
from tactile_fem.neuron.transduction import intercept_pA, transduction_of
from tactile_fem.runtime.estimates import Estimate, r_squared

Array = NDArray[Any]
_GAIN, _SHARE, _TIME_S = (0.0, np.inf), (0.0, 1.0), (1e-3, 1e3)
# Constants that may be free, and their bounds.
_BOUNDS: dict[str, tuple[float, float]] = {
    "static_gain_pA_per_kPa": _GAIN,
    "dynamic_gain_pA_s_per_kPa": _GAIN,
    "adaptation": _SHARE,
    "adaptation_time_s": _TIME_S,
    "fast_adaptation": _SHARE,
    "fast_adaptation_time_s": _TIME_S,
    "compression_kPa": (1e-6, np.inf),
    "intercept_pA": (-np.inf, np.inf),
    **{f"generator_gains_pA_per_kPa[{k}]": _GAIN for k in range(4)},
    **{f"generator_times_s[{k}]": _TIME_S for k in range(3)},
}
_GAIN_FACTORS = np.logspace(-2, 2, 17)  # tried before the fit
_SAMPLES_PER_WINDOW = 200  # of a window, at which the current is evaluated
_CONFIDENCE = 0.95
# Relative step of derivatives. With a small one, a receptor that reaches its rheobase, where the
# rate increases vertically, would dominate the derivative.
_RELATIVE_STEP = 0.02
# Constants are not determined in directions with relatively smaller singular values.
_SMALLEST_SINGULAR_RATIO = 2e-3


class FitWarning(UserWarning):
    """A constant that the data do not determine."""


class Window(NamedTuple):
    """A stretch of time and the mean rates in it."""

    start_s: float
    end_s: float
    rate_Hz: ArrayLike  # spikes/s, (receptors,)
    sd_Hz: ArrayLike = 1.0  # standard deviation of the rates, a number or (receptors,)


class Recording(NamedTuple):
    """Drive of the receptors in an experiment, and measured rates of their afferents."""

    time_s: ArrayLike  # (t,)
    drive: ArrayLike  # (t, receptors), for example in kPa
    windows: Sequence[Window]


@dataclass(frozen=True)
class RateFit:
    """Result of `fit`.

    Attributes
    ----------
    neuron
        The constants, fitted ones included.
    estimates
        By name.
    residuals_Hz
        Model less measurement, (receptors,) for each window of each recording.
    r2
        Share of the variance of the rates that the model explains, per window and of all.
    correlation
        Of the estimates, (constants, constants).
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

    All gains are first scaled by one common factor, the best of several; then all free constants
    follow from least squares on the deviations in all windows. A `FitWarning` names a constant
    that has no effect, is at its limit, that others can compensate for, or whose interval is wider
    than its value.

    Parameters
    ----------
    recordings
        Histories and rates.
    neuron
        Model, membrane, the constants that are not fitted, and where the free ones start.
    free
        Names of the constants to fit; of a tuple, ``name[0]``.

    Raises
    ------
    StudyError
        Bad history, windows or names.
    """
    from scipy.optimize import least_squares

    cases = _checked(recordings, neuron, free)
    windows = [window for case in cases for window in case[2]]
    rates = [np.asarray(window.rate_Hz, dtype=float) for window in windows]
    measured, ends = np.concatenate(rates), np.cumsum([len(rate) for rate in rates])[:-1]
    sd = np.concatenate(
        [np.broadcast_to(w.sd_Hz, rate.shape) for w, rate in zip(windows, rates, strict=True)]
    )
    known = neuron.model_copy(update={"intercept_pA": intercept_pA(neuron)})
    start = np.array([_get(known, name) for name in free], dtype=float)
    scale = np.where(start == 0, 1.0, np.abs(start))
    bounds = np.array([_BOUNDS[name] for name in free]).T / scale

    def modelled(x: Array) -> Array:
        model = _with(neuron, free, scale * x)
        return np.concatenate([mean_rates(*case, model).ravel() for case in cases])

    def residuals(x: Array) -> Array:
        return (modelled(x) - measured) / sd

    def jacobian(x: Array) -> Array:
        step = np.diag(_RELATIVE_STEP * np.maximum(np.abs(x), 0.1))
        low, high = np.maximum(x - step, bounds[0]), np.minimum(x + step, bounds[1])
        pairs = zip(low, high, (high - low).sum(axis=1), strict=True)
        return np.column_stack([(residuals(b) - residuals(a)) / width for a, b, width in pairs])

    x = np.clip(start / scale, bounds[0], bounds[1])
    gains = np.array(["gain" in name for name in free])
    tries = [np.where(gains, factor * x, x) for factor in (_GAIN_FACTORS if gains.any() else [1.0])]
    x = min(tries, key=lambda x: float(np.sum(residuals(x) ** 2)))
    found = least_squares(residuals, x, jacobian, bounds=bounds, x_scale="jac", xtol=1e-10)
    found.x = np.where(found.active_mask, np.where(found.active_mask < 0, *bounds), found.x)
    estimates, correlation = _estimates(free, found, scale)
    for name, estimate in estimates.items():
        if estimate.doubt:
            warnings.warn(f"{name} is not determined: {estimate.doubt}", FitWarning, stacklevel=2)
    model = modelled(found.x)
    pairs = [*zip(np.split(model, ends), rates, strict=True), (model, measured)]
    fitted = _with(neuron, free, [estimate.value for estimate in estimates.values()])
    r2 = tuple(r_squared(*pair) for pair in pairs)
    return RateFit(fitted, estimates, np.split(model - measured, ends), r2, correlation)


def mean_rates(time_s: Array, drive: Array, windows: Sequence[Window], neuron: Neuron) -> Array:
    """Return the mean rates of the model, spikes/s, (windows, receptors).

    They are the steady rate of the membrane at the present current, averaged over the window: the
    limit of many trials with irregular spikes.
    """
    share = (np.arange(_SAMPLES_PER_WINDOW) + 0.5) / _SAMPLES_PER_WINDOW
    at = np.concatenate([w.start_s + share * (w.end_s - w.start_s) for w in windows])
    order = np.argsort(at, kind="stable")
    rates = np.empty((len(at), drive.shape[1]))
    rates[order] = rate_of(current_at(at[order], time_s, drive, neuron), neuron)
    return rates.reshape(len(windows), _SAMPLES_PER_WINDOW, -1).mean(axis=1)


def rate_of(current_pA: ArrayLike, neuron: Neuron) -> Array:
    """Return the rate, spikes/s, at which a constant current, pA, makes the membrane fire.

    f = 1 / (t_ref - tau ln(1 - V_th/(R I))) above the rheobase V_th/R, otherwise 0.
    """
    limit_mV = np.asarray(current_pA, dtype=float) * neuron.resistance_GOhm
    with np.errstate(divide="ignore", invalid="ignore"):
        interval = neuron.refractory_s - neuron.time_constant_s * np.log1p(
            -neuron.threshold_mV / limit_mV
        )
        return np.where(limit_mV > neuron.threshold_mV, 1 / interval, 0.0)


def current_at(at_s: Array, time_s: Array, drive: Array, neuron: Neuron) -> Array:
    """Return the transduction current, pA, (times, receptors), at times within a history.

    At a jump it is the later value. The history is as in `tactile_fem.neuron.respond`.
    """
    result = np.zeros((len(at_s), drive.shape[1]))
    columns = np.arange(drive.shape[1])
    for start, length, current, who in transduction_of(neuron).segments(time_s, drive):
        begin, end = np.broadcast_arrays(start, start + length)
        rows = np.flatnonzero((at_s >= np.min(begin)) & (at_s <= np.max(end)))
        if rows.size:
            at = at_s[rows, None]
            place = np.ix_(rows, columns[who])
            value = current.at(np.clip(at - begin, 0.0, length))
            result[place] = np.where((at >= begin) & (at <= end), value, result[place])
    return result


def _get(neuron: Neuron, name: str) -> float:
    key, _, place = name.partition("[")
    value = getattr(neuron, key)
    return value[int(place[:-1])] if place else value


def _with(neuron: Neuron, names: Sequence[str], values: Iterable[float]) -> Neuron:
    """Return the neuron with other values of some constants."""
    changed: dict[str, Any] = {}
    for name, value in zip(names, values, strict=True):
        key, _, place = name.partition("[")
        if place:
            parts = list(changed.get(key, getattr(neuron, key)))
            parts[int(place[:-1])] = float(value)
            changed[key] = tuple(parts)
        else:
            changed[key] = float(value)
    return neuron.model_copy(update=changed)


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
) -> list[tuple[Array, Array, Sequence[Window]]]:
    """Return the recordings' arrays; raise StudyError if there is anything invalid."""
    unknown = [name for name in free if name not in _BOUNDS]
    if unknown or not free:
        raise StudyError(f"fit can free {', '.join(_BOUNDS)}, not {', '.join(unknown) or 'none'}.")
    if not recordings:
        raise StudyError("fit needs a recording.")
    if neuron.threshold_jump_mV:
        raise StudyError("neuron.threshold_jump_mV must be 0: with it the rate has no formula.")
    found = []
    for number, (time_s, drive, windows) in enumerate(recordings):
        name = f"recording {number}"
        time, values = checked(time_s, drive, f"{name}: its drive")
        if not windows:
            raise StudyError(f"{name} needs a window with rates.")
        for k, window in enumerate(windows):
            if problem := _invalid(window, time, values.shape[1], neuron):
                raise StudyError(f"{name}, window {k}{problem}")
        found.append((time, values, windows))
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
