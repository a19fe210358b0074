"""Writes a study template: every key commented out at its default."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from tactile_fem.path import Piece
from tactile_fem.stimulus import Friction, Stimulus
from tactile_fem.study.afferents import Afferents
from tactile_fem.study.explain import model_in, toml_value
from tactile_fem.study.study import Study

_HEADING = """\
# A study: all input of a scan. Each value below is the default, which is the paper's if it states
# one (Hamasaki et al. 2020, DOI 10.1177/1687814020984651). To change a value, remove the
# "#" in front of its line. A name carries its unit. Square brackets in a comment hold the allowed
# values. Axes: X across the finger, Y along it towards the tip, Z from the pad to the nail; the
# origin is the pad's lowest point.
"""
_WIDTH = 98
_NOTE_COLUMN = 32
_LIMITS = {
    "exclusiveMinimum": "> {:g}",
    "minimum": ">= {:g}",
    "exclusiveMaximum": "< {:g}",
    "maximum": "<= {:g}",
    "minLength": "at least {} character",
    "maxLength": "at most {} characters",
}


def commented_template() -> str:
    """Return a study file with every key commented out at its default and described."""
    lines = [_HEADING]
    study = Study()
    for name in Study.model_fields:
        if name == "afferents":
            lines += [*_described("[[afferents]] once or more", Afferents), ""]
            continue
        values = getattr(study, name)
        if values is None and (model := model_in(Study.model_fields[name].annotation)):
            lines += [*_described(f"[{name}]", model), ""]
            continue
        lines += _table(name, values, _summary(type(values)))
        if name == "stimulus":
            for kind, model in Stimulus.kinds.items():
                if kind != study.stimulus.kind:
                    lines += _comment(f'or kind = "{kind}": {_summary(model)}')
                    hidden = {"kind", *Stimulus.model_fields}
                    lines += [*_keys(model.model_construct(), "#     ", hidden), ""]
            for law, model in Friction.kinds.items():
                lines += [*_described(f'[stimulus.friction] with law = "{law}"', model), ""]
        if name == "protocol":
            for kind, model in Piece.kinds.items():
                lines += [*_described(f'[[protocol.path]] with kind = "{kind}"', model), ""]
    return "\n".join(lines).rstrip() + "\n"


def _described(heading: str, model: type[BaseModel]) -> Iterator[str]:
    """Describe a table that may be added to a study."""
    yield from _comment(f"{heading}: {_summary(model)}")
    for key, field, note in notes(model):
        if key == getattr(model, "tag", None):  # the heading says it
            continue
        if not note:
            yield f"#     [afferents.{key}] has the keys of [{key}]"
            continue
        default = None if field.is_required() else field.get_default(call_default_factory=True)
        state = _unset(field) if default in (None, {}) else f"= {toml_value(default)}"
        yield from _comment(f"    {key} {state}: {note}")
        if nested := model_in(field.annotation):
            yield from _described(f"    keys of {key}", nested)


def _table(name: str, values: BaseModel | dict[str, Any], note: str | None) -> Iterator[str]:
    """Write a table, its keys, and the tables in it."""
    yield from _with_note(f"[{name}]", note)
    if isinstance(values, dict):
        yield ""
        return
    nested = {key: value for key, value in values if isinstance(value, BaseModel | dict)}
    yield from _keys(values, "#", set(nested))
    yield ""
    for key, value in nested.items():
        yield from _table(f"{name}.{key}", value, type(values).model_fields[key].description)


def _keys(values: BaseModel, mark: str, hidden: set[str]) -> Iterator[str]:
    """Write a line for each key, the kind first."""
    for key, field, note in sorted(notes(type(values)), key=lambda line: line[0] != "kind"):
        if key in hidden:
            continue
        value = getattr(values, key, None)
        if value is None:
            yield from _comment(f"{key} {_unset(field)}: {note}")
        else:
            yield from _with_note(f"{mark}{key} = {toml_value(value)}", note)


def notes(model: type[BaseModel]) -> Iterator[tuple[str, FieldInfo, str]]:
    """Yield each key of a model, its field, and its description with what is allowed."""
    schema = model.model_json_schema()["properties"]
    if issubclass(model, Stimulus):
        schema["kind"] = {"enum": list(Stimulus.kinds)}
    for key, field in model.model_fields.items():
        note, allowed = field.description or "", _allowed(schema[key])
        yield key, field, f"{note} [{allowed}]" if note and allowed else note


def _unset(field: FieldInfo) -> str:
    return "must be given" if field.is_required() else "is not set"


def _allowed(schema: dict[str, Any]) -> str:
    """Return the choices or limits of a JSON schema; empty if the type is the only limit.

    Those of a list are those of each entry, where they differ one after the other.
    """
    words = [toml_value(value) for value in schema.get("enum", ())]
    words += [form.format(schema[key]) for key, form in _LIMITS.items() if key in schema]
    parts = [*schema.get("anyOf", ()), *([schema["items"]] if "items" in schema else [])]
    words += [_allowed(part) for part in parts]
    entries = [_allowed(part) for part in schema.get("prefixItems", ())]
    words += entries[:1] if len(set(entries)) == 1 else ["; ".join(entries)]
    return ", ".join(filter(None, words))


def _summary(model: type[BaseModel]) -> str:
    line = (model.__doc__ or "").strip().splitlines()[0].rstrip(".")
    return line if line[1].isupper() else line[0].lower() + line[1:]


def _with_note(line: str, note: str | None) -> list[str]:
    """Return the line with its note behind it or, if that is too long, before it."""
    if not note:
        return [line]
    both = f"{line:<{_NOTE_COLUMN}}  # {note}"
    return [both] if len(both) <= _WIDTH else [*_comment(note), line]


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="# ", subsequent_indent="# ")
