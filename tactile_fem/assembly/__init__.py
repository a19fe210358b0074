"""Assembly of virtual works in several cells at once: `VirtualWork(form, u, v)`."""

from tactile_fem.runtime import backend

__all__ = ["backend"]
