# %% [markdown]
# # What fingerprints do
#
# This demo emphasizes
# - strain energy density and spikes with and without ridges and papillae, under an edge, a bar and
#   gratings,
# - the rhythm of ridges that pass an edge, $v/\lambda$, at several speeds and frictions,
# - how far an answer hangs on the shape of the ridges.
#
# All scans are of a sagittal section in plane strain, pressed to 0.06 N/mm. Receptors lie at the
# tips of intermediate ridges (SA1) and of papillae (RA); in skin without papillae on the flat
# epidermis-dermis interface, at its mean depth. Means are over the receptors within 1.5 mm of the
# contact point and over the slide from 0.5 mm on.
#
#     python demos/sections/fingerprints.py results/fingerprints --jobs 2
#     python demos/sections/fingerprints.py results/quick --scans edge_smooth edge_ridged
#         --distance 0.2 --force 0.01

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.signal import find_peaks

from tactile_fem import Results, Study, StudyError, run_script, write_table
from tactile_fem.output.annotations import BLUE, VERMILION
from tactile_fem.output.histories import DISPLACEMENT, central_receptor
from tactile_fem.series import Member, complete_scans, run_series

Array = NDArray[np.float64]

PITCH_MM = 0.47
RIDGES = {"ridge_height_mm": 0.1}
PAPILLAE = {"papilla_depth_mm": 0.2}
RIDGED = RIDGES | PAPILLAE
# As in eLife 93554: an edge 1 mm wide and 0.3 mm high on a plate.
EDGE = {"kind": "grating", "count": 1, "ridge_mm": 1.0, "relief_mm": 0.3, "fillet_radius_mm": 0.1}
STIMULI = {"edge": EDGE, "bar": {"kind": "cylinder", "radius_mm": 3.0}} | {
    f"grating_{period:g}": EDGE
    | {"count": round(12 / period), "ridge_mm": period / 2, "groove_mm": period / 2}
    for period in (0.5, 1.0, 3.0)
}
SKINS = {"smooth": BLUE, "ridged": VERMILION}
# Half of the receptors' stretch that counts, and the start of the slide that does not, mm.
_NEAR_MM, _FROM_MM = 1.5, 0.5


@dataclass(frozen=True)
class Scan:
    """What is scanned: shape of the skin, stimulator and how it moves."""

    skin: dict[str, Any]
    stimulus: str
    speed_mm_s: float = 20.0
    friction: float = 0.3

    def study(self, distance_mm: float, force_N_mm: float, pad_size_mm: float) -> Study:
        """Return its study."""
        place = {"start_mm": -distance_mm / 2} if self.stimulus == "edge" else {}
        if self.stimulus == "bar":
            place = {"shift_mm": (0.0, distance_mm / 2)}
        tips = "papilla_depth_mm" in self.skin
        places = {"SA1": "intermediate_ridges", "RA": "papillae"} if tips else {}
        along = {"placement": "line", "spacing_mm": PITCH_MM / 2, "half_width_mm": 4.0}
        return Study.model_validate(
            {
                "finger": {
                    "kind": "section",
                    "ridge_pitch_mm": PITCH_MM,
                    "ridged_half_length_mm": 5.0,
                    "pad_size_mm": pad_size_mm,
                    **self.skin,
                },
                "stimulus": {**STIMULI[self.stimulus], **place, "friction": self.friction},
                "protocol": {
                    "force_N": force_N_mm,
                    "press_speed_mm_s": 5.0,
                    "speed_mm_s": self.speed_mm_s,
                    "distance_mm": distance_mm,
                },
                "afferents": [
                    {
                        "name": kind,
                        "kind": kind,
                        "receptors": {
                            "average_radius_mm": 0.03,
                            **({"placement": places[kind]} if tips else along),
                        },
                    }
                    for kind in ("SA1", "RA")
                ],
                "solver": {
                    "linear": "direct",
                    "contact_width_MPa": 0.02,
                    "max_slide_step_mm": 0.1,
                },
                "output": {"pictures": False},
            }
        )


