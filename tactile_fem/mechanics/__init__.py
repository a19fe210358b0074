"""Contact mechanics of the finger, in UFL and PETSc."""

from tactile_fem.runtime import backend

__all__ = ["backend"]
