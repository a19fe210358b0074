"""Imports DOLFINx, wherever it was installed from.

Import this module before anything from DOLFINx, petsc4py or mpi4py; packages that use them do
so in their ``__init__``. The PyPI wheel has to set up MPI first; a DOLFINx from conda or the
system does not.
"""

from __future__ import annotations

import os
import shlex
from importlib.util import find_spec
from typing import Any

import numpy as np

from tactile_fem.runtime.doctor import compiler

# The only release that the tests run with; each release changes the interface.
DOLFINX_RELEASE = (0, 11)

_ROUTES = (
    'Install it by one of: pip install "tactile-fem[solver]" (Python >= 3.12 on Linux x86_64); '
    "conda install -c conda-forge fenics-dolfinx=0.11; or the image dolfinx/dolfinx:v0.11.0."
)


def check(version: str, scalar: Any) -> None:
    """Raise ImportError unless DOLFINx has the version that is tested, and real scalars."""
    needed = ".".join(map(str, DOLFINX_RELEASE))
    if not version.startswith(f"{needed}."):
        raise ImportError(f"tactile_fem needs DOLFINx {needed} and found {version}. {_ROUTES}")
    if np.issubdtype(scalar, np.complexfloating):
        raise ImportError(
            f"tactile_fem needs a DOLFINx with real scalars and found {scalar.__name__}. {_ROUTES}"
        )


def load() -> str:
    """Import DOLFINx in the order its installation needs and return its version.

    Raises
    ------
    ImportError
        DOLFINx is missing, too old or too new, without PETSc or of complex scalars.
    """
    if find_spec("dolfinx_solver") is not None:
        import dolfinx_solver  # noqa: F401  (loads MPI before the compiled modules)
    if command := compiler():
        os.environ.setdefault("CC", shlex.join(command))  # for the forms that DOLFINx compiles
    try:
        import dolfinx
    except ImportError as error:
        raise ImportError(f"tactile_fem needs DOLFINx ({error}). {_ROUTES}") from error
    if not dolfinx.has_petsc4py:
        raise ImportError(f"tactile_fem needs a DOLFINx built with petsc4py. {_ROUTES}")
    check(dolfinx.__version__, dolfinx.default_scalar_type)
    return str(dolfinx.__version__)


DOLFINX_VERSION = load()
