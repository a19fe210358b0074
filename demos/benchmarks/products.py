# %% [markdown]
# # Products with the Jacobian
#
# This benchmark emphasizes
# - how long a product with the tissues' tangent takes in the formats at hand: seven of them make up
#   a linear iteration,
# - that memory is slow only where it is asked late: all formats read each number once.
#
#     python demos/benchmarks/products.py --preset coarse
#     mpirun -n 2 python demos/benchmarks/products.py --preset paper

# %%
import time
from collections.abc import Callable

import numpy as np

from tactile_fem import run_script
from tactile_fem.mechanics.compile import jit_options
from tactile_fem.mechanics.domain import create_domain
from tactile_fem.mechanics.problem import Problem
from tactile_fem.runtime.ranks import on_root
from tactile_fem.solvers.block_products import BlockProduct
from tactile_fem.study import Finger, Plate, Solver, Tissue

from petsc4py import PETSc  # isort: skip
from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)
from dolfinx import fem, la  # isort: skip
from dolfinx.fem import petsc as fem_petsc  # isort: skip


FLAGS = Solver().compiler_flags


# %% [markdown]
# ## The tangent of the undeformed finger


# %%
def tangent(preset: str, comm: MPI.Comm) -> fem.Form:
    """Return the tissues' tangent."""
    finger = on_root(comm, lambda: Finger(preset=preset).mesh(), share=False)
    solver = Solver()
    domain = create_domain(finger, comm, solver.held)
    problem = Problem(domain, Tissue(), Plate().body(), 0.3, solver)
    problem.begin_step(np.zeros(3), dt_s=0.01)
    form = problem.bulk.tangent(problem.test)
    return fem.form(form, jit_options=jit_options(FLAGS))


# %% [markdown]
# ## The formats
#
# PETSc multiplies 3 x 3 blocks by a loop of its own or, with `mat_no_unroll`, by BLAS.


# %%
def petsc(form: fem.Form, kind: str, *, blas: bool = False) -> PETSc.Mat:
    """Return the tangent as a matrix of PETSc's."""
    options = PETSc.Options()
    if blas:
        options["mat_no_unroll"] = True
    matrix = fem_petsc.create_matrix(form, kind=kind)
    fem_petsc.assemble_matrix(matrix, form)
    matrix.assemble()
    if blas:
        del options["mat_no_unroll"]
    return matrix


def csr(form: fem.Form) -> la.MatrixCSR:
    """Return the tangent as DOLFINx's own matrix."""
    matrix = fem.create_matrix(form, block_mode=la.BlockMode.compact)
    fem.assemble_matrix(matrix, form)
    matrix.scatter_reverse()
    return matrix


def in_single_precision(exact: la.MatrixCSR, form: fem.Form) -> la.MatrixCSR:
    """Return a copy of the form's matrix."""
    pattern = fem.create_sparsity_pattern(form)
    pattern.finalize()
    matrix = la.matrix_csr(pattern, block_mode=la.BlockMode.compact, dtype=np.float32)
    matrix.data[:] = exact.data
    return matrix


def milliseconds(multiply: Callable[[], None], comm: MPI.Comm, times: int) -> float:
    """Return the time of a product, the mean of many after one."""
    multiply()
    comm.barrier()
    started = time.perf_counter()
    for _ in range(times):
        multiply()
    comm.barrier()
    return 1000 * (time.perf_counter() - started) / times


# %%
def main(*, preset: str = "coarse", times: int = 50) -> None:
    """Print how long a product takes in each format, and by how much it differs from PETSc's."""
    comm = MPI.COMM_WORLD
    form = tangent(preset, comm)
    reference = petsc(form, "baij")
    x, y = reference.createVecs()
    first, end = x.getOwnershipRange()
    x.array = np.random.default_rng(0).normal(size=x.getSize())[first:end]
    reference.mult(x, y)
    wanted, own = y.array.copy(), len(y.array)

    def tell(name: str, megabytes: float, multiply: Callable[[], None], found: np.ndarray) -> None:
        found[:] = 0.0  # some products add
        multiply()
        error = comm.allreduce(np.abs(found[:own] - wanted).max(), MPI.MAX)
        scale = comm.allreduce(np.abs(wanted).max(), MPI.MAX)
        taken = milliseconds(multiply, comm, times)
        if comm.rank == 0:
            print(f"{name:34}{megabytes:8.1f} MB{taken:9.2f} ms   {error / scale:.1e}", flush=True)

    for name, kind, blas in (
        ("AIJ", "aij", False),
        ("BAIJ", "baij", False),
        ("BAIJ, BLAS", "baij", True),
    ):
        matrix = petsc(form, kind, blas=blas)
        size = matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"] * 8e-6
        tell(f"PETSc's {name}", size, lambda: matrix.mult(x, y), y.array_w)
        matrix.destroy()
    exact = csr(form)
    for matrix in (exact, in_single_precision(exact, form)):
        dtype = matrix.data.dtype
        given, result = (la.vector(matrix.index_map(k), 3, dtype=dtype) for k in (1, 0))
        given.array[:own] = x.array
        size = comm.allreduce(matrix.data.nbytes) * 1e-6
        name = f"DOLFINx's MatrixCSR, {dtype.name}"
        tell(name, size, lambda: matrix.mult(given, result), result.array)
    result = np.zeros(own)
    for name, is_symmetric in (
        ("ours, all blocks", False),
        ("ours, blocks up to the diagonal", True),
    ):
        product = BlockProduct(exact, jit_options(FLAGS), is_symmetric=is_symmetric)
        product.take()
        size = comm.allreduce(exact.data.nbytes) * (1e-6 if not is_symmetric else 0.5e-6)
        tell(name, size, lambda: product.add(x.array_r, result), result)


# %%
if __name__ == "__main__":
    run_script(main)
