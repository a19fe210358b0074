"""Compiles C code for this processor, above all the forms', and keeps its cache usable."""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import itertools
import os
import platform
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import IO, Any

import cffi
import numpy as np
import ufl
from dolfinx import fem, jit
from ufl.algorithms.analysis import extract_type
from ufl.classes import Label
from ufl.core.expr import Expr
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

from tactile_fem.runtime.doctor import compiler

_numbers = itertools.count(10**9)  # of the package's constants

# How long to wait for another process that compiles the same form.
_LONGEST_WAIT_S = 300
# Compiling a form never takes this long: its process was killed.
_LONGEST_COMPILATION_S = 600
# A folder of our own, so that `clean_cache` never removes forms that other programs compile.
_SUBFOLDER = "tactile_fem"

_locks: dict[Path, IO[str]] = {}  # open, and so locked, as long as this process lives


def jit_options(flags: Sequence[str]) -> dict[str, Any]:
    """Return DOLFINx's JIT options for the given C compiler flags; its own flags without any.

    ``-march=native`` is dropped where it is not understood (other than x86-64). Where it stays,
    the processor's features become part of the flags and so of the cache's key: a home folder
    shared by different processors then holds one version for each. The environment variable
    TACTILE_FEM_O3, which the tests set, replaces -O3: they compile more than they compute.

    This process counts as a user of the cache from now on, see `clean_cache`.
    """
    is_x86 = platform.machine() in ("x86_64", "AMD64")
    chosen = [flag for flag in flags if flag != "-march=native" or is_x86]
    chosen = [os.environ.get("TACTILE_FEM_O3", flag) if flag == "-O3" else flag for flag in chosen]
    if "-march=native" in chosen:
        features = hashlib.sha256(_cpuinfo("flags").encode()).hexdigest()[:12]
        chosen.append(f"-DTACTILE_CPU={features}")
    own = {"cffi_extra_compile_args": chosen} if chosen else {}
    return {**_common_options(), **own}


def _common_options() -> dict[str, Any]:
    folder = jit.get_options()["cache_dir"] / _SUBFOLDER
    if folder not in _locks:
        _lock(folder)
    return {"cache_dir": folder, "timeout": _LONGEST_WAIT_S}


