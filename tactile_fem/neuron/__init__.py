"""From what a receptor feels to the spikes of its afferent (NumPy, SciPy)."""

from tactile_fem.neuron.drives import DRIVES, Drive, drive_of
from tactile_fem.neuron.field import pool
from tactile_fem.neuron.fields import Field, MaterialPoint
from tactile_fem.neuron.fit import Fit, FitWarning, Recording, Window, fit
from tactile_fem.neuron.io import load, save, to_neo
from tactile_fem.neuron.population import (
    Population,
    fields_of,
    fire_all,
    replaced,
    respond,
)
from tactile_fem.neuron.response import Response

__all__ = [
    "DRIVES",
    "Drive",
    "Field",
    "Fit",
    "FitWarning",
    "MaterialPoint",
    "Population",
    "Recording",
    "Response",
    "Window",
    "drive_of",
    "fields_of",
    "fire_all",
    "fit",
    "load",
    "pool",
    "replaced",
    "respond",
    "save",
    "to_neo",
]
