"""What spikes say about the stimulator: bundles, images of firing, and which letter it was."""

from tactile_fem.reading.bundles import Bundle, bundles
from tactile_fem.reading.image import RateImage, fibre_image, population_image, thinned
from tactile_fem.reading.legibility import Reading, correlation, edge_image, read

__all__ = [
    "Bundle",
    "RateImage",
    "Reading",
    "bundles",
    "correlation",
    "edge_image",
    "fibre_image",
    "population_image",
    "read",
    "thinned",
]
