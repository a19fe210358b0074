# %% [markdown]
# # Why firing decays: skin that relaxes, or receptors that adapt?
#
# This demo emphasizes
# - the same scans with elastic tissue and with tissue that relaxes,
# - four models of one afferent: with adaptation or without, in either tissue,
# - what the speed of a scan does to force, strain energy density and spikes.
#
# Hamasaki et al. (2020) name it first among their limits: their skin was not viscoelastic, so the
# decay of firing in a hold had to be the receptor's. Here
#
# | model | tissue | receptor |
# | --- | --- | --- |
# | neither | elastic | answers to the present drive |
# | receptor | elastic | adapts, the default of `[neuron]` |
# | tissue | `relaxation = "fingerpad"` | answers to the present drive |
# | both | `relaxation = "fingerpad"` | adapts |
#
# and the gain of each is such that it fires as fast as "receptor" while a cylinder is pressed.
#
#     python demos/neurons/decay.py results/decay --jobs 2
#     python demos/neurons/decay.py results/quick --distance 1 --speeds 20 --hold 0.5

# %%
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from cyclopts import Parameter
from decay_figures import elapsed, hold_figure, middle_sed, slide_figure, speed_figure
from scipy.optimize import brentq

from tactile_fem import Study, StudyError, run_script, write_table
from tactile_fem.neuron import Histories, Response, Window, mean_rates, respond
from tactile_fem.output.histories import central_receptor
from tactile_fem.series import Member, run_all
from tactile_fem.study import (
    Cylinder,
    Finger,
    Grating,
    Hold,
    Neuron,
    Output,
    Press,
    Protocol,
    Receptors,
    Solver,
    Text,
    Tissue,
)

TISSUES: tuple[Literal["none", "fingerpad"], ...] = ("none", "fingerpad")
CYLINDER_MM, PRESS_MM, PRESS_MM_S = 6.35, 1.0, 20.0
RAMP_S = PRESS_MM / PRESS_MM_S
# Holds in a row, ever longer, with this many outputs each, s; the last one is the rest.
HOLDS_S, OUTPUTS = (0.01, 0.04, 0.15, 0.6), 6
# Windows after first touch, s; the last one ends with the hold.
WINDOWS_S = ((0.0, RAMP_S), (RAMP_S, 0.1), (0.1, 0.3), (0.55, 1.05), (2.0, 5.05))
RAMP, ONE_SECOND = 0, 3
LEAST_HZ = 0.1
SLIDE_MM_S = 20.0
# The bar's width; the displacement at which its middle is over the contact's; middle afferents.
BAR_MM, BAR_AT_MM, MIDDLE_MM = 4.0, 5.0, 2.0


@dataclass(frozen=True)
class Model:
    """Tissue and receptor of an afferent."""

    tissue: Literal["none", "fingerpad"]
    neuron: Neuron

    def rates(self, trace: Histories) -> np.ndarray:
        """Return the middle afferent's mean rates in the windows, spikes/s, (windows,)."""
        windows = [Window(*when, 0.0) for when in windows_of(trace)]
        drive = middle_sed(trace)[:, None]
        return mean_rates(elapsed(trace), drive, windows, self.neuron)[:, 0]

    def fires(self, trace: Histories) -> Response:
        """Return the spikes of all afferents; times count as the trace's."""
        return respond(trace["time_s"], trace["sed_kPa"], self.neuron)


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    text: str = "G",
    speeds: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (10, 20, 40, 80),
    distance: float = 10.0,
    depth: float = 1.97,
    hold: float = 5.0,
    pad_size: float | None = None,
    far_size: float | None = None,
    jobs: int = 1,
) -> None:
    """Scan, compare and draw.

    Parameters
    ----------
    folder
        For scans, tables and figures; complete scans are not repeated.
    preset, pad_size, far_size
        The mesh.
    text
        The letter that is scanned.
    speeds
        Of the slides, mm/s; the demo's own figures are those of 20 mm/s.
    distance, depth
        Of the slides, mm.
    hold
        How long the cylinder is held, s.
    jobs
        Parallel scans.
    """
    if SLIDE_MM_S not in speeds:
        raise StudyError(f"speeds: {SLIDE_MM_S:g} mm/s must be among them.")
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    members = {
        (kind, tissue): member
        for tissue in TISSUES
        for kind, member in scans_of(finger, tissue, text, speeds, distance, depth, hold)
    }
    scans = run_all(list(members.values()), folder, jobs=jobs)
    traces = {key: scan.trace for key, scan in zip(members, scans, strict=True)}
    presses = {tissue: traces["press", tissue] for tissue in TISSUES}
    models = equally_fast(presses)
    tables = {
        "hold": list(in_the_hold(models, presses)),
        "explained": list(explained(models, presses)),
        "edges": list(at_edges(models, {t: traces["bar", t] for t in TISSUES})),
        "speeds": list(at_speeds(models, traces, speeds)),
    }
    for name, rows in tables.items():
        write_table(folder / f"{name}.csv", rows)
        print_table(rows)
    print(f"with tissue that relaxes: fast adaptation {needed_adaptation(models, presses):.3f}")
    figures = {
        "hold": hold_figure(models, presses),
        "slide": slide_figure(models, {t: traces[SLIDE_MM_S, t] for t in TISSUES}),
        "speeds": speed_figure(tables["speeds"]),
    }
    for name, figure in figures.items():
        figure.savefig(folder / f"{name}.png")
        print(folder / f"{name}.png")


