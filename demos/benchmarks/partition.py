# %% [markdown]
# # Partition of the finger on many ranks
#
# This benchmark emphasizes
# - how evenly the work is distributed: cells, and skin facets, where the contact is integrated,
# - the communication between ranks: ghost nodes, neighbours, lines cut by the partition,
# - without solving anything, so that one computer can analyse 64 ranks.
#
#     mpirun -n 16 python demos/benchmarks/partition.py --preset paper

# %%
import numpy as np

from tactile_fem import run_script
from tactile_fem.finger.mesh_data import SURFACES
from tactile_fem.mechanics.domain import NodeOrder, create_domain
from tactile_fem.runtime.ranks import on_root
from tactile_fem.study import Finger, Solver

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)
from dolfinx import fem  # isort: skip


# %%
def main(*, preset: str = "coarse") -> None:
    """Distribute the finger and print minimum, mean and maximum over the ranks."""
    comm = MPI.COMM_WORLD
    finger = on_root(comm, lambda: Finger(preset=preset).mesh(), share=False)
    domain = create_domain(finger, comm, Solver().held)
    space = fem.functionspace(domain.mesh, ("Lagrange", 2, (3,)))
    nodes = space.dofmap.index_map
    corners = domain.mesh.topology.index_map(0)
    first, end = nodes.local_range
    lines = NodeOrder(domain, space).blocks()
    whole = [np.all((line >= first) & (line < end), axis=1) for line in lines if line.shape[1] > 1]
    cut = sum(np.count_nonzero(~inside) for inside in whole)
    numbers = {
        "cells": domain.mesh.topology.index_map(3).size_local,
        "skin facets": len(domain.surface.find(SURFACES["skin"])),
        "P2 nodes": nodes.size_local,
        "ghost P2 nodes": nodes.num_ghosts,
        "P1 nodes": corners.size_local,
        "neighbours": len(set(nodes.owners.tolist())),
        "lines": sum(map(len, whole)),
        "lines cut": cut,
    }
    for name, mine in numbers.items():
        every = comm.gather(mine)
        if comm.rank == 0:
            row = f"{min(every):>9}{np.mean(every):>11.1f}{max(every):>9}"
            print(f"{name:16}{row}   imbalance {max(every) / max(np.mean(every), 1e-9):.2f}")


# %%
if __name__ == "__main__":
    run_script(main)
