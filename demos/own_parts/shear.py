"""A drive with a field of its own: the shear of the tissue at a receptor."""

import numpy as np

from tactile_fem.neuron import DRIVES, Drive, Field


def shear_of(point):
    F = point.deformation_gradient
    return (F.T * F)[1, 2] / 2


SHEAR = Field("shear_strain_yz", shear_of)
DRIVES["shear"] = Drive(
    "Shear", "1", lambda trace: np.abs(trace["shear_strain_yz"]), fields=(SHEAR,)
)
