"""Contact mechanics of the finger, in UFL and PETSc."""

from tactile_fem import backend

__all__ = ["backend"]
