"""The Jacobian in two parts: what it multiplies by is what is assembled, on any number of ranks."""

from __future__ import annotations

import numpy as np
import pytest
from sphere_on_block import sphere_on_block

from petsc4py import PETSc  # isort: skip

from dolfinx.fem import petsc as fem_petsc

from tactile_fem.solvers.finger_problem import FingerProblem
from tactile_fem.study import Tissue

TISSUES = [{"set": "proposed"}, {"relaxation": "fingerpad"}]


def pressed(tissue: dict, **solver) -> FingerProblem:
    """Return a block under a sphere that slides, at a converged state."""
    made = sphere_on_block(Tissue.model_validate(tissue), **solver)
    for place in ((0, 0, 0.15), (0, 0, 0.3), (0, -0.05, 0.3)):
        made.state.reset()
        assert made.solve(np.array(place, dtype=float), 0.5).converged
        made.accept()
    return made


def entries(made: FingerProblem) -> tuple[PETSc.Mat, PETSc.Mat]:
    """Return the present Jacobian as `fill` puts it together, and as PETSc assembles the forms."""
    jacobian, filled = made.solver._jacobian, made.solver.snes.getJacobian()[1]
    jacobian.assemble_bulk()
    jacobian.assemble_contact()
    jacobian.fill()
    assembled = filled.duplicate()
    parts = [filled.duplicate(), filled.duplicate()]
    # Dirichlet conditions put a one on the diagonal, of the sum of the parts once.
    for part, form, diagonal in zip(
        parts, (jacobian._bulk_form, jacobian._contact()), (1.0, 0.0), strict=True
    ):
        fem_petsc.assemble_matrix(part, form, made.bcs, diag=diagonal)
        part.assemble()
        assembled.axpy(1.0, part)
    return filled, assembled


@pytest.mark.ranks
@pytest.mark.parametrize("linear", ["multigrid", "direct"])
@pytest.mark.parametrize("tissue", TISSUES, ids=["elastic", "relaxing"])
def test_it_has_the_entries_that_petsc_assembles(tissue, linear):
    filled, assembled = entries(pressed(tissue, linear=linear))
    size = assembled.norm()
    assembled.axpy(-1.0, filled)
    assert assembled.norm() < 1e-14 * size


@pytest.mark.ranks
@pytest.mark.parametrize("tissue", TISSUES, ids=["elastic", "relaxing"])
def test_products_are_those_of_its_entries(tissue):
    made = pressed(tissue)
    filled, _ = entries(made)
    operator = made.solver.snes.getJacobian()[0]
    assert operator.getType() == "python"
    x, wanted = filled.createVecs()
    first, _ = x.getOwnershipRange()
    x.array = np.random.default_rng(0).normal(size=x.getSize())[first : first + len(x.array)]
    found = wanted.duplicate()
    for way in ("mult", "multTranspose"):
        getattr(filled, way)(x, wanted)
        getattr(operator, way)(x, found)
        size = wanted.norm()
        found.axpy(-1.0, wanted)
        assert found.norm() < 1e-14 * size


def is_symmetric(matrix: PETSc.Mat) -> bool:
    whole = matrix.convert("dense", out=PETSc.Mat()).getDenseArray()
    return bool(np.abs(whole - whole.T).max() < 1e-14 * np.abs(whole).max())


@pytest.mark.parametrize("tissue", TISSUES, ids=["elastic", "relaxing"])
@pytest.mark.parametrize("inertia", [False, True])
def test_the_tissues_part_is_as_symmetric_as_the_products_take_it(tissue, inertia):
    made = pressed(tissue, inertia=inertia)
    part = made.solver.snes.getJacobian()[1].duplicate()
    fem_petsc.assemble_matrix(part, made.solver._jacobian._bulk_form, made.bcs)
    part.assemble()
    assert (
        is_symmetric(part) == all(term.is_symmetric for term in made.bulk) == (tissue is TISSUES[0])
    )


@pytest.mark.ranks
def test_another_tangent_leaves_no_trace():
    """Sensitivities linearize with the exact one; the next step goes on with the kept one."""
    made = pressed(TISSUES[0])
    filled, _ = entries(made)
    before = filled.copy()
    with made.solver.linearized():
        made.solver._jacobian.fill()
        exact = filled.copy()
    exact.axpy(-1.0, before)
    assert exact.norm() > 1e-9 * before.norm()  # it has more quadrature points
    made.solver._jacobian.fill()
    filled.axpy(-1.0, before)
    assert filled.norm() == 0
