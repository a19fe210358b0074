"""People: one study for many fingers, drawn from a given distribution, and its results."""

from typing import TYPE_CHECKING

from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.people.draw import Person, people
    from tactile_fem.people.ensemble import Ensemble, begin_people, collect_people, run_people

__all__ = ["Ensemble", "Person", "begin_people", "collect_people", "people", "run_people"]

# Its table of a study is imported with the study, on which the others build.
__getattr__ = lazily(
    __name__,
    {
        "draw": ["Person", "people"],
        "ensemble": ["Ensemble", "begin_people", "collect_people", "run_people"],
    },
)
