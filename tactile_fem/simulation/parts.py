"""A user's own parts of a scan, in place of those that the study states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from tactile_fem.finger import FingerMesh
from tactile_fem.neuron import Population
from tactile_fem.path import Path
from tactile_fem.runtime.fingerprint import fingerprint
from tactile_fem.stimulus import RigidBody

if TYPE_CHECKING:
    from tactile_fem.mechanics.terms.term import MakeTerm  # it needs DOLFINx
    from tactile_fem.tissue.energies import Law


@dataclass(frozen=True)
class Parts:
    """Your own parts of a scan; the others are made from the study.

    A checkpoint stores a hash of the code and values of these parts. The scan continues only with
    the same parts.

    Attributes
    ----------
    finger
        A mesh; needed on the first rank alone.
    laws
        Strain energies by the name of the tissue.
    body
        The stimulator.
    path
        Its motion.
    terms
        Make further terms of the virtual work, such as gravity, of the tissues.
    populations
        Afferents with another drive or transduction than a study can name, in place of the study's
        of the same name. They do not affect the mechanics and may change when a scan continues.
    """

    finger: FingerMesh | None = None
    laws: Mapping[str, Law] = field(default_factory=dict)
    body: RigidBody | None = None
    path: Path | None = None
    terms: tuple[MakeTerm, ...] = ()
    populations: tuple[Population, ...] = ()

    def identity(self) -> dict[str, str]:
        """Return the name of each own part of the mechanics and a hash of its code and values.

        Raises
        ------
        StudyError
            A part cannot be told from others.
        """
        return self._identity

    @cached_property
    def _identity(self) -> dict[str, str]:
        """As the parts were before they were used, which may change them."""
        parts: dict[str, object] = {f"law of {name}": law for name, law in self.laws.items()}
        if self.body is not None:
            parts["body"] = self.body
        if self.path is not None:
            parts["path"] = self.path
        parts |= {f"term {number}": term for number, term in enumerate(self.terms, 1)}
        return {
            name: f"{_name(part)} {fingerprint(part, f'parts: the {name}')}"
            for name, part in parts.items()
        }

    def listed(self) -> dict[str, str]:
        """Return all own parts, for ``run.json``: `identity`, finger, and names of populations."""
        found = self.identity()
        if self.finger is not None:
            found["finger"] = f"{_name(self.finger)} {self.finger.hash}"
        if self.populations:
            found["populations"] = ", ".join(population.name for population in self.populations)
        return found


def changed_part(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return in words the first part that is another than before, from their identities."""
    for name in {**before, **now}:
        then, here = (parts.get(name, "the study's") for parts in (before, now))
        # A script that is imported has another name.
        if then.split()[-1] != here.split()[-1]:
            return f"a {name} that was {then}, now it is {here}"
    return ""


NO_PARTS = Parts()


def _name(part: object) -> str:
    named = part if hasattr(part, "__qualname__") else type(part)
    return f"{named.__module__}.{named.__qualname__}"
