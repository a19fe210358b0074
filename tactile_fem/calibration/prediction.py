"""Forces of a fitted finger on another stimulus, with the uncertainty of the fit.

The logarithm of a force F has the variance ``g C g``, with the covariance C of the parameters'
logarithms x and the slopes ``g = d ln F/dx``: exactly, if F is a product of their powers.
"""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from tactile_fem.calibration.measurements import Experiment
from tactile_fem.calibration.parameters import value_at
from tactile_fem.calibration.posterior import SD_OF_95_PERCENT, Posterior
from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime.differences import brief
from tactile_fem.runtime.files import write_figure, write_table, write_text
from tactile_fem.runtime.logs import each_once
from tactile_fem.runtime.session import session
from tactile_fem.runtime.text import aligned
from tactile_fem.simulation import check
from tactile_fem.study import Stimulus, Study, dump_study, keep_files

Array = NDArray[np.float64]

_PRESSES, _SEED = 4, 1  # which check a prediction, with values drawn from the posterior
_TITLE_CHARACTERS = 36
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


def predict(
    posterior: Posterior,
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
    try:
        depth = np.unique(np.asarray(depth_mm, dtype=float))
    except (ValueError, TypeError):
        raise StudyError(f"depth_mm is {depth_mm!r} but must be a number or several.") from None
    speed = study.protocol.press_speed_mm_s if speed_mm_s is None else speed_mm_s
    for name, given in (("depth_mm", depth), ("speed_mm_s", np.array([speed]))):
        if not (given.size and ((given > 0) & (given < np.inf)).all()):
            raise StudyError(f"{name} is {given} but its numbers must be above 0.")
    x, lower = posterior.x, np.linalg.cholesky(posterior.covariance)
    fitted = {key: value for k in range(len(x)) for key, value in posterior.mean(k).items()}
    if wrong := [k for k, v in fitted.items() if not np.isclose(value_at(study, k) or 0, v)]:
        raise StudyError(f"{'.'.join(wrong[0])} of the study is not that of the posterior.")
    body = re.sub(r"\S*/", "", brief(stimulus, 200))  # without folders of its files
    name, one = f"{body} at {speed:g} mm/s".replace(" = ", "="), np.ones_like(depth)
    experiment = Experiment(name, stimulus, speed, depth, np.nan * one, one, one)
    pressed, place = study_of(study, experiment), Path(folder)
    draws = np.random.default_rng(_SEED).normal(size=(_PRESSES, len(x))) @ lower.T
    with session() as run, each_once(*FINGER_LOGGERS):
        check(pressed)
        model = Model(study, [experiment], posterior.parameters, place, jobs, run.comm, 0)
        run.lock(place)
        force = model.predictions(here := 0 * x)[0].values
        if not (force > 0).all():
            raise TactileError(f"{name}: the fitted finger is not pressed to all the depths.")
        slopes = model.jacobian(here)[: len(depth)] / force[:, None]
        half = SD_OF_95_PERCENT * np.linalg.norm(slopes @ lower, axis=1)
        drawn = np.array([p.values for p in model.predictions(*draws, with_derivatives=False)])
        off = np.nanmax(np.abs(drawn - force * np.exp(draws @ slopes.T)), axis=0)
        low, high, error = force * np.exp(-half), force * np.exp(half), off / force / np.sinh(half)
        found = ForcePrediction(name, depth, force, low, high, drawn, error)
        run.on_root(lambda: _write(found, posterior, pressed, place))
    return found


def _write(found: ForcePrediction, posterior: Posterior, pressed: Study, folder: Path) -> None:
    """Write table and figure of a prediction, and study and posterior that it is made from."""
    stem = re.sub(r"[^\w.=-]+", "_", found.name)[:120]
    write_text(folder / f"{stem}.toml", dump_study(pressed))
    keep_files(pressed, folder, afresh=False)
    posterior.save(folder / "posterior.json")
    columns = {"depth_mm": found.depth_mm, "force_N": found.force_N}
    columns |= {"least_95_percent": found.low_N, "largest_95_percent": found.high_N}
    columns |= {f"press_{k}_N": values for k, values in enumerate(found.pressed_N, 1)}
    rows = zip(*(map(short, column) for column in columns.values()), strict=True)
    write_table(folder / f"{stem}.csv", [dict(zip(columns, row, strict=True)) for row in rows])
    drawing = Figure(figsize=(4.0, 3.5), layout="constrained")
    axes, ends = drawing.subplots(), np.abs([found.low_N, found.high_N] - found.force_N)
    label = "fitted finger, 95 % of the posterior"
    axes.errorbar(found.depth_mm, found.force_N, ends, fmt="o-", ms=3, capsize=3, label=label)
    dots = axes.plot(found.depth_mm, found.pressed_N.T, "C1.")
    dots[0].set_label("presses with drawn values")
    finish_panel(axes, found.name)
    write_figure(folder / f"{stem}.png", drawing, dpi=150)


def short(value: float) -> float:
    """Return a number with the five digits that tables have."""
    return float(f"{value:.5g}")


def finish_panel(axes: Axes, name: str, *, is_force: bool = True) -> None:
    """Add labels, a title and the legend to forces over depth, or to a profile."""
    if is_force:
        axes.set(xlabel="Indentation (mm)", ylabel="Normal force (N)", xlim=(0, None))
        axes.set_ylim(0, None)
    else:
        axes.set(xlabel="Distance from the indenter (mm)", ylabel="Deflection of the skin (mm)")
    axes.set_title(textwrap.fill(name, _TITLE_CHARACTERS), fontsize="medium")
    axes.legend(frameon=False, fontsize="small")
