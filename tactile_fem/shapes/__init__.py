"""Shapes from files: scanned fingers, parts of CAD programs, heights of instruments."""

from tactile_fem.shapes.mesh import Mesh

__all__ = ["Mesh"]
