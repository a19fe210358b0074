"""A scan as a notebook shows it: its main numbers and its rasters."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from tactile_fem.errors import StudyError
from tactile_fem.output.figures import draw_plots
from tactile_fem.runtime import html
from tactile_fem.series.run import numbers_of
from tactile_fem.simulation.results import Results


def html_of(results: Results) -> str:
    """Return a table of a scan's main numbers and its rasters; a sentence if it cannot be read."""
    try:
        return html.section(
            results.folder.name, [html.table([], _numbers(results)), *_rasters(results)]
        )
    except StudyError as error:
        return html.section(results.folder.name, [], str(error))


def _numbers(results: Results) -> list[tuple[str, str]]:
    trace, spikes, found = results.trace, results.spikes, numbers_of(results)
    unit = results.study.finger.force_unit
    pressed, normal, tangential = (
        found[f"{name}_{unit.replace('/', '_per_')}"]
        for name in ("pressed", "normal", "tangential")
    )
    where = "in the slide" if trace["displacement_mm"].any() else "at the end"
    counts = [
        f"{one.name} {(spikes.population == one.name).sum()} from "
        f"{(trace['population'] == one.name).sum()} receptors"
        for one in results.study.populations
    ]
    return [
        ("status", str(results.run.get("status", "not begun"))),
        ("path", f"{trace['time_s'][-1] - trace['time_s'][0]:.3g} s, {found['steps'] - 1} steps"),
        ("force at the end of the press", f"{pressed:.3g} {unit}"),
        (f"force {where}", f"{normal:.3g} {unit} normal, {tangential:.3g} {unit} tangential"),
        ("largest SED", f"{found['largest_sed_kPa']:.3g} kPa"),
        ("spikes", "; ".join(counts)),
        ("computed in", f"{found['wall_s']:.0f} s"),
    ]


def _rasters(results: Results) -> list[str]:
    """Return the rasters as images, drawn beside the folder: it may be of somebody else."""
    with TemporaryDirectory() as folder:
        drawn = Results(results.folder)
        drawn.figures = Path(folder)
        files = [path for path in draw_plots(drawn) if path.stem.startswith("raster")]
        return [html.image(path.read_bytes(), path.stem.replace("_", " ")) for path in files]
