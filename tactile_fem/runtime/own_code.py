"""Code of a user that a study names as ``module:name``, from a Python file in its folder.

The file runs when the code is used, not when a study is read.
"""

from __future__ import annotations

import ast
import hashlib
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, Self

from pydantic import ValidationInfo
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from tactile_fem.errors import StudyError, TactileError
from tactile_fem.runtime.fingerprint import fingerprint

MODULE = "tactile_fem_study_"  # begins the names of such modules in `sys.modules`

_NAMED = re.compile(r"(.+\.py|[A-Za-z_]\w*):([A-Za-z_]\w*)")
_HASHED = re.compile(r"\S+ [0-9a-f]{32}")
_given: dict[str, Any] = {}  # functions of scripts


class Code(str):
    """A function or class: ``/folder/module.py:name``, or a script's, its name and hash."""

    @property
    def file(self) -> Path | None:
        """The file that defines it; None for a script's."""
        path = self.rpartition(":")[0]
        return Path(path) if path else None

    def moved(self, change: Callable[[str], str]) -> Self:
        """Return the same in another file."""
        path, _, name = self.rpartition(":")
        return type(self)(f"{change(path)}:{name}") if path else self

    def load(self, key: str = "", also: type | tuple[()] = ()) -> Any:
        """Return the function or class, or an instance of `also`; `key` begins a StudyError."""
        file, name = self.file, self.rpartition(":")[2]
        if not (file.is_file() if file else self in _given):
            why = "there is no such file" if file else "it is known where its script runs"
            raise StudyError(f"{key}{self}: {why}")
        with self.running(key):
            found = getattr(_module(str(file), file.read_bytes()), name) if file else _given[self]
        if not callable(found) and not isinstance(found, also):
            raise StudyError(f"{key}{self} is a {type(found).__name__}, no function or class")
        return found

    @contextmanager
    def running(self, key: str = "") -> Iterator[None]:
        """Raise an error of the code as a StudyError that begins with `key`."""
        try:
            yield
        except TactileError:
            raise
        except (Exception, SystemExit) as error:
            frames = traceback.extract_tb(error.__traceback__)
            lines = [f" (line {f.lineno})" for f in frames if self.startswith(f"{f.filename}:")]
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            raise StudyError(f"{key}{self}: {reason}{''.join(lines[-1:])}") from error

    @classmethod
    def if_named(cls, value: Any, info: ValidationInfo) -> Any:
        """Return a text ``module:name`` as code in the study's folder; all else as it is."""
        if isinstance(value, str) and (found := _NAMED.fullmatch(value)):
            locate = (info.context or {}).get("locate", os.path.abspath)
            return cls(f"{locate(found[1].removesuffix('.py') + '.py')}:{found[2]}")
        return value

    @classmethod
    def validated(cls, value: Any, info: ValidationInfo) -> Self:
        """Return the code that a text names or a function is."""
        if callable(value):
            name = getattr(value, "__qualname__", type(value).__qualname__)
            value = cls(f"{name} {fingerprint(given := value, str(info.field_name))}")
            _given[value] = given
        named = cls.if_named(value, info)
        if isinstance(named, cls) or (isinstance(named, str) and _HASHED.fullmatch(named)):
            return cls(named)
        raise PydanticCustomError("code_type", "no code")

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> CoreSchema:
        text = core_schema.str_schema()
        return core_schema.with_info_plain_validator_function(
            cls.validated, serialization={"type": "to-string"}, json_schema_input_schema=text
        )


@lru_cache
def _module(path: str, source: bytes) -> ModuleType:
    """Return a file's module; what it imports is installed, as results keep a copy of it alone."""
    tree, names = ast.parse(source, path), list[str]()
    for node in ast.walk(tree):
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
    for name in names:
        if Path(path).with_name(f"{name.partition('.')[0]}.py").exists():
            raise ImportError(f"{name} lies beside it, but results keep a copy of one file only")
    module = ModuleType(f"{MODULE}{Path(path).stem}_{hashlib.sha256(source).hexdigest()[:8]}")
    module.__file__ = path
    sys.modules[module.__name__] = module  # where dataclasses look for it
    exec(compile(tree, path, "exec"), vars(module))
    return module
