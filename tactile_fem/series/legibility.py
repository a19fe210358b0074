"""How well an image of firing says which letter it was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tactile_fem.errors import StudyError
from tactile_fem.series.image import Array, RateImage
from tactile_fem.stimulus import outlines
from tactile_fem.study import AnyStimulus

SHIFT_MM = 1.0
# Width of a blurred outline, of the order of the spread of a receptor's field.
_BLUR_MM = 0.3
_FINE = 4  # sub-pixels of a pixel in each direction


def edge_image(stimulus: AnyStimulus, across_mm: Array, along_mm: Array) -> Array:
    """Return the blurred outline of what is raised, (rows, columns), 1 at most.

    Slowly adapting afferents fire at edges (Blake et al. 1997), so the outline rather than the
    raised area is what an image is held against.

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


def correlation(image: Array, template: Array, reach: tuple[int, int]) -> float:
    """Return the largest correlation of an image with a template that is shifted over it.

    Parameters
    ----------
    image, template
        Of the same shape; where the template is shifted in from beyond its border it is zero.
    reach
        Largest shift in rows and columns.

    Returns
    -------
    r
        Pearson's correlation over the whole image; 0 for an even image.
    """
    rows, columns = image.shape
    padded = np.pad(template, [(reach[0], reach[0]), (reach[1], reach[1])])
    shifted = sliding_window_view(padded, (rows, columns)).reshape(-1, rows * columns)
    centred = shifted - shifted.mean(axis=1, keepdims=True)
    own = image.ravel() - image.mean()
    norms = np.linalg.norm(centred, axis=1) * np.linalg.norm(own)
    products = centred @ own
    r = np.divide(products, norms, out=np.zeros_like(products), where=norms > 0)
    return float(r.max())


def outline_correlation(image: RateImage, stimulus: AnyStimulus) -> float:
    """Return the correlation of firing with the stimulator's outline after the best shift."""
    template = edge_image(stimulus, image.across_mm, image.along_mm)
    return correlation(image.rate_Hz, template, _reach(image))


@dataclass(frozen=True)
class Reading:
    """What a reader who knows the letters' images makes of single ones.

    Attributes
    ----------
    letters
        The alphabet.
    confusion
        How often the letter of the row was read as that of the column, (letters, letters).
    """

    letters: tuple[str, ...]
    confusion: NDArray[np.int64]

    @property
    def accuracy(self) -> float:
        """Share of images that were read right."""
        return float(np.trace(self.confusion) / self.confusion.sum())


def read(images: Mapping[str, Sequence[RateImage]], blur_mm: float = 0.0) -> Reading:
    """Read every image by the templates of all letters, leaving its realization out.

    The k-th images of all letters are what one population fires, with its own gains and its own
    noise. They are read as by a stranger: a letter's template is the mean of its other images, and
    an image is read as the letter whose template it correlates with best after a shift of up to
    `SHIFT_MM` in both directions.

    Parameters
    ----------
    images
        Two or more realizations of each letter, as many of each, all of one shape.
    blur_mm
        Standard deviation of a further blur of all images.

    Raises
    ------
    StudyError
        Too few images, or not as many of each letter, or shapes that differ.
    """
    letters = tuple(images)
    counts = {len(several) for several in images.values()}
    if len(counts) != 1 or min(counts) < 2:
        raise StudyError("Reading needs two or more images of each letter, as many of each.")
    shapes = {image.rate_Hz.shape for several in images.values() for image in several}
    if len(shapes) > 1:
        raise StudyError(f"The images have different shapes: {sorted(shapes)}.")
    reach = _reach(images[letters[0]][0])
    # (letters, realizations, rows, columns)
    stack = np.array([[_blurred(image, blur_mm) for image in images[name]] for name in letters])
    confusion = np.zeros((len(letters), len(letters)), dtype=np.int64)
    for k in range(stack.shape[1]):
        templates = np.delete(stack, k, axis=1).mean(axis=1)
        for row, image in enumerate(stack[:, k]):
            scores = [correlation(image, template, reach) for template in templates]
            confusion[row, int(np.argmax(scores))] += 1
    return Reading(letters, confusion)


def _blurred(image: RateImage, width_mm: float) -> Array:
    pixels = [width_mm / (axis[1] - axis[0]) for axis in (image.across_mm, image.along_mm)]
    return np.asarray(gaussian_filter(image.rate_Hz, pixels, mode="constant"))


def _reach(image: RateImage) -> tuple[int, int]:
    rows = round(SHIFT_MM / (image.across_mm[1] - image.across_mm[0]))
    return rows, round(SHIFT_MM / (image.along_mm[1] - image.along_mm[0]))
