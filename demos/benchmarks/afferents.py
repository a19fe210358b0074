# %% [markdown]
# # Time of ten thousand afferents
#
# A second of touch of 10,000 SA1 afferents whose receptors feel a slow wave.
#
#     python demos/benchmarks/afferents.py

# %%
import json
from time import perf_counter

import numpy as np

from tactile_fem import run_script
from tactile_fem.neuron import respond


# %%
def main(count: int = 10_000, *, tries: int = 3) -> None:
    """Print the least time of several tries, as JSON.

    Parameters
    ----------
    count
        Number of afferents.
    tries
        Number of tries.
    """
    time_s = np.linspace(0.0, 1.0, 101)
    phases = np.linspace(0.0, 2 * np.pi, count)
    felt_kPa = 2.0 * (1 + np.sin(8 * np.pi * time_s[:, None] + phases))
    taken_s = []
    for _ in range(tries):
        start = perf_counter()
        response = respond(time_s, felt_kPa)
        taken_s.append(perf_counter() - start)
    rate_per_s = np.mean([len(times) for times in response.spikes])
    print(json.dumps({"seconds": min(taken_s), "rate_per_s": float(rate_per_s)}))


# %%
if __name__ == "__main__":
    run_script(main)
