"""The scans of a series as a table, for an engine or a scheduler that runs them elsewhere."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Sequence
from pathlib import Path

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import FingerMesh
from tactile_fem.runtime.files import write_table, write_text
from tactile_fem.series.members import Member
from tactile_fem.series.run import begin_series
from tactile_fem.simulation.checks import deepest_mm
from tactile_fem.simulation.estimate import Cost, estimate
from tactile_fem.study import Study

LIST, COMMAND, SNAKEFILE = "scans.csv", "series.json", "Snakefile"
_ENGINE = Path(__file__).parent / SNAKEFILE


def write_list(
    members: Sequence[Member], folder: Path | str, *, ranks: int = 1, words: Sequence[str] = ()
) -> Path:
    """Write the study files of a series and ``scans.csv``; nothing runs.

    A row of the table has the name of a scan, its study file, ranks, estimated minutes and memory
    in MB. ``tactile-fem scan STUDY --results NAME``, in the folder, runs it.

    Parameters
    ----------
    members
        The scans.
    folder
        Folder of the series.
    ranks
        Ranks of each scan.
    words
        The command that made the list, for ``series.json``.

    Returns
    -------
    file
        The table.

    Raises
    ------
    StudyError
        Bad input, or the folder contains another series.
    """
    folder = Path(folder)
    begin_series(members, folder)
    costs = _Costs(ranks)
    rows = []
    for member in members:
        cost = costs.of(member.study)
        row = {"name": member.name, "study": f"{member.name}.toml", "ranks": ranks}
        row["minutes"] = math.ceil(cost.wall_s / 60)
        rows.append({**row, "memory_MB": math.ceil(cost.memory_MB)})
    write_text(folder / COMMAND, json.dumps({"folder": str(Path.cwd()), "words": list(words)}))
    write_table(folder / LIST, rows)
    return folder / LIST


class _Costs:
    """Estimates, for which one finger of each fineness is meshed."""

    def __init__(self, ranks: int) -> None:
        self._ranks, self._meshes = ranks, dict[str, FingerMesh]()

    def of(self, study: Study) -> Cost:
        keys = {"kind", "preset", "mesh_file", "pad_size_mm", "far_size_mm"}
        fineness = study.finger.model_dump_json(include=keys)
        mesh = self._meshes.get(fineness) or study.finger.mesh()
        self._meshes[fineness] = mesh
        path = study.protocol.route(deepest_mm(study, mesh.pad_thickness_mm))
        return estimate(study, path, mesh.nodes.size, self._ranks)


def write_snakefile(folder: Path | str) -> Path:
    """Put the Snakefile that runs a list beside it, unless one is there; return its path.

    Raises
    ------
    StudyError
        There is no list in the folder.
    """
    folder = Path(folder)
    if not (folder / LIST).is_file():
        raise StudyError(
            f"{folder} holds no {LIST}: write it first, with --list and the command of the series."
        )
    if not (folder / SNAKEFILE).exists():
        shutil.copyfile(_ENGINE, folder / SNAKEFILE)
    return folder / SNAKEFILE
