"""The command line: a thin layer over `scan`, `load_finger` and the figures."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Annotated, Literal

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy: ranks share the cores

from cyclopts import App, Parameter, validators

from tactile_fem import __version__
from tactile_fem.cli import fit as cli_fit
from tactile_fem.cli import series as cli_series
from tactile_fem.cli import vibrate as cli_vibrate
from tactile_fem.cli import view as cli_view
from tactile_fem.cli.entry import exit_code_of
from tactile_fem.cli.mechanics import with_mechanics
from tactile_fem.cli.options import Ranks, Settings, StudyFile, as_options
from tactile_fem.errors import StudyError
from tactile_fem.runtime import doctor as diagnosis
from tactile_fem.runtime import logs, ranks
from tactile_fem.runtime.files import write_text
from tactile_fem.runtime.signals import raise_stopped, signal_handler
from tactile_fem.simulation.results import Results
from tactile_fem.study import Study
from tactile_fem.study.file import load_study
from tactile_fem.study.template import commented_template

HELP = """Press embossed letters on a layered fingertip and slide them:
how do its afferents respond?

Without a study file the paper's scan is run: F G H, 1.97 mm deep, 10 mm long.

    tactile-fem scan
    tactile-fem scan study.toml --set stimulus.text=EFG --ranks 2
