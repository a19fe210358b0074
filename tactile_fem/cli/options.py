"""What several commands share: their options, the start of mechanics, checks of file names."""

from __future__ import annotations

from collections.abc import Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter, validators

from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime import doctor, ranks
from tactile_fem.runtime.files import Print

if TYPE_CHECKING:
    from tactile_fem.series import Member

Count = Annotated[int, Parameter(validator=validators.Number(gte=1))]
PositiveFloat = Annotated[float, Parameter(validator=validators.Number(gt=0))]
StudyFile = Annotated[
    Path | None,
    Parameter(
        help="Study file in TOML, or a shipped study, hamasaki2020 or macaque; else default values."
    ),
]
Changes = Annotated[
    tuple[str, ...],
    Parameter(
        name="--set", show_default=False, help="Change a value: section.key=value. May be repeated."
    ),
]
ScanFolder = Annotated[Path, Parameter(help="Folder of a scan.")]
Ranks = Annotated[Count, Parameter(name="--ranks", help="MPI processes.")]
Written = Annotated[Path, Parameter(name=["--output", "-o"])]
ListScans = Annotated[
    bool,
    Parameter(
        name="--list",
        help="Run nothing; write the list of scans to scans.csv, for tactile-fem cluster.",
    ),
]
Collect = Annotated[bool, Parameter(help="Run nothing; use scans that ran elsewhere.")]
Overwrite = Annotated[bool, Parameter(show_default=False)]


SeriesFolder = Annotated[Path, Parameter(help="Folder for the scans' folders and summary.csv.")]


@Parameter(name="*")
@dataclass(frozen=True)
class Scheduling:
    """How the scans of a series are run."""

    jobs: Annotated[Count, Parameter(help="Parallel scans.")] = 1
    ranks: Ranks = 1
    list_: ListScans = False
    collect: Collect = False


@Parameter(name="*")
@dataclass(frozen=True)
class Size(Print):
    """Size of figures in print."""

    width_mm: Annotated[
        float | None,
        Parameter(
            validator=validators.Number(gte=40, lte=300),
            help="Width in print, for which a figure is laid out: 85 is a column of many journals.",
        ),
    ] = None
    dpi: Annotated[
        int | None,
        Parameter(
            validator=validators.Number(gte=50, lte=1200),
            help="Dots per inch; default 200, of animations 112.",
        ),
    ] = None


ONE_BY_ONE, OWN_SIZE = Scheduling(), Size()

# The words of the command that runs.
command_line: ContextVar[Sequence[str]] = ContextVar("command_line", default=())


def with_mechanics(module: str, count: int) -> ModuleType:
    """Return a module that computes mechanics, on `count` ranks, which run this command again.

    It raises TactileError if the compiler or a library of the mechanics is missing.
    """
    if finding := doctor.compiler_finding():
        raise TactileError(str(finding))
    if count > 1:
        if ranks.launched_rank() is not None:
            raise StudyError("--ranks does not go together with mpiexec: use one of them.")
        ranks.restart(count, _without_ranks(command_line.get()))
    try:
        return import_module(module)
    except ImportError as error:
        raise TactileError(str(error)) from error


def _without_ranks(words: Sequence[str]) -> list[str]:
    kept = [word for word in words if not word.startswith("--ranks=")]
    while "--ranks" in kept:
        at = kept.index("--ranks")
        del kept[at : at + 2]
    return kept


def list_scans(members: Sequence[Member], folder: Path, ranks_: int = 1) -> None:
    """Write the list of a series' scans, and the command that made it."""
    from tactile_fem import series

    words = [word for word in command_line.get() if word != "--list"]
    file = series.write_list(members, folder, ranks=ranks_, words=words)
    print(f"{len(members)} scans are listed in {file}")


def check_file(option: str, file: Path, *endings: str) -> None:
    """Raise StudyError if a file to be written has another ending or no folder."""
    if file.suffix not in (endings or (file.suffix,)):
        raise StudyError(f'{option} is "{file}" but must end in {", ".join(endings)}.')
    if not file.absolute().parent.is_dir():
        raise StudyError(f'{option} is "{file}" but there is no folder {file.parent}.')
