# %% [markdown]
# # What of a series is kept
#
# The scans of this page take hours. What its numbers need of them, the strain energy density at the
# receptors and the loads, is a few kilobytes for each. This demo packs that into one archive;
# unpacked, the folders are complete scans for the other demos, which run only what is missing.
#
#     python demos/protocols/pack_scans.py results/protocols demos/protocols/scans.zip
#     python -m zipfile -e demos/protocols/scans.zip results/protocols

# %%
import io
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tactile_fem import Results, run_script
from tactile_fem.runtime.files import atomic_write

# The histories that the demos of this folder use.
KEPT = (
    *("time_s", "phase", "displacement_mm", "depth_mm", "stimulator_mm"),
    *("force_N", "newton_iterations", "wall_s"),
    *("receptors_mm", "population", "sed_kPa"),
)


# %%
def main(folder: Path, archive: Path) -> None:
    """Pack the complete scans below a folder.

    Parameters
    ----------
    folder
        Holds series, at any depth.
    archive
        A zip file; it is replaced only when the new one is complete.
    """
    scans = list(complete_below(folder))
    with atomic_write(archive) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_LZMA) as packed:
        for scan in scans:
            name = scan.folder.relative_to(folder).as_posix()
            for own in ("study.toml", "run.json", "spikes.csv"):
                packed.write(scan.folder / own, f"{name}/{own}")
            packed.writestr(f"{name}/trace.npz", reduced(scan))
    print(f"{len(scans)} scans, {archive.stat().st_size / 1e3:.0f} kB: {archive}")


def complete_below(folder: Path) -> Iterator[Results]:
    """Yield the complete scans in a folder and in those below it."""
    for path in sorted(folder.rglob("run.json")):
        scan = Results(path.parent)
        if scan.complete:
            yield scan


def reduced(scan: Results) -> bytes:
    """Return the kept histories of a scan; what receptors feel, in single precision."""
    kept = {name: scan.trace[name] for name in KEPT}
    kept["sed_kPa"] = kept["sed_kPa"].astype(np.float32)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **kept)
    return buffer.getvalue()


if __name__ == "__main__":
    run_script(main)
