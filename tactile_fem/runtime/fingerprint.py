"""A hash of a user's own objects: of their code and of their values, the same in any process."""

from __future__ import annotations

import dis
import hashlib
import sys
import sysconfig
import types
from collections.abc import Iterator, Mapping
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from tactile_fem.errors import StudyError

_PLAIN = int, float, complex, str, bytes, type(None), type(Ellipsis), type(NotImplemented), range
_BUILTIN = types.BuiltinFunctionType, np.ufunc, types.MethodWrapperType, types.WrapperDescriptorType
_INSTALLED = tuple(sysconfig.get_paths()[name] for name in ("stdlib", "purelib", "platlib"))
# Of a class: what Python and dataclasses add, of which all else follows.
_ADDED = {
    *("__module__", "__dict__", "__weakref__", "__doc__", "__annotations__", "__firstlineno__"),
    *("__static_attributes__", "__dataclass_fields__", "__dataclass_params__", "__match_args__"),
    *("__abstractmethods__", "_abc_impl", "__parameters__", "__orig_bases__", "__annotate_func__"),
    *("__replace__", "__annotations_cache__", "__annotate__", "__slots__", "__slotnames__"),
    "__hash__",
}


def fingerprint(value: object, where: str) -> str:
    """Return a hash of an object: a function, class, instance, or values.

    Functions and classes count by their code with all that it refers to, those of installed
    libraries by their names. So neither the name of a script matters nor where it lies.

    Parameters
    ----------
    where
        What a message calls the object.

    Raises
    ------
    StudyError
        Something in it is neither code nor values, say, an open file.
    """
    return _Fingerprint(where).of(value)


class _Fingerprint:
    def __init__(self, where: str) -> None:
        self._where = where
        self._found: dict[int, str] = {}  # by `id`; of objects in which we are their number
        self._kept: list[object] = []  # lest another object gets the `id` of a temporary one

    def of(self, value: object) -> str:
        if isinstance(value, _PLAIN) and type(value) in (*_PLAIN, bool):
            return _digest(type(value).__name__, repr(value))
        if id(value) not in self._found:
            self._found[id(value)] = f"object {len(self._kept)}"
            self._kept.append(value)
            self._found[id(value)] = _digest(*self._parts(value))
        return self._found[id(value)]

    def _parts(self, value: Any) -> Iterator[str]:
        """Yield what makes up a value: words, and hashes of what it consists of."""
        yield type(value).__qualname__
        if isinstance(value, np.ndarray):
            yield f"{value.dtype.str} {value.shape}"
            data = value.tolist() if value.dtype.hasobject else value.tobytes()
            yield self.of(data)
        elif isinstance(value, types.ModuleType):
            yield value.__name__
            if (file := getattr(value, "__file__", None)) and not _is_installed(value.__name__):
                yield self.of(Path(file))
        elif isinstance(value, Path):
            yield self.of(value.read_bytes() if value.is_file() else str(value))
        elif isinstance(value, types.CodeType):
            yield from (value.co_code.hex(), repr((value.co_names, value.co_varnames)))
            yield from map(self.of, value.co_consts)
        elif isinstance(value, _BUILTIN):
            yield getattr(value, "__qualname__", value.__name__)
            yield self.of(getattr(value, "__self__", None))
        elif isinstance(value, types.FunctionType):
            yield from self._of_function(value)
        elif isinstance(value, type):
            yield from self._of_class(value)
        elif isinstance(value, types.MethodType):
            yield from map(self.of, (value.__func__, value.__self__))
        elif isinstance(value, partial):
            yield from map(self.of, (value.func, value.args, value.keywords))
        elif isinstance(value, staticmethod | classmethod):
            yield self.of(value.__func__)
        elif isinstance(value, property):
            yield from map(self.of, (value.fget, value.fset))
        elif isinstance(value, cached_property):
            yield self.of(value.func)
        elif isinstance(value, types.MemberDescriptorType | types.GetSetDescriptorType):
            yield value.__name__
        elif isinstance(value, Mapping):
            yield from sorted(self.of(key) + self.of(own) for key, own in value.items())
        elif isinstance(value, set | frozenset):
            yield from sorted(map(self.of, value))
        elif isinstance(value, list | tuple):
            yield from map(self.of, value)
        else:
            yield from self._of_instance(value)

    def _of_function(self, function: types.FunctionType) -> Iterator[str]:
        yield function.__qualname__.rpartition(".")[2]
        if _is_installed(function.__module__):
            yield f"{function.__module__}.{function.__qualname__}"
            if function.__closure__ is None:
                return
        own = function.__code__, function.__defaults__, function.__kwdefaults__, vars(function)
        yield from map(self.of, own)
        for cell in function.__closure__ or ():
            try:
                yield self.of(cell.cell_contents)
            except ValueError:  # an empty cell
                yield "empty"
        if not _is_installed(function.__module__):
            known = function.__globals__
            for name in sorted(_globals_of(function.__code__) & known.keys()):
                yield name + self.of(known[name])

    def _of_class(self, kind: type) -> Iterator[str]:
        if _is_installed(kind.__module__):
            yield f"{kind.__module__}.{kind.__qualname__}"
            return
        yield kind.__name__
        yield from map(self.of, kind.__bases__)
        for name in sorted(vars(kind).keys() - _ADDED):
            yield name + self.of(vars(kind)[name])

    def _of_instance(self, value: Any) -> Iterator[str]:
        kind = type(value)
        try:
            reduced = value.__reduce_ex__(4)
        except (TypeError, AttributeError, ValueError) as error:
            raise StudyError(
                f"{self._where} refers to an object of the type {kind.__module__}."
                f"{kind.__qualname__}, which cannot be told from others; a scan that is continued "
                "must have the same parts, so keep functions, numbers and arrays in them."
            ) from error
        if isinstance(reduced, str):  # the name of a function in the cache of another
            yield self.of(getattr(value, "__wrapped__", reduced))
            return
        made_by, *state = reduced
        yield from map(self.of, (kind, made_by))
        computed = {name for own in kind.__mro__ for name, attribute in vars(own).items()
                    if isinstance(attribute, cached_property)}  # fmt: skip
        for part in state:
            if isinstance(part, dict):
                part = {name: own for name, own in part.items() if name not in computed}
            elif isinstance(part, Iterator):
                part = list(part)
            yield self.of(part)


def _digest(*parts: str) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


def _globals_of(code: types.CodeType) -> set[str]:
    """Return the names of globals that code and the functions in it read."""
    names = {own.argval for own in dis.get_instructions(code) if own.opname == "LOAD_GLOBAL"}
    inner = [own for own in code.co_consts if isinstance(own, types.CodeType)]
    return names.union(*map(_globals_of, inner))


def _is_installed(module: str | None) -> bool:
    """Return whether a module is of Python, of this package, or of another that is installed."""
    if module is None or module.partition(".")[0] == "tactile_fem":
        return True
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return module in sys.builtin_module_names
    return any(Path(file).is_relative_to(folder) for folder in _INSTALLED)
