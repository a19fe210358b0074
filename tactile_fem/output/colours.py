"""Colours of the tissues in pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_fem.finger.mesh_data import TISSUES

COLOURS = {
    "stratum_corneum": "#E7C6A5",
    "epidermis": "#A8683F",
    "dermis": "#C8553D",
    "subcutaneous": "#F2DFA7",
    "bone": "#B9C0C6",
    "nail": "#7FB0BF",
}
# No strain energy density is shown in them.
RIGID = ("bone", "nail")


def is_soft(tissue: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return which tags are those of tissues whose strain energy density is shown."""
    return ~np.isin(tissue, [TISSUES[name] for name in RIGID])
