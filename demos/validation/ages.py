# %% [markdown]
# # A child's, an adult's and an old finger under letters
#
# Few numbers of fingertips by age are published, none of the layers or moduli of a child's. Each
# ratio to the adult below has its source or is a guess that says so; an old finger is therefore
# scanned with stiffer and with softer skin too. All are pressed equally deep by the same letters,
# and have receptors at the same places, although a child's lie closer together.
#
#     python demos/validation/ages.py results/ages --people results/people_letters
#
# Expected time: half an hour on two cores. Options of a study follow, as in `people_letters.py`.

# %%
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from people_letters import LETTERS, alike, base, felt, numbers_with_likeness, print_rows

from tactile_fem import Results, Study, run_script, write_table
from tactile_fem.calibration.parameters import Parameter, powers_of, with_values
from tactile_fem.people import Ensemble
from tactile_fem.people.bands import bands_table
from tactile_fem.runtime.files import write_figure
from tactile_fem.series import Member, population_image, run_all

# Ratios to the adult. Layers follow the size, hence the quotients.
# - child of 8 years: diameter of the index finger 15 mm on average from 3 to 10 years, 20 % more at
#   10 than at 3 (160 children, Ann Anat 2010, 192:156; abstract), so some 15.7 mm, against 20 mm
#   (from memory). Dermis thinner (Seidenari et al. 2000, other sites; size guessed). Epidermis:
#   sources contradict each other.
# - old, 72 years: epidermis and dermis half as much thinner as on the inner arm (7 and 6 % a
#   decade, Branchet et al. 1990), as others find no change. Friction lower in four of six studies;
#   size guessed. Skin conforms to gratings as that of the young (Vega-Bermudez and Johnson 2004),
#   other moduli are said to rise and to fall.
SIZE = 0.78
CHILD = {"finger.size": SIZE, "finger.dermis": 0.85 / SIZE}
CHILD |= dict.fromkeys(("finger.stratum_corneum", "finger.epidermis"), 1 / SIZE)
OLD = {"finger.epidermis": 0.85, "finger.dermis": 0.9, "stimulus.friction": 0.75}
FINGERS: Mapping[str, Mapping[str, float]] = {
    "child": CHILD,
    "adult": {},
    "old": OLD,
    "old-stiff": {**OLD, "skin": 1.3},
    "old-soft": {**OLD, "skin": 0.75},
}


# %%
def aged(study: Study, ratios: Mapping[str, float]) -> Study:
    """Return the study with values times their ratios, by the names of `powers_of`."""
    plain = study.model_copy(update={"people": None})
    each = [Parameter(name, powers_of(name, plain), math.e) for name in ratios]
    return with_values(plain, each, [math.log(ratio) for ratio in ratios.values()])


def main(
    folder: Path,
    *changes: str,
    people: Path | None = None,
    letters: str = LETTERS,
    jobs: int = 2,
) -> None:
    """Scan letters under fingers of three ages, and print what they feel.

    Parameters
    ----------
    folder
        Folder for scans, the table and the figure.
    changes
        Changes of the study: section.key=value.
    people
        Results of `people_letters.py`, for a column of adults' bands.
    letters
        Letters; numbers and figure are those of the first.
    jobs
        Parallel scans.
    """
    studies = {name: aged(base(changes), ratios) for name, ratios in FINGERS.items()}
    members = {
        name: [Member(f"{name}-{letter}", felt(study, text=letter), {}) for letter in letters]
        for name, study in studies.items()
    }
    every = [one for own in members.values() for one in own]
    found = iter(run_all(every, folder / "scans", jobs=jobs))
    scans = {name: [next(found) for _ in own] for name, own in members.items()}
    numbers = {name: numbers_with_likeness(own[0]) for name, own in scans.items()}
    images = {name: [population_image(one) for one in own] for name, own in scans.items()}
    columns = min(image.rate_Hz.shape[1] for own in images.values() for image in own)
    rates = np.array([[i.rate_Hz[:, :columns] for i in own] for own in images.values()])
    for name, r in zip(numbers, alike(rates), strict=True):
        apart = r[~np.eye(len(letters), dtype=bool)]
        numbers[name]["likeness of letters"] = float(apart.mean()) if len(apart) else math.nan
    rows = table(numbers, adults(people))
    print_rows([list(rows[0]), *(list(row.values()) for row in rows)])
    write_table(folder / "ages.csv", rows)
    write_figure(folder / "ages.png", draw({n: own[0] for n, own in scans.items()}))


def adults(people: Path | None) -> dict[str, str]:
    """Return the widest band of adults by the name of the number, that of "number" its share."""
    if people is None:
        return {}
    scans = Ensemble.open(people / "scans").results("text-G")
    each = [numbers_with_likeness(scan) for scan in scans]
    rows = bands_table({key: [own[key] for own in each] for key in each[0]})
    return {name: band for name, *_, band in rows}


def table(
    numbers: Mapping[str, Mapping[str, float]], band: Mapping[str, str]
) -> list[dict[str, str]]:
    """Return a row for each number, with a column for each finger."""
    rows = []
    for key in numbers["adult"]:
        row = {"number": key, **{name: f"{own[key]:.3g}" for name, own in numbers.items()}}
        rows.append({**row, f"adults: {band['number']}": band.get(key, "")} if band else row)
    return rows


def draw(scans: Mapping[str, Results]) -> Figure:
    """Draw the spikes of the receptors under the G, a panel for each finger."""
    figure = Figure(figsize=(11, 2.8), layout="constrained")
    panels: Sequence = np.atleast_1d(figure.subplots(1, len(scans), sharex=True, sharey=True))
    for axes, (name, scan) in zip(panels, scans.items(), strict=True):
        image = population_image(scan)
        row, time_s = image.response.events()
        along = scan.study.protocol.speed_mm_s * time_s
        axes.plot(along, image.across_mm[row], "k.", ms=2)
        for shape in scan.study.stimulus.outlines():
            axes.plot(*shape.exterior.xy[::-1], color="C1", lw=1)
        axes.set(title=name, xlabel="Displacement (mm)", aspect="equal")
        axes.set(xlim=(0, image.along_mm[-1]), ylim=(image.across_mm[-1], image.across_mm[0]))
    panels[0].set_ylabel("X on the letter (mm)")
    return figure


# %%
if __name__ == "__main__":
    run_script(main)
