"""The command that lets a finger vibrate."""

from __future__ import annotations

import logging
from typing import Annotated, Literal

from cyclopts import Parameter

from tactile_fem.cli.options import PositiveFloat, Ranks, ScanFolder, with_mechanics
from tactile_fem.runtime import ranks

logger = logging.getLogger(__name__)


def vibrate(
    results: ScanFolder,
    /,
    *,
    frequencies: str = "1:1000:25",
    at_mm: float | None = None,
    at_s: float | None = None,
    moves: Literal["body", "bone"] = "body",
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0),
    amplitude_um: PositiveFloat = 10.0,
    shapes: Annotated[
        str | None,
        Parameter(
            help="Frequencies in Hz at which the finger's shape is kept and drawn; the nearest "
            "computed ones are taken. By default, the lowest, the middle and the highest."
        ),
    ] = None,
    ranks_: Ranks = 1,
) -> None:
    """Let the body or the bone vibrate about a state of a scan.

    Writes what receptors feel and their firing rates over frequency, and the shape of the finger at
    some frequencies, into the subfolder vibration.

    Parameters
    ----------
    frequencies
        Frequencies in Hz: low:high:count, logarithmically spaced, or a list.
    at_mm
        Displacement of a state kept by output.restarts; by default, the last state.
    at_s
        Its time, if several states have the same displacement.
    moves
        What vibrates.
    direction
        Direction of the vibration: X, Y and Z.
    amplitude_um
        Amplitude for the table and the firing rates.
    """
    from tactile_fem import Results
    from tactile_fem.vibration import few_of, frequencies_of, nearest, unfelt

    wanted = frequencies_of(frequencies, "--frequencies")
    shaped = few_of(wanted) if shapes is None else frequencies_of(shapes, "--shapes")
    found = Results.open(results)
    found.load_state(at_mm, at_s)  # raises here if there is no such state
    module = with_mechanics("tactile_fem.vibration.vibrate", ranks_)
    for population in [afferents.population() for afferents in found.study.populations]:
        if reason := unfelt(population):
            logger.warning("no firing rates of %s afferents: %s", population.name, reason)
    keeper = module.ModeKeeper(wanted[nearest(wanted, shaped)])
    spectrum = module.vibrate(
        results,
        wanted,
        at_mm=at_mm,
        at_s=at_s,
        moves=moves,
        direction=direction,
        observers=[keeper],
    )
    modes = keeper.modes()
    if ranks.is_first():
        from tactile_fem.vibration.figures import write_vibration

        for file in write_vibration(found, spectrum, modes, amplitude_um / 1000):
            print(file)
