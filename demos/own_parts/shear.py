"""A drive with a field of its own: the shear of the tissue at a receptor."""

import numpy as np

from tactile_fem.neuron import DRIVES, Drive, Field


def shear_of(point):
    """Return the shear strain between Y and Z at a point of the tissue, in UFL."""
    F = point.deformation_gradient
    return (F.T * F)[1, 2] / 2


SHEAR = Drive(
    "Shear",
    "1",
    lambda trace: np.abs(trace["shear_strain_yz"]),
    fields=(Field("shear_strain_yz", shear_of),),
)
DRIVES["shear"] = SHEAR  # now `feels` in a study may be "shear" or "shear_rate"
