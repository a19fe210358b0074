"""Finds what pip cannot install: a C compiler, and libraries for meshes and pictures.

It uses only the standard library, so that it runs before anything is installed.
"""

from __future__ import annotations

import ctypes
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

# Libraries that gmsh's wheel loads, and the Debian packages that provide them.
GMSH_LIBRARIES = {
    "libGLU.so.1": "libglu1-mesa",
    "libGL.so.1": "libgl1",
    "libXcursor.so.1": "libxcursor1",
    "libXft.so.2": "libxft2",
    "libXinerama.so.1": "libxinerama1",
}
# One of them renders off screen; without any VTK crashes.
OFF_SCREEN_LIBRARIES = ("libEGL.so.1", "libOSMesa.so.8", "libOSMesa.so")


@dataclass(frozen=True)
class Finding:
    """Something missing: what does not work without it, Debian packages that provide it.

    It is fatal if no scan runs without it.
    """

    sentence: str
    packages: tuple[str, ...] = ()
    fatal: bool = False

    def __str__(self) -> str:
        """Return the sentence, and the command that installs what is missing."""
        line = install_line([self])
        return f"{self.sentence} On Debian or Ubuntu: {line}" if line else self.sentence


def compiler() -> list[str]:
    """Return the words of the command of the C compiler; none if there is no compiler.

    The compiler that Python was built with need not be installed; any other can be used.
    """
    built_with = (sysconfig.get_config_var("CC") or "cc").split()[0]
    commands = (os.environ.get("CC", ""), built_with, "gcc", "cc", "clang")
    return next(filter(None, map(_program, commands)), [])


def compiler_finding() -> Finding | None:
    """Try to compile against Python, because DOLFINx compiles each form on first use."""
    words, version = compiler(), f"{sys.version_info.major}.{sys.version_info.minor}"
    packages = "gcc", "libc6-dev", f"python{version}-dev"
    if not words:
        return Finding("There is no C compiler, which DOLFINx needs to run.", packages, fatal=True)
    if problem := _problem(words):
        what = f"DOLFINx needs {shlex.join(words)} to compile for Python {version}, but: {problem}."
        if words == _program(os.environ.get("CC", "")):
            what += " The variable CC names this compiler: unset it, or name another."
        return Finding(what, packages, fatal=True)
    return None


def variable_finding() -> Finding | None:
    """Check that the variable CC, if it is set, names a program."""
    named, words = os.environ.get("CC"), compiler()
    if not named or not words or _program(named):
        return None
    return Finding(f'CC is "{named}", which cannot be run: {words[0]} is used instead.')


def gmsh_finding() -> Finding | None:
    """Check the libraries that gmsh loads."""
    missing = [package for name, package in GMSH_LIBRARIES.items() if not has_library(name)]
    if not missing:
        return None
    return Finding(
        "Libraries that gmsh needs are missing: only the shipped fingers can be used.",
        tuple(missing),
    )


def picture_finding() -> Finding | None:
    """Check for a library that renders off screen."""
    if any(map(has_library, OFF_SCREEN_LIBRARIES)):
        return None
    return Finding(
        "There is no EGL or OSMesa library to draw with: 3-D pictures are skipped.", ("libegl1",)
    )


def has_library(name: str) -> bool:
    """Return whether a shared library can be loaded."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return (Path(sys.prefix) / "lib" / name).exists()
    return True


def _program(command: str) -> list[str]:
    """Return the words of a command; none if it cannot be run."""
    try:
        words = shlex.split(command)
    except ValueError:  # a quotation that does not end
        return []
    return words if words and shutil.which(words[0]) else []


def _problem(compiler: list[str]) -> str:
    """Return why headers of C and Python do not compile, as the compiler says, or nothing."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "probe.c"
        source.write_text("#include <stdio.h>\n#include <math.h>\n#include <Python.h>\n")
        # As in setuptools: an environment may provide headers that its Python lacks.
        folders = [f"-I{sys.prefix}/include", f"-I{sysconfig.get_path('include')}"]
        command = [*compiler, "-c", *folders, str(source), "-o", f"{source}.o"]
        # Python has found a folder that can be written; a compiler takes TMPDIR as it is.
        environment = {**os.environ, "TMPDIR": tempfile.gettempdir()}
        try:
            done = subprocess.run(
                command, capture_output=True, env=environment, timeout=60, errors="replace"
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return str(error)
        if done.returncode == 0 and Path(f"{source}.o").exists():
            return ""
        lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}, no object file"]
        return next((line for line in lines if "error" in line), lines[-1])


def install_line(missing: Iterable[Finding]) -> str:
    """Return the command that installs all packages, or nothing."""
    packages = dict.fromkeys(package for finding in missing for package in finding.packages)
    return f"apt-get install {' '.join(packages)}" if packages else ""


def main() -> int:
    """Print what is missing and how to install it; return 1 if no scan can run."""
    found = (compiler_finding(), variable_finding(), gmsh_finding(), picture_finding())
    missing = [finding for finding in found if finding is not None]
    for finding in missing:
        print(f"{'Error' if finding.fatal else 'Warning'}: {finding.sentence}")
    if line := install_line(missing):
        print(f"On Debian or Ubuntu:  {line}")
    return 1 if any(finding.fatal for finding in missing) else 0


if __name__ == "__main__":
    sys.exit(main())
