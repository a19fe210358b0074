"""Explains in sentences what is wrong with a study."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import partial
from typing import Any, get_args

import tomlkit
from pydantic import BaseModel, ValidationError

from tactile_fem.path import Piece
from tactile_fem.stimulus import Stimulus
from tactile_fem.study import Study
from tactile_fem.study.afferents import Afferents

KINDS = Stimulus.kinds
PIECES = Piece.kinds
# What the kinds of a section are kinds of.
_WHAT = {"stimulus": "stimulus", "protocol": "piece"}

# What a value must be, by pydantic's kind of error.
_ALLOWED = {
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "less than {lt:g}",
    "less_than_equal": "at most {le:g}",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "string_pattern_mismatch": "made of letters, digits, _ and -",
    "string_too_short": "at least {min_length} character long",
    "string_too_long": "at most {max_length} characters long",
    "bool_type": "true or false",
    "path_type": "the path of a file",
    "tuple_type": "a list",
    "too_long": "a list of at most {max_length} entries",
    "too_short": "a list of at least {min_length} entry",
    "dict_type": "a table",
    "model_type": "a table of values",
    "model_attributes_type": "a table of values",
}


def explain(error: ValidationError) -> str:
    """Return one sentence per problem, each naming the field, its value and what is allowed."""
    problems = error.errors(include_url=False)
    places = [problem["loc"] for problem in problems]
    sentences = (
        _sentence(problem)
        for problem in problems
        # Entries that are wrong are not counted: then a list is too short as well.
        if problem["type"] != "too_short" or not any(map(partial(_below, problem["loc"]), places))
    )
    return "\n".join(dict.fromkeys(sentences))


def _below(place: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    return len(other) > len(place) and other[: len(place)] == place


def toml_value(value: Any) -> str:
    """Return `value` as written in a study file, on one line."""
    if isinstance(value, dict):
        return "a table" if value else "an empty table"
    if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
        return "a list of tables"
    try:
        text = tomlkit.item(value).as_string()
    except (TypeError, ValueError):
        text = repr(value)
    return " ".join(text.split())


def _shown(value: Any) -> str:
    """Return `value` as in a study file, short enough for a sentence."""
    text = toml_value(value)
    return text if len(text) <= 60 else text[:57] + "..."


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return a half sentence: the nearest of the known words, or all of them."""
    known = list(known)
    near = get_close_matches(word, known, n=1, cutoff=0.6)
    return f"did you mean {near[0]}?" if near else f"allowed: {', '.join(known)}."


def path_in_file(location: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return a location without pydantic's union tags: the path in the study file."""
    if location[:1] == ("stimulus",):
        return location[:1] + location[2:]
    if location[:2] == ("protocol", "path"):
        return location[:3] + location[4:]
    if location[:2] == ("solver", "petsc"):
        return location[:3]
    return location


def _dotted(path: Iterable[str | int]) -> str:
    """Return ``section.key``, list entries counted from 1."""
    text = ""
    for part in path:
        text += f" (entry {part + 1})" if isinstance(part, int) else f".{part}"
    return text.lstrip(".")


def _sentence(problem: Any) -> str:
    kind, location, context = problem["type"], problem["loc"], problem.get("ctx", {})
    path = path_in_file(location)
    name, value = _dotted(path) or "the study", _shown(problem["input"])
    if kind == "extra_forbidden":
        return _unknown(location, path)
    if kind == "missing":
        return f"{name} is missing: {_dotted(path[:-1])} is {value}."
    if kind == "union_tag_invalid":
        tag, kinds = context["tag"], KINDS if path[0] == "stimulus" else PIECES
        what, hint = _WHAT[path[0]], suggestion(tag, kinds)
        return f'{name}.kind is "{tag}", which is no kind of {what}; {hint}'
    if kind == "union_tag_not_found":
        return f"{name} has no kind; allowed: {', '.join(PIECES)}."
    if kind == "value_error":
        return _end(f"{name}: {context['error']}" if path else str(context["error"]))
    return _end(f"{name} is {value} but must be {_allowed(kind, path, context, problem['msg'])}")


def _end(sentence: str) -> str:
    return sentence if sentence.endswith((".", "?", "!")) else sentence + "."


def _allowed(kind: str, path: tuple[str | int, ...], context: Any, message: str) -> str:
    """Return what a value may be, to follow "must be"."""
    if path[:2] == ("solver", "petsc") and len(path) == 3:
        return "text, a number, true or false"
    if kind == "literal_error":
        return str(context["expected"]).replace("'", '"')
    if path == ("afferents",):
        return "a list of tables, each under [[afferents]]"
    if path == ("protocol", "path"):
        return "a list of tables, each under [[protocol.path]]"
    if kind in _ALLOWED:
        return _ALLOWED[kind].format(**context)
    return "valid: " + message[:1].lower() + message[1:]


def _unknown(location: tuple[str | int, ...], path: tuple[str | int, ...]) -> str:
    word = str(path[-1])
    if len(path) == 1:
        return f"{word} is not a section of the study; {_section_hint(word)}"
    model: Any = Study
    if location[0] in _WHAT and len(location) != len(path):
        at, kinds = (1, KINDS) if location[0] == "stimulus" else (3, PIECES)
        model = kinds[str(location[at])]
        if len(location) == at + 2:
            return (
                f'{_dotted(path)} is not a key of a {_WHAT[location[0]]} of kind "{location[at]}"; '
                f"{_kinds_with(word, kinds) or suggestion(word, model.model_fields)}"
            )
        location = location[at + 1 :]
    for part in location[:-1]:
        if not isinstance(part, int):
            annotation = Afferents if part == "afferents" else model.model_fields[part].annotation
            model = next(
                (m for m in get_args(annotation) if hasattr(m, "model_fields")), annotation
            )
    hint = suggestion(word, model.model_fields)
    return f"{_dotted(path)} is not a key of [{_dotted(path[:-1])}]; {hint}"


def _kinds_with(word: str, models: Mapping[str, type[BaseModel]]) -> str:
    """Return a half sentence that names the kinds with this key, if there are any."""
    kinds = [f'"{kind}"' for kind, model in models.items() if word in model.model_fields]
    words = " or ".join(part for part in (", ".join(kinds[:-1]), *kinds[-1:]) if part)
    return f"it goes with kind = {words}." if kinds else ""


def _section_hint(word: str) -> str:
    models = [(section, info.annotation) for section, info in Study.model_fields.items()]
    models += [("stimulus", model) for model in KINDS.values()]
    models += [("afferents", Afferents)]
    keys = [
        f"{section}.{word}"
        for section, model in models
        if word in getattr(model, "model_fields", ())
    ]
    if keys:
        return f"did you mean {' or '.join(dict.fromkeys(keys))}?"
    return suggestion(word, Study.model_fields)
