"""Base classes and types for the tables of a study."""

from __future__ import annotations

import inspect
import json
import os
import textwrap
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, Union, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    TypeAdapter,
    ValidationInfo,
    create_model,
    model_serializer,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, core_schema

from tactile_fem.runtime import html
from tactile_fem.runtime.differences import brief
from tactile_fem.runtime.own_code import MODULE, Code
from tactile_fem.runtime.version import warn_of_former

# Strict: text such as "0.2 mm" and true or false are not accepted as numbers.
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]
Whole = Annotated[int, Field(strict=True)]


def absolute(path: Path | str, folder: Path | str = "") -> Path:
    """Return an absolute path; a relative one starts from `folder` or the working directory."""
    return Path(os.path.abspath(Path(folder, os.path.expanduser(path))))


def nonzero(value: float) -> float:
    """Return a number that is not 0."""
    if value == 0:
        raise ValueError("must not be 0")
    return value


def in_utf8(path: Path) -> Path:
    """Return a path that can be written into a study file."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise ValueError(f"{str(path)!a} is no path in UTF-8: rename the file or folder") from None
    return path


# Absolute, so that it refers to the same file in the study saved in a results folder.
File = Annotated[Path, AfterValidator(absolute), AfterValidator(in_utf8)]


class Settings(BaseModel):
    """A frozen group of values without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Let `help` show what each key means."""
        super().__pydantic_init_subclass__(**kwargs)
        keys = "\n".join(_described(name, field) for name, field in cls.model_fields.items())
        own = inspect.cleandoc(vars(cls).get("__doc__") or "")
        cls.__doc__ = f"{own}\n\nParameters\n----------\n{keys}"

    @classmethod
    def file_keys(cls) -> set[str]:
        """Return the keys whose values name files."""
        return {key for key, field in cls.model_fields.items() if "Path" in str(field.annotation)}

    @classmethod
    def absolute_name(cls, name: str, folder: Path) -> str:
        """Return the name of a file as a path that does not start from a folder."""
        return str(absolute(name, folder))

    def files(self) -> dict[str, Path]:
        """Return the files that it is read from, by their keys."""
        found = {}
        for key, value in self:
            if isinstance(value, Path):
                found[key] = value
            if isinstance(value, Settings):
                found |= {f"{key}.{own}": file for own, file in value.files().items()}
            for k, one in enumerate(value if isinstance(value, tuple) else (value,)):
                if isinstance(one, Code) and one.file:
                    entry = f" (entry {k + 1})" if isinstance(value, tuple) else ""
                    found[f"{key}{entry}"] = one.file
        return found

    def _repr_html_(self) -> str:
        """Show the keys in a notebook, and what they mean."""
        fields = type(self).model_fields
        rows = [(key, brief(value), _meaning(fields[key])) for key, value in self]
        return html.section(type(self).__name__, [html.table(["key", "value", ""], rows)])


def _described(name: str, field: FieldInfo) -> str:
    """Return a key with its default and its description, as in a docstring."""
    default, of = field.get_default(), ""
    if isinstance(default, str | int | float | tuple):
        of = f" : default {default!r}"
    elif isinstance(default, BaseModel):
        of = f" : {type(default).__name__}"
    text = textwrap.indent(textwrap.fill(_meaning(field), 96), "    ")
    return f"{name}{of}\n{text}".rstrip()


def _meaning(field: FieldInfo) -> str:
    """Return the description of a key, or the first line of the table that it holds."""
    types = field.annotation, *get_args(field.annotation)
    tables = [one for one in types if isinstance(one, type) and issubclass(one, BaseModel)]
    lines = [(one.__doc__ or "").strip().partition("\n")[0] for one in tables]
    return field.description or "".join(lines[:1])


class Kind(Settings):
    """Settings of one of several kinds, which the key `kind` names, or another as its `tag` says.

    A class directly below this one is a family, such as `Stimulus`; a class below that one which
    states a `kind` joins it. A field of the type of the family takes any of its kinds, in a
    study file too, once the module that defines it has been imported:

        class Wave(Stimulus):
            kind: Literal["wave"] = "wave"
    """

    if TYPE_CHECKING:

        @property
        def kind(self) -> str:
            """Name of the kind, as a study states it."""

    kinds: ClassVar[dict[str, type[Kind]]] = {}
    tag: ClassVar[str] = "kind"
    former: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Methods of an earlier version that nobody calls any more, and what to do instead."""
    coded: ClassVar[type[Kind] | None] = None
    """The kind whose tag names code in a file beside the study, if a family has one."""

    def __init_subclass__(cls) -> None:
        if Kind in cls.__bases__:
            cls.kinds = {}

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        for method in cls.former.keys() & vars(cls).keys():
            warn_of_former(f"{cls.__name__}.{method}", cls.former[method])
        name = cls.model_fields[cls.tag].default if cls.tag in cls.__annotations__ else None
        if isinstance(name, str):
            known = cls.kinds.get(name, cls)
            if (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
                raise TypeError(
                    f'{cls.tag} = "{name}" is taken by {known.__module__}.{known.__name__}'
                )
            if not cls.__module__.startswith(MODULE):  # or it would outlive its study
                cls.kinds[name] = cls

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: type[BaseModel], handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        if "kinds" not in vars(cls):
            return handler(source)
        return core_schema.with_info_plain_validator_function(cls.one_of_the_kinds)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {} if "kinds" in vars(cls) else handler(schema)

    @classmethod
    def one_of_the_kinds(cls, value: Any, info: ValidationInfo) -> Any:
        """Return the kind that a table states."""
        name = value.get(cls.tag) if isinstance(value, dict) else getattr(value, cls.tag, None)
        if cls.coded and isinstance(Code.if_named(name, info), Code):
            return cls.coded.model_validate(value, context=info.context)
        if info.context and info.context.get("saved") and isinstance(value, dict):
            if isinstance(name := value.get(cls.tag), str) and name not in cls.kinds:
                return _unknown_in(cls).model_validate(value)
        adapter = _adapter_of(tuple(cls.kinds.values()), cls.tag)
        return adapter.validate_python(value, context=info.context)


@lru_cache
def _adapter_of(kinds: tuple[type[Kind], ...], tag: str) -> TypeAdapter[Any]:
    choice: Any = Annotated[Union[kinds], Field(discriminator=tag)]  # noqa: UP007
    return TypeAdapter(choice)


@lru_cache
def _unknown_in(family: type[Kind]) -> type[Kind]:
    """Return a kind with any keys: a script's own, in results that are read without the script."""
    key: Any = {family.tag: (str, ...)}
    return create_model("Unknown", __base__=family, __cls_kwargs__={"extra": "allow"}, **key)


class Either(Settings):
    """Settings of which some keys, where they are set, take the place of others.

    The others are refused beside them, and left out of what is dumped.
    """

    def _alternatives(self) -> dict[str, list[str]]:
        """Return the keys, the most important first, and what each takes the place of."""
        raise NotImplementedError

    def _used_keys(self) -> list[str]:
        """Return the keys that are set and take the place of others."""
        return [key for key in self._alternatives() if getattr(self, key) is not None]

    @model_validator(mode="after")
    def _has_one_or_the_other(self) -> Self:
        for key in self._used_keys():
            values = {name: getattr(self, name) for name in self._alternatives()[key]}
            given = [
                f"{name} = {json.dumps(value)}"
                for name, value in values.items()
                if name in self.model_fields_set and value is not None
            ]
            if given:
                raise ValueError(
                    f"{', '.join(given)} would have no effect beside {key}: give one or the other"
                )
        return self

    @model_serializer(mode="wrap")
    def _used(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        hidden = [name for key in self._used_keys() for name in self._alternatives()[key]]
        return {name: value for name, value in serialize(self).items() if name not in hidden}
