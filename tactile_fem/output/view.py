"""Views of the deformation: a window with a slider, an animation, a page for the browser.

The finger is cut at the receptors. Behind the cut are its layers. In front of it only the
epidermis-dermis interface is shown, coloured by strain energy density, with the receptors on it.

Import it only if `tactile_fem.output.pictures.can_draw` allows it: VTK may crash otherwise.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib import colormaps
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from tactile_fem.output import drawing
from tactile_fem.output.film import Film, State, deformed
from tactile_fem.runtime.files import atomic_write, write_text

logger = logging.getLogger(__name__)

_SED = "Strain energy density\non the interface (kPa)"
_SED_COLOURS = "viridis"
# Colour and radius in mm.
_SILENT, _FIRING = ("#101010", 0.07), ("#FFFFFF", 0.1)
_RIM_SHIFT_MM = (0.0, 0.03, 0.03)
_PIXELS, _IN_FILM = (1100, 700), (840, 534)
_PER_SECOND = 20


class Scene:
    """Draws frames, each in place of the previous one, into a plotter of its own."""

    def __init__(self, film: Film, *, off_screen: bool = True) -> None:
        self._film = film
        self.plotter = pv.Plotter(window_size=_PIXELS, title="tactile-fem", off_screen=off_screen)
        self.plotter.set_background("white")
        focus = (0.0, film.cut_mm + 0.5, 3.6)
        eye = (9.0, film.cut_mm + 28.0, 24.0)
        self.plotter.camera_position = [eye, focus, (0.0, 0.0, 1.0)]
        self.plotter.enable_parallel_projection()
        self.plotter.parallel_scale = 9.6
        self.show(0)
        self.plotter.add_scalar_bar(
            title=f"{_SED}\n ",
            mapper=self.plotter.actors["interface"].mapper,
            color="black",
            vertical=True,
            position_x=0.88,
            position_y=0.5,
            height=0.42,
            width=0.06,
            fmt="%.1f",
        )

    def add_legend(self) -> None:
        """Name the colours; VTK's own legend would write white on white."""
        figure = Figure(figsize=(2, 2.4))
        dot = {"ls": "", "marker": "o", "ms": 7, "mec": "black", "mew": 0.7}
        handles = [Line2D([], [], color=c, label=name, **dot) for name, c in _legend().items()]
        style = {"loc": "lower left", "fontsize": 9, "framealpha": 0.9, "edgecolor": "none"}
        figure.legend(handles=handles, handletextpad=0.2, **style)
        legend = pv.ChartMPL(figure, size=(0.17, 0.29), loc=(0.0, 0.0))
        legend.border_color = "white"
        self.plotter.add_chart(legend)

    def show(self, k: int) -> State:
        """Draw frame `k` and return its state."""
        state = self._film[k]
        for name, mesh, style in _pieces(state, self._film):
            self.plotter.remove_actor(name, render=False)
            if mesh.n_points:
                self.plotter.add_mesh(
                    mesh,
                    name=name,
                    reset_camera=False,
                    render=False,
                    show_scalar_bar=False,
                    **style,
                )
        self.plotter.reset_camera_clipping_range()
        self.plotter.render()
        return state


def _pieces(state: State, film: Film) -> Iterator[tuple[str, pv.DataSet, dict[str, Any]]]:
    """Yield everything to be drawn: a name, a mesh and its style."""
    cut = (0.0, film.cut_mm, 0.0)
    for name, part in drawing.parts(state.solid):
        colour = drawing.COLOURS[name]
        shell = part.extract_surface(algorithm=None).clip("y", origin=cut)
        if shell.n_points:
            yield f"{name} shell", deformed(shell), {"color": colour, "ambient": 0.25}
        face = part.slice("y", origin=cut)
        if face.n_points:
            face = deformed(face)
            yield f"{name} face", face, {"color": colour, "lighting": False}
            yield f"{name} rim", drawing.rim(face, _RIM_SHIFT_MM), drawing.RIM_STYLE
    front = state.interface.clip("y", origin=cut, invert=False)
    front = deformed(front.clip("z", origin=(0.0, 0.0, film.rim_mm)))
    style = {
        "scalars": "sed_kPa",
        "cmap": _SED_COLOURS,
        "clim": (0, film.top_kPa),
        "lighting": False,
    }
    yield "interface", front, style
    yield "interface rim", drawing.rim(front, _RIM_SHIFT_MM), drawing.RIM_STYLE
    for name, which, (colour, radius) in (
        ("silent", ~state.fired, _SILENT),
        ("firing", state.fired, _FIRING),
    ):
        points = pv.PolyData(state.receptors_mm[which])
        balls = points.glyph(geom=pv.Sphere(radius=radius), scale=False, orient=False)
        yield name, balls, {"color": colour, "ambient": 0.4}
    yield "stimulator", state.stimulator, drawing.RELIEF_STYLE


