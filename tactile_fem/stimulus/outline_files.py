"""Flat shapes from drawings: rings of points, SVG files and pictures.

A drawing lies as letters do: its right is along Y, its top towards -X.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import affinity

from tactile_fem.errors import StudyError
from tactile_fem.runtime.number_table import UnusableError
from tactile_fem.stimulus.heights import reading
from tactile_fem.stimulus.rings import filled

_MAX_PIXELS = 20_000_000
_PHOTOMETRIC = 262  # tag of a TIFF: 0 if its gray values count from white
# Gray values of a picture are smoothed over this many pixels, so that steps of pixels vanish.
_SMOOTHING_PIXELS = 1.0
# Points of an outline that lie closer than this to a line are left out, in pixels.
_TOLERANCE_PIXELS = 0.1


def shape_of(rings: Sequence[ArrayLike]) -> shapely.Geometry:
    """Return the shape of rings of points (n, 2): what an odd number of them goes around.

    Raises
    ------
    StudyError
        It has no area.
    """
    shape = filled(rings, even_odd=True)
    if shape.is_empty or not shape.area:
        raise StudyError("stimulus.polygons: a shape has no area")
    return shape


def read_outlines(file: Path, needs_size: bool) -> list[shapely.Geometry]:
    """Return the shapes of an SVG, in mm, or of a picture, in pixels.

    Parameters
    ----------
    file
        An .svg, or a picture that Pillow reads.
    needs_size
        Whether the file must state its size.

    Raises
    ------
    StudyError
        It cannot be read, is too large, shows nothing, or states no size that is needed.
    """
    start = f"stimulus.file = {file}"
    with reading(file, start):
        if file.suffix.lower() == ".svg":
            try:
                from tactile_fem.stimulus.svg import read_svg
            except ImportError:
                raise StudyError(
                    "stimulus.file: svgelements, which reads .svg files, is not installed: pip "
                    "install svgelements"
                ) from None
            found = read_svg(file)
        elif needs_size:
            raise UnusableError("is a picture, which has no size in mm: give width_mm")
        else:
            found = _read_picture(file)
    if not found:
        raise StudyError(f"{start} shows nothing that could be raised: it must be black there")
    return found


def _read_picture(file: Path) -> list[shapely.Geometry]:
    from PIL import Image, ImageOps

    with Image.open(file) as image:
        if image.width * image.height > _MAX_PIXELS:
            raise UnusableError(
                f"has {image.width * image.height:,} pixels but may have at most {_MAX_PIXELS:,}"
            )
        upright = ImageOps.exif_transpose(image)
        if image.mode in ("I", "F") or image.mode.startswith("I;"):
            return _contours(1 - _gray_of_many_bits(image, np.asarray(upright)))
        if upright.mode not in ("1", "L", "LA", "P", "PA", "RGB", "RGBA"):
            upright = upright.convert("RGB")
        upright = upright.convert("RGBA")
        white = Image.new("RGBA", upright.size, "white")
        gray = np.asarray(Image.alpha_composite(white, upright).convert("L"), dtype=float)
    return _contours(1 - gray / 255)


def _gray_of_many_bits(image: Any, values: NDArray[Any]) -> NDArray[np.float64]:
    """Return gray values of more than eight bits from 0, black, to 1."""
    # Pillow reads 16 bits of a PNG as 16 or as 32, and takes no notice of a TIFF's WhiteIsZero.
    largest = 1.0 if image.mode == "F" else 65535.0
    has_16_bits = image.mode.startswith("I;16") or image.format == "PNG"
    is_in_range = np.isfinite(values).all() and values.min() >= 0 and values.max() <= largest
    if not is_in_range or not (has_16_bits or image.mode == "F"):
        raise UnusableError(
            f"has gray values from {values.min():g} to {values.max():g} (mode {image.mode}) but "
            "must have 8 or 16 bits, or floating-point numbers from 0 to 1"
        )
    gray = values / largest
    is_white_zero = getattr(image, "tag_v2", {}).get(_PHOTOMETRIC) == 0
    return 1 - gray if is_white_zero else gray


def outlines_of_pixels(pixels: ArrayLike, pixel_mm: float) -> list[shapely.Geometry]:
    """Return the shapes of a picture in an array (rows, columns), in mm; see `Drawing.of_pixels`.

    Raises
    ------
    StudyError
        They are neither booleans nor from 0 to 1, or nothing is raised.
    """
    start = "Drawing.of_pixels"
    if np.ma.is_masked(pixels):
        raise StudyError(f"{start}: pixels are masked; fill them first, pixels.filled(False)")
    try:
        values = np.asarray(pixels, dtype=float)
    except (TypeError, ValueError):
        raise StudyError(f"{start}: pixels must be numbers in rows and columns") from None
    if values.ndim != 2 or not values.size or not np.isfinite(values).all():
        raise StudyError(f"{start} needs finite values in rows and columns, not {values.shape}")
    if values.min() < 0 or values.max() > 1:
        raise StudyError(
            f"{start}: pixels are from {values.min():g} to {values.max():g} but must be booleans "
            "or from 0 to 1: divide them by their largest possible value, or compare them with one"
        )
    if not (np.isfinite(pixel_mm) and pixel_mm > 0):
        raise StudyError(f"{start}: pixel_mm is {pixel_mm} but must be greater than 0")
    shapes = _contours(values)
    if not shapes:
        raise StudyError("Drawing.of_pixels: no pixel is raised")
    return [affinity.scale(shape, pixel_mm, pixel_mm, origin=(0, 0)) for shape in shapes]


def _contours(darkness: NDArray[np.float64]) -> list[shapely.Geometry]:
    """Return the regions with values above a half, X along rows and Y along columns, in pixels."""
    import contourpy
    from scipy import ndimage

    edge = int(np.ceil(4 * _SMOOTHING_PIXELS))
    padded = np.pad(darkness, edge)
    smooth = ndimage.gaussian_filter(padded, _SMOOTHING_PIXELS)
    lines = contourpy.contour_generator(
        z=smooth.T, fill_type=contourpy.FillType.OuterOffset
    ).filled(0.5, np.inf)
    shapes = []
    for points, offsets in zip(*lines, strict=True):
        rings = [points[a:b] - edge for a, b in pairwise(offsets)]
        shape = shape_of(rings).simplify(_TOLERANCE_PIXELS)
        if not shape.is_empty:
            shapes.append(shape)
    return shapes
