"""Imports DOLFINx, wherever it was installed from.

Import this module before anything from DOLFINx, petsc4py or mpi4py; packages that use them do
so in their ``__init__``. The PyPI wheel has to set up MPI first; a DOLFINx from conda or the
system does not.
"""

from __future__ import annotations

import logging
import os
import shlex
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from tactile_fem.errors import TactileError
from tactile_fem.runtime.doctor import compiler, variable_finding
from tactile_fem.runtime.ranks import is_first

logger = logging.getLogger(__name__)

# The only release that the tests run with; each release changes the interface.
DOLFINX_RELEASE = (0, 11)

_ROUTES = (
    'Install it by one of: pip install "tactile-fem[solver]" (Python >= 3.12 on Linux x86_64); '
    "conda install -c conda-forge fenics-dolfinx=0.11; or the image dolfinx/dolfinx:v0.11.0."
)


def check(version: str, scalar: DTypeLike) -> None:
    """Raise ImportError unless DOLFINx has the version that is tested, and real scalars."""
    needed = ".".join(map(str, DOLFINX_RELEASE))
    if not version.startswith(f"{needed}."):
        raise ImportError(f"tactile_fem needs DOLFINx {needed} and found {version}. {_ROUTES}")
    name = np.dtype(scalar).name
    if name.startswith("complex"):
        raise ImportError(
            f"tactile_fem needs a DOLFINx with real scalars and found {name}. {_ROUTES}"
        )


def load() -> str:
    """Import DOLFINx in the order its installation needs and return its version.

    It raises ImportError if DOLFINx is missing, of another release, without PETSc or of complex
    scalars.
    """
    if find_spec("h5py") is not None:  # of readers of instruments' files, of NWB files
        import h5py  # noqa: F401  (its HDF5 does not load behind that of PETSc, which is another)
    if find_spec("dolfinx_solver") is not None:
        import dolfinx_solver  # noqa: F401  (loads MPI before the compiled modules)
    _prepare_compilation()
    arguments = sys.argv
    # DOLFINx refuses arguments that are not UTF-8.
    sys.argv = [word.encode(errors="replace").decode() for word in arguments]
    try:
        import dolfinx
    except ImportError as error:
        raise ImportError(f"tactile_fem needs DOLFINx ({error}). {_ROUTES}") from error
    finally:
        sys.argv = arguments
    if not dolfinx.has_petsc4py:
        raise ImportError(f"tactile_fem needs a DOLFINx built with petsc4py. {_ROUTES}")
    check(dolfinx.__version__, dolfinx.default_scalar_type)
    return str(dolfinx.__version__)


def _prepare_compilation() -> None:
    """Correct what DOLFINx and the compiler of its forms take from the environment.

    It raises TactileError if there is no working directory, or no folder for the cache of compiled
    forms.
    """
    try:
        os.getcwd()  # PETSc asks for it
    except OSError as error:
        raise TactileError(
            f"The working directory cannot be used ({error.strerror}): change to another."
        ) from None
    os.environ["TMPDIR"] = tempfile.gettempdir()  # Python has tried to write there
    finding = variable_finding()
    if finding and is_first():
        logger.warning("%s", finding.sentence)
    if command := compiler():
        os.environ["CC"] = shlex.join(command)
    if not os.environ.get("XDG_CACHE_HOME"):  # empty: DOLFINx would take the working directory
        os.environ.pop("XDG_CACHE_HOME", None)
    try:
        Path.home()
    except RuntimeError:  # DOLFINx asks for it even if it uses another folder
        cache = os.environ.get("XDG_CACHE_HOME")
        if not cache:
            raise TactileError(
                "This user has no home folder for the cache of compiled forms: set HOME or "
                "XDG_CACHE_HOME to a folder that can be written."
            ) from None
        os.environ["HOME"] = cache


DOLFINX_VERSION = load()
