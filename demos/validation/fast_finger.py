# %% [markdown]
# # How wrong is the finger in milliseconds?
#
# The fast finger has learnt from random shapes along random paths. Here it meets what it has not
# seen: letters, gratings, dots, Braille, a ball and an edge, at other depths and frictions, beside
# full scans of the same. It prints a table and draws the worst and the best histories.
#
#     python demos/validation/fast_finger.py results/fast_finger
#
# Expected time: 25 minutes on one core, for the full scans.

# %%
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from tactile_fem import Results, Study, load_study, run_script, write_table
from tactile_fem.series import Member, run_series
from tactile_fem.surrogate import FastFinger, HeightMap

FINGER = Path(__file__).parents[2] / "meshes" / "fast_finger.npz"
COARSER = "protocol.output_mm=0.2"
DEEP, SHALLOW = "protocol.depth_mm=1.5", "protocol.depth_mm=1"
BODIES: Mapping[str, Sequence[str]] = {
    **{letter: [f"stimulus.text={letter}"] for letter in "GCOQHE"},
    **{
        f"grating of {period} mm": [
            "stimulus.kind=grating",
            f"stimulus.ridge_mm={period / 2}",
            f"stimulus.groove_mm={period / 2}",
            f"stimulus.friction={friction}",
            DEEP,
            COARSER,
        ]
        for period, friction in ((2, 0.3), (5, 0.6), (12, 0.1))
    },
    "dots": ["stimulus.kind=dots", COARSER],
    "dots, shallow, friction 0.6": [
        "stimulus.kind=dots",
        "stimulus.friction=0.6",
        SHALLOW,
        COARSER,
    ],
    "Braille": ["stimulus.kind=braille", DEEP, COARSER],
    "ball": ["stimulus.kind=sphere", DEEP, COARSER],
    "edge": [
        "stimulus.kind=edge",
        "stimulus.radius_mm=0.2",
        "stimulus.shift_mm=[0,5]",
        SHALLOW,
        COARSER,
    ],
    "G, shallow, no friction": ["stimulus.text=G", "stimulus.friction=0", SHALLOW, COARSER],
    "G, friction 0.6": ["stimulus.text=G", "stimulus.friction=0.6", COARSER],
}
FIRES = 3  # spikes: afferents with more are compared
STRONG = 0.2  # of the largest SED: histories of receptors that feel more are compared


# %%
def members(overrides: Sequence[str]) -> list[Member]:
    """Return the full scans."""
    plain = [*overrides, "output.pictures=false"]
    found = []
    for name, own in BODIES.items():
        folder = name.replace(", ", "_").replace(" ", "-")
        found.append(Member(folder, load_study(overrides=[*own, *plain]), {}))
    return found


def fast_trace(finger: FastFinger, study: Study) -> tuple[dict[str, np.ndarray], float, float]:
    """Return the fast finger's trace of a study, and what heights and scan took in s."""
    path = study.protocol.route(study.protocol.depth_mm)
    begun = time.perf_counter()
    reach = finger.pad.meets(path.places_mm()[:, :2])
    heights = HeightMap.of(study.stimulus.body(), *reach)
    mapped = time.perf_counter()
    trace = finger.scan(heights, path, friction=float(study.stimulus.friction))
    return trace.arrays(), mapped - begun, time.perf_counter() - mapped


