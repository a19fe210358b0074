"""A user's own parts of a scan, in place of those that the study states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.finger import TISSUES, FingerMesh
from tactile_fem.neuron import Population, fields_of
from tactile_fem.neuron.fields import trial_histories
from tactile_fem.path import Path
from tactile_fem.simulation.fingerprint import fingerprint
from tactile_fem.stimulus import RigidBody
from tactile_fem.stimulus.check import check_body, check_lipschitz
from tactile_fem.study import Tissue

if TYPE_CHECKING:
    from tactile_fem.mechanics.terms.term import MakeTerm  # it needs DOLFINx
    from tactile_fem.tissue.energies import Law

# Where laws are tried: small deformations of either sign.
_DEFORMATIONS = (
    np.eye(3),
    np.array([[1.02, 0.05, 0.0], [0.0, 0.97, 0.01], [0.0, 0.0, 1.01]]),
    np.array([[0.95, 0.0, 0.02], [0.03, 1.04, 0.0], [0.0, -0.04, 1.02]]),
)


@dataclass(frozen=True)
class Parts:
    """Own parts of a scan; what is not given is made from the study.

    A checkpoint stores which parts were own ones and a hash of their code and values. The scan
    continues only with parts that are the same.

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
        of the same name; no part of the mechanics, so a scan may go on with others.
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


def check_parts(parts: Parts, of_study: Tissue) -> None:
    """Try own parts before any long work; raise StudyError for one that cannot be used.

    Laws have to suit the tissues of the study, some of which relax.
    """
    parts.identity()
    for tissue, law in parts.laws.items():
        if tissue not in TISSUES:
            raise StudyError(f'parts.laws: "{tissue}" is no tissue; allowed: {", ".join(TISSUES)}.')
        energies = [_energy(law, F) for F in _DEFORMATIONS]
        if not np.isfinite(energies).all():
            raise StudyError(f"parts.laws: the energy of {tissue} is not finite at a small strain.")
        if getattr(of_study, tissue).g and not hasattr(law, "in_shear"):
            raise StudyError(
                f"parts.laws: {tissue} relaxes (tissue.{tissue}.g), so its law needs a method "
                "in_shear(a, X), its energy in the simple shear gamma^2 = a."
            )
    if parts.body is not None:
        check_body(parts.body, "parts.body")
        check_lipschitz(parts.body, "parts.body")
    if parts.path is not None:
        if not parts.path.pieces:
            raise StudyError("parts.path: it has no pieces but needs one or more.")
        parts.path.check()
    for population in parts.populations:
        trial = trial_histories(fields_of([population]))
        population.fire({**trial, "receptors_mm": np.zeros((1, 3))})


def _energy(law: Law, F: np.ndarray) -> float:
    """Return the energy density of a law at a deformation gradient, (3, 3)."""
    import ufl  # takes a while

    origin = ufl.as_vector([0.0, 0.0, 0.0])
    return float(law.energy(ufl.as_matrix(F.tolist()), origin)(()))


def _name(part: object) -> str:
    named = part if hasattr(part, "__qualname__") else type(part)
    return f"{named.__module__}.{named.__qualname__}"
