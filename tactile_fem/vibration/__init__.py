"""Small vibrations about a state of a scan: what receptors feel, and how their afferents fire.

`tactile_fem.vibrate` computes them; a `Spectrum` holds them.
"""

from tactile_fem.vibration.spectrum import Spectrum, frequencies_of

__all__ = ["Spectrum", "frequencies_of"]
