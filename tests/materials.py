"""Constants of the tissues for tests.

Forms are compiled for the terms that a tissue has, whatever their constants. Tests therefore share
few kinds of tissues: layers as in `PROPOSED`, `RELAXING`, or one neo-Hookean layer of dermis, all
of them viscous, those of `NO_VISCOSITY_S` to no effect.
"""

from blocks import LAYERS

from tactile_fem.study import Material, Polynomial, Tissue
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

NO_VISCOSITY_S = 1e-12
PROPOSED = Tissue.model_validate({"set": "proposed"})
ELASTIC = PROPOSED.model_copy(update={"viscous_time_s": NO_VISCOSITY_S})
ONE_LAYER = Tissue.model_validate({"set": "maeno1998", "viscous_time_s": NO_VISCOSITY_S})


def uniform(C10_MPa: float, D1_per_MPa: float, **more: float) -> Tissue:
    """Return one neo-Hookean law in all layers; compiled as `PROPOSED`."""
    layer = {"C10_MPa": C10_MPa, "D1_per_MPa": D1_per_MPa, "C20_MPa": 0.0, "C30_MPa": 0.0}
    tiny = 1e-9 * C10_MPa
    shapes = dict(zip(LAYERS, ("C30_MPa", "C30_MPa", "C20_MPa", "C20_MPa"), strict=True))
    layers = {name: {**layer, shape: tiny} for name, shape in shapes.items()}
    return Tissue.model_validate({"viscous_time_s": NO_VISCOSITY_S, **layers, **more})


def relaxing(
    tissue: Tissue = PROPOSED,
    *,
    g: tuple[float, float] = (0.3, 0.2),
    tau_s: tuple[float, float] = (0.01, 0.5),
    viscous_time_s: float | None = None,
) -> Tissue:
    """Return tissues whose layers relax by two networks; all compile the same forms."""
    data = tissue.model_dump(exclude_none=True)
    for name in LAYERS:
        data[name] |= {"g": g, "tau_s": tau_s}
    if viscous_time_s is not None:
        data["viscous_time_s"] = viscous_time_s
    return Tissue.model_validate(data)


RELAXING = relaxing()


def young_modulus(constants: Material) -> float:
    """Return the small-strain Young's modulus, in MPa."""
    G, K = float(shear_modulus(constants)), float(bulk_modulus(constants))
    return 9 * K * G / (3 * K + G)
