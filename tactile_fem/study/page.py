"""Writes the page of every study key, `demos/pages/study.md`; a test compares the two."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from tactile_fem.study import Afferents, Stimulus, Study
from tactile_fem.study.explain import KINDS, toml_value

_HEAD = """\
# Every key of the study

Made from the models by `python -m tactile_fem.study.page > demos/pages/study.md`. A name carries
its unit: mm, N, MPa, s, pA, pF, GOhm, mV. *paper* marks what stands in Hamasaki et al. 2020,
*proposed* what this project chose. Axes: X across the finger, Y along it towards the tip, Z from
the pad to the nail.
`tactile-fem init study.toml` writes the same as a file to edit; `--set section.key=value` changes a
value for one run.
"""
_LIMITS = (
    ("exclusiveMinimum", "> {:g}"),
    ("minimum", ">= {:g}"),
    ("exclusiveMaximum", "< {:g}"),
    ("maximum", "<= {:g}"),
    ("minLength", "{} characters or more"),
    ("maxLength", "{} at most"),
)


def study_page() -> str:
    """Return the page in Markdown."""
    study = Study()
    lines = [_HEAD]
    for name in Study.model_fields:
        if name == "afferents":
            lines += _heading("[[afferents]]", Afferents)
            lines += _table(Afferents, study.populations[0], skip=set())
        else:
            lines += _section(name, getattr(study, name))
    return "\n".join(lines).rstrip() + "\n"


def _section(name: str, values: BaseModel) -> Iterator[str]:
    model = type(values)
    yield from _heading(f"[{name}]", model)
    yield from _table(model, values, skip=set())
    for key in type(values).model_fields:
        inner = getattr(values, key)
        if isinstance(inner, BaseModel):
            yield from _heading(f"[{name}.{key}]", type(inner))
            yield from _table(type(inner), inner, skip=set())
    if name == "stimulus":
        for kind, other in KINDS.items():
            if kind != getattr(values, "kind", ""):
                yield from _heading(f'[stimulus] with kind = "{kind}"', other)
                yield from _table(other, other(), skip=set(Stimulus.model_fields) | {"kind"})


def _heading(title: str, model: type[BaseModel]) -> list[str]:
    about = (model.__doc__ or "").strip().splitlines()[0]
    return [f"## `{title}`", "", about, ""]


def _table(model: type[BaseModel], values: BaseModel, skip: set[str]) -> Iterator[str]:
    """Write a row for each key that is a value, not a table of its own."""
    rows = []
    properties = model.model_json_schema()["properties"]
    for key, field in model.model_fields.items():
        value = getattr(values, key)
        if isinstance(value, BaseModel) or key in skip:
            continue
        default = "not set" if value is None else f"`{toml_value(value)}`"
        allowed = _allowed({"enum": list(KINDS)} if key == "kind" else properties[key])
        rows.append(f"| `{key}` | {default} | {allowed} | {field.description or ''} |")
    if rows:
        yield "| key | default | allowed | meaning |"
        yield "| --- | --- | --- | --- |"
        yield from rows
        yield ""


def _allowed(schema: dict[str, Any]) -> str:
    """Return in words what a JSON schema allows."""
    if "anyOf" in schema:
        words = [_allowed(option) for option in schema["anyOf"] if option.get("type") != "null"]
        return " or ".join(dict.fromkeys(words))
    if "enum" in schema:
        return ", ".join(f"`{toml_value(value)}`" for value in schema["enum"])
    if "const" in schema:
        return f"`{toml_value(schema['const'])}`"
    if schema.get("type") == "array":
        return f"list of {_allowed(schema.get('items') or schema['prefixItems'][0])}"
    if schema.get("type") == "object":
        return f"table of {_allowed(schema['additionalProperties'])}"
    names = {"number": "number", "integer": "whole number", "string": "text"}
    names["boolean"] = "`true`, `false`"
    limits = [form.format(schema[key]) for key, form in _LIMITS if key in schema]
    return " ".join([names[schema["type"]], ", ".join(limits)]).strip()


if __name__ == "__main__":
    print(study_page(), end="")
