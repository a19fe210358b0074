"""Energies against their closed forms; no mesh needed beyond a single cell."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from scipy.optimize import brentq

from tactile_fem.runtime import backend  # noqa: F401

from mpi4py import MPI  # isort: skip

from dolfinx import fem, mesh
from materials import FULL, NEO_HOOKEAN, SECOND_ORDER, YEOH, young_modulus

from tactile_fem.assembly.compile import expression
from tactile_fem.errors import StudyError
from tactile_fem.study import TISSUE_SETS, Elastic, Polynomial, Tissue
from tactile_fem.tissue.energies import (
    ORIGIN,
    bulk_modulus,
    shear_modulus,
    stiffness,
    stress,
)


class Point:
    """Evaluates stress and energy of a law at given deformation gradients."""

    def __init__(self, law):
        self.mesh = mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1)
        self.F = fem.Constant(self.mesh, np.eye(3))
        P = stress(law, self.F, ORIGIN)
        values = [law.energy(self.F, ORIGIN), stiffness(law, self.F, ORIGIN)]
        values += [P[i, j] for i in range(3) for j in range(3)]
        self._values = expression(ufl.as_vector(values), np.full((1, 3), 0.25))

    def _at(self, F):
        self.F.value[:] = F
        return self._values.eval(self.mesh, np.array([0], dtype=np.int32)).ravel()

    def energy(self, F):
        return self._at(F)[0]

    def stiffness(self, F):
        return self._at(F)[1]

    def stress(self, F):
        return self._at(F)[2:].reshape(3, 3)


def closed_form(c: Polynomial, stretch: np.ndarray) -> np.ndarray:
    """Principal first Piola stresses of the polynomial energy."""
    J = stretch.prod()
    square = stretch**2
    I1 = square.sum() * J ** (-2 / 3)
    I2 = (square.sum() ** 2 - (square**2).sum()) / 2 * J ** (-4 / 3)
    dI1 = J ** (-2 / 3) * 2 * stretch - 2 / 3 * I1 / stretch
    dI2 = J ** (-4 / 3) * 2 * stretch * (square.sum() - square) - 4 / 3 * I2 / stretch
    a, b = I1 - 3, I2 - 3
    W1 = c.C10_MPa + 2 * c.C20_MPa * a + c.C11_MPa * b + 3 * c.C30_MPa * a**2
    W2 = c.C01_MPa + c.C11_MPa * a + 2 * c.C02_MPa * b
    WJ = 2 / c.D1_per_MPa * (J - 1)
    if c.D2_per_MPa is not None:
        WJ += 4 / c.D2_per_MPa * (J - 1) ** 3
    return W1 * dI1 + W2 * dI2 + WJ * J / stretch


@pytest.mark.parametrize("constants", [NEO_HOOKEAN, SECOND_ORDER, YEOH, FULL])
@pytest.mark.parametrize("stretch", [0.6, 0.9, 1.2, 1.6])
def test_uniaxial_stress_is_the_closed_form(constants, stretch):
    def side(lateral: float) -> float:
        return closed_form(constants, np.array([stretch, lateral, lateral]))[1]

    lateral = brentq(side, 0.5, 1.6, xtol=1e-14)
    P = Point(constants).stress(np.diag([stretch, lateral, lateral]))
    expected = closed_form(constants, np.array([stretch, lateral, lateral]))[0]
    assert np.sign(expected) == np.sign(stretch - 1)
    np.testing.assert_allclose(P, np.diag([expected, 0, 0]), atol=1e-10)


@pytest.mark.parametrize("constants", [FULL, Elastic(E_MPa=170.0, nu=0.3)])
def test_stress_is_the_derivative_of_the_energy(constants):
    point = Point(constants)
    random = np.random.default_rng(1)
    F = np.eye(3) + 0.2 * random.normal(size=(3, 3))
    direction = random.normal(size=(3, 3))
    eps = 1e-5
    difference = (point.energy(F + eps * direction) - point.energy(F - eps * direction)) / (2 * eps)
    assert np.sum(point.stress(F) * direction) == pytest.approx(difference, rel=1e-7)


@pytest.mark.parametrize("constants", [NEO_HOOKEAN, FULL, Elastic(E_MPa=170.0, nu=0.3)])
def test_rotation_costs_no_energy(constants):
    angle = 0.7
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    point = Point(constants)
    assert point.energy(R) == pytest.approx(0, abs=1e-12)
    F = R @ np.diag([1.2, 0.9, 0.95])
    assert point.energy(F) == pytest.approx(point.energy(np.diag([1.2, 0.9, 0.95])), rel=1e-12)


@pytest.mark.parametrize("constants", [NEO_HOOKEAN, FULL, Elastic(E_MPa=170.0, nu=0.3)])
def test_small_strain_moduli(constants):
    point = Point(constants)
    G, K = float(shear_modulus(constants)), float(bulk_modulus(constants))
    shear = 1e-5
    F = np.eye(3)
    F[0, 1] = shear
    assert point.stress(F)[0, 1] / shear == pytest.approx(G, rel=1e-4)

    def side(lateral: float) -> float:
        return point.stress(np.diag([1 + shear, 1 + lateral, 1 + lateral]))[1, 1]

    lateral = brentq(side, -shear, 0, xtol=1e-16)
    axial = point.stress(np.diag([1 + shear, 1 + lateral, 1 + lateral]))[0, 0]
    assert axial / shear == pytest.approx(young_modulus(constants), rel=1e-3)
    one_sided = point.stress(np.diag([1 + shear, 1, 1]))[0, 0]
    assert one_sided / shear == pytest.approx(K + 4 * G / 3, rel=1e-3)
    assert point.stiffness(np.eye(3)) == pytest.approx(K + 4 * G / 3, rel=1e-12)


@pytest.mark.parametrize("constants", [NEO_HOOKEAN, SECOND_ORDER, YEOH, FULL])
def test_stiffness_follows_the_slope_of_simple_shear(constants):
    point = Point(constants)

    def sheared(amount: float) -> np.ndarray:
        F = np.eye(3)
        F[0, 1] = amount
        return F

    rise = point.stress(sheared(0.701))[0, 1] - point.stress(sheared(0.699))[0, 1]
    shear = (point.stiffness(sheared(0.7)) - 2 / constants.D1_per_MPa) * 3 / 4
    assert rise / 0.002 == pytest.approx(shear, rel=1e-5)


def test_named_set_is_nearly_incompressible():
    tissue = Tissue.model_validate({"set": "maeno1998"})
    for name, E_MPa in (("epidermis", 0.136), ("dermis", 0.080), ("subcutaneous", 0.034)):
        constants = getattr(tissue, name)
        assert young_modulus(constants) == pytest.approx(E_MPa, rel=1e-12)
        assert E_MPa / (2 * float(shear_modulus(constants))) - 1 == pytest.approx(0.48, rel=1e-12)


@pytest.mark.parametrize("relaxation", ["none", "fingerpad"])
@pytest.mark.parametrize("name", TISSUE_SETS)
def test_a_scaled_tissue_has_scaled_energy_and_relaxes_as_before(name, relaxation):
    tissue = Tissue.model_validate({"set": name, "relaxation": relaxation})
    F = ufl.as_matrix(np.diag([1.2, 0.9, 0.95]).tolist())
    for layer, constants in tissue.materials().items():
        scaled = constants.scaled(0.3)
        before, after = (float(one.energy(F, ORIGIN)(())) for one in (constants, scaled))
        assert after == pytest.approx(0.3 * before, rel=1e-12)
        assert (scaled.g, scaled.tau_s) == (constants.g, constants.tau_s)
        assert bool(scaled.g) == (relaxation != "none" and layer not in ("bone", "nail"))
    for factor in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(StudyError, match="factor is"):
            tissue.dermis.scaled(factor)


def test_a_tissue_made_in_python_relaxes_as_the_same_tables_of_a_file():
    law = {"C10_MPa": 0.01, "D1_per_MPa": 2.0}
    own = Polynomial(**law)
    made = Tissue(relaxation="fingerpad", epidermis=own, nail=Elastic(E_MPa=1.0, nu=0.3))
    assert made.epidermis.g == made.dermis.g == Tissue(relaxation="fingerpad").dermis.g != ()
    assert made.epidermis.model_dump(exclude={"g", "tau_s"}) == own.model_dump(
        exclude={"g", "tau_s"}
    )  # C30 of the set is not added
    assert made.nail.g == () and made.viscous_time_s == 0.0
    elastic = Tissue(relaxation="fingerpad", epidermis=Polynomial(**law, g=(), tau_s=()))
    assert elastic.epidermis.g == ()
