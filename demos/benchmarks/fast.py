# %% [markdown]
# # Time of the fast finger
#
# A letter scan, its spikes and steps of a loop, with the threads that BLAS takes by default, beside
# other processes that are busy all the time. The least of several tries counts.
#
#     python demos/benchmarks/fast.py --beside 2

# %%
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np

from tactile_fem import run_script
from tactile_fem.study import Protocol, Text
from tactile_fem.surrogate import FastFinger, HeightMap

SHIPPED = Path(__file__).parents[2] / "meshes/fast_finger.npz"


# %%
def main(finger: Path = SHIPPED, *, beside: int = 2, tries: int = 3) -> None:
    """Print the times, as JSON.

    Parameters
    ----------
    finger
        The fast finger.
    beside
        Number of busy processes.
    tries
        Number of tries.
    """
    busy = [sys.executable, "-c", "while True: pass"]
    others = [subprocess.Popen(busy) for _ in range(beside)]
    try:
        print(json.dumps(times(FastFinger.read(finger), tries)))
    finally:
        for other in others:
            other.kill()
            other.wait()


def times(fast: FastFinger, tries: int) -> dict[str, float]:
    """Return the time of a scan, s, of its spikes, and median and longest of a loop's steps, ms."""
    body, path, scans = Text(text="G").body(), Protocol().route(2.0), []
    scan_s = best(lambda: scans.append(fast.scan(body, path, friction=0.3)), tries)
    spikes_s = best(lambda: fast.respond(scans[0]), tries)
    heights = HeightMap.of(body, *fast.pad.meets(np.array([[0.0, -6.0], [0.0, 6.0]])))
    loop = fast.loop(heights, friction=0.3)
    steps = [(0.0, 0.0, z) for z in np.linspace(0.05, 1.5, 30)]
    steps += [(0.0, y, 1.5) for y in np.linspace(0.02, 2.0, 100)]
    took_ms = []
    for place in steps:
        start = perf_counter()
        loop.step(place, 0.001)
        took_ms.append(1e3 * (perf_counter() - start))
    return {
        "seconds": scan_s,
        "spikes_s": spikes_s,
        "step_ms": float(np.median(took_ms)),
        "longest_step_ms": max(took_ms),
    }


def best(work: Callable[[], object], tries: int) -> float:
    """Return the least time, s."""
    taken = []
    for _ in range(tries):
        start = perf_counter()
        work()
        taken.append(perf_counter() - start)
    return min(taken)


# %%
if __name__ == "__main__":
    run_script(main)