def print_table(rows: list[dict[str, Any]]) -> None:
    """Print rows as a table of Markdown."""
    print("\n| " + " | ".join(rows[0]) + " |\n|" + " --- |" * len(rows[0]))
    for row in rows:
        told = (
            f"{value:.4g}" if isinstance(value, float) else str(value) for value in row.values()
        )
        print("| " + " | ".join(told) + " |")
    print()


# %% [markdown]
# A cylinder is pressed and held; a letter is scanned at all speeds, and a bar with two edges.


# %%
def scans_of(
    finger: Finger,
    tissue: Literal["none", "fingerpad"],
    text: str,
    speeds: tuple[float, ...],
    distance: float,
    depth: float,
    hold: float,
) -> Iterator[tuple[str | float, Member]]:
    """Yield the scans with one kind of tissue; letters have their speed as key."""
    common = Study(
        finger=finger,
        tissue=Tissue(relaxation=tissue),
        solver=Solver(max_press_step_mm=0.2, petsc={"snes_atol": 1e-6}),
        output=Output(pictures=False),
    )
    press = Press(depth_mm=PRESS_MM, speed_mm_s=PRESS_MM_S)
    times = [time for time in (*HOLDS_S, hold - sum(HOLDS_S)) if time > 0]
    holds = [Hold(time_s=time, output_s=time / OUTPUTS) for time in times]
    held = {
        "stimulus": Cylinder(radius_mm=CYLINDER_MM),
        "protocol": Protocol(path=(press, *holds)),
        "receptors": Receptors(half_width_mm=0.0),
        "solver": common.solver.model_copy(update={"max_press_step_mm": 0.05}),
    }
    yield "press", Member(f"press-{tissue}", common.model_copy(update=held), {"tissue": tissue})
    slide = Protocol(depth_mm=depth, distance_mm=distance, output_mm=0.2)
    bar = Grating(ridge_mm=BAR_MM, count=1, start_mm=-BAR_AT_MM)
    barred = {"stimulus": bar, "protocol": slide}
    yield "bar", Member(f"bar-{tissue}", common.model_copy(update=barred), {"tissue": tissue})
    for speed in speeds:
        protocol = slide.model_copy(update={"speed_mm_s": speed})
        lettered = {"stimulus": Text(text=text), "protocol": protocol}
        values = {"tissue": tissue, "speed_mm_s": speed}
        name = f"{text}-{tissue}-{speed:g}"
        yield speed, Member(name, common.model_copy(update=lettered), values)


# %%
def equally_fast(presses: Mapping[str, Histories]) -> dict[str, Model]:
    """Return the four models, with gains such that all fire as fast in the ramp."""
    adapts = Neuron()
    answers = adapts.model_copy(update={"fast_adaptation": 0.0, "adaptation": 0.0})
    reference = Model("none", adapts)
    wanted = reference.rates(presses["none"])[RAMP]
    others = {
        "neither": Model("none", answers),
        "tissue": Model("fingerpad", answers),
        "both": Model("fingerpad", adapts),
    }
    scaled = {name: as_fast(model, presses, wanted) for name, model in others.items()}
    return {"neither": scaled["neither"], "receptor": reference, **scaled}


def as_fast(model: Model, presses: Mapping[str, Histories], wanted_Hz: float) -> Model:
    """Return the model with a gain with which it fires at a rate in the ramp."""

    def with_factor(logarithm: float) -> Model:
        gain = np.exp(logarithm) * model.neuron.static_gain_pA_per_kPa
        update = {"static_gain_pA_per_kPa": float(gain)}
        return replace(model, neuron=model.neuron.model_copy(update=update))

    def surplus(logarithm: float) -> float:
        return float(with_factor(logarithm).rates(presses[model.tissue])[RAMP] - wanted_Hz)

    return with_factor(brentq(surplus, -6.0, 3.0))


def windows_of(trace: Histories) -> list[tuple[float, float]]:
    """Return the windows that begin before the trace ends."""
    return [when for when in WINDOWS_S if when[0] < elapsed(trace)[-1]]


