"""The command that shows a scan in three dimensions, over `tactile_fem.output.view`."""

from __future__ import annotations

import ctypes
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from tactile_fem.errors import StudyError, TactileError
from tactile_fem.output import pictures
from tactile_fem.runtime import logs
from tactile_fem.scan.results import Results

_ENDINGS = (".gif", ".mp4", ".html")


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
) -> None:
    """Show the finger cut open, the strain energy density and the firing receptors.

    Opens a window with a slider for the displacement or the time, or writes a file with --save,
    which needs no display.
    """
    found = Results.open(results)
    _check(save, at_mm)
    logs.set_up()
    if save is not None:
        os.environ.pop("DISPLAY", None)  # it might be unreachable
    import pyvista

    from tactile_fem.output import view as viewing
    from tactile_fem.output.film import Film
    from tactile_fem.output.plots import DISPLACEMENT

    pyvista.vtk_verbosity("off")  # without a display VTK warns before it draws off screen
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


def _check(save: Path | None, at_mm: float | None) -> None:
    """Raise errors that can be detected before a graphics library is loaded."""
    if save is not None and save.suffix not in _ENDINGS:
        raise StudyError(f'--save is "{save}" but must end in {", ".join(_ENDINGS)}.')
    if save is not None and not save.absolute().parent.is_dir():
        raise StudyError(f'--save is "{save}" but there is no folder {save.parent}.')
    if at_mm is not None and (save is None or save.suffix != ".html"):
        raise StudyError("--at-mm goes with --save to an .html file.")
    reason = pictures.can_draw()
    if reason is not None:
        raise TactileError(reason)
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
