"""Summary of a series: one row of numbers for each scan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactile_fem.output.extrema import central_receptor
from tactile_fem.runtime.files import write_records
from tactile_fem.scan.results import Results
from tactile_fem.series.members import Member
from tactile_fem.series.run import folder_of, is_complete


def write_summary(members: Sequence[Member], folder: Path | str) -> Path:
    """Write ``summary.csv``: values, status and numbers of each scan; return its path."""
    folder = Path(folder)
    rows = [
        {"scan": member.name, **member.values, **_numbers(member, folder)} for member in members
    ]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    path = folder / "summary.csv"
    write_records(path, [{name: row.get(name, "") for name in columns} for row in rows])
    return path


def _numbers(member: Member, folder: Path) -> dict[str, Any]:
    """Return the numbers of a scan; only its status if it is not complete."""
    if not is_complete(member, folder):
        return {"status": "not complete"}
    numbers = numbers_of(Results.open(folder_of(member, folder)))
    short = {k: float(f"{v:.5g}") if isinstance(v, float) else v for k, v in numbers.items()}
    return {"status": "complete", **short, "wall_s": round(numbers["wall_s"], 1)}


def numbers_of(results: Results) -> dict[str, int | float]:
    """Return cost and results of a scan: forces and SED of the slide, spikes, also by population.

    Forces are averaged over the steps of the slide; without a slide the last step is used.
    """
    trace, spikes = results.trace, results.spikes
    slide = trace["displacement_mm"] > 0
    if not slide.any():
        slide[-1] = True
    force, sed = trace["force_N"][slide], trace["sed_kPa"][slide]
    central = central_receptor(trace["receptors_mm"])
    sliding = spikes.time_s >= 0
    by_name = {
        f"spikes_{afferents.name}": int((spikes.population[sliding] == afferents.name).sum())
        for afferents in results.study.afferents
    }
    return {
        "steps": len(trace["time_s"]),
        "newton_iterations": int(trace["newton_iterations"].sum()),
        "wall_s": float(trace["wall_s"].sum()),
        "pressed_N": float(trace["force_N"][np.argmax(trace["depth_mm"]), 2]),
        "normal_N": float(force[:, 2].mean()),
        "tangential_N": float(np.hypot(force[:, 0], force[:, 1]).mean()),
        "largest_sed_kPa": float(sed.max()),
        "central_largest_sed_kPa": float(sed[:, central].max()),
        "spikes": int(sliding.sum()),
        "central_spikes": int((spikes.receptor[sliding] == central).sum()),
        **by_name,
    }
