"""Small vibrations about a state of a scan: what receptors feel, and how their afferents fire.

`tactile_fem.vibrate` computes them; a `Spectrum` holds them, `Modes` the shapes of the finger.
"""

from typing import TYPE_CHECKING

from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.output import Modes, nearest
    from tactile_fem.vibration.spectrum import Spectrum, few_of, frequencies_of, unfelt

__all__ = ["Modes", "Spectrum", "few_of", "frequencies_of", "nearest", "unfelt"]

__getattr__ = lazily(
    "tactile_fem",
    {
        "output.modes": ["Modes", "nearest"],
        "vibration.spectrum": ["Spectrum", "few_of", "frequencies_of", "unfelt"],
    },
)
