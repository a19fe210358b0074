# %% [markdown]
# # Time of the fast finger
#
# A letter scan, its spikes and steps of a loop, with the threads that BLAS takes by default: alone,
# then beside other processes that are busy all the time. The least of several tries counts.
#
#     python demos/benchmarks/fast.py --beside 2

# %%
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
    """Print the times.

    Parameters
    ----------
    finger
        The fast finger.
    beside
        Number of busy processes.
    tries
        Number of tries.
    """
    fast = FastFinger.read(finger)
    for count in dict.fromkeys((0, beside)):
        busy = [sys.executable, "-c", "while True: pass"]
        others = [subprocess.Popen(busy) for _ in range(count)]
        try:
            print(f"beside {count} busy processes: {times(fast, tries)}", flush=True)
        finally:
            for other in others:
                other.kill()
                other.wait()


def times(fast: FastFinger, tries: int) -> str:
    """Return the times in words."""
    body, path, scans = Text(text="G").body(), Protocol().route(2.0), []
    scan_s = best(lambda: scans.append(fast.scan(body, path, friction=0.3)), tries)
    spikes_s = best(lambda: fast.respond(scans[0]), tries)
    said = f"scan {scan_s:.2f} s, spikes {spikes_s:.2f} s, step of a loop"
    heights = HeightMap.of(body, *fast.pad.meets(np.array([[0.0, -6.0], [0.0, 6.0]])))
    for name, places in (("one receptor", [(0.0, 0.0)]), ("those of the study", None)):
        loop = fast.loop(heights, friction=0.3, receptors_mm=places)
        steps = [(0.0, 0.0, z) for z in np.linspace(0.05, 1.5, 30)]
        steps += [(0.0, y, 1.5) for y in np.linspace(0.02, 2.0, 100)]
        took_ms = []
        for place in steps:
            start = perf_counter()
            loop.step(place, 0.001)
            took_ms.append(1e3 * (perf_counter() - start))
        said += f" {np.median(took_ms):.2f} ms, at most {max(took_ms):.1f} ms ({name});"
    return said


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
