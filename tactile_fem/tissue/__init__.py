"""Strain energies of the tissues."""