# --- windows and files -------------------------------------------------------------------------


def window(film: Film) -> None:
    """Open a window with a slider over the scan, and wait until it is closed."""
    _window_plotter(film, off_screen=False).show()


def _window_plotter(film: Film, *, off_screen: bool) -> pv.Plotter:
    scene = Scene(film, off_screen=off_screen)
    scene.add_legend()
    if len(film) > 1:
        scene.plotter.add_slider_widget(
            lambda value: scene.show(film.nearest(value)),
            (film.along[0], film.along[-1]),
            title=film.label,
            value=film.along[0],
            color="black",
            fmt="%.2f",
            pointa=(0.03, 0.91),
            pointb=(0.33, 0.91),
        )
    return scene.plotter


def save_html(film: Film, k: int, path: Path) -> None:
    """Write frame `k` as an HTML page on which it can be rotated and zoomed."""
    scene = Scene(film)
    state = scene.show(k)
    page = scene.plotter.trame.export_html(None).read()
    scene.plotter.close()
    rows = "".join(
        f'<br><span style="color:{colour};text-shadow:0 0 1px black">&#9679;</span> {name}'
        for name, colour in _legend().items()
    )
    box = (  # next to the viewer, which clears its own container
        '<div class="content" style="width:100vw;height:100vh"></div>'
        '<div style="position:fixed;left:1em;bottom:1em;padding:.5em 1em;background:#ffffffe6;'
        f'font:15px/1.5 sans-serif;pointer-events:none">{_title(state)}{rows}</div>'
    )
    write_text(path, page.replace("</body>", f"{box}</body>"))


def save_gif(film: Film, path: Path) -> None:
    """Write an animation, 20 frames a second."""
    images = frames(film)
    first = next(images)
    palette = _palette(first)
    few = [_indexed(image, palette) for image in chain([first], images)]
    with atomic_write(path) as part:
        few[0].save(
            part,
            format="GIF",
            save_all=True,
            append_images=few[1:],
            duration=1000 // _PER_SECOND,
            loop=0,
        )


def save_mp4(film: Film, path: Path) -> None:
    """Write an animation, 20 frames a second."""
    import imageio_ffmpeg

    with atomic_write(path) as part:
        stream = imageio_ffmpeg.write_frames(
            str(part),
            _IN_FILM,
            fps=_PER_SECOND,
            macro_block_size=2,
            output_params=["-f", "mp4"],
        )
        stream.send(None)
        for image in frames(film):
            stream.send(image.tobytes())
        stream.close()


def frames(film: Film) -> Iterator[Image.Image]:
    """Yield the images of an animation, with colour bar and legend."""
    logger.info("%d frames to draw", len(film))
    scene = Scene(film)
    scene.add_legend()
    for k in range(len(film)):
        scene.plotter.add_text(_title(scene.show(k)), font_size=10, name="title")
        image = Image.fromarray(scene.plotter.screenshot(return_img=True))
        yield image.resize(_IN_FILM, Image.Resampling.LANCZOS)
    scene.plotter.close()


def _palette(image: Image.Image) -> NDArray[np.uint8]:
    """Return (256, 3) colours: those of the colour scale and legend, the rest from a frame."""
    named = [*colormaps[_SED_COLOURS](np.linspace(0, 1, 128)), *map(to_rgba, _legend().values())]
    fixed = np.round(255 * np.array(named)[:, :3])
    others = image.quantize(256 - len(fixed), dither=Image.Dither.NONE).getpalette()
    return np.vstack([fixed, np.reshape(others, (-1, 3))])[:256].astype(np.uint8)


def _indexed(image: Image.Image, palette: NDArray[np.uint8]) -> Image.Image:
    """Return the image with the nearest colours of a palette; Pillow's search is not exact."""
    pixels = np.asarray(image).astype(np.int64) @ [1 << 16, 1 << 8, 1]
    colours, place = np.unique(pixels, return_inverse=True)
    rgb = np.column_stack([colours >> 16, (colours >> 8) & 255, colours & 255])
    nearest = cKDTree(palette).query(rgb)[1].astype(np.uint8)
    few = Image.fromarray(nearest[place.reshape(pixels.shape)])
    few.putpalette(palette.tobytes())
    return few


def _title(state: State) -> str:
    return f"Displacement {state.displacement_mm:.1f} mm, {1000 * state.time_s:.0f} ms"


def _legend() -> dict[str, str]:
    layers = {name.replace("_", " "): colour for name, colour in drawing.COLOURS.items()}
    return {**layers, "receptor, silent": _SILENT[0], "receptor, firing": _FIRING[0]}
