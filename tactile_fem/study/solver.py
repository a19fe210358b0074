"""Discretization of the contact, steps and solvers of a study."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from tactile_fem.runtime.own_code import Code
from tactile_fem.runtime.settings import NonNegative, Positive, Settings, Whole


def _option_value(value: Any) -> Any:
    if isinstance(value, str | int | float):
        return value
    raise PydanticCustomError("petsc_type", "no value of an option")


class Solver(Settings):
    """Discretization of the contact and control of the steps."""

    nitsche_gamma: Positive = Field(
        1.2,
        description="gamma_h = gamma (K + 4 G/3)/h of the deformed skin: small values are "
        "inaccurate, large ones slow",
    )
    nitsche_theta: Literal[-1, 0, 1] = Field(
        0, description="0 incomplete; 1 symmetric and -1 skew need a gamma of 40"
    )
    contact_width_MPa: NonNegative = Field(
        0.005, description="pressure over which contact is regularized; 0: not at all"
    )
    bulk_degree: Annotated[Whole, Field(ge=1, le=12)] = Field(
        4, description="quadrature degree; with 3 large elements can fold at sharp bends"
    )
    locking_ratio: Positive = Field(
        25.0,
        description="K/G of a tissue above which its volume change is integrated at centroids, "
        "to avoid locking; 1e9: never",
    )
    contact_degree: Annotated[Whole, Field(ge=1, le=30)] = Field(
        10, description="quadrature degree"
    )
    inertia: bool = Field(
        False,
        strict=True,
        description="include inertia (tissue.density_kg_m3), which matters for vibration above "
        "50 Hz; without it the finger is always in equilibrium",
    )
    terms: tuple[Code, ...] = Field(
        (),
        description='further terms of the virtual work, each "module:name": a subclass of Term in '
        "a Python file beside the study",
    )
    held: Annotated[tuple[Literal["bone", "nail", "cut"], ...], Field(min_length=1)] = Field(
        ("bone", "nail", "cut"), description="parts that are fixed; the others deform"
    )
    first_step_mm: Positive = Field(
        0.05, description="first step of a piece of the path towards the finger"
    )
    max_press_step_mm: Positive = Field(
        0.1,
        description="longest step towards the finger; longer ones can catch the skin on an edge",
    )
    first_slide_step_mm: Positive = Field(
        0.02,
        description="first step of a piece across the finger, in which slip begins everywhere",
    )
    max_slide_step_mm: Positive = Field(0.2, description="longest step across the finger")
    min_step_mm: Positive = Field(
        0.0005,
        description="a step that fails at this length ends the scan; shorter in proportion where "
        "the motion is slower than 20 mm/s",
    )
    tangent_iterations: Annotated[Whole, Field(ge=1)] = Field(
        5,
        description="Newton iterations after which the lagged tissue tangent is assembled anew; "
        "the contact tangent is never lagged",
    )
    compiler_flags: tuple[str, ...] = Field(
        ("-O3", "-march=native", "-ffast-math", "-fno-finite-math-only"),
        description="C flags for the compiled forms; an empty list keeps DOLFINx's",
    )
    linear: Literal["multigrid", "direct"] = Field(
        "multigrid",
        description="linear solver; direct (MUMPS), the default of ridged sections, needs much "
        "more time and memory for a solid finger",
    )
    petsc: dict[str, Annotated[str | int | float | bool, BeforeValidator(_option_value)]] = Field(
        default_factory=dict, description="PETSc options, without their prefix `-tactile_`"
    )

    def own_terms(self) -> list[Any]:
        """Return what makes the terms; StudyError if it is not found."""
        return [code.running("solver.terms: ")(code.load("solver.terms: ")) for code in self.terms]
