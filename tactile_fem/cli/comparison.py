"""Scans side by side, printed and drawn, for the commands that compare."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_fem.errors import StudyError
from tactile_fem.runtime.text import aligned

if TYPE_CHECKING:
    from tactile_fem.results.results import Results


def show_comparison(scans: Mapping[str, Results], picture: Path) -> None:
    """Draw scans on common axes and print their table."""
    from tactile_fem import series

    series.write_comparison(picture, scans)
    print("\n".join(aligned(series.compare(scans))))
    print(f"Written to {picture}")


def named_scans(folders: Sequence[Path]) -> dict[str, Results]:
    """Return complete scans by the names of their folders, or paths where names are the same.

    Raises
    ------
    StudyError
        There are not two folders, one is given twice, or one holds no complete scan.
    """
    from tactile_fem import Results

    if len(folders) < 2:
        raise StudyError("A comparison needs the folders of two or more scans.")
    places = Counter(folder.resolve() for folder in folders)
    names = Counter(_name(folder) for folder in folders)
    found = {}
    for folder in folders:
        if places[folder.resolve()] > 1:
            raise StudyError(f"{folder} is given twice: name each scan once.")
        scan = Results.open(folder)
        if not scan.complete:
            raise StudyError(f"The scan in {folder} is not complete: resume it first.")
        found[_name(folder) if names[_name(folder)] == 1 else str(folder)] = scan
    return found


def _name(folder: Path) -> str:
    return os.path.basename(os.path.abspath(folder))
