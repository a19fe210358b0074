"""Text tables and figures that summarize an ensemble."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tactile_fem import Results
from tactile_fem.output import Abscissa
from tactile_fem.people.bands import SHARES, bands_table, people_needed
from tactile_fem.people.causes import Causes, causes, causes_table
from tactile_fem.people.ensemble import Ensemble
from tactile_fem.people.figures import bands_figure, causes_figure, paired_figure, people_raster
from tactile_fem.people.paired import paired
from tactile_fem.people.tables import central_spikes_s, history_rows, place_rows
from tactile_fem.runtime.files import write_figure, write_table
from tactile_fem.runtime.text import aligned
from tactile_fem.series import common

Array = NDArray[np.float64]

# Numbers of a scan that are its cost.
_COST = ("steps", "newton_iterations", "wall_s")
# Numbers whose causes are drawn, as their names begin, and what they are called.
_DRAWN = {
    "normal_": "normal force",
    "central_largest_sed_": "central SED",
    "central_spikes": "central spikes",
}
# Numbers that differ by less are the same in all people, as a held force is.
_SAME_SHARE = 5e-3


def write_report(ensemble: Ensemble) -> list[str]:
    """Return a summary of an ensemble in lines of text, and write its figures.

    First how many people failed, and why. Tables: median and bands of each number, by condition;
    where its spread comes from; how each further condition differs from the first one within
    people. Figures, in ``figures`` of the folder: ``bands.png``, ``raster.png``, ``causes.png``
    and, with conditions, ``paired.png``. Bands of histories are in ``histories.csv``, of the spikes
    at each place in ``places.csv``.

    Raises
    ------
    StudyError
        Nobody is complete.
    """
    numbers = {name: _numbers(ensemble, name) for name in ensemble.conditions}
    folder = ensemble.folder / "figures"
    folder.mkdir(exist_ok=True)
    write_table(ensemble.folder / "histories.csv", history_rows(ensemble))
    if rows := place_rows(ensemble):
        write_table(ensemble.folder / "places.csv", rows)
    lines = [*_sample(ensemble), "", *_spread(ensemble, numbers), *_differences(numbers)]
    for name, figure in _figures(ensemble, numbers):
        write_figure(folder / f"{name}.png", figure)
    found = _causes(ensemble, numbers)
    if found:
        lines += ["", *aligned(causes_table(found))]
        same = np.isclose(ensemble.draws, ensemble.scores).all(axis=0)
        added = np.array(ensemble.names)[~same]
        lines += [f"{name}: its share beyond that of correlated values above" for name in added]
        if drawn := _drawn(found, ensemble.conditions[0]):
            write_figure(folder / "causes.png", causes_figure(drawn))
    else:
        few, needed = int(ensemble.complete.sum()), len(ensemble.names) + 2
        lines += ["", f"{few} people: the causes of the spread need {needed} or more"]
    return lines


def _sample(ensemble: Ensemble) -> Iterator[str]:
    """Yield how many people there are, who failed, and why."""
    done, number = int(ensemble.complete.sum()), len(ensemble.people)
    failed = len({name.partition("_")[0] for name in ensemble.failed})
    left = f", {number - done - failed} not scanned yet" if done + failed < number else ""
    yield f"{done} of {number} people are complete, {failed} failed{left}"
    yield from (f"  {name}: {why}" for name, why in ensemble.failed.items())
    if failed:
        yield "what follows is for complete people, a biased sample unless failures are random"


def _numbers(ensemble: Ensemble, condition: str) -> dict[str, Array]:
    """Return the numbers of all people, (n,), without the cost; NaN of who is not complete."""
    numbers = ensemble.numbers(condition)
    return {name: ensemble.of_all(own) for name, own in numbers.items() if name not in _COST}


def _named(numbers: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
    """Return the numbers of all conditions, named with their condition if there are several."""
    return {
        f"{condition}: {name}" if condition else name: values
        for condition, own in numbers.items()
        for name, values in own.items()
    }


def _spread(ensemble: Ensemble, numbers: Mapping[str, Mapping[str, Array]]) -> list[str]:
    count, needed = int(ensemble.complete.sum()), people_needed(max(SHARES))
    few = f"{count} people: a band of {100 * max(SHARES):.0f} % needs {needed} people"
    return [*aligned(bands_table(_named(numbers))), *([few] if count < needed else [])]


def _differences(numbers: Mapping[str, Mapping[str, Array]]) -> Iterator[str]:
    """Yield how numbers of each further condition differ from the first one's."""
    (first, own), *others = numbers.items()
    for second, theirs in others:
        yield ""
        yield f"{second} after {first}, within people"
        for name in [name for name in own if name in theirs]:
            yield f"  {name}: {paired(own[name], theirs[name])}"