"""


_OVERWRITE = {"another folder": "another name with --results", "overwrite=True": "--overwrite"}

app = App(name="tactile-fem", help=HELP, version=__version__, help_format="plaintext")
app.command(cli_series.sweep)
app.command(cli_series.fibre)
app.command(cli_view.preview)
app.command(cli_view.view)
app.command(cli_fit.fit)
app.command(cli_vibrate.vibrate)

_positive = validators.Number(gt=0)


@app.command
def scan(
    study: StudyFile = None,
    /,
    *,
    settings: Settings = None,
    results: Annotated[Path, Parameter(help="Folder for data and pictures.")] = Path(
        "results/scan"
    ),
    ranks_: Ranks = 1,
    overwrite: Annotated[
        bool,
        Parameter(
            negative="",
            show_default=False,
            help="Replace the scan in the folder; other files stay.",
        ),
    ] = False,
) -> None:
    """Run a study and write data and pictures into a folder.

    An interrupted scan continues from its last checkpoint when started again.
    Options that start with -tactile_ are passed to PETSc: -tactile_snes_rtol 1e-8.
    """
    the_study = load_study(study, settings or ())
    first = ranks.launched_rank() in (None, 0)
    if first and (overwrite or not Results.unfinished(results, the_study)):
        with as_options(_OVERWRITE):
            Results.check(results, overwrite=overwrite)
    arguments = ["scan", *([str(study)] if study else [])]
    arguments += [word for setting in settings or () for word in ("--set", setting)]
    arguments += ["--results", str(results), *(["--overwrite"] if overwrite else [])]
    module = _prepared(the_study, ranks_, arguments)
    _run(partial(module.scan, the_study, results, overwrite=overwrite), results)


@app.command
def resume(
    results: Annotated[Path, Parameter(help="Folder of an interrupted scan.")],
    /,
    *,
    ranks_: Ranks = 1,
) -> None:
    """Continue a scan from its last checkpoint, on any number of ranks."""
    module = _prepared(Results.open(results).study, ranks_, ["resume", str(results)])
    _run(partial(module.resume, results), results)


def _prepared(study: Study, ranks_: int, arguments: list[str]) -> ModuleType:
    """Return the module that scans, on all ranks; raise first what would stop a scan later."""
    from tactile_fem.simulation.checks import check_study

    check_study(study)
    return with_mechanics("tactile_fem.simulation.run", ranks_, arguments)


def _run(start: Callable[..., object], folder: Path) -> None:
    """Scan or resume on all ranks; the first one draws."""
    from mpi4py import MPI

    rank = MPI.COMM_WORLD.rank
    logs.set_up(rank)
    with signal_handler(raise_stopped):
        start()
    if rank == 0:
        found = Results.open(folder)
        if found.study.output.pictures:
            _draw(found)
        print(f"Data and pictures are in {folder}")


@app.command
def mesh(
    study: StudyFile = None,
    /,
    *,
    settings: Settings = None,
    output: Annotated[
        Path | None, Parameter(name=["--output", "-o"], help="Write the mesh to this .msh file.")
    ] = None,
) -> None:
    """Mesh the finger and print its sizes, volumes, layers and quality."""
    finger = load_study(study, settings or ()).finger
    if output is not None and output.suffix != ".msh":
        raise StudyError(f'--output is "{output}" but must end in .msh.')
    from tactile_fem.finger import describe, load_finger, write_msh

    logs.set_up()
    the_mesh = load_finger(finger)
    print(describe(the_mesh, finger))
    if output is not None:
        try:
            write_msh(output, the_mesh)
        except OSError as error:
            raise StudyError(f"{output} cannot be written: {error.strerror}.") from None
        print(f"Written to {output}")


@app.command
def export(
    study: StudyFile = None,
    /,
    *,
    deck: Annotated[Path, Parameter(help="Write the deck to this .inp file.")],
    settings: Settings = None,
    format_: Annotated[
        Literal["calculix", "abaqus"],
        Parameter(name="--format", help="Dialect of the deck; they differ in three lines."),
    ] = "calculix",
    press_step_mm: Annotated[
        float | None, Parameter(help="Increments of the indentation.", validator=_positive)
    ] = None,
    slide_step_mm: Annotated[
        float | None, Parameter(help="Increments of the slide.", validator=_positive)
    ] = None,
    grid_mm: Annotated[
        float, Parameter(help="Spacing of the stimulator's height field.", validator=_positive)
    ] = 0.1,
    overwrite: Annotated[
        bool, Parameter(negative="", show_default=False, help="Replace the file.")
    ] = False,
) -> None:
    """Write mesh, materials, contact and steps as an input deck for CalculiX or Abaqus.

    Lengths in mm. Increments default to the study's longest steps.
    """
    the_study = load_study(study, settings or ())
    if deck.suffix != ".inp":
        raise StudyError(f'--deck is "{deck}" but must end in .inp.')
    if deck.exists() and not overwrite:
        raise StudyError(f"{deck} exists already: choose another name, or --overwrite.")
    from tactile_fem.finger import load_finger
    from tactile_fem.output.deck import write_deck
    from tactile_fem.simulation.checks import check_solid, check_study, check_with_mesh
    from tactile_fem.stimulus import make_body

    check_solid(the_study.finger, "an input deck")
    check_study(the_study)
    logs.set_up()
    finger = load_finger(the_study.finger)
    check_with_mesh(the_study, make_body(the_study.stimulus), finger)
    try:
        size = write_deck(
            the_study,
            finger,
            deck,
            press_step_mm=press_step_mm,
            slide_step_mm=slide_step_mm,
            grid_mm=(grid_mm, grid_mm),
            code=format_,
        )
    except OSError as error:
        raise StudyError(f"{deck} cannot be written: {error.strerror}.") from None
    print(
        f"{size.cells} tetrahedra, {size.unknowns} unknowns, {size.skin_facets} faces of the skin"
    )
    print(f"Written to {deck}")


@app.command
def plot(results: Annotated[Path, Parameter(help="Folder of a scan.")], /) -> None:
    """Draw all figures of a scan again."""
    found = Results.open(results)
    logs.set_up()
    _draw(found)


@app.command
def report(
    results: Annotated[Path, Parameter(help="Folder of a scan or of a series.")],
    /,
    *,
    output: Annotated[Path | None, Parameter(help="Default report.html in the folder.")] = None,
) -> None:
    """Write one HTML file with the figures, numbers and parameters."""
    from tactile_fem.series.report import write_report

    logs.set_up()
    print(f"Written to {write_report(results, output=output)}")


def _draw(results: Results) -> None:
    from tactile_fem.output.figures import draw

    for path in draw(results):
        print(path)


@app.command
def init(
    file: Annotated[Path, Parameter(help="Name of the new file.")] = Path("study.toml"), /
) -> None:
    """Write a study file with every value commented out at its default."""
    if file.exists():
        raise StudyError(f"{file} exists already: choose another name.")
    try:
        write_text(file, commented_template())
    except OSError as error:
        raise StudyError(f"{file} cannot be written: {error.strerror}.") from None
    print(f"Written to {file}")


@app.command
def doctor() -> int:
    """Check compiler and libraries that pip cannot install, and name their packages."""
    code = diagnosis.main()
    try:
        from tactile_fem.runtime import backend
    except ImportError as error:
        print(f"Error: {error}")
        return 1
    print(f"DOLFINx {backend.DOLFINX_VERSION}")
    return code


# --- entry -------------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code, see `exit_code_of`."""
    return exit_code_of(app, petsc_settings(sys.argv[1:] if arguments is None else arguments))


def petsc_settings(arguments: Sequence[str]) -> list[str]:
    """Turn ``-tactile_snes_rtol 1e-8`` into ``--set solver.petsc.snes_rtol=1e-8``."""
    tokens = list(arguments)
    turned: list[str] = []
    while tokens:
        token = tokens.pop(0)
        if not token.startswith("-tactile_"):
            turned.append(token)
            continue
        has_value = tokens and not re.match(r"-[-A-Za-z]", tokens[0])
        value = tokens.pop(0) if has_value else '""'
        turned += ["--set", f"solver.petsc.{token.removeprefix('-tactile_')}={value}"]
    return turned
