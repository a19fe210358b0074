"""Recognises letters in images of firing by their templates; used by the demos here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.figure import Figure
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tactile_fem.errors import StudyError
from tactile_fem.output.plots import styled
from tactile_fem.series.image import Array, RateImage
from tactile_fem.stimulus import outlines
from tactile_fem.study import AnyStimulus

SHIFT_MM = 1.0
# Width of a blurred outline, of the order of the spread of a receptor's field.
_BLUR_MM = 0.3
_FINE = 4  # sub-pixels of a pixel in each direction


def edge_image(stimulus: AnyStimulus, across_mm: Array, along_mm: Array) -> Array:
    """Return the blurred outline of the raised shapes, (rows, columns), 1 at most.

    Slowly adapting afferents fire at edges (Blake et al. 1997), so images are compared with the
    outline rather than with the raised area.

    Raises
    ------
    StudyError
        The stimulator has no outline.
    """
    shapes = [shape for shape in outlines(stimulus) if not shape.is_empty]
    if not shapes:
        raise StudyError(f'The stimulator "{stimulus.kind}" has no outline to compare with.')
    lines = shapely.unary_union([shape.boundary for shape in shapes])
    pixel = across_mm[1] - across_mm[0], along_mm[1] - along_mm[0]
    offsets = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    x = (across_mm[:, None] + offsets * pixel[0]).ravel()
    y = (along_mm[:, None] + offsets * pixel[1]).ravel()
    points = shapely.points(*np.meshgrid(x, y, indexing="ij"))
    near = np.exp(-0.5 * (shapely.distance(lines, points) / _BLUR_MM) ** 2)
    cells = near.reshape(len(across_mm), _FINE, len(along_mm), _FINE)
    return np.asarray(cells.mean(axis=(1, 3)))


def correlation(image: Array, template: Array, max_shift: tuple[int, int]) -> float:
    """Return the largest correlation of an image with a template over all shifts.

    Parameters
    ----------
    image, template
        Of the same shape; the shifted template is zero beyond its border.
    max_shift
        Largest shift in rows and columns.

    Returns
    -------
    r
        Pearson's correlation over the whole image; 0 for a uniform image.
    """
    rows, columns = image.shape
    padded = np.pad(template, [(max_shift[0], max_shift[0]), (max_shift[1], max_shift[1])])
    shifted = sliding_window_view(padded, (rows, columns)).reshape(-1, rows * columns)
    centred = shifted - shifted.mean(axis=1, keepdims=True)
    own = image.ravel() - image.mean()
    norms = np.linalg.norm(centred, axis=1) * np.linalg.norm(own)
    products = centred @ own
    r = np.divide(products, norms, out=np.zeros_like(products), where=norms > 0)
    return float(r.max())


def outline_correlation(image: RateImage, stimulus: AnyStimulus) -> float:
    """Return the correlation of firing with the stimulator's outline at the best shift."""
    template = edge_image(stimulus, image.across_mm, image.along_mm)
    return correlation(image.rate_Hz, template, _max_shift(image))


@dataclass(frozen=True)
class Recognition:
    """How often each letter was recognised as each.

    Attributes
    ----------
    letters
        The alphabet.
    confusion
        Number of images of the row's letter that were recognised as the column's letter,
        (letters, letters).
    """

    letters: tuple[str, ...]
    confusion: NDArray[np.int64]

    @property
    def accuracy(self) -> float:
        """Share of images that were recognised correctly."""
        return float(np.trace(self.confusion) / self.confusion.sum())


def recognise(images: Mapping[str, Sequence[RateImage]], blur_mm: float = 0.0) -> Recognition:
    """Recognise every image by the templates of all letters, with its own realization left out.

    The k-th images of all letters come from the same population, with the same gains and noise.
    The templates must not know that population: the template of a letter is the mean of its
    other images. An image is recognised as the letter whose template it correlates with best,
    after a shift of up to `SHIFT_MM` in both directions.

    Parameters
    ----------
    images
        At least two realizations of each letter, equally many of each, all of one shape.
    blur_mm
        Standard deviation of an additional blur of all images.

    Raises
    ------
    StudyError
        There are too few images, or their numbers or shapes differ.
    """
    letters = tuple(images)
    counts = {len(several) for several in images.values()}
    if len(counts) != 1 or min(counts) < 2:
        raise StudyError("Recognition needs two or more images of each letter, as many of each.")
    shapes = {image.rate_Hz.shape for several in images.values() for image in several}
    if len(shapes) > 1:
        raise StudyError(f"The images have different shapes: {sorted(shapes)}.")
    max_shift = _max_shift(images[letters[0]][0])
    # (letters, realizations, rows, columns)
    stack = np.array([[_blurred(image, blur_mm) for image in images[name]] for name in letters])
    confusion = np.zeros((len(letters), len(letters)), dtype=np.int64)
    for k in range(stack.shape[1]):
        templates = np.delete(stack, k, axis=1).mean(axis=1)
        for row, image in enumerate(stack[:, k]):
            scores = [correlation(image, template, max_shift) for template in templates]
            confusion[row, int(np.argmax(scores))] += 1
    return Recognition(letters, confusion)


@styled
def confusion_figure(recognitions: Mapping[str, Mapping[float, Recognition]]) -> Figure:
    """Draw the confusion matrices.

    Parameters
    ----------
    recognitions
        By protocol (rows) and blur of the images in mm (columns).
    """
    rows, columns = len(recognitions), len(next(iter(recognitions.values())))
    figure = Figure(figsize=(3.6 * columns, 3.6 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).flat
    titled = [
        (f"{protocol}, blur {width:g} mm", recognition)
        for protocol, of_blur in recognitions.items()
        for width, recognition in of_blur.items()
    ]
    for axes, (title, recognition) in zip(panels, titled, strict=True):
        share = recognition.confusion / recognition.confusion.sum(axis=1, keepdims=True)
        axes.imshow(share, cmap="cividis", vmin=0, vmax=1)
        for (row, column), value in np.ndenumerate(share):
            if value > 0:
                colour = "black" if value > 0.6 else "white"
                text = f"{100 * value:.0f}"
                axes.text(column, row, text, ha="center", va="center", fontsize=6, color=colour)
        places = range(len(recognition.letters))
        axes.set_xticks(places, recognition.letters)
        axes.set_yticks(places, recognition.letters)
        axes.set(xlabel="Recognised as", ylabel="Letter")
        axes.set_title(f"{title}: {100 * recognition.accuracy:.0f} % correct", fontsize=9)
    return figure


def _blurred(image: RateImage, width_mm: float) -> Array:
    pixels = [width_mm / (axis[1] - axis[0]) for axis in (image.across_mm, image.along_mm)]
    return np.asarray(gaussian_filter(image.rate_Hz, pixels, mode="constant"))


def _max_shift(image: RateImage) -> tuple[int, int]:
    rows = round(SHIFT_MM / (image.across_mm[1] - image.across_mm[0]))
    return rows, round(SHIFT_MM / (image.along_mm[1] - image.along_mm[0]))
