"""Populations of afferents: where they lie, what they feel, how they fire."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from tactile_fem.neuron.settings import Neuron
from tactile_fem.receptors.settings import Receptors
from tactile_fem.runtime.settings import Settings

if TYPE_CHECKING:
    from tactile_fem.neuron import Population

# What the kinds are that is not as in SA1. Densities: Johansson and Vallbo 1979 (RA 140, PC 21 per
# cm2). RA end in dermal papillae, PC at about 2 mm depth. Filters, gains, spread, refractoriness:
# demos/neurons/vibration.py. Membrane times of 5 and 1.5 ms: of published models (touchSim).
_KINDS: dict[Any, dict[str, Any]] = {
    "RA": {
        "feels": "compression",
        "receptors": {"density_per_cm2": 140.0, "side": "dermis"},
        "neuron": {
            "model": "band_pass",
            "filter_centre_Hz": 49.0,
            "filter_quality": 0.5,
            "filter_order": 1,
            "filter_gain_pA": 3290.0,
            "filter_off": 0.4,
            "capacitance_pF": 3.0,
            "refractory_s": 0.006,
            "gain_spread": 0.9,
            "threshold_noise": 0.1,
        },
    },
    "PC": {
        "feels": "indentation",
        "receptors": {"density_per_cm2": 21.0, "below_skin_mm": 2.0, "side": "subcutaneous"},
        "neuron": {
            "model": "band_pass",
            "filter_centre_Hz": 465.0,
            "filter_quality": 0.82,
            "filter_order": 2,
            "filter_gain_pA": 398000.0,
            "filter_off": 0.0,
            "capacitance_pF": 0.9,
            "refractory_s": 0.003,
            "threshold_jump_mV": 960.0,
            "threshold_recovery_s": 0.004,
            "gain_spread": 0.6,
            "threshold_noise": 0.1,
        },
    },
}


def of_kind(kind: Any) -> dict[str, Any]:
    """Return what a population of a kind has by default that one of SA1 has not."""
    return _KINDS.get(kind if isinstance(kind, str) else None, {})


class Afferents(Settings):
    """A population; it takes what its own tables lack from `[receptors]` and `[neuron]`."""

    name: Annotated[str, Field(pattern="^[A-Za-z0-9_-]+$", max_length=40)] = Field(
        description="its name in results and figures: letters, digits, _ and -"
    )
    kind: Literal["SA1", "RA", "PC"] = Field(
        "SA1", description="of afferent: what is not given below is that of its kind"
    )
    feels: str = Field(
        "sed",
        description="sed, von_mises, largest_stretch, smallest_stretch, largest_stress, "
        "smallest_stress, pressure, compression or indentation; each also with _rate behind it",
    )
    receptors: Receptors = Receptors()
    neuron: Neuron = Neuron()

    def population(self) -> Population:
        """Return the afferents, which fire."""
        from tactile_fem.neuron import Population

        return Population(self.name, self.neuron, self.feels)
