"""Constants that every kind of polynomial energy has, for tests."""

from tactile_fem.study import Elastic, Polynomial
from tactile_fem.tissue.energies import bulk_modulus, shear_modulus

NEO_HOOKEAN = Polynomial(C10_MPa=0.02297, D1_per_MPa=1.765)
SECOND_ORDER = Polynomial(C10_MPa=0.0135, C20_MPa=0.01, D1_per_MPa=3.0)
FULL = Polynomial(
    C10_MPa=0.01,
    C01_MPa=0.004,
    C20_MPa=0.003,
    C11_MPa=0.002,
    C02_MPa=0.001,
    C30_MPa=0.0005,
    D1_per_MPa=2.0,
    D2_per_MPa=3.0,
)
YEOH = Polynomial(C10_MPa=0.02, C30_MPa=0.1, D1_per_MPa=2.0)


def young_modulus(constants: Polynomial | Elastic) -> float:
    """Return the small-strain Young's modulus, in MPa."""
    G, K = shear_modulus(constants), bulk_modulus(constants)
    return 9 * K * G / (3 * K + G)
