"""Receptors: where they are, and what they feel (`tactile_fem.receptors.probe`)."""

from tactile_fem.receptors.layout import Layout, lay_out, place_all
from tactile_fem.receptors.placement import Samples, place, sample

__all__ = ["Layout", "Samples", "lay_out", "place", "place_all", "sample"]
