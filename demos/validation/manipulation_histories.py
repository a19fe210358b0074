# %% [markdown]
# # What afferents feel while a plate pushes the fingertip as an object does in manipulation
#
# The protocol of Saal, Birznieks and Johansson (eLife 89616), in two orders of its loads. The plate
# of 30 mm diameter is an unlimited one, as skin touches it no farther out, and friction of 3 keeps
# it from slipping. A background of 0.2 N is held for half a second. Each load rises to 4 N in 125
# ms, half a period of a sine of 4 Hz, stays 250 ms, falls as it rose, and pauses 250 ms; along the
# skin it has 0 or 1.4 N, 20 degrees from the normal. Tissue relaxes. The load that is last in an
# order comes before the first as well.
#
#     python demos/validation/manipulation_histories.py results/manipulation
#     python demos/validation/manipulation_histories.py results/quick --pad-size 3 --far-size 6
#
# It writes `one.npz` and `two.npz`, which `manipulation.py` reads; folders of scans lie in `scans`.

# %%
from pathlib import Path
from typing import Any, Literal

import numpy as np
from manipulation_firing import (
    BACK_S,
    BACKGROUND_N,
    LOADS,
    NORMAL_N,
    ORDERS,
    PAUSE_S,
    PLATEAU_S,
    RISE_S,
    SETTLING_S,
    Array,
    afferents,
    sequence,
)

from tactile_fem import Results, Study, completed, run_script
from tactile_fem.runtime.files import atomic_write

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)

FRICTION, PRESS_MM_S = 3.0, 5.0


# %%
def pushed(load: str, outputs: int, normal_N: float) -> list[dict[str, Any]]:
    """Return the pieces of the path that are a load."""
    x, y = (normal_N / NORMAL_N * force for force in LOADS[load])

    def piece(time_s: float, normal_N: float, along_N: tuple[float, float]) -> dict[str, Any]:
        steps = outputs if time_s <= RISE_S else outputs // 2
        return {
            "kind": "push",
            "time_s": time_s,
            "normal_N": normal_N,
            "tangential_N": along_N,
            "course": "half_sine",
            "output_s": time_s / steps,
        }

    top, none = (normal_N, (x, y)), (BACKGROUND_N, (0.0, 0.0))
    return [
        piece(RISE_S, *top),
        piece(PLATEAU_S, *top),
        piece(BACK_S, *none),
        piece(PAUSE_S, *none),
    ]


def study(
    order: str, finger: dict[str, Any], outputs: int = 12, normal_N: float = NORMAL_N
) -> Study:
    """Return the study of an order, with as many outputs in the rise of a load."""
    press = {"kind": "press", "force_N": BACKGROUND_N, "speed_mm_s": PRESS_MM_S}
    settle = {
        "kind": "push",
        "time_s": SETTLING_S,
        "normal_N": BACKGROUND_N,
        "tangential_N": (0.0, 0.0),
        "output_s": SETTLING_S / 5,
    }
    loads = [piece for load in sequence(order) for piece in pushed(load, outputs, normal_N)]
    return Study.model_validate(
        {
            "finger": finger,
            "tissue": {"set": "plate", "relaxation": "fingerpad", "viscous_time_s": 0.004},
            "stimulus": {"kind": "plate", "friction": FRICTION},
            "protocol": {"path": [press, settle, *loads]},
            "afferents": afferents(),
            "output": {"pictures": False, "states_mm": 100.0},
        }
    )


def felt(results: Results) -> dict[str, Array]:
    """Return what is kept of a scan; the first load begins at time 0."""
    trace = results.trace
    names = trace["population"]
    drives = np.empty((len(trace["time_s"]), len(names)))
    for one in results.study.populations:
        own = names == one.name
        drives[:, own] = one.population().felt(trace)[1]
    shown = ("force_N", "stimulator_mm", "receptors_mm", "directions")
    return {
        "time_s": trace["time_s"] - SETTLING_S,
        "population": names,
        "felt": drives.astype(np.float32),
        **{name: trace[name].astype(np.float32) for name in shown},
    }


# %%
def main(
    folder: Path,
    *,
    orders: tuple[str, ...] = tuple(ORDERS),
    preset: Literal["coarse", "medium", "paper"] = "medium",
    pad_size: float | None = None,
    far_size: float | None = None,
    outputs: int = 12,
    normal: float = NORMAL_N,
) -> None:
    """Push, and keep what is felt.

    Parameters
    ----------
    folder
        Folder for scans and files.
    orders
        Orders of the loads.
    preset, pad_size, far_size
        Mesh of the finger, sizes in mm.
    outputs
        Outputs in the rise of each load.
    normal
        Largest normal force, N; the tangential force is in proportion.
    """
    sizes = {"pad_size_mm": pad_size, "far_size_mm": far_size}
    finger = {"preset": preset, **{key: size for key, size in sizes.items() if size}}
    for order in orders:
        results = completed(study(order, finger, outputs, normal), folder / "scans" / order)
        if MPI.COMM_WORLD.rank:
            continue
        arrays = felt(results)
        with atomic_write(folder / f"{order}.npz") as part, part.open("wb") as stream:
            np.savez_compressed(stream, **arrays)
        x, y, z = arrays["stimulator_mm"][-1]
        print(
            f"order {order}: {len(arrays['time_s'])} steps; at last the plate is at X {x:.3f}, "
            f"Y {y:.3f}, depth {z:.3f} mm",
            flush=True,
        )


# %%
if __name__ == "__main__":
    run_script(main)
