# %% [markdown]
# # A letter as SA1, RA and PC afferents see it
#
# This demo emphasizes
# - three kinds of afferents in one scan,
# - images of their firing, and how much of the letter each of them carries.
#
# SA1 afferents lie on the epidermis-dermis interface and feel strain energy density; RA lie beneath
# it in the papillae and feel how fast they are compressed; PC lie in the fat, 2 mm deep, and feel
# acceleration. All are drawn on a line of receptors 0.2 mm apart, more densely than they lie in a
# finger, so that images can be compared. Correlation with the letter's outline, at the best shift
# of up to 1 mm, tells how spatial a kind is. A scan has no inertia and its steps are 5 ms apart, so
# PC's band is reached by what is abrupt only.
#
#     python demos/protocols/kinds.py results/kinds
#     python demos/protocols/kinds.py results/quick --depth 0.5 --distance 0.4

# %%
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from firing_images import population_image, side_by_side
from letter_recognition import outline_correlation

from tactile_fem import Study, completed, load_study, run_script
from tactile_fem.output.histories import rings

KINDS = "SA1", "RA", "PC"


# %%
def main(
    folder: Path,
    *,
    text: str = "G",
    depth: float = 1.97,
    distance: float = 10.0,
    set_: Annotated[tuple[str, ...], Parameter(name="--set", consume_multiple=True)] = (),
) -> None:
    """Scan a letter with three kinds of afferents and compare their images.

    Parameters
    ----------
    folder
        For the scan and the figure.
    text, depth, distance
        The letter; depth and slide, mm.
    set_
        Further values of the study, ``section.key=value``.
    """
    study = load_study(
        overrides=[
            "finger.preset=coarse",
            f"stimulus.text={text}",
            f"protocol.depth_mm={depth}",
            f"protocol.distance_mm={distance}",
            "output.pictures=false",
            *set_,
        ]
    )
    kinds = [{"name": kind, "kind": kind} for kind in KINDS]
    scan = completed(Study.model_validate({**study.model_dump(), "afferents": kinds}), folder)
    images = {kind: population_image(scan, name=kind) for kind in KINDS}
    for kind, image in images.items():
        counts = image.response.counts()
        r = outline_correlation(image, study.stimulus)
        busy = float(np.mean(image.rate_Hz > image.rate_Hz.max() / 4)) if counts.any() else 0.0
        print(
            f"{kind}: {counts.sum()} spikes, outline r = {r:.3f}, "
            f"{100 * busy:.0f} % of the image above a quarter of its maximum"
        )
    side_by_side(images, rings(study.stimulus)).savefig(folder / "kinds.png")
    print(folder / "kinds.png")


if __name__ == "__main__":
    run_script(main)
