"""Tables, figures and the study file of a fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_fem.calibration.fit import Fit
from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.parameters import unit_of, value_at
from tactile_fem.runtime.files import write_figure, write_table, write_text
from tactile_fem.study.file import dump_study
from tactile_fem.study.kept import keep_files

Row = dict[str, str | float]

# Share of the variance that the measurements must take away to call a parameter identified.
_IDENTIFIED = 0.5
_UNLIKELY = 0.01  # chance of deviations that are only the measurements' own
_BLUE, _ORANGE = "#0072B2", "#D55E00"


def write_report(fit: Fit, folder: Path) -> None:
    """Write ``study.toml``, tables and the figure of a fit into its folder.

    ``parameters.csv`` (values, 95 % intervals), ``constants.csv`` (each value of the study that
    they change), ``correlation.csv``, ``predicted.csv`` (model and measurement), ``pulls.csv``
    (what each measurement changes) and ``fit.png``.
    """
    write_text(folder / "study.toml", dump_study(fit.study))
    keep_files(fit.study, folder, afresh=True)
    write_table(folder / "parameters.csv", parameters_table(fit))
    write_table(folder / "constants.csv", constants_table(fit))
    names = [p.name for p in fit.parameters]
    write_table(folder / "correlation.csv", _square(names, fit.correlation))
    write_table(folder / "predicted.csv", predicted_table(fit))
    pulls = [
        {**_place(e, k), **dict(zip(names, _rounded(row), strict=True))}
        for (e, k), row in zip(_numbers(fit), fit.pulls, strict=True)
    ]
    write_table(folder / "pulls.csv", pulls)
    write_figure(folder / "fit.png", figure(fit), dpi=150)


def parameters_table(fit: Fit) -> list[Row]:
    """Return value, interval and what was learnt of each parameter."""
    rows: list[Row] = []
    for parameter, x, (least, largest), learnt in zip(
        fit.parameters, fit.x, fit.intervals, fit.learnt, strict=True
    ):
        start = parameter.value(fit.start)
        rows.append(
            {
                "parameter": parameter.name,
                "unit": parameter.unit,
                "start": _short(start),
                "value": _short(start * np.exp(x)),
                "least_95_percent": _short(start * least),
                "largest_95_percent": _short(start * largest),
                "learnt": round(float(learnt), 2),
                "identified": "yes" if learnt >= _IDENTIFIED else "no",
            }
        )
    return rows


def constants_table(fit: Fit) -> list[Row]:
    """Return each value of the study that a parameter changes, with its 95 % interval."""
    rows: list[Row] = []
    for parameter, x, ends in zip(fit.parameters, fit.x, fit.intervals, strict=True):
        for keys, power in parameter.powers.items():
            start = value_at(fit.start, keys)
            least, largest = sorted(start * ends**power)
            rows.append(
                {
                    "constant": ".".join(keys),
                    "unit": unit_of(keys),
                    "start": _short(start),
                    "value": _short(start * np.exp(power * x)),
                    "least_95_percent": _short(least),
                    "largest_95_percent": _short(largest),
                    "parameter": parameter.name,
                }
            )
    return rows


def predicted_table(fit: Fit) -> list[Row]:
    """Return model, measurement and deviation of each number."""
    model = np.concatenate(fit.predicted)
    return [
        {
            **_place(e, k),
            "model": _short(value),
            "measured": float(e.mean[k]),
            "sd": float(e.sd[k]),
            "deviation_sd": _short(deviation),
        }
        for (e, k), value, deviation in zip(_numbers(fit), model, fit.deviations, strict=True)
    ]


def summary(fit: Fit) -> str:
    """Return the result in lines of text."""
    lines = [f"{'parameter':26} {'value':>10} {'unit':17} 95 % interval"]
    for row in parameters_table(fit):
        note = "" if row["identified"] == "yes" else ": not identified"
        interval = f"{row['least_95_percent']:.3g} to {row['largest_95_percent']:.3g}"
        lines.append(
            f"{row['parameter']:26} {row['value']:10.4g} {row['unit']:17} {interval}{note}"
        )
    names = [p.name for p in fit.parameters]
    for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
        if abs(fit.correlation[i, j]) > 0.7:
            lines.append(f"correlation of {names[i]} and {names[j]} {fit.correlation[i, j]:+.2f}")
    for experiment, values in zip(fit.experiments, fit.predicted, strict=True):
        lines += _agreement(experiment, values)
    lines.append(f"{fit.squares}; {len(fit.deviations)} numbers, {fit.evaluations} points")
    if not fit.converged:
        lines.append("not converged: allow more points; no press is repeated")
    if fit.chance < _UNLIKELY:
        lines.append(
            "the model is farther from the measurements than their standard deviations allow: the "
            "intervals are too narrow"
        )
    return "\n".join(lines)


def r_squared(model: np.ndarray, measured: np.ndarray) -> float:
    """Return the coefficient of determination."""
    spread = np.sum((measured - measured.mean()) ** 2)
    return float(1 - np.sum((model - measured) ** 2) / spread) if spread else float("nan")


def figure(fit: Fit) -> Figure:
    """Draw each experiment: forces over depth, profiles over the distance from the indenter."""
    panels = [
        (experiment, values, chosen)
        for experiment, values in zip(fit.experiments, fit.predicted, strict=True)
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


def _agreement(experiment: Experiment, values: np.ndarray) -> list[str]:
    lines = [experiment.name]
    force, off = experiment.is_force, (values - experiment.mean) / experiment.sd
    for k in np.flatnonzero(force):
        lines.append(
            f"{experiment.depth_mm[k]:8.2f} mm  {values[k]:7.4f} N  measured "
            f"{experiment.mean[k]:.4f} ({experiment.sd[k]:.4f})  {off[k]:+.2f} sd"
        )
    if not force.all():
        error = (values - experiment.mean)[~force]
        r2 = r_squared(values[~force], experiment.mean[~force])
        rms = float(np.sqrt(np.mean(error**2)))
        worst = error[np.argmax(np.abs(error))]
        lines.append(f"   profile: R2 {r2:.4f}, rms {rms:.4f} mm, worst {worst:+.3f} mm")
    return lines


def _numbers(fit: Fit) -> list[tuple[Experiment, int]]:
    return [(experiment, k) for experiment in fit.experiments for k in range(len(experiment.mean))]


def _place(experiment: Experiment, k: int) -> Row:
    place = experiment.place_mm[k]
    return {
        "indenter": experiment.name,
        "depth_mm": float(experiment.depth_mm[k]),
        "place_mm": "" if np.isnan(place) else float(place),
    }


def _square(names: list[str], values: np.ndarray) -> list[Row]:
    return [
        {"parameter": name, **dict(zip(names, _rounded(row), strict=True))}
        for name, row in zip(names, values, strict=True)
    ]


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(value), 3) for value in values]


def _short(value: float) -> float:
    return float(f"{value:.5g}")
