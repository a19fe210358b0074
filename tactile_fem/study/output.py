"""What a scan writes."""

from __future__ import annotations

from pydantic import AliasChoices, Field

from tactile_fem.path.recording import Frame
from tactile_fem.runtime.settings import File, Positive, Settings


class Output(Settings):
    """What is written besides the receptors' histories."""

    states_mm: Positive = Field(
        0.4,
        validation_alias=AliasChoices("states_mm", "fields_mm"),  # its former name
        description="way of the body, down, across or, at 5 mm from its axis, around, between two "
        "states whose fields are kept",
    )
    restarts: bool = Field(
        False,
        strict=True,
        validation_alias=AliasChoices("restarts", "states"),
        description="keep with each of them all that a restart needs, for vibration there",
    )
    pictures: bool = Field(True, strict=True, description="draw the figures at the end")
    measured: File | None = Field(
        None,
        description="a CSV file with columns as of a piece follow, which is compared with the scan "
        "in all that the path does not take from it",
    )
    measured_frame: Frame | None = Field(None, description="moves to contact_s, if not followed")
