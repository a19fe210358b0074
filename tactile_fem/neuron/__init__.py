"""From the strain energy density at a receptor to the spikes of its afferent (NumPy, SciPy)."""

from tactile_fem.neuron.afferent import respond
from tactile_fem.neuron.field import ReceptiveField
from tactile_fem.neuron.fit import Fit, FitWarning, Window, fit
from tactile_fem.neuron.io import load, save, to_neo
from tactile_fem.neuron.response import Response

__all__ = [
    "Fit",
    "FitWarning",
    "ReceptiveField",
    "Response",
    "Window",
    "fit",
    "load",
    "respond",
    "save",
    "to_neo",
]
