"""Receptors: where they are, and what they feel (`tactile_fem.receptors.probe`)."""

from tactile_fem.receptors.placement import Layout, Samples, lay_out, place, sample

__all__ = ["Layout", "Samples", "lay_out", "place", "sample"]
