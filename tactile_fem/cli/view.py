"""The commands that show finger and stimulator in three dimensions, before and after a scan."""

from __future__ import annotations

import ctypes
import logging
import os
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from tactile_fem.cli.options import Settings, StudyFile
from tactile_fem.errors import PlaceError, StudyError, TactileError
from tactile_fem.finger import load_finger
from tactile_fem.finger.scanned import Scans
from tactile_fem.output import pictures, section
from tactile_fem.runtime import logs
from tactile_fem.runtime.files import write_figure
from tactile_fem.simulation.checks import check_with_mesh, tell_missed
from tactile_fem.simulation.results import Results
from tactile_fem.stimulus import make_body
from tactile_fem.study.file import load_study
from tactile_fem.vibration.modes import Modes

logger = logging.getLogger(__name__)

_ENDINGS = (".gif", ".mp4", ".html")
_OF_SECTION = (".gif", ".png")


def view(
    results: Annotated[Path, Parameter(help="Folder of a scan.")],
    /,
    *,
    save: Annotated[
        Path | None,
        Parameter(help="Write an animation, .gif or .mp4, or a page for the browser, .html."),
    ] = None,
    at_mm: Annotated[
        float | None,
        Parameter(help="Displacement of a slide shown on the page; default at the largest SED."),
    ] = None,
    vibration: Annotated[
        float | None,
        Parameter(
            help="Show not the scan but its vibration: at the frequency in Hz that is nearest of "
            "those whose shape `vibrate` kept, over one period.",
            validator=validators.Number(gt=0),
        ),
    ] = None,
    amplitude_um: Annotated[
        float, Parameter(help="Amplitude of the vibration.", validator=validators.Number(gt=0))
    ] = 10.0,
) -> None:
    """Show the finger cut open, the strain energy density and the firing receptors.

    Opens a window with a slider for the displacement, the time or the phase, or writes a file
    with --save, which needs no display.
    """
    found = Results.open(results)
    logs.set_up()
    if vibration is None and found.study.finger.is_section:
        _view_section(found, save, at_mm)
        return
    _check(save, at_mm)
    if vibration is not None and at_mm is not None:
        raise StudyError("--at-mm does not go with --vibration: its state was chosen by `vibrate`.")
    modes = None if vibration is None else _modes(found)
    if save is not None:
        os.environ.pop("DISPLAY", None)  # it might be unreachable
    import pyvista

    from tactile_fem.output import view as viewing
    from tactile_fem.output.film import Film
    from tactile_fem.output.histories import DISPLACEMENT
    from tactile_fem.output.mode_film import ModeFilm

    pyvista.vtk_verbosity("off")  # without a display VTK warns before it draws off screen
    film: Film | ModeFilm
    if modes is not None and vibration is not None:
        film = ModeFilm(found, modes, modes.nearest(vibration), amplitude_um / 1000)
    else:
        film = Film(found)
    if at_mm is not None and film.label != DISPLACEMENT:
        raise StudyError(f"--at-mm is {at_mm:g} but the path in {results} is no straight slide.")
    if save is None:
        viewing.window(film)
        return
    if save.suffix == ".html":
        k = film.strongest if at_mm is None else film.nearest(at_mm)
        viewing.save_html(film, k, save)
    elif save.suffix == ".mp4":
        viewing.save_mp4(film, save)
    else:
        viewing.save_gif(film, save)
    print(f"Written to {save}")


def _view_section(results: Results, save: Path | None, at_mm: float | None) -> None:
    """Write the film of a section, or a picture of one moment."""
    if save is None:
        raise StudyError(f"A section needs --save with a name in {' or '.join(_OF_SECTION)}.")
    _check_file("--save", save, _OF_SECTION)
    film = section.SectionFilm(results)
    if save.suffix == ".gif":
        section.save_gif(film, save)
    else:
        k = film.strongest if at_mm is None else film.nearest(at_mm)
        write_figure(save, section.moment_figure(film, k))
    print(f"Written to {save}")


def preview(
    study: StudyFile = None,
    /,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Write this .png file.")],
    settings: Settings = None,
) -> None:
    """Draw finger and stimulator before a scan, and where the contact point goes."""
    the_study = load_study(study, settings or ())
    _check_file("--output", output, (".png",))
    logs.set_up()
    if the_study.finger.is_section:
        mesh, body = load_finger(the_study.finger), make_body(the_study.stimulus)
        tell_missed(body, check_with_mesh(the_study, body, mesh), mesh)
        write_figure(output, section.layers_figure(mesh, body, (0.0, 0.0, 0.0)))
        print(f"Written to {output}")
        return
    _check_drawing()
    os.environ.pop("DISPLAY", None)  # it might be unreachable
    import pyvista

    from tactile_fem.output.preview import preview_figure, scans_figure

    pyvista.vtk_verbosity("off")  # as in `view`
    body = make_body(the_study.stimulus)
    try:
        finger = load_finger(the_study.finger)
    except PlaceError as error:
        if the_study.finger.is_scanned:
            write_figure(output, scans_figure(Scans.of(the_study.finger), error.place_mm))
            print(f"The scans and the place are drawn in {output}")
        raise
    path = check_with_mesh(the_study, body, finger)
    tell_missed(body, path, finger)
    logger.info("drawing finger and stimulator")
    write_figure(output, preview_figure(finger, body, path))
    print(f"Written to {output}")


def _check_drawing() -> None:
    """Raise TactileError if a graphics library is missing, before one is loaded."""
    reason = pictures.can_draw()
    if reason is not None:
        raise TactileError(reason)


def _modes(results: Results) -> Modes:
    path = results.vibration / "modes.npz"
    if not path.exists():
        raise StudyError(f"{path} is missing: run tactile-fem vibrate {results.folder} first.")
    return Modes.load(path)


def _check_file(option: str, file: Path, endings: Sequence[str]) -> None:
    """Raise StudyError if a file to be written has another ending or no folder."""
    if file.suffix not in endings:
        raise StudyError(f'{option} is "{file}" but must end in {", ".join(endings)}.')
    if not file.absolute().parent.is_dir():
        raise StudyError(f'{option} is "{file}" but there is no folder {file.parent}.')


def _check(save: Path | None, at_mm: float | None) -> None:
    """Raise errors that can be detected before a graphics library is loaded."""
    if save is not None:
        _check_file("--save", save, _ENDINGS)
    if at_mm is not None and (save is None or save.suffix != ".html"):
        raise StudyError("--at-mm goes with --save to an .html file.")
    _check_drawing()
    if save is None and not has_display():
        raise TactileError(
            "There is no display for a window: write a file instead, --save scan.gif or scan.html."
        )
    if save is not None and save.suffix == ".html" and find_spec("trame_pyvista") is None:
        raise TactileError('An .html file needs trame: pip install "tactile-fem[html]".')
    if save is not None and save.suffix == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise TactileError("An .mp4 file needs ffmpeg: pip install imageio-ffmpeg, or save a .gif.")


def has_display() -> bool:
    """Return whether a window can be opened: the display in the environment may be unreachable."""
    if not sys.platform.startswith("linux"):
        return True
    try:
        x = ctypes.CDLL("libX11.so.6")
    except OSError:
        return False
    x.XOpenDisplay.restype = ctypes.c_void_p
    return x.XOpenDisplay(None) is not None
