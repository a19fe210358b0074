"""People: one study for many fingers, drawn from a stated distribution, and what it gives."""

from tactile_fem.people.draw import Person, people
from tactile_fem.people.ensemble import Ensemble, begin_people, collect_people, run_people

__all__ = ["Ensemble", "Person", "begin_people", "collect_people", "people", "run_people"]
