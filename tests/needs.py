"""Marks of tests that want libraries which pip does not bring; they are skipped with the reason."""

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


NO_GMSH, NO_PICTURES = gmsh_problem(), pictures.can_draw()
needs_gmsh = pytest.mark.skipif(NO_GMSH is not None, reason=str(NO_GMSH))
needs_graphics = pytest.mark.skipif(NO_PICTURES is not None, reason=str(NO_PICTURES))
