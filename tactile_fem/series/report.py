"""One HTML file that shows a scan, or a series of them: figures, numbers, parameters."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.output.histories import rings
from tactile_fem.runtime import html
from tactile_fem.runtime.differences import brief
from tactile_fem.runtime.files import write_text
from tactile_fem.series.run import numbers_of
from tactile_fem.simulation.results import Results
from tactile_fem.study.file import dump_study

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 62em; margin: 2em auto;
       padding: 0 1em; }
table { border-collapse: collapse; margin: 1em 0; font-size: 14px; }
th, td { border-bottom: 1px solid #ddd; padding: .25em .8em; text-align: left; }
td { font-variant-numeric: tabular-nums; }
img { max-width: 100%; height: auto; }
figure { margin: 1.5em 0; } figcaption { color: #555; font-size: 14px; }
pre { background: #f5f4f0; padding: 1em; overflow-x: auto; font-size: 12px; }
"""
_CAPTIONS = {
    "force": "Force on the finger over the indentation and over the path.",
    "felt": "What the central receptor of each population feels, and the outline that passes it.",
    "sed": "Strain energy density of the central receptor and the outline that passes it.",
    "raster": "Spikes of each receptor over the path.",
    "firing": "Firing rate.",
    "measured": "What was recorded and what the model gave.",
    "finger": "Layers of the undeformed finger.",
}


def write_report(folder: Path | str, *, output: Path | None = None) -> Path:
    """Write the report of a scan's or a series' folder and return its path.

    It is ``report.html`` in the folder unless `output` is given.

    Raises
    ------
    StudyError
        There are no results.
    """
    folder = Path(folder)
    summary = folder / "summary.csv"
    title, parts = _series(summary) if summary.is_file() else _scan(Results.open(folder))
    path = output or folder / "report.html"
    write_text(path, _page(title, parts))
    return path


# --- contents ----------------------------------------------------------------------------------


def _scan(results: Results) -> tuple[str, list[str]]:
    from tactile_fem.output.figures import draw_plots  # takes 0.5 s

    study, run = results.study, results.run
    rows = [("status", run.get("status", "unknown")), ("friction", brief(study.stimulus.friction))]
    rows += [("receptors", len(results.trace["receptors_mm"]))]
    rows += [(name, f"{value:.5g}") for name, value in numbers_of(results).items()]
    drawn = {path.stem: path for path in draw_plots(results)}
    drawn |= {path.stem: path for path in sorted(results.figures.glob("*.png"))}
    parts = [html.table(["quantity", "value"], rows), "<h2>Figures</h2>"]
    for name, path in drawn.items():
        caption = name.replace("_", " ").replace("deformation", "deformation at")
        parts.append(html.image(path.read_bytes(), _CAPTIONS.get(name, caption)))
    details = [(name, value) for name, value in run.items() if not isinstance(value, dict)]
    parts += ["<h2>Run</h2>", html.table([], details)]
    parts += [f"<details><summary>Study</summary><pre>{escape(dump_study(study))}</pre></details>"]
    return f"Scan of {getattr(study.stimulus, 'text', study.stimulus.kind)}", parts


def _series(summary: Path) -> tuple[str, list[str]]:
    from tactile_fem.output.figures import draw_plots

    with summary.open(newline="", encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    folders = [path.parent for path in sorted(summary.parent.glob("*/study.toml"))]
    scans = [results for results in map(Results.open, folders) if results.complete]
    if not scans:
        raise StudyError(f"{summary.parent} holds no complete scan of a series.")
    complete = [row[head.index("status")] for row in rows].count("complete")
    parts = [f"<p>{complete} of {len(rows)} scans are complete; figures are those of these.</p>"]
    parts += [html.table(head, rows)]
    comparison = summary.parent / "comparison.png"
    if comparison.is_file():
        parts.append(html.image(comparison.read_bytes(), "The scans side by side."))
    shifts = {results.study.stimulus.shift_mm[0] for results in scans}
    populations = scans[0].study.populations
    passes = [one for one in scans if len(one.trace["receptors_mm"]) == len(populations)]
    # The unshifted pass may be the scan of a population, whose central receptor counts.
    if passes and len(shifts) == len(scans):
        for afferents in populations:
            parts += _event_plot(scans, afferents.name)
    for results in scans:
        if results not in passes:
            drawn = [path for path in draw_plots(results) if path.stem.startswith("raster")]
            parts += [html.image(path.read_bytes(), results.folder.name) for path in drawn]
    return f"Series {summary.parent.name}", parts


def _event_plot(passes: Sequence[Results], population: str) -> list[str]:
    """Draw spikes and rates of passes over one receptor of a population."""
    from tactile_fem.output.plots import firing_figure, raster_figure
    from tactile_fem.series.image import fibre_image

    image, stimulus = fibre_image(passes, population=population), passes[0].study.stimulus
    unshifted = stimulus.model_copy(update={"shift_mm": (0.0, stimulus.shift_mm[1])})
    shapes, along = rings(unshifted), image.along_mm
    row, time_s = image.response.events()
    trace = passes[0].trace
    places = np.interp(time_s, trace["time_s"], trace["displacement_mm"]), image.across_mm[row]
    raster = raster_figure(*places, image.across_mm, (along[0], along[-1]), shapes)
    firing = firing_figure(along, image.across_mm, image.rate_Hz, shapes)
    count = f"{len(passes)} of {len(image.across_mm)} passes"
    captions = f"{population}: spikes in {count} over one receptor.", "Firing rate in these passes."
    return [html.figure(f, text) for f, text in zip((raster, firing), captions, strict=True)]


# --- HTML --------------------------------------------------------------------------------------


def _page(title: str, parts: Iterable[str]) -> str:
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
    body = "\n".join([f"<h1>{escape(title)}</h1>", *parts])
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'
