"""The study: everything a scan is made from, with the paper's values as defaults.

"The paper" is Hamasaki et al. 2020, DOI 10.1177/1687814020984651. Descriptions say ``paper``
where a value stands in its text and ``proposed`` where this project chose it.
Lengths are mm, forces N, stresses MPa, times s, currents pA, potentials mV.
"""

from __future__ import annotations

from typing import Any

from pydantic import model_validator

from tactile_fem.study.base import Section
from tactile_fem.study.parts import (
    Finger,
    Neuron,
    Output,
    Receptors,
    Solver,
)
from tactile_fem.study.protocol import AnyPiece, Follow, Hold, Lift, Press, Protocol, Slide
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
    "TISSUE_SETS",
    "AnyPiece",
    "AnyStimulus",
    "Cylinder",
    "Dots",
    "Edge",
    "Elastic",
    "Finger",
    "Follow",
    "Grating",
    "Hold",
    "Lift",
    "Neuron",
    "Output",
    "Plate",
    "Polynomial",
    "Press",
    "Protocol",
    "Receptors",
    "Section",
    "Slide",
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
