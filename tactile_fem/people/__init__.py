"""People: one study for many fingers, drawn from a stated distribution, and what it gives."""

from tactile_fem.people.draw import Person, people
from tactile_fem.people.ensemble import Ensemble, run_people

__all__ = ["Ensemble", "Person", "people", "run_people"]
