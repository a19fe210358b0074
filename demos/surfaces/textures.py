# %% [markdown]
# # Sandpaper and woven cloth under the finger
#
# This demo emphasizes
# - how a measured height map is stroked (`stimulus.kind = "surface"`),
# - which of its waves the skin of a mesh can follow; `--preset medium` follows more,
# - what is left of the texture in the strain energy at the receptors and in the spikes.
#
# Two maps of known spectra stand for measured ones. The sandpaper is a Gaussian random field: the
# power of its waves falls as $e^{-(k l/2)^2}$ with the wave number $k$, and $l$, here half the size
# of a grain, is the length over which heights are correlated. The cloth is a plain weave of round
# threads, pressed flat, and repeats without a seam.
#
#     python demos/surfaces/textures.py results/textures
#     mpirun -n 2 python demos/surfaces/textures.py results/textures

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.figure import Figure

from tactile_fem import Results, Study, run_script, scan, write_table
from tactile_fem.output.annotations import INK
from tactile_fem.output.histories import DISPLACEMENT, central_receptor
from tactile_fem.runtime.ranks import on_root
from tactile_fem.series import numbers_of
from tactile_fem.stimulus.relief import Roughness
from tactile_fem.study import Finger, Protocol, Surface

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

SPACING_MM = 0.025
MICROMETRE_MM = 0.001
SHOWN_MM = 5.0  # half the width of the pictures


@dataclass(frozen=True)
class Row:
    """A texture's numbers in the slide."""

    texture: str
    rms_mm: float
    half_of_variance_beyond_mm: float
    normal_N: float
    tangential_N: float
    central_sed_kPa: float
    its_variation: float
    spikes: int


# %% [markdown]
# ## The maps
#
# In micrometres, as instruments write them: rows follow each other along X, columns along Y.


# %%
def sandpaper(grain_mm: float, rms_um: float) -> np.ndarray:
    """Return heights of 12.8 x 25.6 mm, um, whose neighbours are correlated over half a grain."""
    shape = 512, 1024
    frequencies = (np.fft.fftfreq(n, SPACING_MM) for n in shape)
    k = 2 * np.pi * np.hypot(*np.meshgrid(*frequencies, indexing="ij"))
    amplitude = np.exp(-((k * grain_mm / 2) ** 2) / 8)
    white = np.fft.fft2(np.random.default_rng(1).normal(size=shape))
    heights = np.fft.ifft2(white * amplitude).real
    return rms_um * (heights - heights.mean()) / heights.std()


def cloth(pitch_mm: float, height_um: float) -> np.ndarray:
    """Return one repeat of a plain weave, two threads each way, um."""
    count = round(2 * pitch_mm / SPACING_MM)
    at = np.arange(count) / count * 2  # in threads
    x, y = at[:, None], at[None, :]

    def threads(across: np.ndarray, along: np.ndarray, first: float) -> np.ndarray:
        number, off = np.round(across), across - np.round(across)
        round_back = np.sqrt(np.maximum(1 - (off / 0.48) ** 2, 0))
        wave = first * np.cos(np.pi * number) * np.cos(np.pi * along)
        return (wave + round_back) / 2

    return height_um * np.maximum(threads(x, y, 1.0), threads(y, x, -1.0))


# %% [markdown]
# ## The scans


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    force: float = 0.5,
    distance: float = 8.0,
) -> None:
    """Stroke both textures with a force that is held, N, over a distance in mm."""
    comm = MPI.COMM_WORLD
    maps = {"sandpaper": sandpaper(1.0, 60.0), "cloth": cloth(2.4, 350.0)}
    scans = {}
    for name, heights in maps.items():
        file = folder / f"{name}.npy"
        on_root(comm, lambda file=file, heights=heights: save(file, heights))
        study = Study(
            finger=Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size),
            stimulus=Surface(
                file=file,
                spacing_mm=SPACING_MM,
                unit_mm=MICROMETRE_MM,
                low_pass_mm=0.3,
                repeat="periodic",
            ),
            protocol=Protocol(force_N=force, hold="force", distance_mm=distance),
        )
        scans[name] = scan(study, folder / name)
    if comm.rank:
        return
    rows = [row(name, Results.open(folder / name)) for name in scans]
    for r in rows:
        print(
            f"{r.texture}: {r.rms_mm:.4f} mm rms, half of the variance in waves longer than "
            f"{r.half_of_variance_beyond_mm:.2f} mm; {r.normal_N:.3f} N, {r.tangential_N:.3f} N "
            f"across; SED of the middle receptor {r.central_sed_kPa:.2f} kPa, varies by "
            f"{100 * r.its_variation:.0f} %; {r.spikes} spikes"
        )
    write_table(folder / "textures.csv", rows)
    draw(folder, scans).savefig(folder / "textures.png", dpi=105)
    print(folder / "textures.png")


def save(file: Path, heights: np.ndarray) -> None:
    """Write a map, unless it is there."""
    file.parent.mkdir(parents=True, exist_ok=True)
    if not file.exists():
        np.save(file, heights.astype(np.float32))


def row(name: str, results: Results) -> Row:
    """Return the numbers of one scan."""
    trace, numbers = results.trace, numbers_of(results)
    waves = Roughness.of(results.study.stimulus.relief().heights)
    slide = trace["displacement_mm"] > 0
    central = trace["sed_kPa"][slide, central_receptor(trace["receptors_mm"])]
    return Row(
        name,
        waves.rms_mm,
        waves.wavelength_of(0.5),
        numbers["normal_N"],
        numbers["tangential_N"],
        float(central.mean()),
        float(central.std() / central.mean()),
        len(results.spikes.time_s),
    )


# %% [markdown]
# ## The picture
#
# Heights where the finger goes, the strain energy of the line of receptors while they pass there,
# and their spikes.


# %%
def draw(folder: Path, scans: dict[str, object]) -> Figure:
    """Draw a column for each texture."""
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    grid = figure.subplots(3, len(scans), squeeze=False, sharex=True, sharey=True)
    for column, name in zip(grid.T, scans, strict=True):
        results = Results.open(folder / name)
        trace, spikes = results.trace, results.spikes
        slide = trace["displacement_mm"] >= 0
        d, x = trace["displacement_mm"][slide], trace["receptors_mm"][:, 0]
        across, along = np.linspace(-SHOWN_MM, SHOWN_MM, 201), np.linspace(d[0], d[-1], 301)
        places = np.stack(np.meshgrid(across, along, indexing="ij"), -1).reshape(-1, 2)
        relief = results.study.stimulus.relief().heights.derivatives(places, 0)[0]
        heights, felt, fired = column
        shown = heights.pcolormesh(along, across, 1e3 * relief.reshape(201, 301), cmap="gray")
        figure.colorbar(shown, ax=heights, label="Height (µm)")
        heights.set_title(name)
        shown = felt.pcolormesh(d, x, trace["sed_kPa"][slide].T, cmap="viridis", shading="nearest")
        figure.colorbar(shown, ax=felt, label="SED (kPa)")
        inside = spikes.displacement_mm >= 0
        fired.plot(spikes.displacement_mm[inside], x[spikes.receptor[inside]], ".", ms=2, color=INK)
        fired.set(xlabel=DISPLACEMENT, ylim=(-SHOWN_MM, SHOWN_MM))
        for axes in column:
            axes.set_ylabel("X (mm)")
    return figure


if __name__ == "__main__":
    run_script(main)
