"""Contact mechanics of the finger, in UFL and PETSc."""

from typing import TYPE_CHECKING

from tactile_fem.runtime import backend
from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.mechanics.contact_law import ContactLaw
    from tactile_fem.mechanics.faults import stopping
    from tactile_fem.mechanics.problem import Problem
    from tactile_fem.mechanics.terms.contact import SkinPart
    from tactile_fem.mechanics.terms.inertia import mass_density, moment_of_inertia
    from tactile_fem.mechanics.terms.term import Delay

__all__ = [
    "ContactLaw",
    "Delay",
    "Problem",
    "SkinPart",
    "backend",
    "mass_density",
    "moment_of_inertia",
    "stopping",
]

__getattr__ = lazily(
    __name__,
    {
        "contact_law": ["ContactLaw"],
        "faults": ["stopping"],
        "problem": ["Problem"],
        "terms.contact": ["SkinPart"],
        "terms.inertia": ["mass_density", "moment_of_inertia"],
        "terms.term": ["Delay"],
    },
)
