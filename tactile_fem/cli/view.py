"""The commands that show finger and stimulator in three dimensions, before and after a scan."""

from __future__ import annotations

import ctypes
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from tactile_fem.cli.options import (
    OWN_SIZE,
    Changes,
    PositiveFloat,
    ScanFolder,
    Size,
    StudyFile,
    Written,
    check_file,
)
from tactile_fem.errors import PlaceError, StudyError, TactileError

if TYPE_CHECKING:
    from tactile_fem.finger.plane import Plane

_PREVIEW_DPI = 150


def preview(study: StudyFile = None, /, *, output: Written, changes: Changes = ()) -> None:
    """Draw finger and stimulator before a scan, and where the contact point goes.

    Parameters
    ----------
    output
        Write this .png file.
    """
    from tactile_fem import load_study

    the_study = load_study(study, changes)
    check_file("--output", output, ".png")
    from tactile_fem import preview as preview_of
    from tactile_fem.finger.anatomy import SurfaceFiles
    from tactile_fem.runtime.files import write_figure

    try:
        figure = preview_of(the_study)
    except PlaceError as error:
        if the_study.finger.is_scanned:
            drawn = SurfaceFiles.reader(the_study.finger).figure(error.place_mm)
            write_figure(output, drawn, _PREVIEW_DPI)
            print(f"The scans and the place are drawn in {output}")
        raise
    write_figure(output, figure, _PREVIEW_DPI)
    print(f"Written to {output}")


def view(
    results: ScanFolder,
    /,
    *,
    save: Path | None = None,
    at_mm: float | None = None,
    at_s: float | None = None,
    show: str | None = None,
    size: Size = OWN_SIZE,
    vibration: Annotated[
        PositiveFloat | None,
        Parameter(
            help="Show not the scan but its vibration: at the frequency in Hz that is nearest of "
            "those whose shape `vibrate` kept, over one period."
        ),
    ] = None,
    amplitude_um: PositiveFloat = 10.0,
) -> None:
    """Show the finger cut open, the strain energy density and the firing receptors, or any field.

    Opens a window with a slider for the time or the phase, or writes a file with --save, which
    needs no display.

    Parameters
    ----------
    save
        Write an animation, .gif or .mp4 (which needs imageio-ffmpeg), a frame, .png, a page for the
        browser, .html (which needs the extra html), or, for ParaView and PyVista, all fields of all
        kept states, .vtkhdf.
    at_mm
        Displacement of the frame or page; default where what is shown is largest.
    at_s
        Its time instead, which is negative in the press.
    show
        Instead of the receptors a field: sed, displacement, stretch, von_mises, on the finger cut
        along X = 0; pressure, friction, slip, on the skin from beneath; or a column of the table
        that `fields` writes, such as stress_zz_kPa.
    amplitude_um
        Amplitude of the vibration.
    """
    from tactile_fem import Results

    found = Results.open(results)
    plane = found.study.finger.section_plane
    _check_options(plane, save, {"--at-mm": at_mm, "--at-s": at_s}, vibration, show)
    modes_file = found.vibration / "modes.npz"
    if vibration is not None and not modes_file.exists():
        raise StudyError(f"{modes_file} is missing: run tactile-fem vibrate {results} first.")
    from tactile_fem.output import pictures

    pictures.prepare_drawing(plane, off_screen=save is not None)
    if save is not None and save.suffix == ".vtkhdf":
        from tactile_fem.output.vtkhdf import write_states

        print(f"{write_states(found, save)} states written to {save}")
        return
    if save is None and not has_display():
        raise TactileError(
            "There is no display for a window: write a file instead, --save scan.gif or scan.html."
        )
    from tactile_fem.output import view as viewing
    from tactile_fem.output.film import Film
    from tactile_fem.output.modes import Modes

    look: pictures.Look = "receptors" if show is None else "deformation"
    if vibration is None:
        film = Film.of_scan(found, show or "sed")
    else:
        modes, look = Modes.load(modes_file), "vibration"
        film = Film.of_vibration(modes, modes.nearest(vibration), amplitude_um / 1000)
    frames = pictures.frames_of(found, film, look, off_screen=save is not None)
    if save is None:
        viewing.window(frames).show()
        return
    k = film.strongest if at_s is None else film.nearest(at_s)
    if at_mm is not None:
        k = film.nearest_mm(at_mm)
    with size.used():
        viewing.save(frames, save, k)
    print(f"Written to {save}")


def _check_options(
    plane: Plane,
    save: Path | None,
    at: dict[str, float | None],
    frequency_Hz: float | None,
    show: str | None,
) -> None:
    """Raise errors that can be detected before a graphics library is loaded."""
    endings = (".gif", ".mp4", ".png", ".vtkhdf", ".html")[: None if plane.is_space else 4]
    if save is not None:
        check_file("--save", save, *endings)
    elif not plane.is_space:
        raise StudyError(f"A section needs --save with a name in {', '.join(endings)}.")
    kind = None if save is None else save.suffix
    given = [option for option, value in at.items() if value is not None]
    if given and kind not in (".png", ".html"):
        raise StudyError(f"{given[0]} goes with --save to a .png or .html file.")
    if given and frequency_Hz is not None:
        raise StudyError(f"{given[0]} does not go with --vibration, whose state is its own.")
    if show is not None and frequency_Hz is not None:
        raise StudyError("--show does not go with --vibration, which shows the amplitude.")
    if kind == ".vtkhdf" and (show is not None or frequency_Hz is not None):
        raise StudyError(
            "A .vtkhdf file contains all fields of the scan: leave out the other options."
        )
    if len(given) > 1:
        raise StudyError("--at-mm and --at-s are both given, but one of them chooses the frame.")
    if kind == ".html" and find_spec("trame_pyvista") is None:
        raise TactileError('An .html file needs trame: pip install "tactile-fem[html]".')
    if kind == ".mp4" and find_spec("imageio_ffmpeg") is None:
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


COMMANDS = (preview, view)
