"""What a scan writes."""

from __future__ import annotations

from typing import Any

from pydantic import Field, ValidationInfo, model_validator

from tactile_fem.path.recording import Frame
from tactile_fem.runtime.settings import File, Positive, Settings
from tactile_fem.runtime.version import renamed

_FORMER = {"fields_mm": "states_mm", "states": "restarts"}


class Output(Settings):
    """What is written besides the receptors' histories."""

    states_mm: Positive = Field(
        0.4,
        description="way of the body, down, across or, at 5 mm from its axis, around, between two "
        "states whose fields are kept",
    )
    restarts: bool = Field(
        False,
        strict=True,
        description="keep with each of them all that a restart needs, for vibration there",
    )
    pictures: bool = Field(True, strict=True, description="draw the figures at the end")
    measured: File | None = Field(
        None,
        description="a CSV file with columns as of a piece follow, which is compared with the scan "
        "in all that the path does not take from it",
    )
    measured_frame: Frame | None = Field(None, description="moves to contact_s, if not followed")

    @model_validator(mode="before")
    @classmethod
    def _has_present_keys(cls, table: Any, info: ValidationInfo) -> Any:
        is_saved = (info.context or {}).get("saved", False)  # in results nobody writes it anew
        return renamed(table, _FORMER, "output", warns=not is_saved)
