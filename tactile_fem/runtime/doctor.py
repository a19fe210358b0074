"""Checks what pip cannot install: a C compiler, and libraries for meshes and pictures.

It uses only the standard library, so that it runs before anything is installed.
"""

from __future__ import annotations

import ctypes
import ctypes.util
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

GMSH_LIBRARIES = {
    "libGLU.so.1": "libglu1-mesa",
    "libGL.so.1": "libgl1",
    "libXcursor.so.1": "libxcursor1",
    "libXft.so.2": "libxft2",
    "libXinerama.so.1": "libxinerama1",
}
_OFF_SCREEN = ("libEGL.so.1", "libOSMesa.so.8", "libOSMesa.so")


@dataclass(frozen=True)
class Finding:
    """A missing program or library.

    Attributes
    ----------
    sentence
        What is missing and what does not work without it.
    packages
        Debian packages that provide it.
    fatal
        Whether it is needed for every scan.
    """

    sentence: str
    packages: tuple[str, ...]
    fatal: bool = False

    def __str__(self) -> str:
        """Return the sentence, and the command that installs what is missing."""
        return f"{self.sentence} On Debian or Ubuntu: {install_line([self])}"


def has_library(name: str) -> bool:
    """Return whether a shared library can be loaded."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return (Path(sys.prefix) / "lib" / name).exists()
    return True


def compiler() -> list[str]:
    """Return the command of the C compiler; empty if there is none.

    The compiler that Python was built with need not be installed; any other can be used.
    """
    named = os.environ.get("CC") or (sysconfig.get_config_var("CC") or "cc").split()[0]
    for command in (named, "gcc", "cc", "clang"):
        words = shlex.split(command)
        if words and shutil.which(words[0]):
            return words
    return []


def compiler_finding() -> Finding | None:
    """Try to compile against Python, because DOLFINx compiles each form on first use."""
    words, library = compiler(), ("gcc", "libc6-dev")
    if not words:
        return Finding("There is no C compiler, which DOLFINx needs to run.", library, fatal=True)
    if not _compiles(words, "#include <stdio.h>\n#include <math.h>\n"):
        what = f"The C compiler {words[0]} does not compile: headers of the C library are missing."
        return Finding(what, library, fatal=True)
    if not _compiles(words, "#include <Python.h>\n"):
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        what = f"The headers of Python {python} are missing, which DOLFINx needs to run."
        return Finding(what, (f"python{python}-dev",), fatal=True)
    return None


def _compiles(compiler: list[str], code: str) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "probe.c"
        source.write_text(code)
        # As in setuptools: an environment may provide headers that its Python lacks.
        folders = [f"-I{sys.prefix}/include", f"-I{sysconfig.get_path('include')}"]
        command = [*compiler, "-c", *folders, str(source), "-o", f"{source}.o"]
        try:
            return subprocess.run(command, capture_output=True, timeout=60).returncode == 0
        except (OSError, subprocess.TimeoutExpired):
            return False


def gmsh_finding() -> Finding | None:
    """Check the libraries that gmsh's wheel loads."""
    missing = [package for name, package in GMSH_LIBRARIES.items() if not has_library(name)]
    if not missing:
        return None
    return Finding(
        "Libraries that gmsh needs are missing: only the shipped fingers and your own .msh files "
        "can be used.",
        tuple(missing),
    )


def picture_finding() -> Finding | None:
    """Check for a library that renders off screen; without one VTK crashes."""
    if any(has_library(name) for name in _OFF_SCREEN):
        return None
    return Finding(
        "There is no EGL or OSMesa library to draw with: 3-D pictures are skipped.",
        ("libegl1",),
    )


def findings() -> list[Finding]:
    """Return all that is missing."""
    found = (compiler_finding(), gmsh_finding(), picture_finding())
    return [finding for finding in found if finding is not None]


def install_line(missing: Iterable[Finding]) -> str:
    """Return the command that installs all packages, or nothing."""
    packages = dict.fromkeys(package for finding in missing for package in finding.packages)
    return f"apt-get install {' '.join(packages)}" if packages else ""


def main() -> int:
    """Print what is missing and how to install it; return 1 if no scan can run."""
    missing = findings()
    for finding in missing:
        print(f"{'Error' if finding.fatal else 'Warning'}: {finding.sentence}")
    if missing:
        print(f"On Debian or Ubuntu:  {install_line(missing)}")
    return 1 if any(finding.fatal for finding in missing) else 0


if __name__ == "__main__":
    sys.exit(main())
