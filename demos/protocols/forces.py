# %% [markdown]
# # Does the force matter to how well letters are read?
#
# This demo emphasizes
# - how well letters, embossed or of Braille, can be told from the firing of a population, at
#   several forces,
# - a sweep over two values of the study, letters and forces.
#
# A finger presses until it bears the force, and holds force or depth while the letter passes at
# 20 mm/s. As in `legibility.py` afferents differ in gain and thresholds vary, each image of firing
# is recognised by templates from other populations, and a reader may have noise of its own:
# `--noise` takes the standard deviation that `legibility.py --accuracy 0.5` found, so that all are
# read by the same reader. Force hardly matters to people who read raised letters (Loomis 1985).
#
#     python demos/protocols/forces.py results/braille --jobs 2
#     python demos/protocols/forces.py results/embossed --jobs 2 --kind text --letters CFGHOQ \
#         --forces 0.3 0.6 0.9 --distance 10 --hold depth
#     python demos/protocols/forces.py results/quick --letters ab --forces 0.05 --distance 0.6

# %%
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from firing_images import letters_figure, population_image
from legibility import print_found, realized, save
from letter_recognition import confusion_figure, recognise

from tactile_fem import run_script
from tactile_fem.output.histories import rings
from tactile_fem.series import complete_scans, run_series, sweep, write_summary


# %%
def main(
    folder: Path,
    *,
    kind: Literal["braille", "text"] = "braille",
    letters: str = "abcdefghijklmnopqrstuvwxyz",
    forces: Annotated[tuple[float, ...], Parameter(consume_multiple=True)] = (0.2, 0.5),
    distance: float = 7.0,
    output: float = 0.2,
    preset: str = "coarse",
    realizations: int = 10,
    gain_spread: float = 0.3,
    threshold_noise: float = 0.1,
    noise: float = 0.0,
    hold: Literal["force", "depth"] = "force",
    set_: Annotated[tuple[str, ...], Parameter(name="--set", consume_multiple=True)] = (),
    jobs: int = 1,
) -> None:
    """Scan each letter with each force, N, over a distance in mm, and recognise the images.

    Parameters
    ----------
    kind
        Of the letters: Braille, or embossed.
    output
        Spacing of the output positions in the slide, mm; steps are at most this long.
    noise
        The reader's inner noise, spikes/s.
    hold
        What the slide holds: the force, or the depth at which the press reached it, which takes
        less than half of the time.
    set_
        Further values of the study, ``section.key=value``.
    jobs
        Parallel scans.
    """
    overrides = [
        f"stimulus.kind={kind}",
        # Embossed letters start half a pitch away by default.
        *([f"stimulus.start_mm={-distance / 2}"] if kind == "braille" else []),
        f"finger.preset={preset}",
        f"protocol.hold={hold}",
        f"protocol.distance_mm={distance}",
        f"protocol.output_mm={output}",
        *set_,
    ]
    axes = [f"stimulus.text={','.join(letters)}", f"protocol.force_N={','.join(map(str, forces))}"]
    members = sweep(axes, overrides=overrides)
    run_series(members, folder, jobs=jobs)
    print(write_summary(members, folder))
    scans = complete_scans(members, folder)
    variety = {"gain_spread": gain_spread, "threshold_noise": threshold_noise}
    recognitions, images = {}, {}
    for force in forces:
        own = {s.study.stimulus.text: s for s in scans if s.study.protocol.force_N == force}
        varied_images = {
            letter: realized(partial(population_image, scan), scan, variety, realizations)
            for letter, scan in own.items()
        }
        recognition = recognise(varied_images, noise_Hz=noise)
        name = f"{force:g} N"
        recognitions[name] = {0.0: recognition}
        images[name] = {letter: population_image(scan) for letter, scan in own.items()}
        spikes = sum(int(image.response.counts().sum()) for image in images[name].values())
        print(f"{name}: {spikes / len(own):.0f} spikes a letter")
        print_found(name, 0.0, recognition)
    outlines = {scan.study.stimulus.text: rings(scan.study.stimulus) for scan in scans}
    figures = {
        "letters": letters_figure(images, outlines),
        "confusion": confusion_figure(recognitions),
    }
    save(figures, folder)


if __name__ == "__main__":
    run_script(main)
