"""Sizes that the header of heights in a text file states."""

from __future__ import annotations

import importlib
import io
import logging
import re
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

logger = logging.getLogger(__name__)


def header_library() -> ModuleType | None:
    """Return the library that knows headers, if it is installed."""
    try:
        return importlib.import_module("SurfaceTopography.IO")
    except ImportError:
        return None


def sizes_of(
    header: Sequence[str], shape: tuple[int, int], file: Path
) -> tuple[tuple[float, float] | None, float | None]:
    """Return the spacing along rows' X and columns' Y and the unit, mm, that a header states.

    SurfaceTopography knows the headers of Gwyddion, SPIP, Wyko, Nova and Attocube; without it they
    are not known.
    """
    header = [re.sub(r"(\d),(\d)", r"\1.\2", line) for line in header]
    library = header_library()
    if library is None or not any(re.search(r"\d", line) for line in header):
        return None, None
    errors = importlib.import_module("SurfaceTopography.Exceptions")
    convert = importlib.import_module("SurfaceTopography.Support.UnitConversion")
    rows = [" ".join(["1"] * shape[1])] * shape[0]  # their numbers do not matter

    def parsed(*further: str) -> Any:
        text = io.StringIO("\n".join([*header, *further, *rows]))
        with library.open_topography(text, format="asc") as reader:
            return reader.default_channel

    try:
        channel, unit_mm = parsed(), None
        if channel.unit is not None:
            scale = channel.height_scale_factor or 1.0
            unit_mm = scale * float(convert.get_unit_conversion_factor(channel.unit, "mm"))
        elif "xunit" in channel.info["raw_metadata"]:  # it states the unit of lengths only
            channel = parsed("# Value units: mm")
    except errors.ReadFileError as error:
        reason = re.sub(r" from the file '.*?'", "", " ".join(str(error).split()))
        logger.warning("The header of %s is not used: %s", file, reason)
        return None, None
    if channel.unit is None or len(channel.physical_sizes or ()) < 2:
        return None, unit_mm
    factor = float(convert.get_unit_conversion_factor(channel.unit, "mm"))
    along_columns, along_rows = (float(size) * factor for size in channel.physical_sizes)
    return (along_rows / shape[0], along_columns / shape[1]), unit_mm
