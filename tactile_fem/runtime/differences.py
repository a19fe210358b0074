"""How two tables of a study differ, and values in few words."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel


class Difference(NamedTuple):
    """A key, ``section.key``, and its value in either table; None where it is not set."""

    key: str
    here: Any
    there: Any


def differences(here: BaseModel, there: BaseModel) -> Iterator[Difference]:
    """Yield the keys that one table states otherwise than another, the kind of a table first.

    What only `there` has is left out: its key `kind` differs then.
    """
    names = sorted(dict(here), key=lambda name: name != "kind")
    for name in names:
        yield from _between(name, getattr(here, name), getattr(there, name, None))


def _between(key: str, here: Any, there: Any) -> Iterator[Difference]:
    if here == there:
        return
    if isinstance(here, BaseModel) and isinstance(there, BaseModel):
        for found in differences(here, there):
            yield found._replace(key=f"{key}.{found.key}")
    elif _are_tables(here) and _are_tables(there) and len(here) == len(there):
        for number, pair in enumerate(zip(here, there, strict=True), 1):
            yield from _between(f"{key} (entry {number})", *pair)
    else:
        yield Difference(key, here, there)


def _are_tables(value: Any) -> bool:
    return isinstance(value, tuple) and any(isinstance(entry, BaseModel) for entry in value)


def brief(value: Any, longest: int = 60) -> str:
    """Return a value in few words: of a table what is not its default."""
    text = _brief(value)
    if len(text) <= longest:
        return text
    if isinstance(value, Path):  # its end says more
        return f"...{text[3 - longest :]}"
    return f"{text[: longest - 3]}..."


def _brief(value: Any) -> str:
    if value is None:
        return "not set"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, BaseModel):
        own = differences(value, type(value).model_construct())
        keys = [f"{found.key} = {_brief(found.here)}" for found in own]
        kind = getattr(value, getattr(value, "tag", "kind"), "")
        return " ".join(filter(None, [kind, ", ".join(keys)])) or "as by default"
    if _are_tables(value):
        return "; ".join(map(_brief, value))
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_brief, value))}]"
    return str(value)
