"""
A ramp and a hold without a finger
==================================

Spikes of one afferent. A second. Change the history.
"""
# sphinx_gallery_thumbnail_path = 'raster.png'

# %%
# The history
# -----------
# .. figure:: /raster.png

import numpy as np

from tactile_fem.neuron import respond
from tactile_fem.study import Neuron

time_s = np.linspace(0.0, 1.0, 101)
print(respond(time_s, np.minimum(time_s / 0.05, 1.0)[:, None], Neuron()).counts())
