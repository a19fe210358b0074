"""From the strain energy density at a receptor to the spikes of its afferent (NumPy only)."""

from tactile_fem.neuron.afferent import respond
from tactile_fem.neuron.response import Response

__all__ = ["Response", "respond"]
