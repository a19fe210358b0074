"""Writes a study template: every key commented out at its default."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from tactile_fem.study import Afferents, Stimulus, Study
from tactile_fem.study.explain import KINDS, PIECES, toml_value

_HEAD = """\
# A study: all input of a scan. Each value below is the default, which is the paper's if it states
# one (Hamasaki et al. 2020, DOI 10.1177/1687814020984651). To change a value, remove the
# "#" in front of its line. A name carries its unit. Square brackets in a comment hold the allowed
# values. Axes: X across the finger, Y along it towards the tip, Z from the pad to the nail; the
# origin is the pad's lowest point.
"""
_WIDTH = 98
_NOTES_AT = 32
_LIMITS = {
    "exclusiveMinimum": "> {:g}",
    "minimum": ">= {:g}",
    "exclusiveMaximum": "< {:g}",
    "maximum": "<= {:g}",
    "maxLength": "at most {} characters",
}


def commented_template() -> str:
    """Return a study file with every key commented out at its default and described."""
    lines = [_HEAD]
    study = Study()
    for name in Study.model_fields:
        if name == "afferents":
            lines += _described("[[afferents]] once or more", Afferents)
            continue
        values = getattr(study, name)
        lines += _table(name, values, _summary(type(values)))
        if name == "stimulus":
            for kind, model in KINDS.items():
                if kind != study.stimulus.kind:
                    lines += _comment(f'or kind = "{kind}": {_summary(model)}')
                    lines += [
                        *_keys(model.model_construct(), "#     ", {"kind", *Stimulus.model_fields}),
                        "",
                    ]
        if name == "protocol":
            for kind, model in PIECES.items():
                lines += _described(f'[[protocol.path]] with kind = "{kind}"', model)
    return "\n".join(lines).rstrip() + "\n"


def _described(heading: str, model: type[BaseModel]) -> Iterator[str]:
    """Describe a table that may be added to a study."""
    yield from _comment(f"{heading}: {_summary(model)}")
    schema = model.model_json_schema()["properties"]
    for key, field in model.model_fields.items():
        if key == "kind" and model is not Afferents:  # the heading says it
            continue
        if not field.description:
            yield f"#     [afferents.{key}] has the keys of [{key}]"
            continue
        default = "" if field.default in (None, PydanticUndefined) else toml_value(field.default)
        line = f"{key} = {default}" if default else key
        allowed = _allowed(schema[key])
        note = f"{field.description} [{allowed}]" if allowed else field.description
        yield from _comment(f"    {line}: {note}")
    yield ""


def _table(name: str, values: BaseModel | dict[str, Any], note: str | None) -> Iterator[str]:
    """Write a table, its keys, and the tables in it."""
    yield from _with_note(f"[{name}]", note)
    nested = {}
    if isinstance(values, BaseModel):
        nested = {key: value for key, value in values if isinstance(value, BaseModel | dict)}
        yield from _keys(values, "#", set(nested))
    yield ""
    for key, value in nested.items():
        yield from _table(f"{name}.{key}", value, type(values).model_fields[key].description)


def _keys(values: BaseModel, mark: str, without: set[str]) -> Iterator[str]:
    """Write a line for each key, the kind of a stimulus first."""
    schema = type(values).model_json_schema()["properties"]
    for key, field in sorted(type(values).model_fields.items(), key=lambda item: item[0] != "kind"):
        if key in without:
            continue
        value, note = getattr(values, key, None), field.description or ""
        allowed = _allowed({"enum": list(KINDS)} if key == "kind" else schema[key])
        note += f" [{allowed}]" if allowed else ""
        if value is None:
            yield from _comment(f"{key} is not set: {note}")
        else:
            yield from _with_note(f"{mark}{key} = {toml_value(value)}", note)


def _allowed(schema: dict[str, Any]) -> str:
    """Return the choices or limits of a JSON schema; empty if the type is the only limit."""
    options = [schema, *schema.get("anyOf", ()), *schema.get("prefixItems", ())[:1]]
    words = []
    for part in [*options, *(option.get("items", {}) for option in options)]:
        words += [toml_value(value) for value in part.get("enum", ())]
        words += [form.format(part[key]) for key, form in _LIMITS.items() if key in part]
    return ", ".join(words)


def _summary(model: type[BaseModel]) -> str:
    line = (model.__doc__ or "").strip().splitlines()[0].rstrip(".")
    return line if line[1].isupper() else line[0].lower() + line[1:]


def _with_note(line: str, note: str | None) -> list[str]:
    """Return the line with its note behind it or, if that is too long, before it."""
    if not note:
        return [line]
    both = f"{line:<{_NOTES_AT}}  # {note}"
    return [both] if len(both) <= _WIDTH else [*_comment(note), line]


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="# ", subsequent_indent="# ")