def _cpuinfo(key: str) -> str:
    """Return a line of /proc/cpuinfo; the machine's name if there is none."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith(key))
    except (OSError, StopIteration):
        return platform.node()


def compiled_by() -> dict[str, str]:
    """Return the C compiler and the processor, on which the last digits of results depend."""
    command = compiler() or ["cc"]
    lines: list[str] = []
    with suppress(OSError, subprocess.SubprocessError):
        result = subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=10)
        lines = result.stdout.splitlines()
    return {"version": (lines or command)[0], "processor": _cpuinfo("model name")}


class _Numbered(ufl.Constant):
    """A constant of UFL with one of the package's own numbers: DOLFINx's class can pass none on."""

    def __init__(self, domain: object, shape: tuple[int, ...] = ()) -> None:
        super().__init__(domain, shape, next(_numbers))  # type: ignore[no-untyped-call]


class Constant(fem.Constant, _Numbered):
    """A constant of DOLFINx whose number has as many digits as that of any other one of this class.

    UFL sorts the constants of a sum or product by their numbers as text: a form with a 9th and a
    10th one has another signature than with an 11th and a 12th, and would be compiled again.
    """


def expression(value: Expr, points: np.ndarray) -> fem.Expression:
    """Compile a UFL expression at points of the reference cell or facet, (points, 3 or 2)."""
    return fem.Expression(with_own_labels(value), points, jit_options=_common_options())


def with_own_labels(value: Expr) -> Expr:
    """Return an expression whose variables are counted from 0, as UFL counts those of a form.

    Otherwise each problem of a process would have another signature, and be compiled again.
    """
    labels = sorted(extract_type(value, Label), key=lambda label: label.count())
    own = {label: Label(number) for number, label in enumerate(labels)}
    return map_expr_dag(_Relabeled(own), value)


class _Relabeled(MultiFunction):
    expr = MultiFunction.reuse_if_untouched

    def __init__(self, own: Mapping[Label, Label]) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._own = own

    def label(self, label: Label) -> Label:
        return self._own[label]


@jit.mpi_jit_decorator  # type: ignore[untyped-decorator]
def c_functions(
    source: Path,
    declarations: str,
    jit_options: Mapping[str, Any],
    key: str = "",
    generated: Callable[[], str] = str,
    **definitions: int | str,
) -> tuple[Any, cffi.FFI]:
    """Compile a file of C functions, or load them from the cache of forms.

    Called with a communicator before the other arguments, whose ranks all call.

    Parameters
    ----------
    source
        The file.
    declarations
        Declarations of its functions, in C.
    jit_options
        Options of the compiler, see `jit_options`.
    key, generated
        Makes code that stands before the file's, and what changes with that code.
    **definitions
        Preprocessor constants.

    Returns
    -------
    The functions as attributes, and what converts their arguments.
    """
    options = jit.get_options(dict(jit_options))
    flags = [f"-D{name}={value}" for name, value in definitions.items()]
    flags = [*options["cffi_extra_compile_args"], *flags]
    code = source.read_text(encoding="ascii")
    made_from = repr((key, code, declarations, flags, cffi.__version__))
    name = f"tactile_{source.stem}_{hashlib.sha256(made_from.encode()).hexdigest()[:16]}"
    folder = options["cache_dir"]
    library = folder / f"{name}{EXTENSION_SUFFIXES[0]}"
    if not library.exists() or not library.stat().st_size:  # empty after a power cut
        builder = cffi.FFI()
        builder.cdef(declarations)
        whole = generated() + code
        builder.set_source(name, whole, extra_compile_args=flags, libraries=["m"])
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as own:  # at once: others may be compiling it
            Path(builder.compile(tmpdir=own)).replace(library)
    spec = importlib.util.spec_from_file_location(name, library)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.lib, module.ffi


def clean_cache(folder: Path) -> None:
    """Remove forms whose compilation was interrupted from our part of DOLFINx's cache, `folder`.

    FFCx sets aside those that failed. Those of a process that was killed it takes for ones that
    another compiles, and at every start would wait for them until its timeout and then give up. So
    a lock shows whether there are other processes; theirs are not removed.
    """
    ours = folder / _SUBFOLDER
    least_age_s = 0.0 if _lock(ours) else _LONGEST_COMPILATION_S
    empty = set()
    for library in ours.glob("libffcx_*.so"):  # after a power cut
        with suppress(OSError):  # another process was faster
            if not library.stat().st_size:
                empty.add(library.name.partition(".")[0])
    for source in ours.glob("libffcx_*.c"):
        ready = source.with_suffix(".c.cached")
        with suppress(OSError):
            age_s = time.time() - source.stat().st_mtime
            # A library that is just being linked is empty too: its form is not ready yet.
            if source.stem in empty if ready.exists() else age_s >= least_age_s:
                ready.unlink(missing_ok=True)
                source.unlink()


def _lock(folder: Path) -> bool:
    """Register as a user of a cache; return whether it is the only one, False if unknown.

    The system releases the lock when the process ends, however it ends.
    """
    with suppress(OSError):  # no locks there, or not writable, which DOLFINx will report
        if folder not in _locks:
            folder.mkdir(parents=True, exist_ok=True)
            _locks[folder] = (folder / "tactile_fem.lock").open("a", encoding="ascii")
        try:
            fcntl.flock(_locks[folder], fcntl.LOCK_EX | fcntl.LOCK_NB)
            alone = True
        except BlockingIOError:
            alone = False
        fcntl.flock(_locks[folder], fcntl.LOCK_SH)
        return alone
    return False
