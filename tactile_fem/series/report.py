"""One HTML file that shows a scan, or a series of them: figures, numbers, parameters."""

from __future__ import annotations

import base64
import csv
import io
import logging
from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tactile_fem.errors import StudyError
from tactile_fem.output.extrema import central_receptor
from tactile_fem.output.figures import draw_plots, rings
from tactile_fem.runtime.files import write_text
from tactile_fem.scan.results import Results
from tactile_fem.series import RateImage, bundles, fibre_image, population_image
from tactile_fem.series.figures import side_by_side
from tactile_fem.series.legibility import outline_correlation
from tactile_fem.study import AnyStimulus
from tactile_fem.study.file import dump_study

logger = logging.getLogger(__name__)

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
    "force": "Force on the finger over the indentation and the slide.",
    "sed": "Strain energy density of the central receptor, and what passes beneath it.",
    "felt": "What the central receptor feels, and what passes beneath it.",
    "raster": "Spikes: a dot each, where the stimulator was and where the receptor lies.",
    "firing": "Firing rate.",
    "finger": "The deformed finger.",
}


def write_report(
    folder: Path | str, *, fibre: Path | str | None = None, output: Path | None = None
) -> Path:
    """Write the report of a scan, or of a series, and return its path.

    Parameters
    ----------
    folder
        Results of a scan, or the folder of a series.
    fibre
        Folder of passes over one receptor, to be compared with the scan.
    output
        Default ``report.html`` in `folder`.

    Raises
    ------
    StudyError
        There are no results.
    """
    folder = Path(folder)
    summary = folder / "summary.csv"
    if summary.is_file():
        title, parts = _series(summary)
    else:
        title, parts = _scan(Results.open(folder), Path(fibre) if fibre else None)
    path = output or folder / "report.html"
    write_text(path, _page(title, parts))
    return path


def passes_in(folder: Path) -> list[Results]:
    """Return the complete scans in a series' folder.

    Raises
    ------
    StudyError
        There is none.
    """
    found = [Results.open(place.parent) for place in sorted(folder.glob("*/study.toml"))]
    complete = [results for results in found if results.complete]
    if not complete:
        raise StudyError(f"{folder} holds no complete scan of a series.")
    return complete


# --- what is told ------------------------------------------------------------------------------


def _scan(results: Results, fibre: Path | None) -> tuple[str, list[str]]:
    study = results.study
    what = getattr(study.stimulus, "text", study.stimulus.kind)
    title = f"Scan of {what}"
    parts = [_table(["quantity", "value"], _numbers(results))]
    if (results.trace["displacement_mm"] > 0).any():
        parts += _spikes(results)
    parts += _drawn(results)
    if fibre is not None:
        parts += _protocols(results, passes_in(fibre))
    run = [(name, value) for name, value in results.run.items() if not isinstance(value, dict)]
    parts += ["<h2>How it was made</h2>", _table(["", ""], run)]
    parts += [
        f"<details><summary>The study</summary><pre>{escape(dump_study(study))}</pre></details>"
    ]
    return title, parts


def _numbers(results: Results) -> list[tuple[str, str]]:
    trace, study = results.trace, results.study
    deepest = int(np.argmax(trace["depth_mm"]))
    slide = trace["displacement_mm"] > 0
    central = central_receptor(trace["receptors_mm"])
    rows = [
        ("status", str(results.run.get("status", "unknown"))),
        ("depth", f"{trace['depth_mm'][deepest]:.3f} mm"),
        ("normal force there", f"{trace['force_N'][deepest, 2]:.4f} N"),
        ("friction coefficient", f"{study.stimulus.friction:g}"),
        ("receptors", str(len(trace["receptors_mm"]))),
    ]
    if slide.any():
        force = trace["force_N"][slide]
        sed = trace["sed_kPa"][slide, central]
        rows += [
            (
                "slide",
                f"{trace['displacement_mm'][-1]:.2f} mm at {study.protocol.speed_mm_s:g} mm/s",
            ),
            ("normal force in the slide", f"{force[:, 2].min():.4f} to {force[:, 2].max():.4f} N"),
            ("SED of the central receptor", f"{sed.min():.3f} to {sed.max():.3f} kPa"),
            ("spikes in the slide", str(int((results.spikes.time_s >= 0).sum()))),
        ]
        fired = results.spikes.population[results.spikes.time_s >= 0]
        for name in _names(results):
            rows.append((f"of {name} afferents", str(int((fired == name).sum()))))
    return rows


def _names(results: Results) -> list[str]:
    """Return the names of the populations that the study gives."""
    return [afferents.name for afferents in results.study.afferents]