SCANS = (
    {f"{name}_smooth": Scan({}, name) for name in STIMULI}
    | {f"{name}_ridged": Scan(RIDGED, name) for name in STIMULI}
    | {f"edge_{speed:g}_mm_s": Scan(RIDGED, "edge", speed_mm_s=speed) for speed in (10, 40, 80)}
    | {f"edge_friction_{mu:g}": Scan(RIDGED, "edge", friction=mu) for mu in (0.1, 0.6)}
    | {
        "edge_outer_only": Scan(RIDGES, "edge"),
        "edge_inner_only": Scan(PAPILLAE, "edge"),
        "edge_not_aligned": Scan(RIDGED | {"papillae_aligned": False}, "edge"),
        "edge_flat_ridges": Scan(RIDGED | {"ridge_height_mm": 0.05}, "edge"),
        "edge_deep_papillae": Scan(RIDGED | {"papilla_depth_mm": 0.3}, "edge"),
    }
)


@dataclass(frozen=True)
class Row:
    """Results of one scan."""

    scan: str
    sed_kPa: float
    largest_sed_kPa: float
    papillae_sed_kPa: float
    ridge_wave: float
    ridge_Hz: float
    tangential_N_mm: float
    force_drops_per_mm: float
    sa1_Hz: float
    ra_Hz: float
    sa1_locking: float
    ra_locking: float


# %%
def main(
    folder: Path,
    *,
    scans: Annotated[tuple[str, ...], Parameter(consume_multiple=True)] = tuple(SCANS),
    distance: float = 4.0,
    force: float = 0.06,
    pad_size: float = PITCH_MM / 8,
    jobs: int = 1,
) -> None:
    """Scan stimulators with ridged and smooth skin and compare what is felt.

    Parameters
    ----------
    scans
        Names of those wanted; default all.
    distance, force, pad_size
        Slide, mm; normal force at its start, N/mm; element edge under the contact patch, mm.
    jobs
        Scans at a time.
    """
    if unknown := set(scans) - SCANS.keys():
        raise StudyError(f"scans = {sorted(unknown)}: known are {', '.join(SCANS)}")
    members = [
        Member(name, SCANS[name].study(distance, force, pad_size), {"scan": name}) for name in scans
    ]
    run_series(members, folder, jobs=jobs)
    complete = complete_scans(members, folder)
    rows = [row(results) for results in complete]
    for r in rows:
        print(
            f"{r.scan}: SED at SA1 {r.sed_kPa:.3f} (largest {r.largest_sed_kPa:.2f}), at RA "
            f"{r.papillae_sed_kPa:.3f} kPa; wave at {r.ridge_Hz:.0f} Hz {100 * r.ridge_wave:.1f} "
            f"%; {r.tangential_N_mm:.4f} N/mm across, {r.force_drops_per_mm:.2f} drops/mm; SA1 "
            f"{r.sa1_Hz:.1f}, RA {r.ra_Hz:.1f} spikes/s, locked {r.sa1_locking:.2f}, "
            f"{r.ra_locking:.2f}"
        )
    write_table(folder / "fingerprints.csv", rows)
    draw(complete).savefig(folder / "fingerprints.png", dpi=160)
    print(folder / "fingerprints.png")


# %%
def row(results: Results) -> Row:
    """Return the numbers of one scan's slide."""
    study, trace = results.study, results.trace
    slide = trace["displacement_mm"] >= min(_FROM_MM, trace["displacement_mm"][-1] / 2)
    at = trace["displacement_mm"][slide]
    sed = {kind: trace["sed_kPa"][slide][:, near(results, kind)] for kind in ("SA1", "RA")}
    across = np.abs(trace["force_N"][slide, 1])
    start, seconds = trace["time_s"][slide][0], np.ptp(trace["time_s"][slide])
    return Row(
        results.folder.name,
        float(sed["SA1"].mean()),
        float(sed["SA1"].max()),
        float(sed["RA"].mean()),
        wave(at, sed["SA1"], study.finger.ridge_pitch_mm),
        study.protocol.speed_mm_s / study.finger.ridge_pitch_mm,
        float(across.mean()),
        drops(across) / float(np.ptp(at)),
        *(rate(results, kind, start, seconds) for kind in ("SA1", "RA")),
        *(locking(results, kind, start) for kind in ("SA1", "RA")),
    )


def near(results: Results, kind: str) -> NDArray[np.intp]:
    """Return the numbers of a kind's receptors near the contact point."""
    own = results.receptors_of(kind)
    return own[np.abs(results.trace["receptors_mm"][own, 1]) < _NEAR_MM]