# %%
def in_the_hold(
    models: Mapping[str, Model], presses: Mapping[str, Histories]
) -> Iterator[dict[str, Any]]:
    """Yield force, drive and rates in the windows."""
    for tissue, trace in presses.items():
        for name, values in (
            ("normal force, N", trace["force_N"][:, 2]),
            ("SED, kPa", middle_sed(trace)),
        ):
            yield {"what": f"{name}, {tissue}", **windowed(mean_in_windows(trace, values))}
    for name, model in models.items():
        rates = model.rates(presses[model.tissue])
        yield {"what": f"spikes/s, {name}", **windowed(rates)}


def explained(
    models: Mapping[str, Model], presses: Mapping[str, Histories]
) -> Iterator[dict[str, Any]]:
    """Yield by how much each model lowers the rates of "neither" after the ramp.

    The share of the tissue is that of its logarithm in the sum of both logarithms.
    """
    rates = {name: model.rates(presses[model.tissue]) for name, model in models.items()}
    names = list(windowed(rates["neither"]))
    for k in range(RAMP + 1, len(names)):
        receptor, tissue, both = (
            float(rates["neither"][k] / max(rates[name][k], LEAST_HZ))
            for name in ("receptor", "tissue", "both")
        )
        share = np.log(tissue) / (np.log(tissue) + np.log(receptor))
        yield {
            "window": names[k],
            "lowered by the receptor": receptor,
            "by the tissue": tissue,
            "by both": both,
            "share of the tissue": float(share),
        }


def mean_in_windows(trace: Histories, values: np.ndarray) -> np.ndarray:
    """Return means over the windows of values that are linear between steps."""
    time = elapsed(trace)
    fine = [np.linspace(start, min(end, time[-1]), 401) for start, end in windows_of(trace)]
    return np.array([np.interp(at, time, values).mean() for at in fine])


def windowed(values: np.ndarray) -> dict[str, float]:
    """Return values by the names of their windows."""
    return {f"{a:g} to {b:g} s": float(v) for (a, b), v in zip(WINDOWS_S, values, strict=False)}


def needed_adaptation(models: Mapping[str, Model], presses: Mapping[str, Histories]) -> float:
    """Return the receptor's adaptation in tissue that relaxes that lets firing decay as before.

    As before means: from the ramp to the end of the first second, as "receptor" does.
    """

    def decay(model: Model) -> float:
        rates = model.rates(presses[model.tissue])
        return float(rates[min(ONE_SECOND, len(rates) - 1)] / rates[RAMP])

    wanted = decay(models["receptor"])
    ramp = models["receptor"].rates(presses["none"])[RAMP]

    def surplus(share: float) -> float:
        neuron = models["both"].neuron.model_copy(update={"fast_adaptation": share})
        return decay(as_fast(Model("fingerpad", neuron), presses, ramp)) - wanted

    return float(brentq(surplus, 0.0, 0.99))


# %% [markdown]
# The bar's edges come to the middle afferents one after the other; in between they are nearly
# silent. Each edge has half of the bar's width to either side.


# %%
def at_edges(
    models: Mapping[str, Model], bars: Mapping[str, Histories]
) -> Iterator[dict[str, Any]]:
    """Yield the spikes of middle afferents at the leading and at the trailing edge of the bar."""
    for name, model in models.items():
        trace = bars[model.tissue]
        spikes = model.fires(trace).spikes
        middle = np.flatnonzero(np.abs(trace["receptors_mm"][:, 0]) <= MIDDLE_MM)
        at_mm = SLIDE_MM_S * np.concatenate([spikes[k] for k in middle]) - BAR_AT_MM
        leading = int(((at_mm > -BAR_MM) & (at_mm <= 0)).sum())
        trailing = int(((at_mm > 0) & (at_mm <= BAR_MM)).sum())
        yield {
            "model": name,
            "leading edge, spikes": leading,
            "trailing edge, spikes": trailing,
            "ratio": leading / trailing if trailing else float("inf"),
        }


# %%
def at_speeds(
    models: Mapping[str, Model],
    traces: Mapping[tuple[str | float, str], Histories],
    speeds: tuple[float, ...],
) -> Iterator[dict[str, Any]]:
    """Yield forces, drive and firing in the slide at each speed."""
    for speed in speeds:
        for name, model in models.items():
            trace = traces[speed, model.tissue]
            slide = trace["phase"] == "slide"
            normal, tangential = trace["force_N"][slide, 2], trace["force_N"][slide, 1]
            response = model.fires(trace)
            fired = [times[times > 0] for times in response.spikes]
            peak = Response(fired, 0.0, float(trace["time_s"][-1])).peak_rate()
            yield {
                "speed, mm/s": speed,
                "model": name,
                "normal, N": float(normal.mean()),
                "tangential, N": float(np.abs(tangential).mean()),
                "largest SED, kPa": float(trace["sed_kPa"][slide].max()),
                "spikes": sum(map(len, fired)),
                "peak, spikes/s": float(peak[central_receptor(trace["receptors_mm"])]),
            }


# %%
if __name__ == "__main__":
    run_script(main)
