"""Tables, figures and the study file of a calibration."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.parameters import unit_of, value_at
from tactile_fem.calibration.result import Calibration
from tactile_fem.neuron import Estimate
from tactile_fem.runtime.files import write_figure, write_table, write_text
from tactile_fem.study import Study, dump_study, keep_files

Array = NDArray[np.float64]
Row = dict[str, str | float]

_TITLE_CHARACTERS = 36
_GREY = "#999999"
_BLUE, _ORANGE = "#0072B2", "#D55E00"


def write_results(found: Calibration, folder: Path) -> None:
    """Write ``study.toml``, tables and the figure of a calibration into its folder.

    ``parameters.csv`` (values, 95 % intervals), ``constants.csv`` (each value of the study that
    they change), ``correlation.csv``, ``predicted.csv`` (model and measurement), ``curves.csv``
    (the fitted finger's forces at each step), ``pulls.csv`` (influence of each measurement),
    ``posterior.json`` (the parameters with their covariance, for ``people.fit`` in a study) and
    ``fit.png``.
    """
    unused, usual = ("stimulus", "protocol"), Study()  # by a fit
    default = [name for name in unused if getattr(found.study, name) == getattr(usual, name)]
    write_text(folder / "study.toml", dump_study(found.study, without=default))
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
    found.posterior.save(folder / "posterior.json")
    write_table(folder / "parameters.csv", parameters_table(found))
    write_table(folder / "constants.csv", constants_table(found))
    write_table(folder / "correlation.csv", correlation)
    write_table(folder / "predicted.csv", predicted_table(found))
    write_table(folder / "curves.csv", curves_table(found))
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


def curves_table(found: Calibration) -> list[Row]:
    """Return the force at each step of the fitted finger's presses."""
    return [
        {"indenter": e.name, "depth_mm": _short(depth), "force_N": _short(force)}
        for e, curve in zip(found.experiments, found.curves, strict=True)
        for depth, force in curve
    ]


def figure(found: Calibration) -> Figure:
    """Draw each experiment: forces over depth, profiles over the distance from the indenter."""
    panels = [
        (experiment, values, curve, is_force)
        for experiment, values, curve in zip(
            found.experiments, found.predicted, found.curves, strict=True
        )
        for is_force in (True, False)
        if (experiment.is_force == is_force).any()
    ]
    drawing = Figure(figsize=(4.0 * len(panels), 3.5), layout="constrained")
    for axes, panel in zip(np.atleast_1d(drawing.subplots(1, len(panels))), panels, strict=True):
        experiment, values, curve, is_force = panel
        if is_force:
            _draw_forces(axes, experiment, curve)
        else:
            _draw_profile(axes, experiment, values)
        title = textwrap.wrap(experiment.name, _TITLE_CHARACTERS)
        axes.set_title("\n".join(title), fontsize="medium")
        axes.legend(frameon=False, fontsize="small")
    return drawing


def _draw_forces(axes: Axes, experiment: Experiment, curve: Array) -> None:
    """Draw the curve of the fitted finger over the measured rows and their averages."""
    force, rows = experiment.is_force, experiment.rows
    if len(rows):
        axes.plot(*rows.T, ".", color=_GREY, ms=3, label="measured rows")
    _draw_measured(axes, experiment, experiment.depth_mm, force)
    axes.plot(*curve.T, color=_BLUE, label="fitted finger", zorder=3)
    axes.set(xlabel="Indentation (mm)", ylabel="Normal force (N)")
    axes.set(xlim=(0, None), ylim=(0, None))


def _draw_profile(axes: Axes, experiment: Experiment, values: Array) -> None:
    chosen, place = ~experiment.is_force, experiment.place_mm
    _draw_measured(axes, experiment, place, chosen)
    order = np.argsort(place[chosen])
    axes.plot(place[chosen][order], values[chosen][order], ".-", color=_BLUE, label="fitted finger")
    axes.set(xlabel="Distance from the indenter (mm)", ylabel="Deflection of the skin (mm)")


def _draw_measured(
    axes: Axes, experiment: Experiment, at: Array, chosen: NDArray[np.bool_]
) -> None:
    mean, sd = experiment.mean[chosen], experiment.sd[chosen]
    axes.errorbar(at[chosen], mean, sd, fmt="o", ms=4, capsize=3, color=_ORANGE, label="mean ± sd")


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
