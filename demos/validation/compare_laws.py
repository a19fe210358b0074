# %% [markdown]
# # Which law, and which drive, predicts rates best
#
# Laws of transduction and drives are fitted to bar and spheres as in `calibrate.py`, and predict a
# grating (by correlation, because other afferents have other gains). The recordings are of monkeys,
# whose finger pads are smaller than the model's. If theirs were $k$ times as stiff, the bar,
# pressed to a depth, would cause $k$ times the stress, and the spheres, pressed with a force $F$,
# would deform the pad as $F/k$ deforms the model's. All tissues scale alike.
#
#     python demos/validation/compare_laws.py
#     python demos/validation/compare_laws.py --stiffness 1 --stiffness 3

# %%
from dataclasses import replace

import numpy as np
import recordings
from calibrate import LAWS, Law, explained, modelled
from recordings import Recording, rates_of

from tactile_fem import run_script
from tactile_fem.neuron import DRIVES, Drive

STRESSES, STRETCHES = "stresses_kPa", "stretches"


def positive(label: str, unit: str, of, order: int) -> tuple[Drive, int]:
    """Return a drive of what is positive, and the power of the stiffness that it grows with."""
    return Drive(label, unit, lambda h: np.maximum(of(h), 0.0).astype(float)), order


# By name: the drive, and whether it is a stress (1) or a strain (0).
COMPARED = {
    "SED": (DRIVES["sed"], 1),
    "von Mises stress": (DRIVES["von_mises"], 1),
    "largest tension": positive("Tension", "kPa", lambda h: h[STRESSES][..., -1], 1),
    "largest compression": positive("Compression", "kPa", lambda h: -h[STRESSES][..., 0], 1),
    "largest stretch": positive("Stretch", "1", lambda h: h[STRETCHES][..., -1] - 1, 0),
    "largest shortening": positive("Shortening", "1", lambda h: 1 - h[STRETCHES][..., 0], 0),
}


# %%
def main(*, stiffness: tuple[float, ...] = (1.0, 2.0, 4.0)) -> None:
    """Fit every law and drive; print what each explains and predicts.

    Parameters
    ----------
    stiffness
        Ratio of the monkeys' pads' stiffness to the model's.
    """
    print(f"{'law':14s}{'drive':22s}stiffness  R2: ramp   hold spheres   all  grating: r")
    rows = [(name, "SED", 1.0) for name in LAWS]
    rows += [("logarithmic", drive, factor) for drive in COMPARED for factor in stiffness]
    for law, name, factor in dict.fromkeys(rows):
        numbers = " ".join(f"{value:7.3f}" for value in compared(LAWS[law], name, factor))
        print(f"{law:14s}{name:22s}{factor:9g}   {numbers}")


def compared(law: Law, name: str, factor: float) -> tuple[float, ...]:
    """Return R2 of ramp, hold, spheres and all, and the correlation of the grating."""
    drive, order = COMPARED[name]
    size = factor**order
    bar = times(recordings.bar(drive), size)
    spheres = [times(one, size) for one in recordings.spheres(drive, factor)]
    found, _ = started(law, spheres).fitted_quietly([bar, *spheres])
    grating = [times(one, size) for one in recordings.grating(drive)]
    model = modelled(grating, found.neuron)
    predicted = np.corrcoef(model, rates_of(grating))[0, 1] if np.ptp(model) else 0.0
    return *found.r2[:2], explained(spheres, found.neuron), found.r2[-1], predicted


def times(one: Recording, factor: float) -> Recording:
    """Return a recording whose drive is larger by a factor."""
    return one._replace(drive=factor * np.asarray(one.drive))


def started(law: Law, spheres: list[Recording]) -> Law:
    """Return a law whose compression starts at the same share of the spheres' drive for all."""
    if law.neuron.model != "logarithmic":
        return law
    scale = 0.02 * float(np.mean([np.max(one.drive) for one in spheres]))
    gains = {"compression_kPa": scale, "static_gain_pA_per_kPa": 430.0 / scale}
    return replace(law, neuron=law.neuron.model_copy(update=gains))


# %%
if __name__ == "__main__":
    run_script(main)
