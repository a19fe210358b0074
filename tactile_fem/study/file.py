"""Studies in TOML: read with overrides, written resolved."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import ValidationError

from tactile_fem import companions
from tactile_fem.errors import StudyError
from tactile_fem.finger import Finger
from tactile_fem.path import Piece
from tactile_fem.runtime.settings import Kind, Settings, absolute
from tactile_fem.runtime.text import read_text
from tactile_fem.stimulus import Friction, Stimulus
from tactile_fem.study.explain import in_words, located
from tactile_fem.study.input_copies import usable
from tactile_fem.study.output import Output
from tactile_fem.study.study import Study
from tactile_fem.tissue.constants import Material

# One file for each study; its name is that of the study.
_SHIPPED = Path(__file__).parent / "shipped"
_FAMILIES: tuple[type[Kind], ...] = (Stimulus, Friction, Piece, Material)

# --- reading -----------------------------------------------------------------------------------


def load_study(
    path: Path | str | None = None, overrides: Sequence[str] = (), *, saved: bool = False
) -> Study:
    """Return the study of a file, a shipped one, or the default one, with some values overridden.

    Parameters
    ----------
    path
        TOML file, or the name of a study that is shipped with the package, such as
        ``"hamasaki2020"``, of which a file of that name takes precedence; None is the default
        study. Relative paths in it start from its folder. In a results folder, files that are gone
        or have changed are read from the copies kept there.
    overrides
        ``section.key=value`` each, ``afferents.name.key=value`` for a population. The value is
        TOML, or else plain text: ``stimulus.text=EFG``. With another kind, of a stimulus for
        example, the file's keys that go only with the former one are left out.
    saved
        It is that of a scan's results: a script's own kinds and drives need not be known here.

    Raises
    ------
    StudyError
        One sentence per problem: field, value, what is allowed.
    """
    file = None if path is None else study_file(path)
    data = {} if file is None else _read(file)
    texts: dict[tuple[str, ...], str] = {}
    changes: dict[str, Any] = {}
    for override in overrides:
        keys, text, value = _parsed(override)
        _put(changes, keys, value, override)
        texts[keys] = text
    if file is not None:
        _resolve_paths(data, file.parent)
    data = _merge(data, changes)
    context: dict[str, Any] = {"saved": saved}
    if file is not None:
        folder = file.parent
        context["locate"] = lambda name: usable(str(absolute(name, folder)), folder)
    try:
        return Study.model_validate(data, context=context)
    except ValidationError as error:
        _use_plain_text(data, texts, error)
    try:
        return Study.model_validate(data, context=context)
    except ValidationError as error:
        raise StudyError(in_words(error)) from None


def shipped_studies() -> dict[str, Path]:
    """Return the files of the studies that are shipped with the package, by name."""
    return {file.stem: file for file in sorted(_SHIPPED.glob("*.toml"))}


def study_file(study: Path | str) -> Path:
    """Return the file of a study: the file itself, or that of a shipped study.

    Raises
    ------
    StudyError
        There is neither; the sentence names the shipped studies.
    """
    path, shipped = Path(study), shipped_studies()
    if str(path) in shipped and not path.is_file():  # a folder of that name holds results
        return shipped[str(path)]
    if path.exists():
        return path
    known = "" if path.suffix else f"; the shipped studies are {', '.join(shipped)}"
    raise StudyError(f"There is no study file {path}{known}.")


def _read(path: Path) -> dict[str, Any]:
    text = read_text(path, f"The study file {path}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"The study file {path} is not valid TOML: {error}.") from None


def _parsed(override: str) -> tuple[tuple[str, ...], str, Any]:
    """Return the keys of an override, its text, and its TOML value or the text where it is none."""
    name, equals, text = override.partition("=")
    keys, text = tuple(part.strip() for part in name.split(".")), text.strip()
    if not equals or len(keys) < 2 or not all(keys):
        raise StudyError(f'"{override}" sets nothing: write section.key=value.')
    try:
        table = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        table = {}
    return keys, text, table["value"] if len(table) == 1 else text


def _put(data: dict[str, Any], keys: tuple[str, ...], value: Any, override: str) -> None:
    for key in keys[:-1]:
        data = data.setdefault(key, {})
        if not isinstance(data, dict):
            raise StudyError(f'"{override}" sets a key below {key}, which is a value, no table.')
    data[keys[-1]] = value


def _merge(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    merged = _of_new_kind(base, changes)
    for key, value in changes.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        merged[key] = _merge(base[key], value) if both else value
        if key == "afferents" and isinstance(value, dict):
            merged[key] = _merge_named(base.get(key), value)
    return merged


def _of_new_kind(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return a table without the keys of its former kind alone, if changes give it another."""
    for family in _FAMILIES:
        new = family.kinds.get(str(changes.get(family.tag)))
        former = family.kinds.get(str(base.get(family.tag, "text")))  # that of a stimulus
        if new and former:
            gone = former.model_fields.keys() - new.model_fields.keys()
            return {key: value for key, value in base.items() if key not in gone}
    return dict(base)


