"""Tables of an ensemble for other programs: bands of histories, and of the spikes at each place."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem import Results
from tactile_fem.neuron import Response
from tactile_fem.people.bands import Bands, bands, covered
from tactile_fem.people.ensemble import Ensemble
from tactile_fem.results import central_receptor

Array = NDArray[np.float64]

# Standard deviation of the Gaussian that spreads a spike.
_WINDOW_S = 0.01


def history_rows(ensemble: Ensemble) -> list[dict[str, Any]]:
    """Return a row for each condition, history and time: median and bands of the complete people.

    Histories are the forces, the contact area, and the SED and firing rate of the central receptor.

    Raises
    ------
    StudyError
        Nobody is complete.
    """
    unit = ensemble.results()[0].study.finger.force_unit.replace("/", "_per_")
    histories = {
        f"normal_{unit}": "normal",
        f"tangential_{unit}": "tangential",
        "contact_area_mm2": "contact_area_mm2",
        "central_sed_kPa": "central_sed_kPa",
    }
    rows: list[dict[str, Any]] = []
    for condition in ensemble.conditions:
        found = {name: ensemble.history(condition, of) for name, of in histories.items()}
        time_s, _ = found[f"normal_{unit}"]
        rates = [_central_rate_Hz(scan, time_s) for scan in ensemble.results(condition)]
        found["central_rate_Hz"] = time_s, np.array(rates)
        for name, (_, values) in found.items():
            start = {"condition": condition, "history": name}
            at = [{**start, "time_s": f"{t:.6g}"} for t in time_s]
            own = _columns(bands(ensemble.of_all(values)))
            rows += [{**a, **b} for a, b in zip(at, own, strict=True)]
    return rows


def place_rows(ensemble: Ensemble) -> list[dict[str, Any]]:
    """Return a row for each condition and receptor: bands of its spikes from time 0 on.

    Places are those of the first person; there are none if people differ in their number, as those
    that are drawn on the mesh can.

    Raises
    ------
    StudyError
        Nobody is complete.
    """
    rows: list[dict[str, Any]] = []
    for condition in ensemble.conditions:
        scans = ensemble.results(condition)
        trace = scans[0].trace
        names, places = trace["population"], trace["receptors_mm"]
        if any(not np.array_equal(scan.trace["population"], names) for scan in scans):
            continue
        counts = np.array([_counts(scan) for scan in scans], dtype=float)
        for k, columns in enumerate(_columns(bands(ensemble.of_all(counts)))):
            x_mm, y_mm, z_mm = (f"{x:.4g}" for x in places[k])
            place = {"population": str(names[k]), "x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm}
            rows.append({"condition": condition, "receptor": k, **place, **columns})
    return rows


def _columns(own: Bands) -> Iterator[dict[str, Any]]:
    """Yield people, median, and ends and probabilities of the bands of values in a row."""
    for k, median in enumerate(own.median):
        row: dict[str, Any] = {"people": int(own.people[k]), "missing": own.missing}
        row["median"] = f"{median:.5g}"
        for share, low, high in zip(own.shares, own.low[:, k], own.high[:, k], strict=True):
            row[f"low_{100 * share:.0f}"] = f"{low:.5g}"
            row[f"high_{100 * share:.0f}"] = f"{high:.5g}"
            row[f"share_{100 * share:.0f}"] = f"{covered(share, own.people[k]):.3g}"
        yield row


def central_spikes_s(scan: Results) -> Array:
    """Return the times of the spikes of the central receptor of the first population, s."""
    trace, spikes = scan.trace, scan.spikes
    own = spikes.receptor == central_receptor(trace["receptors_mm"], trace["population"])
    return np.asarray(spikes.time_s[own], dtype=float)


def _central_rate_Hz(scan: Results, time_s: Array) -> Array:
    """Return the firing rate of the central receptor at times."""
    response = Response([central_spikes_s(scan)], float(time_s[0]), float(time_s[-1]))
    return response.rate(time_s, _WINDOW_S)[:, 0]


def _counts(scan: Results) -> NDArray[np.intp]:
    spikes = scan.spikes
    sliding = spikes.receptor[spikes.time_s >= 0]
    return np.bincount(sliding, minlength=len(scan.trace["population"]))
