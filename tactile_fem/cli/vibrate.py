"""The command that lets a scan's finger vibrate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter, validators

from tactile_fem.cli.mechanics import with_mechanics
from tactile_fem.cli.options import Ranks
from tactile_fem.runtime import logs
from tactile_fem.runtime.files import write_figure
from tactile_fem.scan.results import Results
from tactile_fem.vibration import Spectrum, frequencies_of

_FOLDER = "vibration"


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
    ranks_: Ranks = 1,
) -> None:
    """Let the body or the bone vibrate about a state of a scan.

    Writes what receptors feel and how they fire over the frequency into the folder's vibration/.
    """
    wanted = frequencies_of(frequencies)
    found = Results.open(results)
    found.load_state(at_mm)  # so that a wrong place is told at once
    arguments = ["vibrate", str(results), "--frequencies", frequencies, "--moves", moves]
    arguments += ["--direction", *map(str, direction), "--amplitude-um", str(amplitude_um)]
    arguments += [] if at_mm is None else ["--at-mm", str(at_mm)]
    module = with_mechanics("tactile_fem.vibration.run", ranks_, arguments)
    from mpi4py import MPI

    rank = MPI.COMM_WORLD.rank
    logs.set_up(rank)
    spectrum = module.vibrate(results, wanted, at_mm=at_mm, moves=moves, direction=direction)
    if rank == 0:
        _write(spectrum, found, amplitude_um / 1000)


def _write(spectrum: Spectrum, results: Results, amplitude_mm: float) -> None:
    from tactile_fem.neuron import populations_of
    from tactile_fem.output.spectrum import spectrum_figure

    folder = results.folder / _FOLDER
    folder.mkdir(exist_ok=True)
    populations = populations_of(results.study)
    names = [population.name for population in populations]
    rates = spectrum.all_rates_Hz(populations, amplitude_mm)
    spectrum.save(folder / "spectrum.npz")
    spectrum.write_table(folder / "spectrum.csv", rates, amplitude_mm)
    write_figure(folder / "spectrum.png", spectrum_figure(spectrum, names, rates, amplitude_mm))
    for name in ("spectrum.npz", "spectrum.csv", "spectrum.png"):
        print(folder / name)
