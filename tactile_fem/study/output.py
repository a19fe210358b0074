"""What a scan writes."""

from __future__ import annotations

from pydantic import Field

from tactile_fem.runtime.settings import Positive, Settings


class Output(Settings):
    """What is written besides the receptors' histories."""

    fields_mm: Positive = Field(0.4, description="slide between two written fields (VTU)")
    states: bool = Field(
        False,
        strict=True,
        description="keep the state with each of them, for vibration there",
    )
    pictures: bool = Field(True, strict=True, description="draw the figures at the end")
