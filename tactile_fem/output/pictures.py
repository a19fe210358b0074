"""Pictures of the finger, drawn off screen in a separate process.

A graphics library can crash the process that loads it, so a scan does not load one: it starts
``python -m tactile_fem.output.pictures FOLDER DPI WIDTH_MM [AMPLITUDE_MM]``, which draws the states
of a scan or, with an amplitude, the shapes of its vibration, and prints the names of the files.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem.errors import TactileError
from tactile_fem.finger.plane import SPACE, Plane
from tactile_fem.output.abscissa import Abscissa
from tactile_fem.output.annotations import PICTURE_DPI
from tactile_fem.output.film import FRAMES_PER_STATE, Film
from tactile_fem.output.modes import Modes
from tactile_fem.output.section import SectionScene, gap_of
from tactile_fem.results.fields import read_series
from tactile_fem.results.histories import central_receptor, extrema
from tactile_fem.results.results import Results
from tactile_fem.runtime import doctor
from tactile_fem.runtime.files import Print, in_print, write_figure

if TYPE_CHECKING:
    from tactile_fem.output.view import Frames

logger = logging.getLogger(__name__)

Look = Literal["receptors", "deformation", "vibration"]

_MODULE = "tactile_fem.output.pictures"
_TIMEOUT_S = 600
_MOST_STATES = 8


def can_draw(plane: Plane = SPACE) -> str | None:
    """Return in one sentence why a finger cannot be drawn, or None if nothing is missing.

    A section is drawn with Matplotlib and needs nothing more.
    """
    if not plane.is_space:
        return None
    if find_spec("pyvista") is None:
        return (
            "PyVista is not installed: 3-D pictures are skipped. "
            'To install it: pip install "tactile-fem[pictures]".'
        )
    finding = doctor.picture_finding()
    return None if finding is None else f"{finding}."


def prepare_drawing(plane: Plane, *, off_screen: bool = True) -> None:
    """Raise TactileError if a library is missing, or make this process ready to draw."""
    if reason := can_draw(plane):
        raise TactileError(reason)
    if not off_screen:
        return
    os.environ.pop("DISPLAY", None)  # it might be unreachable
    if plane.is_space:
        import pyvista

        pyvista.vtk_verbosity("off")  # without a display VTK warns before it draws off screen


def draw_pictures(results: Results, amplitude_mm: float | None = None) -> list[Path]:
    """Draw the states of a scan, or the shapes of its vibration, into its folder.

    Return the files. All errors are logged as warnings: pictures are less important than data.
    """
    reason = can_draw(results.study.finger.section_plane)
    if reason is None and amplitude_mm is None and not read_series(results.fields)[1]:
        reason = "There are no field files: 3-D pictures are skipped."
    if reason is not None:
        logger.warning("%s", reason)
        return []
    logger.info("drawing 3-D pictures of the finger, which can take some minutes")
    wanted = in_print.get()
    size = str(wanted.dpi or PICTURE_DPI), repr(wanted.width_mm or 0.0)
    command = [sys.executable, "-m", _MODULE, str(results.folder), *size]
    command += [] if amplitude_mm is None else [repr(amplitude_mm)]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            encoding="utf-8",
            errors="surrogateescape",  # as Python takes names of files that are not UTF-8
            timeout=_TIMEOUT_S,
            env=_environment(),
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        logger.warning("3-D pictures are skipped: %s.", error)
        return []
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        told = "Drawing 3-D pictures ended with code %d (%s); the data are not affected."
        logger.warning(told, done.returncode, last)
    return [Path(line) for line in done.stdout.splitlines() if Path(line).is_file()]


def _environment() -> dict[str, str]:
    """Return the environment without MPI's variables and a display that may be unreachable."""
    mpi = ("PMI_", "PMIX_", "OMPI_", "MPI_", "HYD")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(mpi)}
    environment.pop("DISPLAY", None)
    return {**environment, "PYTHONIOENCODING": "utf-8:surrogateescape"}


# --- in that process ---------------------------------------------------------------------------


def main(folder: str, dpi: str, width_mm: str, amplitude_mm: str | None = None) -> int:
    """Draw into a results folder and print the names of the files; a width of 0 is their own."""
    in_print.set(Print(float(width_mm) or None, int(dpi)))
    results = Results.open(folder)
    shown = _states(results) if amplitude_mm is None else _shapes(results, float(amplitude_mm))
    for path, figure in shown:
        path.parent.mkdir(exist_ok=True)
        write_figure(path, figure)
        print(path, flush=True)
    return 0


def _states(results: Results) -> Iterator[tuple[Path, Figure]]:
    """Yield the layers of a solid finger, and the deformations with the largest and least SED."""
    film = Film.of_scan(results)
    if film.mesh.plane.is_space:
        from tactile_fem.output.anatomy import finger_figure

        yield results.figures / "finger.png", finger_figure(film.mesh)
    for earlier in results.figures.glob("deformation_*.png"):
        earlier.unlink()
    frames, over = frames_of(results, film, "deformation"), Abscissa.of(results.trace)
    for state in choose_states(results.trace, read_series(results.fields)[0]):
        k = FRAMES_PER_STATE * state
        name = f"{film.along[k]:06.3f}_s"
        if over.is_to_scale and film.along[k] >= 0 and film.slid_mm is not None:
            name = f"{film.slid_mm[k]:05.2f}"
        yield results.figures / f"deformation_{name}.png", frames.figure(k)


def _shapes(results: Results, amplitude_mm: float) -> Iterator[tuple[Path, Figure]]:
    """Yield the finger at the largest deflection of its vibration at each frequency."""
    modes = Modes.load(results.vibration / "modes.npz")
    for k, frequency in enumerate(modes.frequency_Hz):
        film = Film.of_vibration(modes, k, amplitude_mm)
        figure = frames_of(results, film, "vibration").figure(film.strongest)
        yield results.vibration / f"shape_{frequency:.4g}_Hz.png", figure


def frames_of(results: Results, film: Film, look: Look, *, off_screen: bool = True) -> Frames:
    """Return the frames of a film as its kind of finger is drawn.

    A section is drawn whole, a solid finger is cut open: behind its receptors, or along its middle.
    """
    if not film.mesh.plane.is_space:
        own = results.stimulator
        return SectionScene(film, own.gap if own else gap_of(results.study.stimulus.body()))
    from tactile_fem.output import scene

    kinds = {"receptors": scene.receptor_scene, "vibration": scene.vibration_scene}
    return kinds.get(look, scene.deformation_scene)(results, film, off_screen=off_screen)


def choose_states(
    trace: Mapping[str, NDArray[np.float64]], times_s: NDArray[np.float64]
) -> list[int]:
    """Return which of the states saved at some times are nearest to extrema of the central SED.

    The largest SED of the path is one of them.
    """
    central = central_receptor(trace["receptors_mm"], trace.get("population"))
    sed = trace["sed_kPa"][:, central]
    rows = [int(np.argmax(sed)), *np.sort(np.concatenate(extrema(sed)))]
    nearest = [int(np.argmin(np.abs(times_s - trace["time_s"][row]))) for row in rows]
    return sorted(list(dict.fromkeys(nearest))[:_MOST_STATES])


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
