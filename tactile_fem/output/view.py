"""Views of a film: a window with a slider, an animation, a page for the browser.

Import it only if `tactile_fem.output.pictures.can_draw` allows it: VTK may crash otherwise.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

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
from tactile_fem.output.gif import PER_SECOND, write_gif
from tactile_fem.runtime.files import atomic_write, write_text
from tactile_fem.runtime.logs import counted

logger = logging.getLogger(__name__)

_PIXELS, _IN_FILM = (1100, 700), (840, 534)


class Frames(Protocol):
    """A film: what can be shown.

    Attributes
    ----------
    label, along
        What the frames are sorted by, and its values, (frames,).
    bar
        Name of the piece whose colours the colour bar explains, and the bar's title.
    camera
        Eye, focus and half of the picture's height, mm; Z is upwards.
    """

    label: str
    along: NDArray[np.float64]
    bar: tuple[str, str]
    camera: tuple[tuple[float, ...], tuple[float, ...], float]

    @property
    def legend(self) -> dict[str, str]:
        """Colours by what they mean."""
        ...

    def __len__(self) -> int: ...

    def nearest(self, value: float, /) -> int:
        """Return the number of the frame nearest to a value of `along`."""
        ...

    def pieces(self, k: int, /) -> Iterator[tuple[str, pv.DataSet, dict[str, Any]]]:
        """Yield everything to be drawn of frame `k`: a name, a mesh and its style."""
        ...

    def title(self, k: int, /) -> str:
        """Return what is written over frame `k`."""
        ...


class Scene:
    """Draws frames, each in place of the previous one, into a plotter of its own."""

    def __init__(self, film: Frames, *, off_screen: bool = True) -> None:
        self._film = film
        self.plotter = pv.Plotter(window_size=_PIXELS, title="tactile-fem", off_screen=off_screen)
        self.plotter.set_background("white")
        eye, focus, half_height = film.camera
        self.plotter.camera_position = [eye, focus, (0.0, 0.0, 1.0)]
        self.plotter.enable_parallel_projection()
        self.plotter.parallel_scale = half_height
        self.show(0)
        piece, title = film.bar
        self.plotter.add_scalar_bar(
            title=f"{title}\n ",
            mapper=self.plotter.actors[piece].mapper,
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
        rows = len(self._film.legend)
        figure = Figure(figsize=(2, 0.3 * rows))
        dot = {"ls": "", "marker": "o", "ms": 7, "mec": "black", "mew": 0.7}
        handles = [
            Line2D([], [], color=c, label=name, **dot) for name, c in self._film.legend.items()
        ]
        style = {"loc": "lower left", "fontsize": 9, "framealpha": 0.9, "edgecolor": "none"}
        figure.legend(handles=handles, handletextpad=0.2, **style)
        legend = pv.ChartMPL(figure, size=(0.17, 0.036 * rows), loc=(0.0, 0.0))
        legend.border_color = "white"
        self.plotter.add_chart(legend)

    def show(self, k: int) -> None:
        """Draw frame `k`."""
        for name, mesh, style in self._film.pieces(k):
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


# --- windows and files -------------------------------------------------------------------------


def window(film: Frames) -> None:
    """Open a window with a slider over the scan, and wait until it is closed."""
    _window_plotter(film, off_screen=False).show()


def _window_plotter(film: Frames, *, off_screen: bool) -> pv.Plotter:
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


def save_html(film: Frames, k: int, path: Path) -> None:
    """Write frame `k` as an HTML page on which it can be rotated and zoomed."""
    logger.info("drawing the page at: %s", film.title(k))
    scene = Scene(film)
    scene.show(k)
    page = scene.plotter.trame.export_html(None).read()
    scene.plotter.close()
    rows = "".join(
        f'<br><span style="color:{colour};text-shadow:0 0 1px black">&#9679;</span> {name}'
        for name, colour in film.legend.items()
    )
    box = (  # next to the viewer, which clears its own container
        '<div class="content" style="width:100vw;height:100vh"></div>'
        '<div style="position:fixed;left:1em;bottom:1em;padding:.5em 1em;background:#ffffffe6;'
        f'font:15px/1.5 sans-serif;pointer-events:none">{film.title(k)}{rows}</div>'
    )
    write_text(path, page.replace("</body>", f"{box}</body>"))


def save_png(film: Frames, k: int, path: Path) -> None:
    """Write frame `k` as a picture."""
    image = next(frames(film, [k], _PIXELS))
    with atomic_write(path) as part:
        image.save(part, format="PNG")


def save_gif(film: Frames, path: Path) -> None:
    """Write an animation, 20 frames a second."""
    images = frames(film)
    first = next(images)
    palette = _palette(first, film.legend)
    few = [_indexed(image, palette) for image in chain([first], images)]
    write_gif(few, path)


def save_mp4(film: Frames, path: Path) -> None:
    """Write an animation, 20 frames a second."""
    import imageio_ffmpeg

    with atomic_write(path) as part:
        stream = imageio_ffmpeg.write_frames(
            str(part),
            _IN_FILM,
            fps=PER_SECOND,
            macro_block_size=2,
            output_params=["-f", "mp4"],
        )
        stream.send(None)
        for image in frames(film):
            stream.send(image.tobytes())
        stream.close()


def frames(
    film: Frames, which: Sequence[int] | None = None, pixels: tuple[int, int] = _IN_FILM
) -> Iterator[Image.Image]:
    """Yield images of all frames, or of some, with title, colour bar and legend."""
    chosen = range(len(film)) if which is None else which
    scene = Scene(film)
    scene.add_legend()
    for k in counted(chosen, "frames to draw"):
        scene.show(k)
        scene.plotter.add_text(film.title(k), font_size=10, name="title")
        image = Image.fromarray(scene.plotter.screenshot(return_img=True))
        yield image.resize(pixels, Image.Resampling.LANCZOS)
    scene.plotter.close()


def _palette(image: Image.Image, legend: dict[str, str]) -> NDArray[np.uint8]:
    """Return (256, 3) colours: those of the colour scale and legend, the rest from a frame."""
    named = [*colormaps[drawing.SCALE](np.linspace(0, 1, 128)), *map(to_rgba, legend.values())]
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
