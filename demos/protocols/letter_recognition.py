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
from scipy.optimize import bisect

from tactile_fem import Stimulus, StudyError
from tactile_fem.output.plots import styled
from tactile_fem.series import RateImage

Array = NDArray[np.float64]

SHIFT_MM = 1.0
# Width of a blurred outline, of the order of the spread of a receptor's field.
_BLUR_MM = 0.3
_NOISES_HZ = (0.1, 1e5)  # between which a reader's is sought
_SEED = 1  # of the reader's noise
_FINE = 4  # sub-pixels of a pixel in each direction


def edge_image(stimulus: Stimulus, across_mm: Array, along_mm: Array) -> Array:
    """Return the blurred outline of the raised shapes, (rows, columns), 1 at most.

    Slowly adapting afferents fire at edges (Blake et al. 1997), so images are compared with the
    outline rather than with the raised area.

    Raises
    ------
    StudyError
        The stimulator has no outline.
    """
    shapes = [shape for shape in stimulus.outlines() if not shape.is_empty]
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


def correlations(images: Array, templates: Array, max_shift: tuple[int, int]) -> Array:
    """Return the largest correlation of each image with each template over all shifts.

    Parameters
    ----------
    images, templates
        (images, rows, columns), (templates, rows, columns); a shifted template is zero beyond
        its border.
    max_shift
        Largest shift in rows and columns.

    Returns
    -------
    r
        Pearson's correlation over the whole image, (images, templates); 0 for a uniform image.
    """
    own = _normed(images.reshape(len(images), -1)).T
    border = [(shift, shift) for shift in max_shift]
    largest = []
    for template in templates:
        windows = sliding_window_view(np.pad(template, border), images.shape[1:])
        largest.append((_normed(windows.reshape(-1, len(own))) @ own).max(axis=0))
    return np.array(largest).T


def _normed(rows: Array) -> Array:
    """Return rows with mean 0 and length 1; uniform rows become 0."""
    centred = rows - rows.mean(axis=1, keepdims=True)
    length = np.linalg.norm(centred, axis=1, keepdims=True)
    return np.divide(centred, length, out=np.zeros_like(centred), where=length > 0)


def outline_correlation(image: RateImage, stimulus: Stimulus) -> float:
    """Return the correlation of firing with the stimulator's outline at the best shift."""
    template = edge_image(stimulus, image.across_mm, image.along_mm)
    found = correlations(image.rate_Hz[None], template[None], _max_shift(image))
    return float(found[0, 0])


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

    def hardest(self) -> list[tuple[str, float]]:
        """Return the letters and the shares that are recognised, the least first."""
        shares = np.diag(self.confusion) / self.confusion.sum(axis=1)
        return sorted(zip(self.letters, shares.tolist(), strict=True), key=lambda pair: pair[1])

    def mistaken(self) -> list[tuple[str, float]]:
        """Return pairs of letters and the share of their images taken for the other, most first."""
        seen = self.confusion.sum(axis=1)
        pairs = []
        for one, other in zip(*np.triu_indices(len(self.letters), 1), strict=True):
            wrong = self.confusion[one, other] + self.confusion[other, one]
            share = float(wrong / (seen[one] + seen[other]))
            pairs.append((self.letters[one] + self.letters[other], share))
        return sorted(pairs, key=lambda pair: -pair[1])


def recognise(
    images: Mapping[str, Sequence[RateImage]], blur_mm: float = 0.0, noise_Hz: float = 0.0
) -> Recognition:
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
    noise_Hz
        The reader's inner noise: standard deviation of what is added to each pixel of an image,
        but not of a template, before the blur.

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
    one = images[letters[0]][0]
    # (letters, realizations, rows, columns)
    rates = np.array([[image.rate_Hz for image in images[name]] for name in letters])
    noise = noise_Hz * np.random.default_rng(_SEED).normal(size=rates.shape)
    known, seen = (_blurred(stack, one, blur_mm) for stack in (rates, rates + noise))
    confusion = np.zeros((len(letters), len(letters)), dtype=np.int64)
    for k in range(known.shape[1]):
        templates = np.delete(known, k, axis=1).mean(axis=1)
        best = correlations(seen[:, k], templates, _max_shift(one)).argmax(axis=1)
        confusion[np.arange(len(letters)), best] += 1
    return Recognition(letters, confusion)


def noise_of_reader(
    images: Mapping[str, Sequence[RateImage]], accuracy: float, blur_mm: float = 0.0
) -> float:
    """Return the inner noise, spikes/s, with which that share of the images is recognised.

    Raises
    ------
    StudyError
        Without noise fewer are recognised.
    """

    def surplus(logarithm: float) -> float:
        return recognise(images, blur_mm, float(np.exp(logarithm))).accuracy - accuracy

    low, high = np.log(_NOISES_HZ)
    if surplus(low) < 0:
        share = surplus(low) + accuracy
        raise StudyError(f"{share:.0%} are recognised without noise, but {accuracy:.0%} asked for.")
    return float(np.exp(bisect(surplus, low, high, xtol=0.02)))


@styled
def confusion_figure(recognitions: Mapping[str, Mapping[float, Recognition]]) -> Figure:
    """Draw the confusion matrices.

    Parameters
    ----------
    recognitions
        By protocol (rows) and blur of the images in mm (columns).
    """
    rows, columns = len(recognitions), len(next(iter(recognitions.values())))
    alphabet = len(next(iter(next(iter(recognitions.values())).values())).letters)
    side = max(3.6, 0.3 * alphabet)
    figure = Figure(figsize=(side * columns, side * rows), layout="constrained")
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


def _blurred(rates: Array, image: RateImage, width_mm: float) -> Array:
    """Return a stack of images (..., rows, columns), each blurred."""
    pixels = [width_mm / (axis[1] - axis[0]) for axis in (image.across_mm, image.along_mm)]
    return np.asarray(gaussian_filter(rates, pixels, mode="constant", axes=(-2, -1)))


def _max_shift(image: RateImage) -> tuple[int, int]:
    rows = round(SHIFT_MM / (image.across_mm[1] - image.across_mm[0]))
    return rows, round(SHIFT_MM / (image.along_mm[1] - image.along_mm[0]))
