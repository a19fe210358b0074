"""Small vibrations about a state of a scan: what receptors feel, and how their afferents fire.

`tactile_fem.vibrate` computes them; a `Spectrum` holds them, `Modes` the shapes of the finger.
"""

from tactile_fem.vibration.spectrum import Modes, Spectrum, few_of, frequencies_of, nearest, unfelt

__all__ = ["Modes", "Spectrum", "few_of", "frequencies_of", "nearest", "unfelt"]
