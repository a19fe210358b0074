"""Populations of afferents: where they lie, what they feel, how they fire."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from tactile_fem.study.base import Finite, NonNegative, Positive, Section, Whole

# What the one population of a study without [[afferents]] is called.
DEFAULT_NAME = "SA1"
_MOST = 100_000


# Constants of the models that are not those of the default one. Gains of "hamasaki2020" are fitted
# to rates under a bar alone (Phillips and Johnson 1981): demos/neurons/calibrate.py.
_CONSTANTS: dict[Any, dict[str, float]] = {
    "hamasaki2020": {
        "static_gain_pA_per_kPa": 170.0,
        "dynamic_gain_pA_s_per_kPa": 25.5,
        "adaptation": 0.45,
    }
}


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


class Receptors(Section):
    """End organs on the epidermis-dermis interface or anywhere below the skin."""

    placement: Literal["line", "grid", "random", "afferents", "intermediate_ridges", "papillae"] = (
        Field(
            "line",
            description="paper: a line across the finger (in a section, along it); or a grid, at "
            "random, or like afferents: by density on the interface, none close to another; in a "
            "section also at the tips of its intermediate ridges (SA1) or of its papillae (RA)",
        )
    )
    half_width_mm: NonNegative = Field(5.0, description="extent across the finger (X)")
    half_length_mm: NonNegative = Field(
        4.0, description="extent along the finger (Y); a line has none"
    )
    spacing_mm: Positive = Field(0.2, description="of line and grid; paper's shift per pass")
    density_per_cm2: Positive = Field(
        70.0, description="of random and afferents; default that of SA1"
    )
    seed: Annotated[Whole, Field(ge=0)] = Field(1, description="of random and afferents")
    extra_mm: tuple[tuple[Finite, Finite], ...] = Field(
        (), description="further receptors: pairs X, Y"
    )
    below_skin_mm: Positive | None = Field(
        None,
        description="below the undeformed skin; default on the epidermis-dermis interface",
    )
    side: Literal["epidermis", "dermis", "subcutaneous"] = Field(
        "epidermis", description="tissue whose strain energy the receptor feels"
    )
    average_radius_mm: NonNegative = Field(
        0.25, description="proposed: radius of the averaged ball; 0 is the point value"
    )
    end_organs: Annotated[Whole, Field(ge=1, le=50)] = Field(
        1, description="paper: one; more are averaged, one at the receptor, the others around it"
    )
    end_organs_radius_mm: Positive = Field(
        1.0, description="proposed: of the circle on which the other end organs lie"
    )

    @model_validator(mode="after")
    def _are_few(self) -> Self:
        """Refuse more receptors than a fingertip has by far."""
        across, along = 2 * self.half_width_mm, 2 * self.half_length_mm
        rows, columns = across / self.spacing_mm, along / self.spacing_mm
        count = max(rows, columns)  # both lines are laid out, whatever the placement
        if self.placement == "grid":
            count = max(count, rows * columns)
        elif self.placement in ("random", "afferents"):
            count = max(count, self.density_per_cm2 * across * along / 100)
        if count > _MOST:
            raise ValueError(
                f"{count:.3g} receptors are more than {_MOST:,}; choose a smaller extent, a longer "
                "spacing_mm or a lower density_per_cm2"
            )
        return self

    def shared_with(self, own: dict[str, Any]) -> dict[str, Any]:
        """Return what a population takes over that has some keys of its own: all."""
        return self.model_dump()


class Neuron(Section):
    """Transduction current and membrane; gains are per kPa, or per unit of what else is felt."""

    model: Literal["logarithmic", "hamasaki2020", "gerling2018", "band_pass"] = Field(
        "logarithmic",
        description="transduction: of a logarithm; or alpha, kappa, beta, with constants of their "
        "own; or the generator function; or a rectified band-pass, of RA and PC",
    )
    # alpha, S_0 and the fast kappa: demos/neurons/calibrate.py.
    static_gain_pA_per_kPa: NonNegative = Field(
        9740.0, description="alpha; fitted to rates under a bar and spheres"
    )
    dynamic_gain_pA_s_per_kPa: NonNegative = Field(
        0.0, description="beta; hamasaki2020 has one, fitted to rates under a bar"
    )
    adaptation: Annotated[Finite, Field(ge=0, le=1)] = Field(
        0.0, description="kappa; proposed where it is not 0"
    )
    adaptation_time_s: Positive = Field(0.5, description="tau_a; proposed")
    compression_kPa: Positive = Field(
        0.0451,
        description="logarithmic: S_0, above which current grows with the logarithm; fitted",
    )
    fast_adaptation: Annotated[Finite, Field(ge=0, le=1)] = Field(
        0.953, description="logarithmic: kappa of a second, fast adaptation; fitted"
    )
    fast_adaptation_time_s: Positive = Field(
        0.01, description="logarithmic: tau_a of the fast adaptation; proposed"
    )
    intercept_pA: Finite | None = Field(
        None,
        description="I_0 while S > 0; default is the rheobase V_th/R of hamasaki2020, otherwise 0",
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
        1, description="band_pass: how many stages; 1 is a rate below f_0, 2 an acceleration"
    )
    filter_gain_pA: NonNegative = Field(
        1000.0, description="band_pass: current per unit of what is felt, at f_0"
    )
    filter_off: NonNegative = Field(
        0.4, description="band_pass: share of what changes in the other direction; proposed"
    )
    capacitance_pF: Positive = Field(30.0, description="C; after Gerling 2018's public constants")
    resistance_GOhm: Positive = Field(1.667, description="R; after Gerling 2018's constants")
    threshold_mV: Positive = Field(30.0, description="V_th; after Gerling 2018's constants")
    refractory_s: NonNegative = Field(0.001, description="t_ref; after Gerling 2018's constants")
    threshold_jump_mV: NonNegative = Field(
        0.0,
        description="a: what each spike raises the threshold by; 0 is no relative refractoriness",
    )
    threshold_recovery_s: Positive = Field(
        0.01, description="tau_A: time over which the threshold comes back"
    )
    gain_spread: NonNegative = Field(
        0.0, description="sd of the logarithm of the gains between afferents"
    )
    threshold_noise: NonNegative = Field(
        0.0,
        description="sd of the logarithm of the distance from reset to V_th, from spike to spike",
    )
    seed: Annotated[Whole, Field(ge=0, lt=2**63)] = Field(1, description="of spread and noise")

    @model_validator(mode="before")
    @classmethod
    def _with_constants_of_its_model(cls, values: Any) -> Any:
        """Give constants that are not set the values that belong to the model."""
        if not isinstance(values, dict):
            return values
        model = values.get("model")
        return {**_CONSTANTS.get(model if isinstance(model, str) else None, {}), **values}

    def shared_with(self, own: dict[str, Any]) -> dict[str, Any]:
        """Return what a population takes over: of another model, but the constants of the model."""
        values = self.model_dump()
        if own.get("model") in (None, self.model):
            return values
        of_models = {"model"}.union(*_CONSTANTS.values())
        return {key: value for key, value in values.items() if key not in of_models}

    @property
    def time_constant_s(self) -> float:
        """R C of the membrane."""
        return 1e-3 * self.resistance_GOhm * self.capacitance_pF


class Afferents(Section):
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
