"""PETSc's options: the package's defaults, then the study's, then those of PETSc's database.

Users write ``-tactile_snes_monitor``, which applies to every problem. PETSc stores all options of
a process in one table, so each problem has its own copy there, under its own prefix.
"""

from __future__ import annotations

from collections.abc import Mapping

from mpi4py import MPI
from petsc4py import PETSc

from tactile_fem.errors import StudyError
from tactile_fem.mechanics.faults import last_line
from tactile_fem.solvers.multigrid import MULTIGRID_OPTIONS
from tactile_fem.study import Solver

PetscOption = str | int | float | bool
USER_PREFIX = "tactile_"

NEWTON: dict[str, PetscOption] = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "bt",
    "snes_linesearch_order": 1,
    "snes_linesearch_minlambda": 5e-3,  # shorter steps do not converge
    "snes_atol": 1e-8,
    "snes_rtol": 1e-14,
    "snes_stol": 0.0,
    "snes_max_it": 25,
    "snes_error_if_not_converged": False,
    "snes_max_linear_solve_fail": 1000,
}
PLAIN: dict[str, PetscOption] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}
LINEAR: dict[str, dict[str, PetscOption]] = {
    "multigrid": {
        "ksp_type": "fgmres",
        "ksp_max_it": 25,
        "snes_ksp_ew": True,
        # Coarse while Newton's method searches the contact zone: accurate solves mislead it.
        "snes_ksp_ew_rtol0": 0.3,
        "snes_ksp_ew_rtolmax": 0.3,
        **MULTIGRID_OPTIONS,
    },
    "direct": PLAIN,
}
# Of all problems: a press without contact uses few options; products of vectors by BLAS's dgemv
# are rounded as the vectors' addresses have it, so that no scan would repeat its iterations.
_OFF = ("options_left", "vec_mdot_use_gemv", "vec_maxpy_use_gemv")
_latest = 0  # number in the latest prefix


def check_options(solver: Solver) -> None:
    """Let PETSc read the options once, on a solver without a problem.

    Raises
    ------
    StudyError
        PETSc rejects an option. Options of multigrid's components are read later.
    """
    prefix = set_options(options_of(solver), MPI.COMM_SELF)
    trial = PETSc.SNES().create(PETSc.COMM_SELF)
    trial.setOptionsPrefix(prefix)
    try:
        trial.setFromOptions()
    except PETSc.Error as error:
        raise StudyError(
            f"PETSc refuses its options ({last_line(error)}): look at [solver.petsc] and at the "
            "options that start with -tactile_."
        ) from error
    finally:
        trial.destroy()
        clear_options(prefix)


def options_of(solver: Solver) -> dict[str, PetscOption]:
    """Return a problem's options without a prefix: defaults, the study's, PETSc's database.

    The database's options are those that start with ``tactile_`` at this moment, whether set by
    ``PETSC_OPTIONS`` or by a script. They take precedence.
    """
    return {
        **NEWTON,
        **LINEAR[solver.linear],
        **solver.petsc,
        **PETSc.Options(USER_PREFIX).getAll(),
    }


def set_options(options: Mapping[str, PetscOption], comm: MPI.Comm) -> str:
    """Put a problem's options into PETSc's database, until `clear_options`; return their prefix.

    They have to stay there because multigrid reads its options at the first solve. The prefix is
    unique to the problem and the same on all ranks of `comm`.
    """
    global _latest
    _latest = comm.allreduce(_latest, op=MPI.MAX) + 1
    prefix = f"tactile{_latest}_"
    database = PETSc.Options(prefix)
    for name, value in options.items():
        database.setValue(name, value)
    whole = PETSc.Options()
    for name in _OFF:
        if not whole.hasName(name):
            whole.setValue(name, False)
    return prefix


def clear_options(prefix: str) -> None:
    """Remove a problem's options from PETSc's database."""
    database = PETSc.Options(prefix)
    for name in database.getAll():
        database.delValue(name)
