"""Series of scans: sweeps over values, passes over one receptor, and their reports."""

from tactile_fem.series.comparison import compare, write_comparison
from tactile_fem.series.image import (
    RateImage,
    correlations,
    fibre_image,
    outline_image,
    population_image,
    rate_image,
)
from tactile_fem.series.members import Member, single_fibre, sweep
from tactile_fem.series.run import (
    Outcome,
    complete_scans,
    numbers_of,
    run_all,
    run_series,
    share_of,
    write_summary,
)

__all__ = [
    "Member",
    "Outcome",
    "RateImage",
    "compare",
    "complete_scans",
    "correlations",
    "fibre_image",
    "numbers_of",
    "outline_image",
    "population_image",
    "rate_image",
    "run_all",
    "run_series",
    "share_of",
    "single_fibre",
    "sweep",
    "write_comparison",
    "write_summary",
]
