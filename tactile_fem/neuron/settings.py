"""Transduction and membrane of a study."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from tactile_fem.runtime.settings import Finite, NonNegative, Positive, Settings, Whole

# What the one population of a study without [[afferents]] is called.
DEFAULT_NAME = "SA1"

# Constants of the models that are not those of the default one. Gains of "hamasaki2020" are fitted
# to rates under a bar alone (Phillips and Johnson 1981): demos/validation/calibrate.py.
_CONSTANTS: dict[Any, dict[str, float]] = {
    "logarithmic": {
        "static_gain_pA_per_kPa": 10950.0,
        "adaptation": 0.0212,
        "adaptation_time_s": 10.0,
        "fast_adaptation": 0.9512,
    },
    "hamasaki2020": {
        "static_gain_pA_per_kPa": 170.0,
        "dynamic_gain_pA_s_per_kPa": 25.5,
        "adaptation": 0.45,
        "adaptation_time_s": 0.5,
    },
}


class Neuron(Settings):
    """Transduction current and membrane; gains are per kPa, or per unit of another drive."""

    model: Literal["power", "logarithmic", "hamasaki2020", "gerling2018", "band_pass"] = Field(
        "power",
        description="law of transduction: a power of the drive, or a logarithm; the linear law of "
        "the paper (alpha, kappa, beta); a generator function; a rectified band-pass filter, for "
        "RA and PC",
    )
    # alpha, p and both kappa: demos/validation/calibrate.py.
    static_gain_pA_per_kPa: NonNegative = Field(
        594.8, description="alpha; fitted to ramps and holds"
    )
    dynamic_gain_pA_s_per_kPa: NonNegative = Field(
        0.0, description="beta; hamasaki2020 has one, fitted to rates under a bar"
    )
    adaptation: Annotated[Finite, Field(ge=0, le=1)] = Field(
        0.0958, description="kappa; fitted, for hamasaki2020 proposed"
    )
    adaptation_time_s: Positive = Field(60.0, description="tau_a; proposed")
    power: Annotated[Finite, Field(ge=0.05, le=4)] = Field(
        0.436, description="power: p of the drive, which is taken in kPa; fitted"
    )
    drive_threshold_kPa: NonNegative = Field(
        0.0, description="power: D_0, up to which the drive evokes nothing"
    )
    compression_kPa: Positive = Field(
        0.0380, description="logarithmic: S_0, above which current grows with the logarithm; fitted"
    )
    fast_adaptation: Annotated[Finite, Field(ge=0, le=1)] = Field(
        0.9331, description="power, logarithmic: kappa of a second, fast adaptation; fitted"
    )
    fast_adaptation_time_s: Positive = Field(
        0.01, description="power, logarithmic: tau_a of the fast adaptation; proposed"
    )
    intercept_pA: Finite | None = Field(
        None,
        description="I_0 while S > 0; default: the rheobase V_th/R for hamasaki2020, otherwise 0",
    )
    generator_gains_pA_per_kPa: tuple[NonNegative, NonNegative, NonNegative, NonNegative] = Field(
        (100.0, 50.0, 25.0, 50.0),
        description="gerling2018: k_i of the parts, the last does not inactivate; proposed",
    )
    generator_times_s: tuple[Positive, Positive, Positive] = Field(
        (0.008, 0.2, 1.745), description="gerling2018: tau_i; Gerling 2018"
    )
    filter_centre_Hz: Positive = Field(40.0, description="band_pass: f_0")
    filter_quality: Positive = Field(0.5, description="band_pass: Q of its poles")
    filter_order: Annotated[Whole, Field(ge=1, le=4)] = Field(
        1, description="band_pass: number of stages; 1 is a rate below f_0, 2 an acceleration"
    )
    filter_gain_pA: NonNegative = Field(
        1000.0, description="band_pass: current per unit of the drive, at f_0"
    )
    filter_off: NonNegative = Field(
        0.4, description="band_pass: share of changes in the other direction; proposed"
    )
    capacitance_pF: Positive = Field(30.0, description="C; after Gerling 2018's public constants")
    resistance_GOhm: Positive = Field(1.667, description="R; after Gerling 2018's constants")
    threshold_mV: Positive = Field(30.0, description="V_th; after Gerling 2018's constants")
    refractory_s: NonNegative = Field(0.001, description="t_ref; after Gerling 2018's constants")
    threshold_jump_mV: NonNegative = Field(
        0.0, description="a: rise of the threshold with each spike; 0: no relative refractoriness"
    )
    threshold_recovery_s: Positive = Field(
        0.01, description="tau_A: time constant with which the threshold recovers"
    )
    gain_spread: NonNegative = Field(
        0.0, description="sd of the logarithm of the gains, factors of the drive, between afferents"
    )
    threshold_spread: NonNegative = Field(
        0.0, description="sd of the logarithm of V_th between afferents"
    )
    resting_pA: Finite = Field(
        0.0, description="current without load; an afferent fires if it exceeds V_th/R"
    )
    resting_spread_pA: NonNegative = Field(
        0.0, description="sd of the current without load between afferents"
    )
    threshold_noise: NonNegative = Field(
        0.0,
        description="sd of the logarithm of the distance from reset to V_th, from spike to spike",
    )
    seed: Annotated[Whole, Field(ge=0, lt=2**63)] = Field(
        1, description="of spread and noise; give each population its own"
    )

    @model_validator(mode="before")
    @classmethod
    def _with_constants_of_its_model(cls, values: Any) -> Any:
        """Give constants that are not set the values that belong to the model."""
        if not isinstance(values, dict):
            return values
        model = values.get("model")
        return {**_CONSTANTS.get(model if isinstance(model, str) else None, {}), **values}

    def shared_with(self, own: dict[str, Any]) -> dict[str, Any]:
        """Return the keys that a population inherits; of another model, without its constants."""
        values = self.model_dump()
        if own.get("model") in (None, self.model):
            return values
        of_models = {"model"}.union(*_CONSTANTS.values())
        return {key: value for key, value in values.items() if key not in of_models}

    def gain_keys(self) -> list[tuple[str, ...]]:
        """Return the keys of what multiplies the current in its model."""
        if self.model == "band_pass":
            return [("filter_gain_pA",)]
        if self.model == "gerling2018":
            name = "generator_gains_pA_per_kPa"
            return [(name, str(k)) for k in range(len(self.generator_gains_pA_per_kPa))]
        return [("static_gain_pA_per_kPa",), ("dynamic_gain_pA_s_per_kPa",)]

    @property
    def lasting_share(self) -> float:
        """Share of the static current that does not adapt."""
        fast = self.fast_adaptation if self.model in ("power", "logarithmic") else 0.0
        return 1 - self.adaptation - fast

    @property
    def time_constant_s(self) -> float:
        """R C of the membrane."""
        return 1e-3 * self.resistance_GOhm * self.capacitance_pF
