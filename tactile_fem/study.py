"""The study: everything a scan is made from, with the paper's values as defaults.

"The paper" is Hamasaki et al. 2020, DOI 10.1177/1687814020984651. Descriptions say ``paper``
where a value stands in its text and ``proposed`` where this project chose it.
Lengths are mm, forces N, stresses MPa, times s, currents pA, potentials mV.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

# Strict: a number is a number, never text such as "0.2 mm" nor true or false.
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]
Whole = Annotated[int, Field(strict=True)]


MOST_OUTPUTS = 100_000
LONGEST_S = 100_000.0


class Section(BaseModel):
    """A frozen group of values that refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)


# --- finger ------------------------------------------------------------------------------------


class Finger(Section):
    """Shape of the fingertip and of its mesh."""

    preset: Literal["coarse", "medium", "paper"] = Field(
        "coarse", description="mesh size: coarse, medium or paper (81,000 tetrahedra)"
    )
    mesh_file: Path | None = Field(
        None, description="a .msh file with the package's tags; replaces the parametric finger"
    )
    half_width_mm: Positive = Field(8.0, description="proposed: half the finger's width (X)")
    palmar_height_mm: Positive = Field(8.0, description="proposed: axis to pad")
    dorsal_height_mm: Positive = Field(5.5, description="proposed: axis to nail side")
    tip_length_mm: Positive = Field(11.0, description="proposed: length of the rounded tip (Y)")
    straight_length_mm: Positive = Field(14.0, description="proposed: proximal of the rounded tip")
    contact_from_tip_mm: Positive = Field(12.0, description="proposed: tip to contact point")
    pad_radius_mm: Positive = Field(
        18.0, description="proposed: radius of the pad's contour along the finger"
    )
    stratum_corneum_mm: Positive = Field(0.17, description="paper: layer thickness")
    epidermis_mm: Positive = Field(0.65, description="paper: layer thickness")
    dermis_mm: Positive = Field(0.8, description="paper: layer thickness")
    subcutaneous_mm: Positive = Field(
        3.68,
        description="proposed: dermis to bone under the contact point; the paper's nominal 0.7 "
        "leaves too little tissue for its own indentation",
    )
    bone_half_width_mm: Positive = Field(4.0, description="proposed")
    bone_half_height_mm: Positive = Field(2.3, description="proposed")
    bone_tip_gap_mm: Positive = Field(6.0, description="proposed: end of the bone to fingertip")
    nail_thickness_mm: Positive = Field(0.5, description="proposed")
    nail_width_mm: Positive = Field(11.0, description="proposed")
    nail_length_mm: Positive = Field(12.0, description="proposed")
    pad_size_mm: Annotated[Finite, Field(ge=0.05)] | None = Field(
        None, description="element edge under the contact patch; default by preset"
    )
    far_size_mm: Annotated[Finite, Field(ge=0.05)] | None = Field(
        None, description="element edge away from the contact patch; default by preset"
    )
    epidermis_rows: Annotated[Whole, Field(ge=1, le=8)] | None = Field(
        None, description="rows of elements through the epidermis; default by preset"
    )

    @property
    def pad_thickness_mm(self) -> float:
        """Skin surface to bone under the contact point."""
        return self.stratum_corneum_mm + self.epidermis_mm + self.dermis_mm + self.subcutaneous_mm


# --- tissue ------------------------------------------------------------------------------------


