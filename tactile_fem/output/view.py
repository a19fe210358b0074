"""Shows films: pictures, animations, a window with a slider, a page for the browser."""

from __future__ import annotations

import base64
import io
import logging
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, to_rgba
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from tactile_fem.output.annotations import FILM_DPI, PICTURE_DPI, SIZE_INCHES, WINDOW_DPI, annotate
from tactile_fem.runtime.files import atomic_write, write_figure, write_text
from tactile_fem.runtime.logs import counted

if TYPE_CHECKING:
    import pyvista as pv

    from tactile_fem.output.scene import Scene
    from tactile_fem.output.section import SectionScene

    # A film and how its frames are drawn.
    Frames = Scene | SectionScene

logger = logging.getLogger(__name__)

_FRAMES_PER_SECOND = 20


# --- files -------------------------------------------------------------------------------------


def save(frames: Frames, path: Path, k: int) -> None:
    """Write an animation, .gif or .mp4, or frame `k`: .png, or of a solid finger .html."""
    match path.suffix:
        case ".gif":
            _save_gif(frames, path)
        case ".mp4":
            _save_mp4(frames, path)
        case ".html":
            _save_html(frames, path, k)
        case _:
            write_figure(path, frames.figure(k), PICTURE_DPI)


def _images(frames: Frames) -> Iterator[Image.Image]:
    for k in counted(range(len(frames.film)), "frames to draw"):
        canvas = FigureCanvasAgg(frames.figure(k, FILM_DPI))
        canvas.draw()
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _save_gif(frames: Frames, path: Path) -> None:
    """Write an endless animation."""
    images, film = list(_images(frames)), frames.film
    assert film.shown is not None
    palette = _palette(images[0], frames.legend, film.shown.colours(film.limits))
    first, *others = (_indexed(image, palette) for image in images)
    pause_ms = 1000 // _FRAMES_PER_SECOND
    with atomic_write(path) as part:
        first.save(part, "GIF", save_all=True, append_images=others, duration=pause_ms, loop=0)


def _palette(image: Image.Image, legend: dict[str, str], scale: Colormap) -> NDArray[np.uint8]:
    """Return (256, 3) colours: those of the colour scale and legend, the rest from a frame."""
    named = [*scale(np.linspace(0, 1, 128)), *map(to_rgba, legend.values())]
    fixed = np.round(255 * np.array(named)[:, :3])
    others = image.quantize(256 - len(fixed), dither=Image.Dither.NONE).getpalette()
    return np.vstack([fixed, np.reshape(others, (-1, 3))])[:256].astype(np.uint8)


def _indexed(image: Image.Image, palette: NDArray[np.uint8]) -> Image.Image:
    """Return the image with the nearest colours of a palette; Pillow's search is not exact."""
    pixels = np.asarray(image).astype(np.int64) @ [1 << 16, 1 << 8, 1]
    colours, place = np.unique(pixels, return_inverse=True)
    rgb = np.column_stack([colours >> 16, (colours >> 8) & 255, colours & 255])
    nearest = cKDTree(palette).query(rgb)[1].astype(np.uint8)
    indexed = Image.fromarray(nearest[place.reshape(pixels.shape)])
    indexed.putpalette(palette.tobytes())
    return indexed


def _save_mp4(frames: Frames, path: Path) -> None:
    import imageio_ffmpeg

    images = _images(frames)
    first = next(images)
    box = 0, 0, *(side // 2 * 2 for side in first.size)  # ffmpeg takes even numbers only
    mp4 = {"macro_block_size": 2, "output_params": ["-f", "mp4"]}
    with atomic_write(path) as part:
        stream = imageio_ffmpeg.write_frames(str(part), box[2:], fps=_FRAMES_PER_SECOND, **mp4)
        stream.send(None)
        for image in chain([first], images):
            stream.send(image.crop(box).tobytes())
        stream.close()


def _save_html(scene: Scene, path: Path, k: int) -> None:
    """Write a frame as a page on which the finger can be turned; its annotations stay in place."""
    title = scene.film.titles[k]
    logger.info("drawing the page at: %s", title)
    scene.show(k)
    page = scene.plotter.trame.export_html(None).read()
    png = io.BytesIO()
    _overlay(scene, title, PICTURE_DPI).savefig(png, format="png", transparent=True)
    data = base64.b64encode(png.getvalue()).decode("ascii")
    place = "position:fixed;left:0;top:0;width:100vw;height:100vh;object-fit:contain"
    box = (  # next to the viewer, which clears its own container
        '<div class="content" style="width:100vw;height:100vh"></div>'
        f'<img alt="{title}" src="data:image/png;base64,{data}"'
        f' style="{place};pointer-events:none">'
    )
    write_text(path, page.replace("</body>", f"{box}</body>"))


# --- window ------------------------------------------------------------------------------------


def window(scene: Scene) -> pv.Plotter:
    """Return a window, to be shown, with annotations and a slider that chooses the frame."""
    import pyvista as pv

    film = scene.film
    chart = pv.ChartMPL(_overlay(scene, "", WINDOW_DPI), redraw_on_render=False)
    chart.background_color = chart.border_color = (1.0, 1.0, 1.0, 0.0)
    scene.plotter.add_chart(chart)
    scene.show(film.strongest)
    if len(film) > 1:
        scene.plotter.add_slider_widget(
            lambda value: scene.show(film.nearest(value)),
            (film.along[0], film.along[-1]),
            title=film.label,
            value=film.along[film.strongest],
            color="black",
            fmt="%.3f",
            pointa=(0.03, 0.91),
            pointb=(0.33, 0.91),
        )
    return scene.plotter


def _overlay(scene: Scene, title: str, dots_per_inch: int) -> Figure:
    figure = Figure(figsize=SIZE_INCHES, dpi=dots_per_inch)
    annotate(figure, title, scene.legend, scene.bar)
    return figure
