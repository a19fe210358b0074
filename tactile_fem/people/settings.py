"""How people's fingers differ, for an ensemble of them."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Annotated, Any, Self

from pydantic import Field, model_serializer, model_validator

from tactile_fem.runtime.settings import File, Finite, Positive, Settings, Whole

# Scores lie within so many standard deviations: all but one of a million people.
MOST_SD = 5.0

# Ratios at one standard deviation, of adults of both sexes; what has no source is proposed. Forces
# of measured people were not used to choose them; they are compared in demos/validation/people.py.
# - size: length of the index finger 63.9 (4.1) mm (Chatzioglou and Govsa 2024, 51 adults), 6.4 %;
#   hand breadths differ by 7 to 8 % (from memory). Layers of skin follow it.
# - thickness beyond that by size: of the stratum corneum 20 to 27 %, of the living epidermis 19 to
#   20 % between 71 people (Sandby-Moller et al. 2003, DOI 10.1080/00015550310015419; hairy skin, as
#   of the fingertip none was found). Dermis proposed.
# - pad's radius beyond that by size: proposed.
# - moduli of skin: shear waves in the skin of the finger of 90 people tell 30.3 kPa, for 95 % of
#   them 12.1 to 48.4 kPa (Yang, Wang ... Qiu; abstract), one sd of the logarithm being 1.42.
# - moduli of fat: proposed. Published ones go from 0.005 to 0.034 MPa (Gerling 2014, Maeno 1998).
# - friction: 0.78 (0.35) and 0.53 (0.21), 40 to 45 %, on wet smooth glass.
PRIORS = {
    "finger.size": 1.075,
    "finger.pad_radius_mm": 1.15,
    "finger.stratum_corneum": 1.25,
    "finger.epidermis": 1.2,
    "finger.dermis": 1.2,
    "skin": 1.4,
    "subcutaneous": 1.4,
    "stimulus.friction": 1.45,
}
# Of each population, under its name: proposed.
PRIORS_OF_NEURON = {"gain": 1.3, "threshold_mV": 1.1}


class Spread(Settings):
    """How a value differs between people; a number in place of the table is its factor.

    Of several values at once, such as ``skin``, it is that of their factor.
    """

    factor: Annotated[Finite, Field(gt=1)] | None = Field(
        None, description="ratio at one standard deviation of its normally distributed logarithm"
    )
    sd: Positive | None = Field(None, description="standard deviation about the study's value")
    low: Positive | None = Field(None, description="least of uniformly distributed values")
    high: Positive | None = Field(None, description="largest of them")

    @model_validator(mode="before")
    @classmethod
    def _of_number(cls, data: Any) -> Any:
        return {"factor": data} if isinstance(data, int | float | str) else data

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        given = {name for name, value in self if value is not None}
        if given not in ({"factor"}, {"sd"}, {"low", "high"}):
            raise ValueError("give a factor, or a table with factor, with sd, or with low and high")
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise ValueError(f"low is {self.low:g} but must be less than high, {self.high:g}")
        return self

    @model_serializer
    def _short(self) -> Any:
        given = {name: value for name, value in self if value is not None}
        return given.get("factor", given)

    def problem(self, value: float) -> str:
        """Return why a value above 0 cannot be spread so; empty if it can."""
        if self.sd is None or value > MOST_SD * self.sd:
            return ""
        return (
            f"sd = {self.sd:g} about {value:g} allows negative values within {MOST_SD:g} sd: give "
            f"less than {value / MOST_SD:.3g}, a factor, or low and high"
        )

    def log_ratio(self, score: float, value: float) -> float:
        """Return the logarithm of the ratio to a value at a standard score, within 5 sd."""
        if self.sd is not None:
            return math.log(1 + self.sd * score / value)
        if self.low is not None and self.high is not None:
            share = NormalDist().cdf(score)
            return math.log((self.low + (self.high - self.low) * share) / value)
        return math.log(self.factor or 1.0) * score


def _listed(priors: dict[str, float]) -> str:
    return ", ".join(f"{name} {factor:g}" for name, factor in priors.items())


class People(Settings):
    """How people's fingers differ; for `tactile-fem people`."""

    seed: Annotated[Whole, Field(ge=0)] = Field(1, description="of the random numbers")
    fixed: tuple[str, ...] = Field(
        (), description="names of values that do not vary; the others keep their draws"
    )
    fit: File | None = Field(
        None,
        description="posterior.json of a fit: its values and their correlations replace the "
        "shipped spread of the same values",
    )
    spread: dict[str, Spread] = Field(
        default_factory=dict,
        description="by name of a value, beside or instead of the shipped ones: "
        f"{_listed(PRIORS)}, and of each population, as SA1.gain, {_listed(PRIORS_OF_NEURON)}",
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        for name in self.fixed:
            if name in self.spread:
                raise ValueError(f"{name} has a spread but is fixed: leave one of them out")
        return self


def people_of(study: Any) -> People | None:
    """Return the table of a study; None if it has none."""
    return study.people
