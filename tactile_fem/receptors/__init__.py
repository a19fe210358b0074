"""Receptors: where they are, and what they feel (`tactile_fem.simulation.probe`)."""

from tactile_fem.receptors.placement import Layout, Samples, place, sample

__all__ = ["Layout", "Samples", "place", "sample"]
