"""The class of a study, and the tables that companions add to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

from pydantic import (
    BaseModel,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic.fields import FieldInfo

from tactile_fem import companions
from tactile_fem.errors import StudyError
from tactile_fem.finger import Finger, FingerMesh
from tactile_fem.finger.joint import Joint
from tactile_fem.neuron.settings import DEFAULT_NAME, Neuron
from tactile_fem.path import Protocol
from tactile_fem.receptors import Layout
from tactile_fem.receptors.settings import Receptors, misplaced
from tactile_fem.runtime import html
from tactile_fem.runtime.differences import brief, differences
from tactile_fem.runtime.own_code import Code
from tactile_fem.runtime.settings import Settings
from tactile_fem.stimulus import Stimulus, Text
from tactile_fem.study.afferents import Afferents, filled, given_keys
from tactile_fem.study.output import Output
from tactile_fem.study.solver import Solver
from tactile_fem.tissue.constants import Tissue

# Keys that the mechanics does not depend on, as pydantic excludes them.
AFTER_MECHANICS: dict[str, Any] = {
    **dict.fromkeys(companions.tables(), True),
    "neuron": True,
    "afferents": {"__all__": {"neuron", "feels"}},
}


class Study(Settings):
    """A complete, resolved study."""

    finger: Finger = Finger()
    joint: Joint | None = None
    tissue: Tissue = Tissue.model_validate({})
    stimulus: Stimulus = Text()
    protocol: Protocol = Protocol()
    receptors: Receptors = Receptors()
    neuron: Neuron = Neuron()
    afferents: tuple[Afferents, ...] = ()
    solver: Solver = Solver()
    output: Output = Output()

    @model_validator(mode="before")
    @classmethod
    def _defaults(cls, data: Any) -> Any:
        """Add the default kind of a stimulus, and what the finger states for other tables."""
        if not isinstance(data, dict):
            return data
        if isinstance(data.get("stimulus"), dict):
            data = {**data, "stimulus": {"kind": "text", **data["stimulus"]}}
        given = {name: given_keys(table) for name, table in data.items()}
        defaults = Finger.defaults_beside(given)
        usable = {name for name in defaults if isinstance(data.get(name, {}), dict | BaseModel)}
        return data | {name: defaults[name] | given.get(name, {}) for name in usable}

    @field_validator("afferents", mode="before")
    @classmethod
    def _filled(cls, entries: Any, info: ValidationInfo) -> Any:
        """Give each population the keys that it lacks of receptors and neuron of the study."""
        if not isinstance(entries, list | tuple):
            return entries
        names = {"receptors", "neuron"}
        shared = {name: value for name, value in info.data.items() if name in names}
        return [filled(entry, shared) for entry in entries]

    @field_validator("afferents")
    @classmethod
    def _named_once(cls, entries: tuple[Afferents, ...]) -> tuple[Afferents, ...]:
        names = [entry.name for entry in entries]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f'two populations have the name "{name}"')
        return entries

    @model_validator(mode="after")
    def _tables_agree(self, info: ValidationInfo) -> Self:
        problems = []
        if self.joint and self.finger.is_section:
            problems.append('finger.kind is "section" but must be "solid" with a joint')
        is_saved = info.context and info.context.get("saved")  # its drives may be a script's own
        for population in self.populations:
            problem = misplaced(population.receptors, self.finger.section_plane)
            problems += [f"{self.table_of(population)}{problem}"] if problem else []
            if self.afferents and not is_saved and not isinstance(population.feels, Code):
                try:
                    _ = population.population().drive
                except StudyError as error:
                    problems.append(str(error))
        if problems:
            raise ValueError("\n".join(problems))
        return self

    @model_serializer(mode="wrap")
    def _used(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        values = serialize(self)
        if not self.afferents:
            values.pop("afferents", None)
        return values

    @property
    def populations(self) -> tuple[Afferents, ...]:
        """The populations; without `afferents` the one of `receptors` and `neuron`."""
        one = Afferents(name=DEFAULT_NAME, receptors=self.receptors, neuron=self.neuron)
        return self.afferents or (one,)

    def table_of(self, afferents: Afferents) -> str:
        """Return the start of the keys of a population, empty without `afferents`."""
        return f"afferents.{afferents.name}." if self.afferents else ""

    def lay_out(self, finger: FingerMesh) -> Layout:
        """Place the receptors of all populations; raises StudyError if one cannot be placed."""
        layouts = []
        for afferents in self.populations:
            try:
                layouts.append(Layout.of(afferents.receptors, finger, afferents.name))
            except StudyError as error:
                raise StudyError(f"{self.table_of(afferents)}{error}") from None
        return Layout.joined(layouts)

    def _repr_html_(self) -> str:
        """Show in a notebook what differs from the default study, and where nothing does."""
        paper = Study()
        rows = [(key, brief(here), brief(there)) for key, here, there in differences(self, paper)]
        same = [name for name, value in self if value and value == getattr(paper, name)]
        parts = [html.table(["key", "value", "default"], rows)] if rows else []
        return html.section("Study", parts, f"As by default: {', '.join(same)}." if same else "")

    def files(self) -> dict[str, Path]:
        """Return the files that its tables name, by their keys."""
        names = ("finger", "tissue", "stimulus", "solver", "output", *companions.tables())
        tables = {name: getattr(self, name) for name in names}
        sections: dict[str, Settings] = {name: own for name, own in tables.items() if own}
        for number, piece in enumerate(self.protocol.pieces, 1):
            sections[f"protocol.path (entry {number})"] = piece
        sections |= {f"afferents.{one.name}": one for one in self.afferents}
        return {
            f"{name}.{key}": file
            for name, section in sections.items()
            for key, file in section.files().items()
        }


for _name, _table in companions.tables().items():
    Study.model_fields[_name] = FieldInfo(annotation=_table | None, default=None)
Study.model_rebuild(force=True)
companions.import_kinds()
