"""A tissue with fibres: a law of one file, and a field on the mesh."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import LAYERS, block_mesh
from fibres import Fibred
from scipy.optimize import fsolve

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from sphere_on_block import PRESS_AND_SLIDE, TWO_TISSUES, follow, sphere_on_block
from terms import Bulk

from tactile_fem.errors import MeshError, StudyError
from tactile_fem.finger import read_mesh, write_mesh
from tactile_fem.mechanics.domain import create_domain, roller
from tactile_fem.simulation.checks import check
from tactile_fem.solvers.fast import FastSolver
from tactile_fem.solvers.options import LINEAR, NEWTON
from tactile_fem.solvers.plain import PlainSolver
from tactile_fem.study import Material, Tissue
from tactile_fem.study.file import dump_study, load_study

CONSTANTS = {"C10_MPa": 0.01, "k1_MPa": 0.05, "k2": 2.0, "D1_per_MPa": 5.0}
LAW = "tissue.subcutaneous={law='fibred', C10_MPa=0.01, k1_MPa=0.05, D1_per_MPa=5}"
X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@pytest.fixture(autouse=True)
def known(monkeypatch):
    monkeypatch.setitem(Material.kinds, "fibred", Fibred)


def with_fibres(mesh, direction):
    return mesh.with_field("fibre", lambda x: np.tile(direction, (len(x), 1)))


def principal_stress(c: Fibred, stretch: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the principal first Piola stresses, differentiated by hand."""
    J, square = stretch.prod(), stretch**2
    I1, I4 = J ** (-2 / 3) * square.sum(), J ** (-2 / 3) * square @ along**2
    dI1 = J ** (-2 / 3) * 2 * stretch - 2 / 3 * I1 / stretch
    dI4 = J ** (-2 / 3) * 2 * stretch * along**2 - 2 / 3 * I4 / stretch
    E = max(I4 - 1, 0.0)
    return (
        c.C10_MPa * dI1
        + c.k1_MPa * E * np.exp(c.k2 * E**2) * dI4
        + 2 / c.D1_per_MPa * (J - 1) * J / stretch
    )


@pytest.mark.ranks
@pytest.mark.parametrize("direction", [X, Z])
@pytest.mark.parametrize("pull", [1.25, 0.8])
def test_a_block_is_pulled_as_the_closed_form_says(direction, pull):
    """Along its fibres and across them, Z being the pull; of a push those across are stretched."""
    law, along = Fibred(**CONSTANTS), np.array(direction)
    line = np.linspace(0.0, 1.0, 3)
    mesh = with_fibres(block_mesh(line, line, line, ["dermis"] * 2), direction)
    domain = create_domain(mesh if MPI.COMM_WORLD.rank == 0 else None, MPI.COMM_WORLD)
    bulk = Bulk(domain, Tissue(viscous_time_s=0.0, dermis=law))
    bcs = [roller(bulk.V, axis, lambda x, k=axis: np.isclose(x[k], 0)) for axis in range(3)]
    moved = roller(bulk.V, 2, lambda x: np.isclose(x[2], 1))
    moved.g.x.array[:] = pull - 1
    problem = fem_petsc.NonlinearProblem(
        bulk.residual(ufl.TestFunction(bulk.V)),
        bulk.u,
        bcs=[*bcs, moved],
        petsc_options_prefix="fibres_",
        petsc_options={**NEWTON, **LINEAR["direct"], "snes_atol": 1e-12},
    )
    problem.solve()
    assert problem.solver.getConvergedReason() > 0
    sides = fsolve(lambda s: principal_stress(law, np.array([*s, pull]), along)[:2], [1.0, 1.0])
    stretch = np.array([*sides, pull])
    P, dx = bulk.stress("dermis"), ufl.Measure("dx", domain.mesh)  # of a volume of 1
    means = [fem.assemble_scalar(fem.form(P[i, j] * dx)) for i in range(3) for j in range(3)]
    found = np.reshape([domain.comm.allreduce(mean) for mean in means], (3, 3))
    expected = principal_stress(law, stretch, along)
    np.testing.assert_allclose(found, np.diag(expected), atol=1e-8)
    without = principal_stress(law.model_copy(update={"k1_MPa": 0.0}), stretch, along)
    carries = (pull > 1) == (direction == Z)
    assert (abs(expected[2]) > 1.1 * abs(without[2])) == carries


