"""A scan as a notebook shows it: its main numbers and its raster."""

from __future__ import annotations

from tactile_fem.errors import StudyError
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.cross_section import CrossSectionMap
from tactile_fem.output.figures import trains_of
from tactile_fem.output.rasters import raster
from tactile_fem.results.numbers import numbers_of
from tactile_fem.results.results import Results
from tactile_fem.runtime import html


def html_of(results: Results) -> str:
    """Return a table of a scan's main numbers and its raster; a sentence if it cannot be read."""
    try:
        return html.section(
            results.folder.name, [html.table([], _numbers(results)), *_raster(results)]
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
    force = "force in the slide" if trace["displacement_mm"].any() else "largest force"
    counts = [
        f"{one.name} {(spikes.population == one.name).sum()} from "
        f"{(trace['population'] == one.name).sum()} receptors"
        for one in results.study.populations
    ]
    return [
        ("status", str(results.run.get("status", "not begun"))),
        ("path", f"{trace['time_s'][-1] - trace['time_s'][0]:.3g} s, {found['steps'] - 1} steps"),
        ("force at the end of the press", f"{pressed:.3g} {unit}"),
        (force, f"{normal:.3g} {unit} normal, {tangential:.3g} {unit} tangential"),
        ("largest SED", f"{found['largest_sed_kPa']:.3g} kPa"),
        ("spikes", "; ".join(counts)),
        ("computed in", f"{found['wall_s']:.0f} s"),
    ]


def _raster(results: Results) -> list[str]:
    """Return the spikes as an image, if the scan has come as far as a step."""
    over = Abscissa.of(results.trace)
    if len(over.values) < 2:
        return []
    figure = raster(trains_of(results), over, CrossSectionMap.of(results))
    return [html.figure(figure, "Spikes of each receptor over the path.")]