def _causes(ensemble: Ensemble, numbers: Mapping[str, Mapping[str, Array]]) -> dict[str, Causes]:
    """Return the causes of each number that varies; none if people are too few.

    Of positive numbers it is the logarithm, so that no large one decides.
    """
    found = {}
    for name, own in _named(numbers).items():
        known = own[np.isfinite(own)]
        if len(known) < len(ensemble.names) + 2:
            continue
        if np.ptp(known) > _SAME_SHARE * abs(known.mean()):
            of = np.log(own) if (known > 0).all() else own
            found[name] = causes(ensemble.draws, ensemble.names, of, independent=True)
    return found


def _drawn(found: Mapping[str, Causes], condition: str) -> dict[str, Causes]:
    """Return the causes that are drawn, of a condition, by what the numbers are called."""
    start = f"{condition}: " if condition else ""
    return {
        label: own
        for name, own in found.items()
        for key, label in _DRAWN.items()
        if name.startswith(f"{start}{key}")
    }


def _figures(
    ensemble: Ensemble, numbers: Mapping[str, Mapping[str, Array]]
) -> Iterator[tuple[str, Figure]]:
    """Yield the figures of histories and spikes, with their names."""
    conditions = ensemble.conditions
    scans = {name: ensemble.results(name) for name in conditions}
    every = [Abscissa.of(scan.trace) for own in scans.values() for scan in own]
    over, first = common(every), scans[conditions[0]]
    time_s, histories = _histories(ensemble, {name: own[0] for name, own in scans.items()})
    axis = Abscissa(over.label, over.per_s, over.at(time_s), over.phases)
    yield "bands", bands_figure(histories, axis)
    places = iter([over.at(central_spikes_s(scan)) for scan in first])
    spikes = [next(places) if done else None for done in ensemble.complete]
    sed = numbers[conditions[0]]["central_largest_sed_kPa"]
    yield "raster", people_raster(spikes, over, sed, "Largest SED (kPa)")
    for second in conditions[1:2]:
        counts = [numbers[name]["central_spikes"] for name in (conditions[0], second)]
        label = "Spikes of the central receptor"
        yield "paired", paired_figure(counts[0], counts[1], (conditions[0], second), label)


def _histories(
    ensemble: Ensemble, scans: Mapping[str, Results]
) -> tuple[Array, dict[str, dict[str, Array]]]:
    """Return times, s, and the histories (people, n) there by label and condition.

    Parameters
    ----------
    ensemble
        The people.
    scans
        One of each condition.
    """
    scan = next(iter(scans.values()))
    unit, felt = scan.study.finger.force_unit, scan.trace["population"][0]
    labels = {
        f"Normal ({unit})": "normal",
        f"Tangential ({unit})": "tangential",
        f"SED of the central\n{felt} receptor (kPa)": "central_sed_kPa",
    }
    time_s, _ = ensemble.history()
    found: dict[str, dict[str, Array]] = {label: {} for label in labels}
    for label, of in labels.items():
        for condition in scans:
            own = _onto(time_s, *ensemble.history(condition, of))
            found[label][condition] = ensemble.of_all(own)
    return time_s, found


def _onto(time_s: Array, own_s: Array, values: Array) -> Array:
    """Return histories (m, n) at other times, NaN beyond their own."""
    return np.array([np.interp(time_s, own_s, one, np.nan, np.nan) for one in values])