@pytest.mark.ranks
def test_both_solvers_find_the_same(monkeypatch):
    """Under a sphere; a third of the skin moves otherwise than with fibres across."""
    tissue = Tissue(viscous_time_s=0.004, subcutaneous=Fibred(**CONSTANTS))
    found = []
    for make_solver, direction in ((FastSolver, X), (PlainSolver, X), (FastSolver, Z)):
        monkeypatch.setattr(
            "sphere_on_block.block_mesh", lambda *own, a=direction: with_fibres(block_mesh(*own), a)
        )
        made = sphere_on_block(tissue, make_solver=make_solver, count=2, layers=TWO_TISSUES)
        found.append(follow(made, *PRESS_AND_SLIDE).force_N)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7)
    assert abs(found[2][2] / found[0][2] - 1) > 0.01


def test_a_field_is_read_back_and_belongs_to_the_mesh(tmp_path):
    line = np.linspace(0.0, 1.0, 2)
    plain = block_mesh(line, line, line, ["dermis"])
    mesh = plain.with_field("fibre", np.eye(3)[np.arange(len(plain.cells)) % 3])
    write_mesh(tmp_path / "m.npz", mesh)
    again = read_mesh(tmp_path / "m.npz")
    np.testing.assert_array_equal(again.fields["fibre"], mesh.fields["fibre"])
    assert again.hash == mesh.hash != plain.hash
    assert with_fibres(plain, X).hash != mesh.hash
    with pytest.raises(MeshError, match="holds no fields"):
        write_mesh(tmp_path / "m.msh", mesh)
    with pytest.raises(MeshError, match="field fibre of the mesh needs a finite value for each"):
        mesh.with_field("fibre", np.full((3, 3), np.nan)).check()


@pytest.mark.ranks
def test_each_rank_has_the_values_of_its_cells():
    line = np.linspace(0.0, 1.0, 3)
    mesh = block_mesh(line, line, line, LAYERS[2:]).with_field("fibre", lambda x: x)
    domain = create_domain(mesh if MPI.COMM_WORLD.rank == 0 else None, MPI.COMM_WORLD)
    x = ufl.SpatialCoordinate(domain.mesh)
    off = domain.fields["fibre"] - x
    mean = [fem.assemble_scalar(fem.form(off[k] * ufl.dx)) for k in range(3)]
    np.testing.assert_allclose(mean, 0.0, atol=1e-15)


def test_a_study_states_it(tmp_path, small_finger):
    write_mesh(tmp_path / "m.npz", with_fibres(read_mesh(small_finger), X))
    finger = f"finger.mesh_file={tmp_path / 'm.npz'}"
    study = load_study(None, [LAW, finger])
    assert study.tissue.subcutaneous == Fibred(**{**CONSTANTS, "k2": 1.0})
    check(study)
    (tmp_path / "s.toml").write_text(dump_study(study))
    assert load_study(tmp_path / "s.toml") == study
    for settings, sentence in [
        ([LAW], 'tissues needs the field "fibre"; the finger has no fields'),
        ([LAW, finger, "tissue.relaxation=fingerpad"], "subcutaneous relaxes .* needs a method"),
    ]:
        with pytest.raises(StudyError, match=sentence):
            check(load_study(None, settings))
    with pytest.raises(StudyError, match='k1 is not a key of a material of law "fibred"'):
        load_study(None, [LAW, "tissue.subcutaneous.k1=3"])
    del Material.kinds["fibred"]
    there = load_study(tmp_path / "s.toml", saved=True)
    assert dump_study(there) == dump_study(study)
    with pytest.raises(StudyError, match='"fibred", which is no kind of material'):
        load_study(tmp_path / "s.toml")
    with pytest.raises(StudyError, match='law = "fibred" is known where its module is imported'):
        check(there)
