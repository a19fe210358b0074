"""Arguments and options shared by several commands."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from tactile_fem.errors import StudyError

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


@contextmanager
def as_options(words: dict[str, str]) -> Iterator[None]:
    """Let errors name options, instead of what they are called in Python."""
    try:
        yield
    except StudyError as error:
        message = str(error)
        for word, option in words.items():
            message = message.replace(word, option)
        raise StudyError(message) from None
