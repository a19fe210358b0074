"""Tables, figures and the study file of a calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.parameters import unit_of, value_at
from tactile_fem.calibration.prediction import finish_panel, short
from tactile_fem.calibration.result import Calibration
from tactile_fem.neuron import Estimate
from tactile_fem.runtime.files import write_figure, write_table, write_text
from tactile_fem.study import Study, dump_study, keep_files

Array = NDArray[np.float64]
Row = dict[str, str | float]

_GREY = "#999999"
_BLUE, _ORANGE = "#0072B2", "#D55E00"


def write_results(found: Calibration, folder: Path) -> None:
    """Write ``study.toml``, tables and the figure of a calibration into its folder.

    ``parameters.csv`` (values, 95 % intervals, share of the variance taken away), ``constants.csv``
    (each value of the study that they change), ``correlation.csv``, ``predicted.csv`` (model and
    measurement), ``curves.csv`` (the fitted finger's forces at each step), ``pulls.csv`` (influence
    of each measurement), ``posterior.json`` (the parameters with their covariance, for
    ``people.fit`` in a study) and ``fit.png``.
    """
    unused, usual = ("stimulus", "protocol"), Study()  # by a fit
    default = [name for name in unused if getattr(found.study, name) == getattr(usual, name)]
    write_text(folder / "study.toml", dump_study(found.study, without=default))
    keep_files(found.study, folder, afresh=True)
    found.posterior.save(folder / "posterior.json")
    for name, rows in _tables(found).items():
        write_table(folder / f"{name}.csv", rows)
    write_figure(folder / "fit.png", figure(found), dpi=150)


def _tables(found: Calibration) -> dict[str, list[Row]]:
    """Return the rows of each table by its name."""
    parameters, constants = list[Row](), list[Row]()
    for k, parameter in enumerate(found.parameters):
        start = parameter.value(found.start)
        estimate = found.estimate(k, start)
        row: Row = {"parameter": parameter.name, **_values(parameter.unit, start, estimate)}
        row["learnt"] = round(float(found.learnt[k]), 2)
        parameters.append(row | {"identified": "no" if estimate.doubt else "yes"})
        for keys, power in parameter.powers.items():
            start = value_at(found.start, keys)
            values = _values(unit_of(keys), start, found.estimate(k, start, power))
            constants.append({"constant": ".".join(keys), **values, "parameter": parameter.name})

    def by_name(row: Array) -> Row:
        return {p.name: x for p, x in zip(found.parameters, row.round(3).tolist(), strict=True)}

    numbers = [(e, k) for e in found.experiments for k in range(len(e.mean))]
    model = zip(numbers, np.concatenate(found.predicted), found.deviations, strict=True)
    return {
        "parameters": parameters,
        "constants": constants,
        "correlation": [
            {"parameter": parameter.name, **by_name(row)}
            for parameter, row in zip(found.parameters, found.correlation, strict=True)
        ],
        "predicted": [
            {
                **_place(e, k),
                "model": short(value),
                "measured": float(e.mean[k]),
                "sd": float(e.sd[k]),
                "deviation_sd": short(deviation),
            }
            for (e, k), value, deviation in model
        ],
        "curves": [
            {"indenter": e.name, "depth_mm": short(depth), "force_N": short(force)}
            for e, curve in zip(found.experiments, found.curves, strict=True)
            for depth, force in curve
        ],
        "pulls": [
            {**_place(e, k), **by_name(row)}
            for (e, k), row in zip(numbers, found.influence, strict=True)
        ],
    }


def _values(unit: str, start: float, estimate: Estimate) -> Row:
    names = "start", "value", "least_95_percent", "largest_95_percent"
    values = map(short, (start, estimate.value, estimate.low, estimate.high))
    return {"unit": unit, **dict(zip(names, values, strict=True))}


def _place(experiment: Experiment, k: int) -> Row:
    place = experiment.place_mm[k]
    return {
        "indenter": experiment.name,
        "depth_mm": float(experiment.depth_mm[k]),
        "place_mm": "" if np.isnan(place) else float(place),
    }


def figure(found: Calibration) -> Figure:
    """Draw each experiment: forces over depth, profiles over the distance from the indenter."""
    panels = [
        (experiment, values, curve, chosen)
        for experiment, values, curve in zip(
            found.experiments, found.predicted, found.curves, strict=True
        )
        for chosen in (experiment.is_force, ~experiment.is_force)
        if chosen.any()
    ]
    drawing = Figure(figsize=(4.0 * len(panels), 3.5), layout="constrained")
    for axes, panel in zip(np.atleast_1d(drawing.subplots(1, len(panels))), panels, strict=True):
        _draw(axes, *panel)
    return drawing


def _draw(
    axes: Axes, experiment: Experiment, values: Array, curve: Array, chosen: NDArray[np.bool_]
) -> None:
    """Draw forces with the fitted finger's curve over the measured rows, or the profile."""
    is_force = bool(experiment.is_force[chosen].all())
    at = (experiment.depth_mm if is_force else experiment.place_mm)[chosen]
    if is_force and len(experiment.rows):
        axes.plot(*experiment.rows.T, ".", color=_GREY, ms=3, label="measured rows")
    mean, sd = experiment.mean[chosen], experiment.sd[chosen]
    axes.errorbar(at, mean, sd, fmt="o", ms=4, capsize=3, color=_ORANGE, label="mean ± sd")
    drawn = curve.T if is_force else np.array([at, values[chosen]])[:, np.argsort(at)]
    axes.plot(*drawn, "-" if is_force else ".-", color=_BLUE, label="fitted finger", zorder=3)
    finish_panel(axes, experiment.name, is_force=is_force)
