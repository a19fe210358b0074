"""The oracle of the package's mechanics: short scans of all that a scan can be, and their traces.

    python tests/oracle.py before.npz              # store what this revision computes
    python tests/oracle.py after.npz before.npz    # and compare it with another, in every bit

`test_oracle.py` compares with `oracle.npz`, which stays until numbers change on purpose.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tactile_fem import FingerMesh, load_study, resume, scan
from tactile_fem.finger import read_mesh, write_mesh

SMALL = Path(__file__).parent.parent / "meshes" / "small.npz"
COLUMNS = (
    *("time_s", "stimulator_mm", "stimulator_rad", "bone_rad", "force_N", "moment_Nmm"),
    *("contact_area_mm2", "stored_mJ", "sed_kPa", "moved_mm", "newton_iterations"),
)
# What Newton's method leaves is far below what is compared.
EXACT = """
[receptors]
spacing_mm = 2.5
[solver]
max_press_step_mm = 0.2
[solver.petsc]
snes_atol = 1e-11
snes_rtol = 1e-14
"""
FINGER = f'[finger]\nmesh_file = "{SMALL}"\n{EXACT}'
SECTION = f"""
[finger]
kind = "section"
plane = "transverse"
pad_size_mm = 1.0
far_size_mm = 3.0
{EXACT}
"""
# Four kinds of afferents, and what they feel besides.
AFFERENTS = """
[[afferents]]
name = "SA1"
[[afferents]]
name = "RA"
kind = "RA"
[[afferents]]
name = "PC"
kind = "PC"
[[afferents]]
name = "SA2"
kind = "SA2"
[[afferents]]
name = "others"
feels = "compression"
"""
PRESS = """
[[protocol.path]]
kind = "press"
depth_mm = 0.8
"""
BY_FORCE = """
[[protocol.path]]
kind = "press"
force_N = 0.05
"""
BAR = """
[stimulus]
kind = "cylinder"
radius_mm = 3.0
"""
SLIDE = """
[[protocol.path]]
kind = "slide"
by_mm = [0.2, -0.6]
output_mm = 0.2
"""
CASES = {
    "slide": FINGER + '[stimulus]\ntext = "G"\nstart_mm = 0.0\n' + PRESS + SLIDE + AFFERENTS,
    "twist": FINGER
    + '[stimulus]\nkind = "grating"\n'
    + PRESS
    + '[[protocol.path]]\nkind = "twist"\nangle_deg = 4.0\noutput_deg = 2.0\n'
    + '[[protocol.path]]\nkind = "roll"\nangle_deg = 3.0\noutput_deg = 2.0\naxis = "y"\n',
    "push": FINGER
    + '[stimulus]\nkind = "plate"\n'
    + BY_FORCE
    + '[[protocol.path]]\nkind = "push"\ntime_s = 0.05\nnormal_N = 0.1\n'
    + "tangential_N = [0.01, 0.0]\ntorque_Nmm = 0.02\noutput_s = 0.0125\n",
    "held": FINGER + BAR + BY_FORCE + SLIDE + "force_N = 0.05\n",
    "joint": FINGER + BAR + PRESS + SLIDE + "\n[joint]\n",
    "inertia": FINGER.replace("[solver]", "[solver]\ninertia = true")
    + BAR
    + PRESS
    + '[[protocol.path]]\nkind = "hold"\ntime_s = 0.01\noutput_s = 0.0025\n'
    + "vibration = { frequency_Hz = 100, amplitude_mm = 0.01 }\n[joint]\n",
    "relaxation": FINGER
    + '[tissue]\nrelaxation = "fingerpad"\n'
    + BAR
    + PRESS
    + '[[protocol.path]]\nkind = "hold"\ntime_s = 0.5\n'
    + '[[protocol.path]]\nkind = "lift"\n',
    "friction": FINGER
    + BAR
    + "[stimulus.friction]\nlaw = 'kinetic'\nstatic = 0.6\nkinetic = 0.2\nspeed_mm_s = 10\n"
    + PRESS
    + SLIDE,
    "section": SECTION
    + BAR.replace("[stimulus]", '[stimulus]\nalong = "y"')
    + PRESS
    + SLIDE.replace("[0.2, -0.6]", "[0.6, 0.0]"),
}
# This one's finger has curved edges: the shipped ones are straight.
CASES["curved"] = CASES["friction"].replace(f"{SMALL}", "curved.npz")
# The mesh of this one is made by gmsh; those of the others are files, or it is a section of them.
NEED_GMSH = {"section"}


def computed(case: str, stop_after: int = 0) -> dict[str, np.ndarray]:
    """Return what the scan of a case computes, also if it is stopped after a step and continued."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "study.toml"
        file.write_text(CASES[case])
        if case == "curved":
            write_mesh(file.with_name("curved.npz"), _curved())
        result = _scanned(file, Path(folder) / "results", stop_after)
    arrays = result.trace.arrays()
    spikes = result.response.spikes
    found = {name: np.array(arrays[name]) for name in COLUMNS if name in arrays}
    return {
        **found,
        "phase": np.array(arrays["phase"]),
        "spikes": np.array([len(each) for each in spikes]),
        "spikes_s": np.concatenate([np.zeros(0), *spikes]),
    }


