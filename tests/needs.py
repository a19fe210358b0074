"""Marks of tests that need libraries which pip does not bring: they are skipped with the reason.

From tests without these marks the libraries are hidden, see `hidden`.
"""

from __future__ import annotations

import pytest

from tactile_fem.output import pictures
from tactile_fem.runtime import doctor


def gmsh_problem() -> str | None:
    """Return why gmsh cannot be loaded and what to install; None if it can."""
    try:
        import gmsh  # noqa: F401
    except (ImportError, OSError) as error:
        finding = doctor.gmsh_finding()
        remedy = doctor.install_line([finding]) if finding else "pip install gmsh"
        return f"gmsh cannot be loaded ({error}): {remedy}"
    return None


# By mark: why the library cannot be used here, None if it can. `hidden` skips what cannot run.
MISSING = {"needs_gmsh": gmsh_problem(), "needs_graphics": pictures.can_draw()}
needs_gmsh, needs_graphics = pytest.mark.needs_gmsh, pytest.mark.needs_graphics