def errors(finger: FastFinger, scan: Results) -> dict[str, float | str]:
    """Return how far the fast finger is from a full scan, over its slide."""
    fast, heights_s, scan_s = fast_trace(finger, scan.study)
    full = scan.trace
    times = np.linspace(0.0, full["time_s"][-1], 401)  # means are over time, not over steps

    def at(trace: Mapping[str, np.ndarray], name: str) -> np.ndarray:
        values = trace[name].reshape(len(trace["time_s"]), -1)
        own = trace["time_s"]
        return np.column_stack([np.interp(times, own, column) for column in values.T])

    force, true_force = at(fast, "force_N"), at(full, "force_N")
    sed, true_sed = at(fast, "sed_kPa"), at(full, "sed_kPa")
    strong = np.flatnonzero(true_sed.max(axis=0) > STRONG * true_sed.max())
    along = at(full, "displacement_mm")[:, 0]
    likeness = [np.corrcoef(sed[:, k], true_sed[:, k])[0, 1] for k in strong]
    away = np.abs(along[sed.argmax(axis=0)] - along[true_sed.argmax(axis=0)])[strong]
    populations = [afferents.population() for afferents in finger.study.populations]
    spikes, true_spikes = (
        np.array([sum(times >= 0) for times in populations[0].fire(trace).spikes])
        for trace in (fast, full)
    )
    fires = true_spikes > FIRES
    wrong = np.abs(spikes - true_spikes)[fires] / true_spikes[fires]
    image, true_image = (values - values.mean() for values in (sed, true_sed))
    dt = np.diff(fast["time_s"])
    return {
        "normal force, %": 100 * np.abs(force - true_force)[:, 2].mean() / true_force[:, 2].mean(),
        "tangential, %": 100 * np.abs(force - true_force)[:, 1].mean() / true_force[:, 2].mean(),
        "SED rms, % of largest": 100 * np.sqrt(((sed - true_sed) ** 2).mean()) / true_sed.max(),
        "r of histories": float(np.median(likeness)),
        "r of image": float(
            (image * true_image).sum() / np.sqrt((image**2).sum() * (true_image**2).sum())
        ),
        "maxima, mm": float(np.median(away)),
        "spikes of all, %": 100 * (spikes.sum() / max(true_spikes.sum(), 1) - 1),
        "per afferent, %": 100 * float(np.median(wrong)) if len(wrong) else np.nan,
        "outside, % of time": 100 * float(np.average(fast["is_outside"][1:], weights=dt)),
        "heights, s": heights_s,
        "scan, s": scan_s,
        "full scan, s": float(full["wall_s"].sum()),
    }


def draw(finger: FastFinger, scans: Mapping[str, Results], file: Path) -> None:
    """Draw SED over place across the finger and way, full and fast, of some bodies."""
    names = [name for name in ("G", "Braille", "grating of 5 mm", "edge") if name in scans]
    figure = Figure(figsize=(8, 2.6 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 3, squeeze=False)
    for row, name in zip(axes, names, strict=True):
        fast, full = fast_trace(finger, scans[name].study)[0], scans[name].trace
        largest = full["sed_kPa"].max()
        for ax, trace, title in zip(row, (full, fast), ("full", "fast"), strict=False):
            slide = trace["time_s"] >= 0
            x, way = trace["receptors_mm"][:, 0], trace["displacement_mm"][slide]
            ax.pcolormesh(way, x, trace["sed_kPa"][slide].T, vmin=0, vmax=largest, rasterized=True)
            ax.set(xlabel="Displacement (mm)", ylabel="X (mm)", title=f"{name}, {title}")
        middle = np.argmax(full["sed_kPa"].max(axis=0))
        for trace, label in ((full, "full"), (fast, "fast")):
            slide = trace["time_s"] >= 0
            row[2].plot(
                trace["displacement_mm"][slide], trace["sed_kPa"][slide, middle], label=label
            )
        row[2].set(xlabel="Displacement (mm)", ylabel="SED (kPa)", title="where it is largest")
        row[2].legend()
    figure.savefig(file, dpi=90)


def main(folder: Path, *overrides: str, finger: Path = FINGER, jobs: int = 1) -> None:
    """Compare the fast finger with full scans.

    Parameters
    ----------
    folder
        Folder for the scans, the table and the figure.
    overrides
        Values of the study: section.key=value.
    finger
        The fast finger.
    jobs
        Parallel full scans.
    """
    fast = FastFinger.read(finger)
    scans = members(overrides)
    run_series(scans, folder, jobs=jobs)
    complete = {
        name: Results(folder / member.name)
        for name, member in zip(BODIES, scans, strict=True)
        if Results(folder / member.name).complete
    }
    rows = [{"body": name, **errors(fast, scan)} for name, scan in complete.items()]
    write_table(folder / "fast_finger.csv", rows)
    names = list(rows[0])[1:]
    print(f"{'':28}" + " ".join(f"{name:>22}" for name in names))
    middle = {
        "body": "median",
        **{name: np.nanmedian([row[name] for row in rows]) for name in names},
    }
    for row in (*rows, middle):
        print(f"{row['body']:28}" + " ".join(f"{row[name]:22.3g}" for name in names))
    draw(fast, complete, folder / "fast_finger.png")


if __name__ == "__main__":
    run_script(main)
