"""Arguments and options shared by several commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

StudyFile = Annotated[Path | None, Parameter(help="Study file in TOML; default the paper's.")]
Settings = Annotated[
    list[str] | None,
    Parameter(
        name="--set",
        negative="",
        consume_multiple=False,
        help="Change a value: section.key=value. May be repeated.",
    ),
]
Ranks = Annotated[
    int, Parameter(name="--ranks", help="MPI processes.", validator=validators.Number(gte=1))
]
