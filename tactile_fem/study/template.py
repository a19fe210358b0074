"""Writes the study file that people start from: every key commented out at its default."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tactile_fem.study import Afferents, Stimulus, Study
from tactile_fem.study.explain import KINDS, toml_value

_HEAD = """\
# A study: everything a scan is made from. Each value below is the default, the paper's where it
# states one (Hamasaki et al. 2020, DOI 10.1177/1687814020984651). To change a value, remove the
# "#" in front of its line. A name carries its unit. Axes: X across the finger, Y along it towards
# the tip, Z from the pad to the nail; the origin is the pad's lowest point.
"""
_WIDTH = 98
_NOTES_AT = 32


def commented_template() -> str:
    """Return a study file with every key commented out at its default and described."""
    lines = [_HEAD]
    study = Study()
    for name, info in Study.model_fields.items():
        if name == "afferents":
            lines += _populations()
            continue
        lines += _table(name, getattr(study, name), info)
        if name == "stimulus":
            for kind, model in KINDS.items():
                if kind != study.stimulus.kind:
                    lines += _other_kind(kind, model)
    return "\n".join(lines).rstrip() + "\n"


def _table(name: str, values: BaseModel | dict[str, Any], info: FieldInfo) -> Iterator[str]:
    """Write a table, its keys, and the tables in it."""
    if isinstance(values, dict):
        yield from _with_note(f"[{name}]", info.description)
        yield ""
        return
    nested = name.count(".") > 0
    yield from _with_note(f"[{name}]", None if nested else _first_line(type(values)))
    tables = []
    for key, field in _fields(type(values)):
        value = getattr(values, key)
        if isinstance(value, BaseModel | dict):
            tables.append((f"{name}.{key}", value, field))
        elif value is None:
            yield from _not_set(key, field)
        else:
            yield from _with_note(f"#{key} = {toml_value(value)}", field.description)
    yield ""
    for table in tables:
        yield from _table(*table)


def _fields(model: type[BaseModel]) -> list[tuple[str, FieldInfo]]:
    """Return a table's fields, the kind of a stimulus first."""
    return sorted(model.model_fields.items(), key=lambda item: item[0] != "kind")


def _other_kind(kind: str, model: type[BaseModel]) -> Iterator[str]:
    yield from _prose(f'or kind = "{kind}": {_first_line(model)}')
    for key, field in _fields(model):
        if key == "kind" or key in Stimulus.model_fields:
            continue
        if field.default is None:
            yield from _not_set(key, field)
            continue
        for line in _with_note(f"    {key} = {toml_value(field.default)}", field.description):
            yield f"# {line}"
    yield ""


def _populations() -> Iterator[str]:
    yield from _prose(f"[[afferents]] once or more: {_first_line(Afferents)}")
    for key, field in Afferents.model_fields.items():
        if field.description:
            yield from _prose(f"    {key}: {field.description}")
        else:
            yield f"#     [afferents.{key}] has the keys of [{key}]"
    yield ""


def _first_line(model: type[BaseModel]) -> str:
    line = (model.__doc__ or "").strip().splitlines()[0].rstrip(".")
    return line[0].lower() + line[1:]


def _with_note(line: str, note: str | None) -> list[str]:
    """Return the line with its note behind it or, where that is too long, before it."""
    if not note:
        return [line]
    both = f"{line:<{_NOTES_AT}}  # {note}"
    return [both] if len(both) <= _WIDTH else [*_prose(note), line]


def _not_set(key: str, field: FieldInfo) -> list[str]:
    return _prose(f"{key} is not set: {field.description}")


def _prose(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="# ", subsequent_indent="# ")