def wave(at_mm: Array, sed_kPa: Array, pitch_mm: float) -> float:
    """Return the amplitude of SED at the ridges' rhythm over its mean, rms over the receptors.

    Parameters
    ----------
    at_mm, sed_kPa
        Slide (n,) and SED (n, receptors).
    pitch_mm
        Of the ridges.
    """
    even = np.linspace(at_mm[0], at_mm[-1], 400)
    values = np.array([np.interp(even, at_mm, column) for column in sed_kPa.T])
    window = np.hanning(len(even))
    smooth = np.array([np.polyval(np.polyfit(even, own, 4), even) for own in values])
    turning = np.exp(-2j * np.pi * even / pitch_mm)
    amplitude = 2 * np.abs((window * (values - smooth)) @ turning) / window.sum()
    return float(np.sqrt(np.mean(amplitude**2)) / values.mean())


def drops(force: Array, share: float = 0.05) -> int:
    """Return how often a force (n,) falls by a share of its mean before it rises as much again."""
    # An end that only falls is a drop, too.
    lows, _ = find_peaks(-np.append(force, np.inf), prominence=share * force.mean())
    return len(lows)


def rate(results: Results, kind: str, start_s: float, seconds: float) -> float:
    """Return the mean rate of a kind's receptors near the contact point, spikes/s."""
    spikes, receptors = results.spikes, near(results, kind)
    fired = np.isin(spikes.receptor, receptors) & (spikes.time_s >= start_s)
    return float(fired.sum() / (len(receptors) * seconds))


def locking(results: Results, kind: str, start_s: float) -> float:
    """Return how far a kind's spikes keep the ridges' phase: 0 not at all, 1 exactly.

    Pairwise phase consistency (Vinck et al. 2010, DOI 10.1016/j.neuroimage.2010.01.073), which few
    spikes do not raise; mean over the receptors near the contact point with two or more.
    """
    spikes, pitch = results.spikes, results.study.finger.ridge_pitch_mm
    found = []
    for receptor in near(results, kind):
        at = spikes.displacement_mm[(spikes.receptor == receptor) & (spikes.time_s >= start_s)]
        count = len(at)
        if count > 1:
            strength = np.abs(np.exp(2j * np.pi * at / pitch).mean())
            found.append((count * strength**2 - 1) / (count - 1))
    return float(np.mean(found)) if found else float("nan")


# %%
def draw(scans: list[Results]) -> Figure:
    """Draw SED at the middle SA1 receptor, force across and spikes: smooth and ridged skin."""
    pairs: dict[str, dict[str, Results]] = {}
    for results in scans:
        stimulus, _, skin = results.folder.name.rpartition("_")
        if skin in SKINS:
            pairs.setdefault(stimulus, {})[skin] = results
    figure = Figure(figsize=(10, 2.1 * max(1, len(pairs)) + 0.4), layout="constrained")
    grid = figure.subplots(max(1, len(pairs)), 3, sharex=True, squeeze=False)
    for (name, pair), row_ in zip(pairs.items(), grid, strict=False):
        for k, (skin, results) in enumerate(pair.items()):
            draw_scan(row_, results, skin, k)
        row_[0].set_ylabel(f"{name.replace('_', ' ')}\nSED (kPa)")
        row_[1].set_ylabel("Across (N/mm)")
        row_[2].set_yticks([-0.5, -2.5], ["SA1", "RA"])
        for axes in row_[:2]:
            axes.set_ylim(bottom=0)
        for axes in row_:
            axes.spines[["top", "right"]].set_visible(False)
    grid[0, 0].legend(frameon=False)
    for axes in grid[-1]:
        axes.set_xlabel(DISPLACEMENT)
    return figure


def draw_scan(row_: NDArray[Any], results: Results, skin: str, place: int) -> None:
    """Draw one scan into a row of axes: SED, force, the spikes of the receptors near."""
    trace, spikes = results.trace, results.spikes
    slide = trace["displacement_mm"] > 0
    at, own = trace["displacement_mm"][slide], near(results, "SA1")
    centre = own[central_receptor(trace["receptors_mm"][own])]
    style = {"color": SKINS[skin], "label": skin, "lw": 1}
    row_[0].plot(at, trace["sed_kPa"][slide, centre], **style)
    row_[1].plot(at, np.abs(trace["force_N"][slide, 1]), **style)
    for k, kind in enumerate(("SA1", "RA")):
        fired = np.isin(spikes.receptor, near(results, kind)) & (spikes.time_s > 0)
        places = spikes.displacement_mm[fired]
        row_[2].eventplot(places, lineoffsets=-2 * k - place, linelengths=0.8, color=SKINS[skin])


if __name__ == "__main__":
    run_script(main)
