"""What the sections of a study have to agree on, beyond what each of them allows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from tactile_fem.errors import StudyError
from tactile_fem.receptors.settings import misplaced

if TYPE_CHECKING:
    from tactile_fem.study import Study


def disagreements(study: Study, *, saved: bool) -> Iterator[str]:
    """Yield a half sentence for each way in which the sections do not go together.

    Parameters
    ----------
    saved
        It is that of a scan's results, whose drives may be a script's own.
    """
    for population in study.populations:
        name = study.table_of(population)
        problem = misplaced(population.receptors, study.finger.section_plane)
        if problem:
            yield f"{name}{problem}"
        if study.afferents and not saved:
            try:
                _ = population.population().drive
            except StudyError as error:
                yield str(error)
