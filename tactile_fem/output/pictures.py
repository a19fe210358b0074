"""3-D pictures of the finger, drawn off screen in a separate process.

A graphics library can crash the process that loads it, so a scan does not load one:
`draw_pictures` starts ``python -m tactile_fem.output.pictures FOLDER`` and logs its errors.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.output import section
from tactile_fem.output.histories import TIME, Abscissa, at_time, central_receptor, extrema
from tactile_fem.runtime import doctor
from tactile_fem.runtime.files import write_figure
from tactile_fem.simulation.fields import read_series
from tactile_fem.simulation.results import Results

logger = logging.getLogger(__name__)

_LONGEST_S = 600
_MOST = 8


def can_draw() -> str | None:
    """Return in one sentence why no picture can be drawn, or None if nothing is missing."""
    if find_spec("pyvista") is None:
        return (
            "PyVista is not installed: 3-D pictures are skipped. "
            'To install it: pip install "tactile-fem[pictures]".'
        )
    finding = doctor.picture_finding()
    return None if finding is None else f"{finding}."


def draw_pictures(results: Results) -> list[Path]:
    """Draw finger and deformations into the results folder; return the files.

    All errors are logged as warnings, because pictures are less important than the data.
    """
    flat = results.study.finger.is_section
    if not read_series(results.fields)[1] and (flat or can_draw() is None):
        logger.warning("There are no field files: 3-D pictures are skipped.")
        return []
    if flat:
        return _draw_section(results)
    return drawn_apart("tactile_fem.output.pictures", str(results.folder))


def drawn_apart(module: str, *arguments: str) -> list[Path]:
    """Run a module that draws, in a process of its own; return the files that it names.

    All errors are logged as warnings.
    """
    reason = can_draw()
    if reason is not None:
        logger.warning("%s", reason)
        return []
    logger.info("drawing 3-D pictures, which can take some minutes")
    command = [sys.executable, "-m", module, *arguments]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            encoding="utf-8",
            errors="surrogateescape",  # as Python takes names of files that are not UTF-8
            timeout=_LONGEST_S,
            env=_environment(),
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        logger.warning("3-D pictures are skipped: %s.", error)
        return []
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        logger.warning(
            "Drawing 3-D pictures ended with code %d (%s); the data are not affected.",
            done.returncode,
            last,
        )
    return [Path(line) for line in done.stdout.splitlines() if Path(line).is_file()]


def _draw_section(results: Results) -> list[Path]:
    film = section.SectionFilm(results)
    chosen = choose_states(results.trace, read_series(results.fields)[0])
    over_time = film.label == TIME
    results.figures.mkdir(exist_ok=True)
    paths = []
    for k in (section.BETWEEN * state for state in chosen):
        moment = film[k]
        paths.append(_picture(results, over_time, moment.time_s, moment.displacement_mm))
        write_figure(paths[-1], section.moment_figure(film, k))
    return paths


def _picture(results: Results, over_time: bool, time_s: float, slid_mm: float) -> Path:
    """Return the file of a deformation."""
    name = f"{time_s:06.3f}_s" if over_time else f"{slid_mm:05.2f}"
    return results.figures / f"deformation_{name}.png"


def _environment() -> dict[str, str]:
    """Return the environment without MPI's variables and a display that may be unreachable."""
    mpi = ("PMI_", "PMIX_", "OMPI_", "MPI_", "HYD")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(mpi)}
    environment.pop("DISPLAY", None)
    return {**environment, "PYTHONIOENCODING": "utf-8:surrogateescape"}


def choose_states(
    trace: Mapping[str, NDArray[np.float64]], times_s: NDArray[np.float64]
) -> list[int]:
    """Return which of the states saved at some times are nearest to extrema of the central SED."""
    slide = trace["time_s"] >= 0
    central = central_receptor(trace["receptors_mm"], trace.get("population"))
    sed = trace["sed_kPa"][slide, central]
    times = trace["time_s"][slide][np.sort(np.concatenate(extrema(sed)))]
    if not len(times):
        times = times_s[-1:]
    nearest = {int(np.argmin(np.abs(times_s - time))) for time in times}
    return sorted(nearest)[:_MOST]


def main(folder: str) -> int:
    """Draw into a results folder and print the names of the files."""
    import pyvista as pv

    from tactile_fem.output import drawing

    results = Results.open(folder)
    trace = results.trace
    times, files = read_series(results.fields)
    results.figures.mkdir(exist_ok=True)
    first = pv.read(files[0])
    _save(drawing.finger_figure(first), results.figures / "finger.png")
    chosen = choose_states(trace, times)
    grids = [pv.read(files[k]) for k in chosen]
    limits = drawing.colour_limits(grids)
    surface = drawing.stimulator_surface(results)
    over_time = Abscissa.of(results).label == TIME
    for k, grid in zip(chosen, grids, strict=True):
        stimulator = surface.translate(at_time(trace, "stimulator_mm", times[k]))
        slid_mm = float(at_time(trace, "displacement_mm", times[k]))
        title = f"Time {times[k]:.3f} s" if over_time else f"Displacement {slid_mm:.1f} mm"
        figure = drawing.deformation_figure(grid, stimulator, limits, title)
        _save(figure, _picture(results, over_time, times[k], slid_mm))
    return 0


def _save(figure: Figure, path: Path) -> None:
    write_figure(path, figure)
    print(path, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
