"""Histories and numbers of a scan: means over time, largest values, counts of spikes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_fem.errors import StudyError
from tactile_fem.results.histories import central_receptor, mean_over
from tactile_fem.results.results import Results

Array = NDArray[np.float64]

_ROUNDING_S = 1e-12
_LOADS = ("normal", "tangential", "contact_area_mm2")


def numbers_of(results: Results) -> dict[str, int | float]:
    """Return cost and results of a scan: forces and SED of the slide, spikes, also by population.

    Forces and area are means over the time of the slide, which begins at the last step without
    displacement. Without a slide they are those of the step with the largest normal force, and SED
    and spikes are those of the whole path. Forces of a section are per width: their names end in
    ``N_per_mm``. The central receptor is that of the first population.
    """
    trace, spikes = results.trace, results.spikes
    sed, sliding = trace["sed_kPa"], spikes.time_s >= 0
    slid = np.flatnonzero(trace["displacement_mm"] > 0)
    if slid.size:
        slide = np.arange(max(slid[0] - 1, 0), len(sed))
        sed = sed[slide]
    else:
        slide, sliding = trace["force_N"][:, [2]].argmax(axis=0), np.isfinite(spikes.time_s)
    loads = np.column_stack([history(results, of) for of in _LOADS])[slide]
    means = mean_over(trace["time_s"][slide], loads).tolist()
    central = central_receptor(trace["receptors_mm"], trace["population"])
    by_name = {
        f"spikes_{afferents.name}": int((spikes.population[sliding] == afferents.name).sum())
        for afferents in results.study.afferents
    }
    unit = results.study.finger.force_unit.replace("/", "_per_")
    return {
        "steps": len(trace["time_s"]),
        "newton_iterations": int(trace["newton_iterations"].sum()),
        "wall_s": float(trace["wall_s"].sum()),
        f"pressed_{unit}": float(trace["force_N"][trace["time_s"] <= _ROUNDING_S][-1, 2]),
        f"normal_{unit}": means[0],
        f"tangential_{unit}": means[1],
        "contact_area_mm2": means[2],
        "largest_sed_kPa": float(sed.max()),
        "central_largest_sed_kPa": float(sed[:, central].max()),
        "spikes": int(sliding.sum()),
        "central_spikes": int((spikes.receptor[sliding] == central).sum()),
        **by_name,
    }


def history(results: Results, of: str) -> Array:
    """Return one number for each step, (steps,).

    ``normal`` and ``tangential`` are those of the force, ``central_sed_kPa`` that of the central
    receptor of the first population; other names are columns.

    Raises
    ------
    StudyError
        There is no such column with one number for each step.
    """
    trace = results.trace
    if of == "normal":
        return trace["force_N"][:, 2]
    if of == "tangential":
        return np.asarray(np.hypot(*trace["force_N"][:, :2].T))
    if of == "central_sed_kPa":
        return trace["sed_kPa"][:, central_receptor(trace["receptors_mm"], trace["population"])]
    if of not in trace or trace[of].shape != trace["time_s"].shape:
        raise StudyError(f"{results.folder} has no history {of} with one number for each step.")
    return trace[of]
