"""Receptors: where they are, and what they feel (`tactile_fem.receptors.probe`)."""

from tactile_fem.receptors.placement import Samples, place, sample

__all__ = ["Samples", "place", "sample"]