def _merge_named(entries: Any, changes: dict[str, Any]) -> Any:
    """Merge changes into tables of a list, which they call by name."""
    listed = entries if isinstance(entries, list) else []
    tables = [entry for entry in listed if isinstance(entry, dict)]
    names = [str(entry.get("name")) for entry in tables]
    for name, keys in changes.items():
        if name not in names:
            known = ", ".join(map(str, names)) or "none"
            raise StudyError(f"afferents.{name} is no population of the study: it has {known}.")
        if not isinstance(keys, dict):
            raise StudyError(f"afferents.{name} is a population: set afferents.{name}.key=value.")
    return [_merge(entry, changes.get(name, {})) for name, entry in zip(names, tables, strict=True)]


def _use_plain_text(
    data: dict[str, Any], texts: dict[tuple[str, ...], str], error: ValidationError
) -> None:
    """Put the plain text of overrides where text is expected: ``stimulus.text=123``."""
    for problem in error.errors(include_url=False):
        keys, _ = located(problem["loc"])
        if problem["type"] == "string_type" and keys in texts:
            section = data
            for key in keys[:-1]:
                section = section[key]
            section[keys[-1]] = texts[keys]


def _resolve_paths(data: dict[str, Any], folder: Path) -> None:
    """Make the names of files absolute: relative paths start from the folder of the study."""
    protocol = data.get("protocol")
    pieces = protocol.get("path") if isinstance(protocol, dict) else None
    tables: list[Any] = [
        *map(data.get, ("finger", "output", *companions.tables())),
        stimulus := data.get("stimulus"),
    ]
    tables += [stimulus.get("friction")] if isinstance(stimulus, dict) else []
    tables += pieces if isinstance(pieces, list) else []
    tables += data["tissue"].values() if isinstance(data.get("tissue"), dict) else []
    models: list[type[Settings]] = [Finger, Output, *companions.tables().values()]
    models += [kind for family in _FAMILIES for kind in family.kinds.values()]
    model_of = {key: model for model in models for key in model.file_keys()}
    for table in tables:
        for key in model_of.keys() & table.keys() if isinstance(table, dict) else ():
            if isinstance(table[key], str):
                table[key] = usable(model_of[key].absolute_name(table[key], folder), folder)


# --- writing -----------------------------------------------------------------------------------


def dump_study(study: Study, *, without: Collection[str] = ()) -> str:
    """Return the study as TOML, with every value that is set, `without` some of its tables."""
    document = tomlkit.document()
    document.add(tomlkit.comment("The resolved study. A name carries its unit."))
    tables = study.model_dump(mode="json", exclude_none=True, exclude=set(without))
    for section, values in tables.items():
        document.add(tomlkit.nl())
        document.add(section, tomlkit.item(values))
    return tomlkit.dumps(document)
