# %% [markdown]
# # A finger with inertia in time
#
# This demo emphasizes
# - a probe that is pressed in, held and then vibrates, stepped in time by the generalized-alpha
#   method (`solver.inertia`),
# - the harmonic response about the held state, which needs no steps, with inertia and without.
#
# The vibration begins at once, so the finger's own oscillations come with it. They fade within some
# periods: force, compression at an RA and motion at a PC receptor are fitted over the last two.
#
#     python demos/verification/inertia.py results/inertia
#     python demos/verification/inertia.py results/quick --pad-size 3 --far-size 6 --depth 0.3 \
#         --hold 0.05 --periods 3

# %%
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tactile_fem import Results, Study, StudyError, completed, run_script, vibrate
from tactile_fem.study import Finger
from tactile_fem.vibration import Spectrum

FITTED_PERIODS = 2


# %%
def main(
    folder: Path,
    *,
    preset: Literal["coarse", "medium", "paper"] = "coarse",
    pad_size: float | None = None,
    far_size: float | None = None,
    depth: float = 1.0,
    hold: float = 2.0,
    frequency: float = 100.0,
    amplitude: float = 0.01,
    periods: int = 10,
) -> None:
    """Let the probe vibrate in time and compare with the harmonic response.

    Parameters
    ----------
    folder
        For the scans.
    preset, pad_size, far_size
        The mesh.
    depth, hold
        Of the probe, mm, and how long it is held before, s.
    frequency, amplitude, periods
        Of the vibration, Hz and mm, and how many periods, two at least.
    """
    if periods < FITTED_PERIODS:
        raise StudyError(f"--periods is {periods} but must be at least {FITTED_PERIODS}.")
    finger = Finger(preset=preset, pad_size_mm=pad_size, far_size_mm=far_size)
    press = [{"kind": "press", "depth_mm": depth}, {"kind": "hold", "time_s": hold}]
    wave = {"frequency_Hz": frequency, "amplitude_mm": amplitude}
    swing = {"kind": "hold", "time_s": periods / frequency, "vibration": wave}
    completed(study_of(finger, press), folder / "held")
    exact, massless = (
        per_mm(vibrate(folder / "held", [frequency], density_kg_m3=density))
        for density in (None, 0.0)
    )
    scanned = completed(study_of(finger, [*press, swing], inertia=True), folder / "in_time")
    found = fitted(scanned, frequency, amplitude)
    print(f"{frequency:g} Hz, {periods} periods")
    names = "force, N/mm", "compression at RA, 1/mm", "motion at PC"
    for row in zip(names, exact, found, massless, strict=True):
        print_row(*row)
    imbalance = scanned.trace["imbalance_N"].max()
    print(f"forces balance to {imbalance:.1e} N")


# %% [markdown]
# The probe and the tissue, which relaxes, are those of `neurons/vibration.py`.


# %%
def study_of(finger: Finger, path: list[dict[str, Any]], *, inertia: bool = False) -> Study:
    """Return a study of a probe of 1 mm with an RA and a PC receptor under its middle."""
    below = {"placement": "line", "half_width_mm": 0.0}
    probe = {"radius_mm": 0.5, "columns": 1, "rows": 1, "relief_mm": 4.0, "fillet_radius_mm": 0.1}
    return Study.model_validate(
        {
            "finger": finger,
            "tissue": {"relaxation": "fingerpad"},
            "stimulus": {"kind": "dots", "start_mm": 0.0, **probe},
            "protocol": {"path": path},
            "afferents": [
                {"name": kind, "kind": kind, "receptors": below} for kind in ("RA", "PC")
            ],
            "solver": {"inertia": inertia},
            "output": {"pictures": False},
        }
    )


def per_mm(spectrum: Spectrum) -> list[complex]:
    """Return the amplitudes of force, compression and motion at the one frequency."""
    return [spectrum.force_N[0, 2], spectrum.stretches[0, 0, 0], spectrum.moved[0, 1, 2]]


def fitted(scanned: Results, frequency: float, amplitude: float) -> list[complex]:
    """Return the same from the last periods of a scan, fitted together with a drift."""
    trace = scanned.trace
    time_s = trace["clock_s"] - trace["clock_s"][-1]
    last = time_s > -(FITTED_PERIODS + 1e-6) / frequency
    phase = 2 * np.pi * frequency * time_s[last]
    felt = trace["force_N"][:, 2], trace["stretches"][:, 0, 0], trace["moved_mm"][:, 1, 2]
    basis = np.column_stack([np.sin(phase), np.cos(phase), np.ones(len(phase)), phase])
    in_phase, ahead, *_ = np.linalg.lstsq(basis, np.column_stack(felt)[last])[0]
    return list((in_phase + 1j * ahead) / amplitude)


def print_row(what: str, exact: complex, found: complex, massless: complex) -> None:
    """Print an amplitude per mm: harmonic, in time, and harmonic without inertia."""
    off, without = (100 * abs(value / exact - 1) for value in (found, massless))
    print(
        f"{what}: harmonic {told(exact)}, in time {told(found)}, off by {off:.1f} %; "
        f"without inertia {told(massless)}, off by {without:.0f} %"
    )


def told(value: complex) -> str:
    """Return modulus and phase."""
    return f"{abs(value):.4f} at {np.degrees(np.angle(value)):.1f}°"


if __name__ == "__main__":
    run_script(main)
