"""Tips of intermediate ridges and papillae on the epidermis-dermis interface of a section."""

from __future__ import annotations

import numpy as np

from tactile_fem.errors import StudyError
from tactile_fem.finger.mesh_data import SURFACES, FingerMesh

# A tip rises so much above its neighbours, mm: no noise of the mesh, far less than a papilla.
_LEAST_MM = 0.01
# The pad ends so much above its lowest point.
_PAD_MM = 3.0


def tips(finger: FingerMesh, placement: str) -> np.ndarray:
    """Return the tips (n, 3) in mm, from one end of the ridged skin to the other.

    Where the skin has ridges, too, limiting ridges are left out: they lie below its grooves, or,
    if the papillae are not aligned with the ridges, on one flank of them.

    Parameters
    ----------
    finger
        A section.
    placement
        "intermediate_ridges", whose tips are deepest, or "papillae".

    Raises
    ------
    StudyError
        The interface has none.
    """
    from scipy.signal import find_peaks  # takes 0.3 s, and few studies need it

    interface, skin = _palmar(finger, "interface"), _palmar(finger, "skin")
    along = finger.plane.axes[0]
    if placement == "papillae":
        found = interface[find_peaks(-interface[:, 2], prominence=_LEAST_MM)[0]]
    else:
        found = interface[find_peaks(interface[:, 2], prominence=_LEAST_MM)[0]]
        grooves = skin[find_peaks(skin[:, 2], prominence=_LEAST_MM)[0], along]
        crests = skin[find_peaks(-skin[:, 2], prominence=_LEAST_MM)[0], along]
        if len(grooves) and len(crests):
            off = [
                np.abs(found[:, along, None] - places).min(axis=1) for places in (crests, grooves)
            ]
            found = found[off[0] <= off[1] + _LEAST_MM]
    if len(found) < 2:  # the pad itself has one lowest point
        raise StudyError(
            f'receptors.placement = "{placement}": the interface has no such tips; set '
            "finger.papilla_depth_mm"
        )
    return found


def _palmar(finger: FingerMesh, surface: str) -> np.ndarray:
    """Return the corners (n, 3) of a surface on the side of the pad, along the section."""
    facets = finger.facets[finger.surface == SURFACES[surface]]
    points = finger.nodes[np.unique(facets[:, : finger.simplex.dim])]
    palmar = points[points[:, 2] < points[:, 2].min() + _PAD_MM]
    return palmar[np.argsort(palmar[:, finger.plane.axes[0]])]
