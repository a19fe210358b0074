# %% [markdown]
# # A population of afferents compared with one fibre in many passes
#
# This demo emphasizes
# - the classic protocol of single-fibre recordings: the letter is shifted across the finger between
#   passes, and one receptor's spikes are stacked to an image,
# - the population protocol of Hamasaki et al. 2020 (DOI 10.1177/1687814020984651): one pass, many
#   receptors,
# - that the passes are separate scans, which run in parallel and are not repeated.
#
# Let $r_p(x, d)$ be the rate of the afferent at $x$ when the letter has moved by $d$, and
# $r_f(s, d)$ that of the afferent at $x = 0$ when the letter is shifted by $s$. A skin that is
# the same everywhere and pressed evenly has $r_p(x, d) = r_f(-x, d)$. A finger is round, so
# receptors far from its middle carry less force, and the population's image is less clear. Both
# images are compared with the letter's outline by Pearson's correlation at the best shift of up to
# 1 mm.
#
#     python demos/protocols/single_fibre.py results/fibre --jobs 2
#     python demos/protocols/single_fibre.py results/quick --spacing 1 --half-width 1 --depth 0.4 \
#         --distance 0.4

# %%
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from firing_images import population_image, side_by_side
from letter_recognition import outline_correlation

from tactile_fem import Results, Study, load_study, run_script, write_table
from tactile_fem.output.histories import rings
from tactile_fem.series import (
    Member,
    RateImage,
    complete_scans,
    fibre_image,
    run_series,
    single_fibre,
    write_summary,
)

# Spikes further apart belong to different bundles: 33 spikes/s at 20 mm/s.
GAP_MM = 0.6


# %% [markdown]
# The population's receptors have the same spacing as the passes, so both images have the
# same rows. The population's scan is also the unshifted pass.


# %%
def main(
    folder: Path,
    *,
    text: str = "G",
    spacing: float = 0.2,
    half_width: float = 5.0,
    depth: float = 1.97,
    distance: float = 10.0,
    output: float = 0.1,
    preset: str = "coarse",
    set_: Annotated[tuple[str, ...], Parameter(name="--set", consume_multiple=True)] = (),
    jobs: int = 1,
) -> None:
    """Scan in both protocols and compare their images.

    Parameters
    ----------
    spacing, half_width
        Of receptors and shifts, mm.
    output
        Spacing of the output positions in the slide, mm; steps are at most this long.
    set_
        Further values of the study, ``section.key=value``.
    jobs
        Parallel scans.
    """
    study = load_study(
        overrides=[
            f"finger.preset={preset}",
            f"stimulus.text={text}",
            f"protocol.depth_mm={depth}",
            f"protocol.distance_mm={distance}",
            f"protocol.output_mm={output}",
            f"receptors.half_width_mm={half_width}",
            f"receptors.spacing_mm={spacing}",
            "output.pictures=false",
            *set_,
        ]
    )
    unshifted = Member("population", study, {"shift_mm": 0.0})
    shifted = single_fibre(study, spacing_mm=spacing, half_width_mm=half_width)
    members = [unshifted, *(member for member in shifted if member.values["shift_mm"])]
    run_series(members, folder, jobs=jobs)
    print(write_summary(members, folder))
    population = Results.open(folder / unshifted.name)
    passes = complete_scans(members, folder)
    images = {"population": population_image(population), "single fibre": fibre_image(passes)}
    print_results(images, study, folder)


def print_results(images: dict[str, RateImage], study: Study, folder: Path) -> None:
    """Print and draw both images."""
    rows = []
    for name, image in images.items():
        r = outline_correlation(image, study.stimulus)
        count = image.response.counts().sum()
        print(f"{name:12s} {len(image.across_mm):3d} rows {count:6d} spikes, outline r = {r:.3f}")
        speed = study.protocol.speed_mm_s
        for bundle in image.response.bundles(GAP_MM / speed)[len(image.across_mm) // 2]:
            start, end = speed * bundle.start_s, speed * bundle.end_s
            rows.append({"protocol": name, "start_mm": start, "end_mm": end, **vars(bundle)})
            print(
                f"    {start:5.2f} to {end:5.2f} mm: {bundle.spikes:3d} "
                f"spikes, {bundle.rate_Hz:4.0f} /s"
            )
    if rows:
        write_table(folder / "bundles.csv", rows)
    side_by_side(images, rings(study.stimulus)).savefig(folder / "protocols.png")
    print(folder / "protocols.png")


if __name__ == "__main__":
    run_script(main)
