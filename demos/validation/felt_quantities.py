"""What an afferent may respond to, as the small files of histories keep it.

Each quantity is kept once at the afferent and once as the mean over a cluster of end organs, with
``cluster_`` before its name:

- `sed_kPa`: strain energy density,
- `stretch`: the largest stretch less 1,
- `compression_kPa`: the largest compressive stress, zero under tension,
- `area`: the relative increase of a piece of area that was parallel to the pad.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_fem.neuron import Drive

Array = NDArray[Any]

CLUSTER = "cluster_"
END_ORGANS = 9
# Drive that makes a scan keep the tensor from which changes of area follow.
KEEPS_TENSOR = "directed_stretch"


def quantities(columns: Mapping[str, Array], receptors: Array) -> dict[str, Array]:
    """Return the quantities of some receptors, (t, receptors), from the columns of a trace."""
    xx, yx, yy = np.moveaxis(columns["right_cauchy_green"][:, receptors, :3], -1, 0)
    return {
        "sed_kPa": columns["sed_kPa"][:, receptors],
        "stretch": columns["stretches"][:, receptors, -1] - 1,
        "compression_kPa": np.maximum(-columns["stresses_kPa"][:, receptors, 0], 0.0),
        "area": np.sqrt(xx * yy - yx**2) - 1,
    }


def both(columns: Mapping[str, Array], afferents: Array, clusters: Array) -> dict[str, Array]:
    """Return the quantities of afferents, and those of their clusters under longer names."""
    own, mean = quantities(columns, afferents), quantities(columns, clusters)
    return own | {f"{CLUSTER}{name}": values for name, values in mean.items()}


def _kept(label: str, unit: str, key: str) -> Drive:
    return Drive(label, unit, lambda kept: np.maximum(kept[key].astype(float), 0.0))


_OWN = {
    "sed": ("Strain energy density", "kPa", "sed_kPa"),
    "stretch": ("Largest stretch - 1", "1", "stretch"),
    "compression": ("Compressive stress", "kPa", "compression_kPa"),
    "area": ("Increase of area", "1", "area"),
}
# By name what afferents may respond to; what is negative counts as zero.
FELT = {name: _kept(*told) for name, told in _OWN.items()} | {
    f"{name} of cluster": _kept(f"{label} of cluster", unit, f"{CLUSTER}{key}")
    for name, (label, unit, key) in _OWN.items()
}