def _images(
    results: Results, title: str, image: Callable[[str | None], RateImage]
) -> dict[str, RateImage]:
    """Return an image of each population that the study names, or of its only one.

    Of several, those that make none, not being on an even line, are left out.
    """
    images = {}
    for name in _names(results):
        try:
            images[f"{title}, {name}"] = image(name)
        except StudyError as error:
            logger.warning("no image of the %s afferents: %s", name, error)
    return images or {title: image(None)}


def _spikes(results: Results) -> list[str]:
    spikes, study = results.spikes, results.study
    parts = []
    for afferents in study.populations:
        who = results.receptors_of(afferents.name)
        central = who[central_receptor(results.trace["receptors_mm"][who])]
        own = (spikes.receptor == central) & (spikes.time_s >= 0)
        found = bundles(spikes.displacement_mm[own], study.protocol.speed_mm_s)
        rows = [
            (k, f"{b.start_mm:.2f}", f"{b.end_mm:.2f}", b.spikes, f"{b.rate_Hz:.0f}")
            for k, b in enumerate(found, 1)
        ]
        head = ["bundle", "start mm", "end mm", "spikes", "rate 1/s"]
        which = f"central {afferents.name} receptor" if study.afferents else "central receptor"
        parts += [f"<h2>Spike bundles of the {which}</h2>", _table(head, rows)]
    return parts


def _drawn(results: Results) -> list[str]:
    parts = ["<h2>Figures</h2>"]
    paths = {path.stem: path for path in draw_plots(results)}
    paths |= {path.stem: path for path in sorted(results.figures.glob("*.png"))}
    for name, path in paths.items():
        caption = _CAPTIONS.get(
            name, name.replace("_", " ").replace("deformation", "deformation at")
        )
        kind, _, population = name.partition("_")
        if population and kind in _CAPTIONS:
            caption = f"{population}: {_CAPTIONS[kind]}"
        parts.append(_image(path.read_bytes(), caption))
    return parts


def _protocols(results: Results, passes: Sequence[Results]) -> list[str]:
    base = results.study.stimulus.shift_mm[0]
    if all(one.study.stimulus.shift_mm[0] != base for one in passes):
        passes = [results, *passes]  # its middle receptor's is the pass that needs no shift
    images = {
        **_images(results, "population", lambda name: population_image(results, population=name)),
        **_images(
            results,
            "single fibre",
            lambda name: fibre_image(passes, base_mm=base, population=name),
        ),
    }
    figure = side_by_side(images, rings(results.study.stimulus))
    rows = [
        (name, len(image.across_mm), int(image.response.counts().sum()), _likeness(image, results))
        for name, image in images.items()
    ]
    head = ["protocol", "rows", "spikes", "correlation with the outline"]
    caption = "The population's image and that of passes over one receptor."
    return ["<h2>Both protocols</h2>", _table(head, rows), _image(_png(figure), caption)]


def _likeness(image: RateImage, results: Results) -> str:
    return f"{outline_correlation(image, results.study.stimulus):.3f}"


def _series(summary: Path) -> tuple[str, list[str]]:
    with summary.open(newline="", encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    scans = passes_in(summary.parent)
    parts = [_table(head, rows)]
    shifts = {results.study.stimulus.shift_mm[0] for results in scans}
    alone = [
        results
        for results in scans
        if len(results.trace["receptors_mm"]) == len(results.study.populations)
    ]
    # Among passes the one without a shift may be a population's: its middle receptor counts.
    if alone and len(shifts) == len(scans):
        images = _images(scans[0], "single fibre", lambda name: fibre_image(scans, population=name))
        figure = side_by_side(images, rings(_unshifted(scans)))
        parts.append(_image(_png(figure), "Passes over one receptor."))
    parts += [part for results in scans if results not in alone for part in _rasters(results)]
    return f"Series {summary.parent.name}", parts


def _unshifted(passes: Sequence[Results]) -> AnyStimulus:
    """Return the passes' stimulator where it is not shifted across the finger."""
    stimulus = passes[0].study.stimulus
    return stimulus.model_copy(update={"shift_mm": (0.0, stimulus.shift_mm[1])})


def _rasters(results: Results) -> list[str]:
    if not (results.trace["displacement_mm"] > 0).any():
        return []
    title = results.folder.name
    images = _images(results, title, lambda name: population_image(results, population=name))
    figure = side_by_side(images, rings(results.study.stimulus))
    return [_image(_png(figure), results.folder.name)]


# --- HTML --------------------------------------------------------------------------------------


def _page(title: str, parts: Iterable[str]) -> str:
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
    body = "\n".join([f"<h1>{escape(title)}</h1>", *parts])
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    lines = ["<tr>" + "".join(f"<th>{escape(str(cell))}</th>" for cell in head) + "</tr>"]
    for row in rows:
        lines.append("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>")
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _image(png: bytes, caption: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    text = escape(caption)
    source = f'<img alt="{text}" src="data:image/png;base64,{data}">'
    return f"<figure>{source}<figcaption>{text}</figcaption></figure>"


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
