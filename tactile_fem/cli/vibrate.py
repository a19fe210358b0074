"""The command that lets a scan's finger vibrate."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter, validators

from tactile_fem.cli.mechanics import with_mechanics
from tactile_fem.cli.options import Ranks, as_options
from tactile_fem.neuron import Population
from tactile_fem.runtime import logs
from tactile_fem.runtime.files import write_figure
from tactile_fem.simulation.results import Results
from tactile_fem.vibration import Spectrum, frequencies_of
from tactile_fem.vibration.modes import Modes, few_of, nearest
from tactile_fem.vibration.spectrum import unfelt

logger = logging.getLogger(__name__)


def vibrate(
    results: Annotated[Path, Parameter(help="Folder of a scan.")],
    /,
    *,
    frequencies: Annotated[
        str, Parameter(help="In Hz: low:high:count, evenly spaced in their logarithm, or a list.")
    ] = "1:1000:25",
    at_mm: Annotated[
        float | None,
        Parameter(help="Displacement of a state kept by output.states; default the last state."),
    ] = None,
    at_s: Annotated[
        float | None, Parameter(help="Its time, where several states lie at one displacement.")
    ] = None,
    moves: Annotated[Literal["body", "bone"], Parameter(help="What vibrates.")] = "body",
    direction: Annotated[
        tuple[float, float, float], Parameter(help="X, Y and Z of the vibration.")
    ] = (0.0, 0.0, 1.0),
    amplitude_um: Annotated[
        float,
        Parameter(
            help="Amplitude for the table and the firing rates.", validator=validators.Number(gt=0)
        ),
    ] = 10.0,
    shapes: Annotated[
        str | None,
        Parameter(
            help="Frequencies in Hz at which the finger's shape is kept and drawn: of those "
            "computed the nearest. Default the lowest, the middle and the highest."
        ),
    ] = None,
    ranks_: Ranks = 1,
) -> None:
    """Let the body or the bone vibrate about a state of a scan.

    Writes what receptors feel and how they fire over the frequency, and the finger's shape at some
    frequencies, into the folder's vibration/.
    """
    wanted = frequencies_of(frequencies, "--frequencies")
    kept = few_of(wanted) if shapes is None else frequencies_of(shapes, "--shapes")
    found = Results.open(results)
    with as_options({"by at_s": "by --at-s"}):
        found.load_state(at_mm, at_s)  # so that a wrong place is told at once
    arguments = ["vibrate", str(results), "--frequencies", frequencies, "--moves", moves]
    arguments += ["--direction", *map(str, direction), "--amplitude-um", str(amplitude_um)]
    arguments += [] if shapes is None else ["--shapes", shapes]
    for option, value in (("--at-mm", at_mm), ("--at-s", at_s)):
        arguments += [] if value is None else [f"{option}={value}"]
    module = with_mechanics("tactile_fem.vibration.run", ranks_, arguments)
    from mpi4py import MPI

    rank = MPI.COMM_WORLD.rank
    logs.set_up(rank)
    from tactile_fem.vibration.keeper import ModeKeeper

    for population in map(Population.of, found.study.populations):
        if reason := unfelt(population):
            logger.warning("%s afferents get no firing rates here: %s", population.name, reason)
    keeper = ModeKeeper(wanted[nearest(wanted, kept)])
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
    if rank == 0:
        _write(found, spectrum, modes, amplitude_um / 1000)


def _write(results: Results, spectrum: Spectrum, modes: Modes | None, amplitude_mm: float) -> None:
    from tactile_fem.output.mode_pictures import draw_modes
    from tactile_fem.output.spectrum import spectrum_figure

    folder = results.vibration
    folder.mkdir(exist_ok=True)
    populations = [Population.of(afferents) for afferents in results.study.populations]
    names = [population.name for population in populations]
    rates = spectrum.all_rates_Hz(populations, amplitude_mm)
    spectrum.save(folder / "spectrum.npz")
    spectrum.write_table(folder / "spectrum.csv", rates, amplitude_mm)
    write_figure(folder / "spectrum.png", spectrum_figure(spectrum, names, rates, amplitude_mm))
    for name in ("spectrum.npz", "spectrum.csv", "spectrum.png"):
        print(folder / name)
    if modes is None:
        return
    for earlier in folder.glob("shape_*_Hz.png"):
        earlier.unlink()
    modes.save(folder / "modes.npz")
    print(folder / "modes.npz")
    if results.study.output.pictures:
        for path in draw_modes(results, amplitude_mm):
            print(path)
