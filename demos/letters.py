# %% [markdown]
# # The letters F G H pass under a fingertip
#
# This demo emphasizes
# - how a study is written in Python and run on any number of ranks,
# - what a scan returns: forces, strain energy density at the receptors, spikes,
# - what it cost: steps, Newton iterations, time and memory.
#
# A layered fingertip is pressed $d = 1.97$ mm deep onto embossed letters that then slide 10 mm at
# 20 mm/s with friction $\mu = 0.3$ (Hamasaki et al. 2020, DOI 10.1177/1687814020984651). In each
# step PETSc's SNES finds the displacement $u$ with
#
# $$\int_\Omega P(u) : \nabla v\, dx - \int_\Gamma s(u)\cdot v\, dA = 0 \quad \forall v,$$
#
# where the contact traction $s$ is Nitsche's: $s_n = [t\cdot\nu - \gamma_h g]_+$ along the
# obstacle's normal $\nu$ and Coulomb's law for $t_t - \gamma_h\,\mathrm{slip}$ across it.
#
#     python demos/letters.py results/letters
#     mpirun -n 2 python demos/letters.py results/letters
#     python demos/letters.py results/short --distance 0.4

# %%
from pathlib import Path

import numpy as np

from tactile_fem import Results, Study, draw, run_script, scan
from tactile_fem.output.histories import central_receptor
from tactile_fem.study import Protocol, Text

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)


# %% [markdown]
# Every value of a study has the paper's default; only the values that are changed most often are
# parameters here.


# %%
def main(folder: Path, *, text: str = "FGH", depth: float = 1.97, distance: float = 10.0) -> None:
    """Scan a text and print its results and cost."""
    study = Study(
        stimulus=Text(text=text),
        protocol=Protocol(depth_mm=depth, distance_mm=distance),
    )
    rank = MPI.COMM_WORLD.rank
    result = scan(study, folder)
    if rank == 0:
        print_results(result)
        for path in draw(folder):
            print(path)


# %% [markdown]
# The numbers: force at full depth and during the slide, the central receptor, spikes, cost.


# %%
def print_results(result) -> None:
    """Print the numbers of a scan."""
    trace, run_ = result.trace, Results.open(result.folder).run
    pressed = int(np.flatnonzero(trace.displacement_mm == 0)[-1])
    sliding = slice(pressed, None)
    normal, along = trace.force_N[sliding, 2], trace.force_N[sliding, 1]
    sed = trace.sed_kPa[sliding, central_receptor(trace.receptors_mm)]
    print(f"normal force at {trace.depth_mm[-1]:.2f} mm       {normal[0]:.3f} N")
    print(f"normal force in the slide     {normal.min():.3f} to {normal.max():.3f} N")
    print(f"tangential / normal at end    {-along[-1] / normal[-1]:.3f}")
    print(f"contact force minus reaction  {trace.imbalance_N.max():.1e} N at most")
    print(f"SED of the central receptor   {sed.min():.3f} to {sed.max():.3f} kPa")
    print(f"spikes                        {sum(map(len, result.response.spikes))}")
    print(f"tetrahedra, unknowns          {run_['mesh']['tetrahedra']}, {run_['mesh']['unknowns']}")
    steps, newton = len(trace.time_s) - 1, trace.newton_iterations.sum()
    print(f"steps, Newton iterations      {steps}, {newton} ({newton / steps:.1f} per step)")
    print(f"ranks, wall time, memory      {run_['ranks']}, {run_['wall_s']:.0f} s, ", end="")
    print(f"{run_['peak_memory_MB']:.0f} MB")


# %%
if __name__ == "__main__":
    run_script(main)
