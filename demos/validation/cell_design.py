# %% [markdown]
# # Heights of a cell of nine dots that evoke wanted rates
#
# The fast finger answers for ten cells at once in a fraction of a second, so heights can be found
# by least squares: nine dots are pressed on and held, and nine SA1 afferents above them are to fire
# at wanted rates. A full scan of the cell that was found says what they would do.
#
#     python demos/validation/cell_design.py results/cell_design
#
# Expected time: a minute or two.

# %%
import time
from pathlib import Path

import numpy as np
import shapely
from scipy.optimize import least_squares

from tactile_fem import Study, run_script, scan, write_table
from tactile_fem.neuron import respond
from tactile_fem.study import Drawing, Hold, Press, Protocol, Receptors
from tactile_fem.surrogate import FastFinger, HeightMap

FINGER = Path(__file__).parents[2] / "meshes" / "fast_finger.npz"
SPACING_MM, RADIUS_MM, FILLET_MM = 2.5, 0.8, 0.1
LEAST_MM, LARGEST_MM, DEPTH_MM, HOLD_S = 0.1, 1.0, 1.6, 0.5
# One row of the cell after the other, spikes/s.
WANTED_HZ = np.array([[40.0, 10.0, 40.0], [10.0, 40.0, 10.0], [40.0, 10.0, 40.0]])
CENTRES = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)]) * SPACING_MM


# %%
def route(highest_mm: float) -> Protocol:
    """Return the press of a cell, its plate always equally deep, and the hold."""
    depth = DEPTH_MM - LARGEST_MM + highest_mm
    return Protocol(path=(Press(depth_mm=depth), Hold(time_s=HOLD_S, output_s=0.05)))


def cell(heights_mm: np.ndarray) -> HeightMap:
    """Return the heights of nine round dots with filleted edges, over their highest possible."""
    spacing, half = 0.1, 8.0
    axis = np.arange(-half, half + spacing / 2, spacing)
    points = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    body = HeightMap.of_array(np.zeros((len(axis), len(axis))), spacing)
    top = np.full(points.shape[:2], -LARGEST_MM)
    for centre, height in zip(CENTRES, heights_mm, strict=True):
        fillet = min(FILLET_MM, height)
        beyond = np.linalg.norm(points - centre, axis=-1) - (RADIUS_MM - fillet)
        round_mm = np.sqrt(np.maximum(fillet**2 - np.maximum(beyond, 0) ** 2, 0)) - fillet
        dot = np.where(beyond < fillet, height + round_mm, 0.0)
        top = np.maximum(top, dot - LARGEST_MM)
    return HeightMap(body.grid, top)


def sed_of_rates(rates_Hz: np.ndarray) -> np.ndarray:
    """Return the energy densities in kPa at which afferents fire so often while they are held."""
    sed, time_s = np.geomspace(0.01, 30, 300), np.array([0.0, 0.05, HOLD_S + 0.05])
    history = np.array([[0.0], [1.0], [1.0]]) * sed
    held = respond(time_s, history).mean_rate(0.05, HOLD_S + 0.05)
    # The least energy density of each rate.
    rate, first = np.unique(np.maximum.accumulate(held), return_index=True)
    return np.interp(rates_Hz, rate, sed[first])


def held_sed(finger: FastFinger, cells: list[HeightMap]) -> np.ndarray:
    """Return the energy densities at the nine afferents at the end of the hold, (cells, 9)."""
    path = route(LARGEST_MM).route(DEPTH_MM)
    traces = finger.scan_all(cells, path, receptors_mm=CENTRES)
    return np.array([trace.sed_kPa[-1] for trace in traces])


def design(finger: FastFinger, wanted_kPa: np.ndarray) -> np.ndarray:
    """Return the nine heights whose energy densities are nearest to the wanted ones."""
    step = 0.02

    def error(heights: np.ndarray) -> np.ndarray:
        return np.sqrt(held_sed(finger, [cell(heights)])[0]) - np.sqrt(wanted_kPa)

    def slopes(heights: np.ndarray) -> np.ndarray:
        signs = np.where(heights + step > LARGEST_MM, -1.0, 1.0)
        moved = [cell(heights + step * s * one) for s, one in zip(signs, np.eye(9), strict=True)]
        roots = np.sqrt(held_sed(finger, [cell(heights), *moved]))
        return ((roots[1:] - roots[0]) / (step * signs)[:, None]).T

    found = least_squares(
        error, np.full(9, 0.5), slopes, bounds=(LEAST_MM, LARGEST_MM), diff_step=step, max_nfev=25
    )
    return found.x


def drawing(heights_mm: np.ndarray) -> Drawing:
    """Return the cell as a full scan takes it."""
    dots = [shapely.Point(centre).buffer(RADIUS_MM, quad_segs=32) for centre in CENTRES]
    return Drawing(
        polygons=dots, relief_mm=heights_mm.round(3).tolist(), fillet_radius_mm=FILLET_MM
    )


def full_rates(heights_mm: np.ndarray, folder: Path) -> np.ndarray:
    """Return the rates in the hold of a full scan of the cell."""
    study = Study(
        stimulus=drawing(heights_mm),
        protocol=route(float(heights_mm.max())),
        receptors=Receptors(half_width_mm=0.0, extra_mm=[tuple(c) for c in CENTRES if c.any()]),
    )
    result = scan(study, folder)
    places = result.trace.receptors_mm[:, :2]
    order = [int(np.linalg.norm(places - centre, axis=1).argmin()) for centre in CENTRES]
    return result.response.mean_rate(0.0, HOLD_S)[order]


def main(folder: Path, *, finger: Path = FINGER) -> None:
    """Design a cell, and check it.

    Parameters
    ----------
    folder
        Folder for the full scan and the table.
    finger
        The fast finger.
    """
    fast = FastFinger.read(finger)
    begun = time.perf_counter()
    heights = design(fast, sed_of_rates(WANTED_HZ.ravel()))
    print(f"designed in {time.perf_counter() - begun:.1f} s")
    path = route(LARGEST_MM).route(DEPTH_MM)
    trace = fast.scan(cell(heights), path, receptors_mm=CENTRES)
    fast_Hz = fast.respond(trace).mean_rate(0.0, HOLD_S)
    full_Hz = full_rates(heights, folder / "full")
    rows = [
        {"x_mm": x, "y_mm": y, "height_mm": h, "wanted_Hz": w, "fast_Hz": f, "full_Hz": g}
        for (x, y), h, w, f, g in zip(
            CENTRES, heights.round(3), WANTED_HZ.ravel(), fast_Hz, full_Hz, strict=True
        )
    ]
    write_table(folder / "cell_design.csv", rows)
    for row in rows:
        print("  ".join(f"{name} {value:6.2f}" for name, value in row.items()))
    print(f"r of wanted and full rates: {np.corrcoef(WANTED_HZ.ravel(), full_Hz)[0, 1]:.3f}")


if __name__ == "__main__":
    run_script(main)