class Polynomial(Section):
    """Polynomial energy of order two, with the cubic term of Yeoh; neo-Hookean with C10 alone."""

    C10_MPa: Positive = Field(description="of (I1bar - 3)")
    C01_MPa: Finite = Field(0.0, description="of (I2bar - 3)")
    C20_MPa: Finite = Field(0.0, description="of (I1bar - 3)^2")
    C11_MPa: Finite = Field(0.0, description="of (I1bar - 3)(I2bar - 3)")
    C02_MPa: Finite = Field(0.0, description="of (I2bar - 3)^2")
    C30_MPa: Finite = Field(0.0, description="of (I1bar - 3)^3")
    D1_per_MPa: Positive = Field(description="2/K, of (J - 1)^2 / D1")
    D2_per_MPa: Positive | None = Field(None, description="of (J - 1)^4 / D2; default without it")

    @property
    def is_neo_hookean(self) -> bool:
        """Whether C10 and D1 say all."""
        higher = (self.C01_MPa, self.C20_MPa, self.C11_MPa, self.C02_MPa, self.C30_MPa)
        return not any(higher) and self.D2_per_MPa is None

    @model_validator(mode="after")
    def _resists_shear(self) -> Self:
        if self.C10_MPa + self.C01_MPa <= 0:
            raise ValueError(
                f"C10_MPa + C01_MPa is {self.C10_MPa + self.C01_MPa:g} but must be greater than 0, "
                "being half the shear modulus"
            )
        return self


class Elastic(Section):
    """Linear elastic constants of bone and nail (St. Venant-Kirchhoff at finite rotation)."""

    E_MPa: Positive = Field(description="Young's modulus")
    nu: Annotated[Finite, Field(gt=-1.0, lt=0.5)] = Field(description="Poisson's ratio")


def _neo_hookean(E_MPa: float, nu: float = 0.48) -> dict[str, float]:
    """Return C10 = G/2 and D1 = 2/K of a neo-Hookean tissue."""
    return {
        "C10_MPa": E_MPa / (4 * (1 + nu)),
        "D1_per_MPa": 6 * (1 - 2 * nu) / E_MPa,
    }


_DERMIS = {"C10_MPa": 0.01351, "C20_MPa": 0.010, "D1_per_MPa": 3.0}
# The paper's outer layers are neo-Hookean. C30 acts where they are stretched or squeezed by tens
# of percent, as friction of 1 does; with 0.3 it changes SED by less than 0.5 %.
_CORNEUM = {"C10_MPa": 0.0845, "C30_MPa": 0.4225, "D1_per_MPa": 0.48}
_EPIDERMIS = {"C10_MPa": 0.02297, "C30_MPa": 0.006, "D1_per_MPa": 1.765}
_BONE = {"E_MPa": 17_000.0, "nu": 0.3}
_NAIL = {"E_MPa": 170.0, "nu": 0.3}

TISSUE_SETS: dict[str, dict[str, dict[str, float]]] = {
    # C10 and C20 of the subcutaneous tissue: demos/validation/fit_tissue.py, on the force that
    # measured finger pads take from a flat plate; D1 of 5 kPa and nu 0.48; the rest as below.
    "fitted": {
        "stratum_corneum": _CORNEUM,
        "epidermis": _EPIDERMIS,
        "dermis": _DERMIS,
        "subcutaneous": {"C10_MPa": 1.1e-4, "C20_MPa": 8.95e-4, "D1_per_MPa": 48.0},
        "bone": _BONE,
        "nail": _NAIL,
    },
    # Proposed: chosen by hand after the same forces.
    "proposed": {
        "stratum_corneum": _CORNEUM,
        "epidermis": _EPIDERMIS,
        "dermis": _DERMIS,
        "subcutaneous": {"C10_MPa": 4.22e-4, "C20_MPa": 3.0e-4, "D1_per_MPa": 96.0},
        "bone": _BONE,
        "nail": _NAIL,
    },
    # Maeno et al. 1998; stratum corneum as above.
    "maeno1998": {
        "stratum_corneum": _neo_hookean(1.0),
        "epidermis": _neo_hookean(0.136),
        "dermis": _neo_hookean(0.080),
        "subcutaneous": _neo_hookean(0.034),
        "bone": _BONE,
        "nail": _NAIL,
    },
    # Gerling et al. 2014: shear moduli; its epidermis includes the stratum corneum.
    "gerling2014": {
        "stratum_corneum": _neo_hookean(1.212 * 2 * 1.48),
        "epidermis": _neo_hookean(1.212 * 2 * 1.48),
        "dermis": _neo_hookean(0.0507 * 2 * 1.48),
        "subcutaneous": _neo_hookean(0.00237 * 2 * 1.48),
        "bone": _BONE,
        "nail": _NAIL,
    },
}


