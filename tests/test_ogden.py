"""Ogden's law against its principal stresses, also where stretches coincide."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering
from ufl.algorithms.apply_derivatives import apply_derivatives

from tactile_fem.errors import StudyError
from tactile_fem.study import Ogden, Polynomial
from tactile_fem.study.file import load_study
from tactile_fem.tissue.energies import (
    ORIGIN,
    _Expander,
    bulk_modulus,
    shear_modulus,
)

ALPHAS = -3.0, 9.0
H = np.array([[0.3, -0.5, 0.2], [0.7, 0.1, 0.4], [-0.2, 0.6, -0.9]])
UNIAXIAL = [np.diag([s, s**-0.5, s**-0.5]) for s in (0.5, 1.3)]
EQUIBIAXIAL = [np.diag([s, s, s**-2]) for s in (0.7, 1.0001)]
SHEARED = [np.array([[1, g, 0], [0, 1, 0], [0, 0, 1.0]]) for g in (3e-3, 2.0)]
# Beside stretches that coincide, and where a series takes the place of the closed form.
CLOSE = [np.diag(s) for s in ([1.2, 1.2 + 1e-9, 0.8], [1.0012, 1, 1], [1.0013, 1, 1], [1.1] * 3)]
TURNED = np.array([[1.1, 0.4, -0.2], [0.0, 0.8, 0.3], [0.5, -0.1, 1.2]])
ALL = [np.eye(3), *UNIAXIAL, *EQUIBIAXIAL, *SHEARED, *CLOSE, TURNED]


def law(alpha: float) -> Ogden:
    return Ogden(mu_MPa=0.04, alpha=alpha, D1_per_MPa=2.0)


def expected(F: np.ndarray, alpha: float, mu: float = 0.04, D1: float = 2.0) -> np.ndarray:
    """Return the first Piola stress, differentiated by hand in the principal stretches."""
    left, stretch, right = np.linalg.svd(F)
    J = stretch.prod()
    power = (stretch * J ** (-1 / 3)) ** alpha
    principal = 2 * mu / alpha * (power - power.mean()) + 2 / D1 * (J - 1) * J
    return left @ np.diag(principal / stretch) @ right


def along(F: np.ndarray, x) -> ufl.core.expr.Expr:
    """Return ``F + x H``."""
    return ufl.as_matrix([[F[i, j] + x * H[i, j] for j in range(3)] for i in range(3)])


def number(value) -> float:
    """Evaluate what is made of numbers."""
    return float(_Expander().visit(apply_derivatives(apply_algebra_lowering(value))))


@pytest.mark.parametrize(("alpha", "which"), [(9.0, ALL), (-3.0, ALL[::3])])
def test_stress_and_stiffness_are_those_of_the_principal_stretches(alpha, which):
    """The stiffness by differences of the fourth order."""
    h = 2e-4
    for F in which:
        x = ufl.variable(ufl.as_ufl(0.0))
        slope = ufl.diff(law(alpha).energy(along(F, x), ORIGIN), x)
        right = expected(F, alpha)
        size = max(0.04, abs(right).max())
        assert number(slope) == pytest.approx(np.sum(H * right), abs=1e-11 * size), F
        near = [np.sum(H * expected(F + k * h * H, alpha)) for k in (-2, -1, 1, 2)]
        wanted = np.dot(near, [1, -8, 8, -1]) / (12 * h)
        assert number(ufl.diff(slope, x)) == pytest.approx(wanted, rel=1e-7), F


def test_at_rest_it_has_its_moduli_and_with_an_exponent_of_2_it_is_neo_hookean():
    for alpha in (*ALPHAS, 0.5, 26.0, -50.0, 50.0):
        assert float(shear_modulus(law(alpha))) == pytest.approx(0.04, rel=1e-12)
        assert float(bulk_modulus(law(alpha))) == pytest.approx(1.0, rel=1e-12)
    other = Polynomial(C10_MPa=0.02, D1_per_MPa=2.0)
    for F in ALL:
        found, wanted = (number(one.energy(along(F, 0.0), ORIGIN)) for one in (law(2.0), other))
        assert found == pytest.approx(wanted, abs=1e-15, rel=1e-12)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_simple_shear_stores_what_a_network_takes(alpha):
    for F in SHEARED:
        found = number(law(alpha).in_shear(ufl.as_ufl(F[0, 1] ** 2), ORIGIN))
        wanted = number(law(alpha).energy(along(F, 0.0), ORIGIN))
        assert found == pytest.approx(wanted, abs=1e-15, rel=1e-9)


def test_a_study_states_it():
    own = "tissue.dermis={law='ogden', mu_MPa=0.01, alpha=%s, D1_per_MPa=2.0}"
    assert load_study(None, [own % 9]).tissue.dermis.alpha == 9.0
    for alpha, sentence in (0, "must not be 0"), (60, "is 60 but must be at most 50"):
        with pytest.raises(StudyError, match=sentence):
            load_study(None, [own % alpha])


@pytest.mark.slow
def test_newton_converges_from_rest_and_to_the_same_as_neo_hookean(study):
    from tactile_fem import scan
    from tactile_fem.study import Plate, Press, Protocol

    forces = []
    for values in (
        {"C10_MPa": 4e-4, "C20_MPa": 0.0, "D1_per_MPa": 21.0},
        {"law": "ogden", "mu_MPa": 8e-4, "alpha": 2.0, "D1_per_MPa": 21.0},
        {"law": "ogden", "mu_MPa": 8e-4, "alpha": 9.0, "D1_per_MPa": 21.0},
    ):
        own = {
            "tissue": {"subcutaneous": values},
            "stimulus": Plate(),
            "protocol": Protocol(path=(Press(depth_mm=0.5),)),
        }
        changed = type(study).model_validate({**dict(study), **own})
        forces.append(scan(changed).trace.force_N[-1, 2])
    assert forces[1] == pytest.approx(forces[0], rel=1e-8)
    assert forces[2] / forces[0] == pytest.approx(0.992, abs=0.003)  # softer in compression
