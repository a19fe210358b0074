"""From the drive of a receptor to the spikes of its afferent (NumPy, SciPy)."""

from tactile_fem.neuron.currents import ExponentialSum, Segment, Transduction
from tactile_fem.neuron.drives import DRIVES, Drive, Histories, drive_of
from tactile_fem.neuron.fields import (
    MOVED,
    SED,
    STANDARD,
    STRETCHES,
    Field,
    MaterialPoint,
    trial_histories,
)
from tactile_fem.neuron.fitting import Estimate, FitWarning, RateFit, fit, r_squared
from tactile_fem.neuron.population import Population, fields_of, fire_all, replaced, respond
from tactile_fem.neuron.rates import (
    Recording,
    Window,
    current_at,
    mean_rates,
    modelled_rates,
    rate_of,
)
from tactile_fem.neuron.response import Response, load, save, to_neo, to_nwb
from tactile_fem.neuron.sampled import SampledModel

__all__ = [
    "DRIVES",
    "MOVED",
    "SED",
    "STANDARD",
    "STRETCHES",
    "Drive",
    "Estimate",
    "ExponentialSum",
    "Field",
    "FitWarning",
    "Histories",
    "MaterialPoint",
    "Population",
    "RateFit",
    "Recording",
    "Response",
    "SampledModel",
    "Segment",
    "Transduction",
    "Window",
    "current_at",
    "drive_of",
    "fields_of",
    "fire_all",
    "fit",
    "load",
    "mean_rates",
    "modelled_rates",
    "r_squared",
    "rate_of",
    "replaced",
    "respond",
    "save",
    "to_neo",
    "to_nwb",
    "trial_histories",
]
