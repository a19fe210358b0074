"""Explains in sentences what is wrong with a study."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from typing import Any, get_args

import tomlkit
from pydantic import BaseModel, ValidationError

from tactile_fem.runtime.settings import Kind
from tactile_fem.study.study import Study

# What a value must be, by pydantic's kind of error.
_REQUIREMENTS = {
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
    "code_type": '"module:name", what a Python file beside the study defines',
    "petsc_type": "text, a number, true or false",
    "tuple_type": "a list",
    "too_long": "a list of at most {max_length} entries",
    "too_short": "a list with {min_length} or more entries",
    "dict_type": "a table",
    "model_type": "a table of values",
    "model_attributes_type": "a table of values",
}


def in_words(error: ValidationError) -> str:
    """Return one sentence per problem, each naming the field, its value and what is allowed."""
    problems = error.errors(include_url=False)
    parents = {place["loc"][:n] for place in problems for n in range(len(place["loc"]))}
    sentences = (
        _sentence(problem)
        for problem in problems
        # Entries that are wrong are not counted: then a list is too short as well.
        if problem["type"] != "too_short" or problem["loc"] not in parents
    )
    return "\n".join(dict.fromkeys(sentences))


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


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return a half sentence: the nearest of the known words, or all of them."""
    known = list(known)
    near = get_close_matches(word, known, n=1, cutoff=0.6)
    return f"did you mean {near[0]}?" if near else f"allowed: {', '.join(known)}."


def located(location: tuple[Any, ...]) -> tuple[tuple[Any, ...], Any]:
    """Return the path of a location in the study file, and the model of what is there or around it.

    The path lacks pydantic's tags of unions; the model is None for a plain value.
    """
    path: tuple[Any, ...] = ()
    model: Any = Study
    for part in location:
        if is_family(model) and part in model.kinds:
            model = model.kinds[part]
            continue
        path += (part,)
        if isinstance(part, str) and model is not None and part in model.model_fields:
            model = model_in(model.model_fields[part].annotation)
    return path, model


def model_in(annotation: Any) -> type[BaseModel] | None:
    """Return the model in the type of a field, such as that of the entries of a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(model_in, get_args(annotation))), None)


def is_family(model: Any) -> bool:
    """Return whether a model is that of all kinds of something."""
    return isinstance(model, type) and Kind in model.__bases__


def _dotted(path: Iterable[str | int]) -> str:
    """Return ``section.key``, list entries counted from 1."""
    text = ""
    for part in path:
        text += f" (entry {part + 1})" if isinstance(part, int) else f".{part}"
    return text.lstrip(".")


def _sentence(problem: Any) -> str:
    kind, context = problem["type"], problem.get("ctx", {})
    path, model = located(problem["loc"])
    name, value = _dotted(path) or "the study", toml_value(problem["input"])
    if kind == "extra_forbidden":
        return _unknown(path, model)
    if len(value) > 60:
        value = value[:57] + "..."
    if kind == "missing":
        return f"{name} is missing: {_dotted(path[:-1])} is {value}."
    if kind == "union_tag_invalid":
        what, hint = model.__name__.lower(), suggestion(context["tag"], model.kinds)
        return f'{name}.{model.tag} is "{context["tag"]}", which is no kind of {what}; {hint}'
    if kind == "union_tag_not_found":
        return f"{name} has no {model.tag}; allowed: {', '.join(model.kinds)}."
    if kind == "value_error":
        sentence = f"{name}: {context['error']}" if path else str(context["error"])
    elif model is not None and kind in ("tuple_type", "too_short"):
        sentence = f"{name} is {value} but must be a list of tables, each under [[{name}]]"
    else:
        sentence = f"{name} is {value} but must be {_allowed(kind, context, problem['msg'])}"
    return sentence if sentence.endswith((".", "?", "!")) else sentence + "."


def _allowed(kind: str, context: Any, message: str) -> str:
    """Return what a value may be, to follow "must be"."""
    if kind == "literal_error":
        return str(context["expected"]).replace("'", '"')
    if kind in _REQUIREMENTS:
        return _REQUIREMENTS[kind].format(**context)
    return "valid: " + message[:1].lower() + message[1:]


def _unknown(path: tuple[Any, ...], model: type[BaseModel]) -> str:
    """Return what an unknown key of a model may stand for."""
    word, name = str(path[-1]), _dotted(path)
    if model is Study:
        keys = [f"{table}.{word}" for table, one in _tables() if word in one.model_fields]
        hint = f"did you mean {' or '.join(dict.fromkeys(keys))}?"
        return (
            f"{word} is not a section of the study; "
            f"{hint if keys else suggestion(word, Study.model_fields)}"
        )
    hint = suggestion(word, model.model_fields)
    if not issubclass(model, Kind):
        return f"{name} is not a key of [{_dotted(path[:-1])}]; {hint}"
    what = next(filter(is_family, model.__mro__)).__name__.lower()
    kinds = [f'"{kind}"' for kind, one in model.kinds.items() if word in one.model_fields]
    if kinds:
        words = " or ".join(part for part in (", ".join(kinds[:-1]), kinds[-1]) if part)
        hint = f"it goes with {model.tag} = {words}."
    own = model.model_fields[model.tag].default
    return f'{name} is not a key of a {what} of {model.tag} "{own}"; {hint}'


def _tables() -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield the tables of a study and the models of what they may hold."""
    for table, field in Study.model_fields.items():
        model: Any = model_in(field.annotation)
        for one in model.kinds.values() if is_family(model) else (model,):
            yield table, one
