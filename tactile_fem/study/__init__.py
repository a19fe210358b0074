"""The study: all input of a scan, with the paper's values as defaults.

"The paper" is Hamasaki et al. 2020, DOI 10.1177/1687814020984651. In descriptions, ``paper``
marks values stated in its text and ``proposed`` values chosen by this project.
Lengths are mm, forces N, stresses MPa, times s, currents pA, potentials mV.
"""

from __future__ import annotations

from typing import Any

from pydantic import model_validator

from tactile_fem.study.base import Section
from tactile_fem.study.parts import (
    LONGEST_S,
    MOST_OUTPUTS,
    Finger,
    Neuron,
    Output,
    Protocol,
    Receptors,
    Solver,
)
from tactile_fem.study.stimulus import (
    AnyStimulus,
    Cylinder,
    Dots,
    Edge,
    Grating,
    Plate,
    Sphere,
    Stimulus,
    Text,
)
from tactile_fem.study.tissue import TISSUE_SETS, Elastic, Polynomial, Tissue

__all__ = [
    "LONGEST_S",
    "MOST_OUTPUTS",
    "TISSUE_SETS",
    "AnyStimulus",
    "Cylinder",
    "Dots",
    "Edge",
    "Elastic",
    "Finger",
    "Grating",
    "Neuron",
    "Output",
    "Plate",
    "Polynomial",
    "Protocol",
    "Receptors",
    "Section",
    "Solver",
    "Sphere",
    "Stimulus",
    "Study",
    "Text",
    "Tissue",
]


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
