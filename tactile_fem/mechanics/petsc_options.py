"""PETSc's options: the package's defaults, then the study's, then those of PETSC_OPTIONS."""

from __future__ import annotations

from petsc4py import PETSc

from tactile_fem.errors import StudyError
from tactile_fem.mechanics.faults import last_line
from tactile_fem.mechanics.multigrid import MULTIGRID_OPTIONS
from tactile_fem.study import Solver

PetscOption = str | int | float | bool
PREFIX = "tactile_"

NEWTON: dict[str, PetscOption] = {
    "snes_type": "newtonls",
    "snes_linesearch_type": "bt",
    "snes_linesearch_order": 1,
    "snes_linesearch_minlambda": 5e-3,  # shorter steps lead nowhere
    "snes_atol": 1e-8,
    "snes_rtol": 1e-14,
    "snes_stol": 0.0,
    "snes_max_it": 25,
    "snes_error_if_not_converged": False,
    "snes_max_linear_solve_fail": 1000,
}
LINEAR: dict[str, dict[str, PetscOption]] = {
    "multigrid": {
        "ksp_type": "fgmres",
        "ksp_max_it": 25,
        "snes_ksp_ew": True,
        # Loose while Newton's method looks for what touches: closer solves lead astray.
        "snes_ksp_ew_rtol0": 0.3,
        "snes_ksp_ew_rtolmax": 0.3,
        **MULTIGRID_OPTIONS,
    },
    "direct": {
        "ksp_type": "preonly",
        "pc_type": "lu",
        "pc_factor_mat_solver_type": "mumps",
    },
}
_FROM_ENVIRONMENT: dict[str, PetscOption] = dict(PETSc.Options(PREFIX).getAll())


def check_options(solver: Solver) -> None:
    """Let PETSc read the options once, on a solver that has nothing to solve.

    Raises
    ------
    StudyError
        PETSc refuses one. Options of the parts of multigrid are read later.
    """
    set_options(solver)
    trial = PETSc.SNES().create(PETSc.COMM_SELF)
    trial.setOptionsPrefix(PREFIX)
    try:
        trial.setFromOptions()
    except PETSc.Error as error:
        raise StudyError(
            f"PETSc refuses its options ({last_line(error)}): look at [solver.petsc] and at the "
            "options that start with -tactile_."
        ) from error
    finally:
        trial.destroy()


def set_options(solver: Solver) -> dict[str, PetscOption]:
    """Put the options into PETSc's database and return them, without the prefix.

    They stay there, since multigrid reads its own at the first solve; those of an earlier
    problem go.
    """
    database = PETSc.Options(PREFIX)
    for name in database.getAll():
        del database[name]
    options = {**NEWTON, **LINEAR[solver.linear], **solver.petsc, **_FROM_ENVIRONMENT}
    for name, value in options.items():
        database[name] = value
    whole = PETSc.Options()
    if not whole.hasName("options_left"):
        whole["options_left"] = False  # a press without contact uses few of them
    return options
