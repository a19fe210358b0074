"""Series of scans: sweeps over values, passes over one receptor, and their reports."""

from typing import TYPE_CHECKING

from tactile_fem.results.histories import mean_over
from tactile_fem.results.numbers import numbers_of
from tactile_fem.runtime.lazy import lazily
from tactile_fem.series.members import Member, single_fibre, sweep
from tactile_fem.series.run import (
    Outcome,
    collected,
    complete_scans,
    keep_reason,
    reason_of,
    run_all,
    run_series,
    write_summary,
)

if TYPE_CHECKING:
    from tactile_fem.series.comparison import common, compare, write_comparison
    from tactile_fem.series.image import (
        RateImage,
        correlations,
        fibre_image,
        outline_image,
        population_image,
        rate_image,
    )
    from tactile_fem.series.listing import write_list, write_snakefile

__all__ = [
    "Member",
    "Outcome",
    "RateImage",
    "collected",
    "common",
    "compare",
    "complete_scans",
    "correlations",
    "fibre_image",
    "keep_reason",
    "mean_over",
    "numbers_of",
    "outline_image",
    "population_image",
    "rate_image",
    "reason_of",
    "run_all",
    "run_series",
    "single_fibre",
    "sweep",
    "write_comparison",
    "write_list",
    "write_snakefile",
    "write_summary",
]

# What draws or needs MPI, which take a while.
__getattr__ = lazily(
    __name__,
    {
        "comparison": ["common", "compare", "write_comparison"],
        "image": [
            *("RateImage", "correlations", "fibre_image", "outline_image", "population_image"),
            "rate_image",
        ],
        "listing": ["write_list", "write_snakefile"],
    },
)
