# %% [markdown]
# # How fine a mesh ridges need
#
# This demo emphasizes
# - convergence of strain energy density at the tips of intermediate ridges and papillae, of force
#   and area of contact, in the number of edges to a ridge.
#
# The ridged section of `fingerprints.py` is pressed on the edge and slid. All meshes are compared
# with the last, the finest.
#
#     python demos/sections/ridge_mesh.py results/ridge_mesh --jobs 2
#     python demos/sections/ridge_mesh.py results/quick --edges 4 5 --force 0.005 --distance 0.1

# %%
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from fingerprints import PITCH_MM, RIDGED, Scan, near

from tactile_fem import Results, run_script, write_table
from tactile_fem.series import Member, complete_scans, run_series


@dataclass(frozen=True)
class Row:
    """The last state with one mesh, and the cost of the scan."""

    edges: float
    triangles: int
    depth_mm: float
    area_mm: float
    tangential_N_mm: float
    ridges_kPa: float
    papillae_kPa: float
    ridges_rms: float
    wall_s: float


# %%
def main(
    folder: Path,
    *,
    edges: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (4, 6, 8, 12),
    distance: float = 0.5,
    force: float = 0.06,
    jobs: int = 1,
) -> None:
    """Press and slide an edge with meshes of so many edges to a ridge.

    Parameters
    ----------
    edges
        The last is what the others are compared with.
    distance, force
        Slide, mm; normal force at its start, N/mm.
    jobs
        Scans at a time.
    """
    members = [
        Member(
            f"edges_{count:g}",
            Scan(RIDGED, "edge").study(distance, force, round(PITCH_MM / count, 5)),
            {"edges": count},
        )
        for count in edges
    ]
    run_series(members, folder, jobs=jobs)
    scans = complete_scans(members, folder)
    if len(scans) < len(members):
        return
    rows = [row(count, results, scans[-1]) for count, results in zip(edges, scans, strict=True)]
    for r in rows:
        print(
            f"{r.edges:g} edges to a ridge, {r.triangles} triangles: depth {r.depth_mm:.4f} mm, "
            f"contact {r.area_mm:.3f} mm, {r.tangential_N_mm:.5f} N/mm across; SED at ridges "
            f"{r.ridges_kPa:.4f}, papillae {r.papillae_kPa:.4f} kPa; rms from the finest "
            f"{100 * r.ridges_rms:.2f} % of its largest; {r.wall_s:.0f} s"
        )
    write_table(folder / "ridge_mesh.csv", rows)


def row(count: float, results: Results, finest: Results) -> Row:
    """Return the numbers of one mesh at the end of the slide."""
    trace = results.trace
    sed, best = (r.trace["sed_kPa"][-1, near(r, "SA1")] for r in (results, finest))
    return Row(
        count,
        results.run["mesh"]["triangles"],
        float(trace["depth_mm"][-1]),
        float(trace["contact_area_mm2"][-1]),
        float(abs(trace["force_N"][-1, 1])),
        float(sed.mean()),
        float(trace["sed_kPa"][-1, near(results, "RA")].mean()),
        float(np.sqrt(np.mean((sed - best) ** 2)) / best.max()),
        float(trace["wall_s"].sum()),
    )


if __name__ == "__main__":
    run_script(main)