def _curved() -> FingerMesh:
    """Return the small finger, bent smoothly: the middles of its edges leave them."""
    mesh = read_mesh(SMALL)
    x, y, z = mesh.nodes.T
    bent = 0.1 * np.column_stack([np.sin(y / 3), np.sin(z / 3), np.sin(x / 3)])
    away = 1 - np.exp(-(np.linalg.norm(mesh.nodes, axis=1) ** 2) / 4)  # not at the pad's apex
    return replace(mesh, nodes=mesh.nodes + away[:, None] * bent)


class _Enough(Exception):
    """The scan is to stop here."""


def _scanned(file: Path, folder: Path, stop_after: int):
    study = load_study(file)
    if not stop_after:
        return scan(study)

    def stop(seen) -> None:
        if seen.step.index >= stop_after:
            raise _Enough

    try:
        scan(study, folder, observers=[stop])
    except _Enough:
        pass
    return resume(folder)


def differing(now: dict[str, np.ndarray], then: dict[str, np.ndarray], share: float) -> list[str]:
    """Return in words what differs by more than a share of its largest value.

    Iterations count only where every bit does: another rounding may take one more.
    """
    if share:
        now, then = (_without_iterations(one) for one in (now, then))
    found = [f"{name} is there only once" for name in sorted(now.keys() ^ then.keys())]
    for name in sorted(now.keys() & then.keys()):
        one, other = now[name], then[name]
        if one.shape != other.shape:
            found.append(f"{name}: shape {one.shape}, was {other.shape}")
        elif one.dtype.kind not in "fc":
            found += [f"{name} differs"] if (one != other).any() else []
        elif one.size:
            most = float(np.abs(one - other).max())
            if not most <= share * float(np.abs(other).max()):
                found.append(f"{name}: differs by {most:.2g}, largest {np.abs(other).max():.3g}")
    return found


def _without_iterations(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: one for name, one in arrays.items() if name != "newton_iterations"}


def stored(file: Path) -> dict[str, dict[str, np.ndarray]]:
    """Return what a file holds, by case."""
    found: dict[str, dict[str, np.ndarray]] = {}
    with np.load(file) as arrays:
        for key in arrays.files:
            case, name = key.split(":")
            found.setdefault(case, {})[name] = arrays[key]
    return found


def main(file: str, before: str = "", *cases: str) -> int:
    """Store all cases, or those named, in a file; compare them with another, in every bit."""
    found = {case: computed(case) for case in cases or CASES}
    flat = {f"{case}:{name}": one for case, arrays in found.items() for name, one in arrays.items()}
    np.savez_compressed(file, **flat)
    failed = 0
    then = stored(Path(before)) if before else {}
    for case in found if before else ():
        words = differing(found[case], then[case], 0.0)
        failed += bool(words)
        print(f"{case}: {'; '.join(words) or 'the same in every bit'}")
    return failed


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
