"""Tables, figures and the study file of a calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_fem.calibration.calibrate import Calibration
from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.model import squares_in_words
from tactile_fem.calibration.parameters import unit_of, value_at
from tactile_fem.runtime.estimates import Estimate, r_squared
from tactile_fem.runtime.files import write_figure, write_table, write_text
from tactile_fem.study.file import dump_study
from tactile_fem.study.kept import keep_files

Row = dict[str, str | float]

_SMALLEST_PROBABILITY = (
    0.01  # probability below which the deviations are not only the measurements'
)
_STRONG_CORRELATION = 0.7
_BLUE, _ORANGE = "#0072B2", "#D55E00"


def write_results(found: Calibration, folder: Path) -> None:
    """Write ``study.toml``, tables and the figure of a calibration into its folder.

    ``parameters.csv`` (values, 95 % intervals), ``constants.csv`` (each value of the study that
    they change), ``correlation.csv``, ``predicted.csv`` (model and measurement), ``pulls.csv``
    (influence of each measurement) and ``fit.png``.
    """
    write_text(folder / "study.toml", dump_study(found.study))
    keep_files(found.study, folder, afresh=True)
    names = [p.name for p in found.parameters]
    correlation = [
        {"parameter": name, **dict(zip(names, _rounded(row), strict=True))}
        for name, row in zip(names, found.correlation, strict=True)
    ]
    pulls = [
        {**_place(e, k), **dict(zip(names, _rounded(row), strict=True))}
        for (e, k), row in zip(_numbers(found), found.influence, strict=True)
    ]
    write_table(folder / "parameters.csv", parameters_table(found))
    write_table(folder / "constants.csv", constants_table(found))
    write_table(folder / "correlation.csv", correlation)
    write_table(folder / "predicted.csv", predicted_table(found))
    write_table(folder / "pulls.csv", pulls)
    write_figure(folder / "fit.png", figure(found), dpi=150)


def parameters_table(found: Calibration) -> list[Row]:
    """Return value, interval and share of variance taken away of each parameter."""
    rows: list[Row] = []
    for k, parameter in enumerate(found.parameters):
        start = parameter.value(found.start)
        estimate = found.estimate(k, start)
        rows.append(
            {
                "parameter": parameter.name,
                **_values(parameter.unit, start, estimate),
                "learnt": round(float(found.learnt[k]), 2),
                "identified": "no" if estimate.doubt else "yes",
            }
        )
    return rows


def constants_table(found: Calibration) -> list[Row]:
    """Return each value of the study that a parameter changes, with its 95 % interval."""
    rows: list[Row] = []
    for k, parameter in enumerate(found.parameters):
        for keys, power in parameter.powers.items():
            start = value_at(found.start, keys)
            values = _values(unit_of(keys), start, found.estimate(k, start, power))
            rows.append({"constant": ".".join(keys), **values, "parameter": parameter.name})
    return rows


def _values(unit: str, start: float, estimate: Estimate) -> Row:
    return {
        "unit": unit,
        "start": _short(start),
        "value": _short(estimate.value),
        "least_95_percent": _short(estimate.low),
        "largest_95_percent": _short(estimate.high),
    }


def predicted_table(found: Calibration) -> list[Row]:
    """Return model, measurement and deviation of each number."""
    model = np.concatenate(found.predicted)
    return [
        {
            **_place(e, k),
            "model": _short(value),
            "measured": float(e.mean[k]),
            "sd": float(e.sd[k]),
            "deviation_sd": _short(deviation),
        }
        for (e, k), value, deviation in zip(_numbers(found), model, found.deviations, strict=True)
    ]


def summary(found: Calibration) -> str:
    """Return the result in lines of text."""
    lines = [f"{'parameter':26} {'value':>10} {'unit':17} 95 % interval"]
    for k, parameter in enumerate(found.parameters):
        e = found.estimate(k, parameter.value(found.start))
        doubt = f": {e.doubt}" if e.doubt else ""
        lines.append(
            f"{parameter.name:26} {e.value:10.4g} {parameter.unit:17} "
            f"{e.low:.3g} to {e.high:.3g}{doubt}"
        )
    names = [p.name for p in found.parameters]
    for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
        if abs(r := found.correlation[i, j]) > _STRONG_CORRELATION:
            lines.append(f"correlation of {names[i]} and {names[j]} {r:+.2f}")
    for experiment, values in zip(found.experiments, found.predicted, strict=True):
        lines += _agreement(experiment, values)
    numbers = f"{len(found.deviations)} numbers, {found.evaluations} points"
    lines.append(f"{squares_in_words(*found.squares)}; {numbers}")
    if not found.converged:
        lines.append("not converged: allow more points; no press is repeated")
    if found.probability < _SMALLEST_PROBABILITY:
        lines.append(
            "the model is farther from the measurements than their standard deviations allow: the "
            "intervals are too narrow"
        )
    return "\n".join(lines)


def _agreement(experiment: Experiment, values: np.ndarray) -> list[str]:
    force, error = experiment.is_force, values - experiment.mean
    lines = [experiment.name]
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


def figure(found: Calibration) -> Figure:
    """Draw each experiment: forces over depth, profiles over the distance from the indenter."""
    panels = [
        (experiment, values, chosen)
        for experiment, values in zip(found.experiments, found.predicted, strict=True)
        for chosen in (experiment.is_force, ~experiment.is_force)
        if chosen.any()
    ]
    drawing = Figure(figsize=(3.6 * len(panels), 3.3), layout="constrained")
    for axes, panel in zip(np.atleast_1d(drawing.subplots(1, len(panels))), panels, strict=True):
        _draw(axes, *panel)
    return drawing


def _draw(axes: Axes, experiment: Experiment, values: np.ndarray, chosen: np.ndarray) -> None:
    force = bool(experiment.is_force[chosen][0])
    at = (experiment.depth_mm if force else experiment.place_mm)[chosen]
    order = np.argsort(at)
    mean, sd = experiment.mean[chosen][order], experiment.sd[chosen][order]
    axes.errorbar(
        at[order], mean, sd, fmt="o", capsize=3, color=_ORANGE, label="measured, mean ± sd"
    )
    axes.plot(at[order], values[chosen][order], color=_BLUE, marker=".", label="model")
    axes.set_title(experiment.indenter.kind, fontsize="medium")
    if force:
        axes.set(xlabel="Indentation (mm)", ylabel="Normal force (N)", ylim=(0, None))
    else:
        axes.set(xlabel="Distance from the indenter (mm)", ylabel="Deflection of the skin (mm)")
    axes.legend(frameon=False, fontsize="small")


def _numbers(found: Calibration) -> list[tuple[Experiment, int]]:
    return [(e, k) for e in found.experiments for k in range(len(e.mean))]


def _place(experiment: Experiment, k: int) -> Row:
    place = experiment.place_mm[k]
    return {
        "indenter": experiment.name,
        "depth_mm": float(experiment.depth_mm[k]),
        "place_mm": "" if np.isnan(place) else float(place),
    }


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(value), 3) for value in values]


def _short(value: float) -> float:
    return float(f"{value:.5g}")