class Tissue(Section):
    """Constants of the tissues; a table left out is taken from the named set."""

    set: Literal["fitted", "proposed", "maeno1998", "gerling2014"] = Field(
        "fitted", description="constants of the tissues that are not given below"
    )
    viscous_time_s: NonNegative = Field(
        0.004,
        description="Kelvin-Voigt time, the shortest relaxation time of measured finger pads "
        "(Pawluk and Howe 1999, DOI 10.1115/1.2835100); steadies the solver; 0 is elastic",
    )
    stratum_corneum: Polynomial
    epidermis: Polynomial
    dermis: Polynomial
    subcutaneous: Polynomial
    bone: Elastic
    nail: Elastic

    @model_validator(mode="before")
    @classmethod
    def _fill_from_set(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        name = data.get("set", "fitted")
        known = isinstance(name, str) and name in TISSUE_SETS
        constants = TISSUE_SETS[name if known else "fitted"]
        filled = dict(data)
        for tissue, values in constants.items():
            given = data.get(tissue, {})
            filled[tissue] = {**values, **given} if isinstance(given, dict) else given
        return filled


# --- stimulus ----------------------------------------------------------------------------------


class Stimulus(Section):
    """What every rigid body has; it translates along the protocol without turning."""

    friction: NonNegative = Field(0.3, description="paper: Coulomb friction (nylon)")
    shift_mm: tuple[Finite, Finite] = Field(
        (0.0, 0.0), description="shift of the body across (X) and along (Y) the finger"
    )


class Text(Stimulus):
    """Embossed letters on a plate."""

    kind: Literal["text"] = "text"
    text: Annotated[str, Field(min_length=1, max_length=40)] = Field(
        "FGH", description="paper: letters in the order in which they pass the receptor"
    )
    font: str = Field("DejaVu Sans", description="proposed: font family or path of a font file")
    g_width_mm: Annotated[Positive, Field(le=100)] = Field(
        6.5, description="paper: width of the letter G, sets the scale"
    )
    pitch_mm: Positive = Field(10.0, description="paper: centre to centre")
    relief_mm: Positive = Field(0.6, description="paper: height of the letters")
    corner_radius_mm: Positive = Field(0.3, description="proposed: least radius of the outline")
    fillet_radius_mm: Positive = Field(0.3, description="proposed: radius of the top edge")
    start_mm: Finite | None = Field(
        None,
        description="place of the text over the contact point at displacement 0, from the first "
        "letter's centre; default half way to the second letter (single letter: half a pitch "
        "before it)",
    )


class Plate(Stimulus):
    """A flat plate."""

    kind: Literal["plate"] = "plate"


class Cylinder(Stimulus):
    """A cylindrical bar lying in the horizontal plane."""

    kind: Literal["cylinder"] = "cylinder"
    radius_mm: Positive = Field(1.585, description="half of 3.17 mm, a usual test bar")
    along: Literal["x", "y"] = Field("x", description="axis of the bar: across or along the finger")


class Sphere(Stimulus):
    """A ball."""

    kind: Literal["sphere"] = "sphere"
    radius_mm: Positive = Field(3.0, description="of the ball")


class Edge(Stimulus):
    """A wedge with a rounded ridge, for the sharp-edge test."""

    kind: Literal["edge"] = "edge"
    radius_mm: Positive = Field(0.025, description="paper: radius of the ridge")
    angle_deg: Annotated[Finite, Field(gt=0, lt=180)] = Field(60.0, description="opening angle")
    along: Literal["x", "y"] = Field("x", description="the ridge: across or along the finger")


class Grating(Stimulus):
    """Parallel rectangular ridges with rounded edges on a plate."""

    kind: Literal["grating"] = "grating"
    ridge_mm: Positive = Field(1.0, description="width of a ridge")
    groove_mm: Positive = Field(1.0, description="width of a groove")
    relief_mm: Positive = Field(0.6, description="height of the ridges")
    fillet_radius_mm: Positive = Field(0.2, description="radius of the top edges")
    count: Annotated[Whole, Field(ge=1, le=200)] = Field(9, description="number of ridges")
    along: Literal["x", "y"] = Field("x", description="direction of the ridges")


class Dots(Stimulus):
    """A rectangular array of round, flat-topped, filleted dots on a plate."""

    kind: Literal["dots"] = "dots"
    radius_mm: Positive = Field(0.7, description="radius of a dot")
    spacing_mm: Positive = Field(3.0, description="centre to centre, both ways")
    relief_mm: Positive = Field(0.6, description="height of the dots")
    fillet_radius_mm: Positive = Field(0.2, description="radius of the top edge")
    columns: Annotated[Whole, Field(ge=1, le=100)] = Field(3, description="across the finger (X)")
    rows: Annotated[Whole, Field(ge=1, le=100)] = Field(7, description="along the finger (Y)")


AnyStimulus = Annotated[
    Text | Plate | Cylinder | Sphere | Edge | Grating | Dots, Field(discriminator="kind")
]

# --- protocol, receptors, neuron, solver, output -----------------------------------------------


class Protocol(Section):
    """Press, then slide towards the palm (-Y), the bone being fixed."""

    depth_mm: Positive = Field(
        1.97, description="paper: indentation of the undeformed pad's lowest point"
    )
    force_N: Positive | None = Field(
        None, description="press to this normal force instead of to depth_mm (paper: 0.6)"
    )
    press_speed_mm_s: Positive = Field(20.0, description="proposed: speed of the indentation")
    speed_mm_s: Positive = Field(20.0, description="paper: speed of the slide")
    distance_mm: NonNegative = Field(10.0, description="paper: length of the slide")
    output_mm: Positive = Field(0.1, description="slide positions that are hit exactly")

    @model_validator(mode="after")
    def _comes_to_an_end(self) -> Self:
        if self.distance_mm / self.output_mm > MOST_OUTPUTS:
            raise ValueError(
                f"distance_mm = {self.distance_mm:g} holds more than {MOST_OUTPUTS:,} times "
                f"output_mm = {self.output_mm:g}"
            )
        lasts_s = self.depth_mm / self.press_speed_mm_s + self.distance_mm / self.speed_mm_s
        if lasts_s > LONGEST_S:
            raise ValueError(f"it lasts {lasts_s:g} s at these speeds, more than {LONGEST_S:,.0f}")
        return self


class Receptors(Section):
    """SA1 end organs on the epidermis-dermis interface."""

    placement: Literal["line", "grid", "random", "afferents"] = Field(
        "line",
        description="paper: a line across the finger; or a grid, at random, or by density on the "
        "interface with distance kept, as afferents lie",
    )
    half_width_mm: NonNegative = Field(5.0, description="extent across the finger (X)")
    half_length_mm: NonNegative = Field(4.0, description="extent along (Y), not of the line")
    spacing_mm: Positive = Field(0.2, description="of line and grid; paper's shift per pass")
    density_per_cm2: Positive = Field(70.0, description="of random and afferents: SA1 afferents")
    seed: Annotated[Whole, Field(ge=0)] = Field(1, description="of random and afferents")
    extra_mm: tuple[tuple[Finite, Finite], ...] = Field(
        (), description="further receptors: pairs X, Y"
    )
    side: Literal["epidermis", "dermis"] = Field(
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


class Neuron(Section):
    """Transduction current and leaky integrate-and-fire membrane."""

    model: Literal["hamasaki2020", "gerling2018"] = Field(
        "hamasaki2020", description="transduction: alpha, kappa, beta; or the generator function"
    )
    # alpha and beta: demos/neurons/fit_bar.py, on rates that Phillips and Johnson (1981) measured
    # under a bar; kappa and tau_a stayed as here in that fit.
    static_gain_pA_per_kPa: NonNegative = Field(
        113.0, description="alpha; fitted to rates under a bar (Phillips and Johnson 1981)"
    )
    dynamic_gain_pA_s_per_kPa: NonNegative = Field(
        17.2, description="beta; fitted to rates under a bar (Phillips and Johnson 1981)"
    )
    adaptation: Annotated[Finite, Field(ge=0, le=1)] = Field(0.45, description="kappa; proposed")
    adaptation_time_s: Positive = Field(0.5, description="tau_a; proposed")
    intercept_pA: Finite | None = Field(
        None,
        description="I_0 while S > 0; default is the rheobase V_th/R, 0 for gerling2018",
    )
    generator_gains_pA_per_kPa: tuple[NonNegative, NonNegative, NonNegative, NonNegative] = Field(
        (100.0, 50.0, 25.0, 50.0),
        description="gerling2018: k_i of the parts, the last does not inactivate; proposed",
    )
    generator_times_s: tuple[Positive, Positive, Positive] = Field(
        (0.008, 0.2, 1.745), description="gerling2018: tau_i; Gerling 2018"
    )
    capacitance_pF: Positive = Field(30.0, description="C; after Gerling 2018's public constants")
    resistance_GOhm: Positive = Field(1.667, description="R; after Gerling 2018's constants")
    threshold_mV: Positive = Field(30.0, description="V_th; after Gerling 2018's constants")
    refractory_s: NonNegative = Field(0.001, description="t_ref; after Gerling 2018's constants")
    gain_spread: NonNegative = Field(
        0.0, description="sd of the logarithm of the gains between afferents"
    )
    threshold_noise: NonNegative = Field(
        0.0, description="sd of the logarithm of V_th from spike to spike"
    )
    seed: Annotated[Whole, Field(ge=0, lt=2**63)] = Field(1, description="of spread and noise")


class Solver(Section):
    """Discretization of the contact and control of the steps."""

    nitsche_gamma: Positive = Field(
        1.2,
        description="gamma_h = gamma (K + 4 G/3)/h of the skin as it is: too little is "
        "inexact, much slow",
    )
    nitsche_theta: Literal[-1, 0, 1] = Field(
        0, description="0 incomplete, the robust one; 1 symmetric, -1 skew"
    )
    contact_width_MPa: NonNegative = Field(
        0.005, description="pressure over which contact sets in smoothly; 0 is a kink"
    )
    bulk_degree: Annotated[Whole, Field(ge=1, le=12)] = Field(3, description="quadrature degree")
    contact_degree: Annotated[Whole, Field(ge=1, le=30)] = Field(
        10, description="quadrature degree"
    )
    held: Annotated[tuple[Literal["bone", "nail", "cut"], ...], Field(min_length=1)] = Field(
        ("bone", "nail", "cut"), description="parts that are fixed; the others deform"
    )
    first_step_mm: Positive = Field(0.05, description="first step of the press")
    max_press_step_mm: Positive = Field(
        0.1, description="longest step of the press; longer ones can catch the skin on an edge"
    )
    first_slide_step_mm: Positive = Field(
        0.02, description="first step of the slide: stick turns to slip everywhere"
    )
    max_slide_step_mm: Positive = Field(0.2, description="longest step of the slide")
    min_step_mm: Positive = Field(0.0005, description="a step that fails at this length ends it")
    compiler_flags: tuple[str, ...] = Field(
        ("-O3", "-march=native", "-ffast-math", "-fno-finite-math-only"),
        description="C flags for the compiled forms; none leaves DOLFINx's own",
    )
    linear: Literal["multigrid", "direct"] = Field(
        "multigrid", description="linear solver; direct (MUMPS) needs much more time and memory"
    )
    petsc: dict[str, str | int | float | bool] = Field(
        default_factory=dict, description="PETSc options without the prefix tactile_"
    )


class Output(Section):
    """What is written besides the receptors' histories."""

    fields_mm: Positive = Field(0.4, description="slide between two written fields (VTU)")
    pictures: bool = Field(True, strict=True, description="draw the figures at the end")


class Study(Section):
    """A complete, resolved study."""

    finger: Finger = Finger()
    tissue: Tissue = Tissue.model_validate({})
    stimulus: AnyStimulus = Text()
    protocol: Protocol = Protocol()
    receptors: Receptors = Receptors()
    neuron: Neuron = Neuron()
    solver: Solver = Solver()
    output: Output = Output()

    @model_validator(mode="before")
    @classmethod
    def _default_kind(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("stimulus"), dict):
            return {**data, "stimulus": {"kind": "text", **data["stimulus"]}}
        return data
