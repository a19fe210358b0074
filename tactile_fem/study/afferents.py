"""Populations of afferents: where they lie, what they feel, how they fire."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field

from tactile_fem.neuron.settings import Neuron
from tactile_fem.receptors.settings import Receptors
from tactile_fem.runtime.own_code import Code
from tactile_fem.runtime.settings import Settings

if TYPE_CHECKING:
    from tactile_fem.neuron import Population

# Defaults of a kind that differ from those of SA1. Densities: Johansson and Vallbo 1979 (RA 140, PC
# 21, SA2 9 per cm2). RA end in dermal papillae, PC at about 2 mm depth. Filters, membranes, gains,
# spread and refractoriness of RA and PC are fitted to thresholds and rates of monkeys' afferents,
# those of RA also to their entrainment (Talbot et al. 1968): demos/validation/vibration.py. But RA
# are as refractory as PC, which bounds rates at 333 spikes/s: people's intervals are above 3.4 ms
# (Knibestöl 1973). With 1 ms, which fits slightly better (rms 8, not 11 spikes/s, at 50 Hz), those
# with high gains fire 700 times a second.
# SA2 are proposed: they lie amid the dermis, and their currents at rest are spread about the
# rheobase, so that half of them fire without a load, as 20 of 41 do in Saal et al. (eLife 89616),
# at rates of 5 to 20 spikes/s.
_KINDS: dict[str, dict[str, Any]] = {
    "RA": {
        "feels": "compression",
        "receptors": {"density_per_cm2": 140.0, "side": "dermis"},
        "neuron": {
            "model": "band_pass",
            "filter_centre_Hz": 35.0,
            "filter_quality": 0.32,
            "filter_order": 1,
            "filter_gain_pA": 5000.0,
            "filter_off": 0.2,
            "capacitance_pF": 0.3,
            "refractory_s": 0.003,
            "threshold_jump_mV": 600.0,
            "threshold_recovery_s": 0.006,
            "gain_spread": 0.9,
            "threshold_noise": 0.1,
        },
    },
    "PC": {
        "feels": "indentation",
        "receptors": {"density_per_cm2": 21.0, "below_skin_mm": 2.0, "side": "subcutaneous"},
        "neuron": {
            "model": "band_pass",
            "filter_centre_Hz": 354.0,
            "filter_quality": 0.68,
            "filter_order": 2,
            "filter_gain_pA": 182000.0,
            "filter_off": 0.0,
            "capacitance_pF": 0.3,
            "refractory_s": 0.003,
            "threshold_jump_mV": 1920.0,
            "threshold_recovery_s": 0.004,
            "gain_spread": 0.5,
            "threshold_noise": 0.1,
        },
    },
    "SA2": {
        "feels": "directed_stretch",
        "receptors": {"density_per_cm2": 9.0, "below_skin_mm": 1.2, "side": "dermis"},
        "neuron": {
            "model": "hamasaki2020",
            "static_gain_pA_per_kPa": 400.0,
            "dynamic_gain_pA_s_per_kPa": 10.0,
            "adaptation": 0.3,
            "adaptation_time_s": 0.5,
            "intercept_pA": 0.0,
            "resting_pA": 18.0,
            "resting_spread_pA": 4.5,
            "threshold_noise": 0.1,
        },
    },
}


class Afferents(Settings):
    """A population; keys that its tables lack come from `[receptors]` and `[neuron]`."""

    name: Annotated[str, Field(pattern="^[A-Za-z0-9_-]+$", max_length=40)] = Field(
        description="its name in results and figures: letters, digits, _ and -"
    )
    kind: Literal["SA1", "RA", "PC", "SA2"] = Field(
        "SA1",
        description="of afferent: what is not given below is that of its kind",
    )
    feels: Annotated[str, AfterValidator(Code.if_named)] = Field(
        "sed",
        description="sed, von_mises, largest_stretch, smallest_stretch, largest_stress, "
        "smallest_stress, pressure (kPa), compression, directed_stretch or indentation (mm); each "
        'also with _rate behind it; or "module:name", a Drive or function of the trace in a file '
        "beside the study; gains are per its unit, and what is negative inhibits",
    )
    receptors: Receptors = Receptors()
    neuron: Neuron = Neuron()

    def population(self) -> Population:
        """Return the afferents, whose method `fire` gives spikes."""
        from tactile_fem.neuron import Population

        return Population(self.name, self.neuron, self.feels)


def given_keys(table: Any) -> dict[str, Any]:
    """Return the keys that a table of the study gives."""
    if isinstance(table, BaseModel):
        return table.model_dump(exclude_unset=True)
    return table if isinstance(table, dict) else {}


def filled(entry: Any, shared: dict[str, Receptors | Neuron]) -> Any:
    """Return a population with the shared keys that it does not give; a file knows no None."""
    if not isinstance(entry, dict | Afferents):
        return entry
    given = given_keys(entry)
    kind = given.get("kind")
    defaults = _KINDS.get(kind, {}) if isinstance(kind, str) else {}
    found = {key: value for key, value in defaults.items() if key not in shared} | given
    for name, common in shared.items():
        own = given.get(name, {})
        if isinstance(own, dict):
            own = {key: value for key, value in own.items() if value is not None}
            found[name] = common.shared_with(given.get(name, {})) | defaults.get(name, {}) | own
    return found
