"""Pictures of a vibration's shape, one for each frequency, drawn in a process of their own.

``python -m tactile_fem.output.mode_pictures FOLDER AMPLITUDE_MM`` draws those of a scan's folder.
"""

from __future__ import annotations

import sys
from pathlib import Path

from tactile_fem.output.pictures import drawn_apart
from tactile_fem.simulation.results import Results
from tactile_fem.vibration.modes import Modes


def draw_modes(results: Results, amplitude_mm: float) -> list[Path]:
    """Draw the finger at each frequency that was kept; return the files.

    All errors are logged as warnings, because pictures are less important than the data.
    """
    return drawn_apart(__name__, str(results.folder), repr(amplitude_mm))


def main(folder: str, amplitude_mm: str) -> int:
    """Draw into the folder of the vibration and print the names of the files."""
    from tactile_fem.output.mode_film import ModeFilm
    from tactile_fem.output.view import save_png

    results = Results.open(folder)
    modes = Modes.load(results.vibration / "modes.npz")
    for k, frequency in enumerate(modes.frequency_Hz):
        film = ModeFilm(results, modes, k, float(amplitude_mm))
        path = results.vibration / f"shape_{frequency:.4g}_Hz.png"
        save_png(film, film.strongest, path)
        print(path, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
