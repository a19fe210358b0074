"""Series of scans: sweeps over values, passes over one receptor, and their reports."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tactile_fem.output.histories import mean_over
from tactile_fem.series.members import Member, single_fibre, sweep
from tactile_fem.series.run import (
    Outcome,
    collected,
    complete_scans,
    numbers_of,
    run_all,
    run_series,
    write_summary,
)

if TYPE_CHECKING:
    from tactile_fem.series.comparison import compare, write_comparison
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
    "compare",
    "complete_scans",
    "correlations",
    "fibre_image",
    "mean_over",
    "numbers_of",
    "outline_image",
    "population_image",
    "rate_image",
    "run_all",
    "run_series",
    "single_fibre",
    "sweep",
    "write_comparison",
    "write_list",
    "write_snakefile",
    "write_summary",
]


def __getattr__(name: str) -> Any:
    """Import what draws or needs MPI when it is first used: both take a while."""
    for module in ("comparison", "image", "listing") if name in __all__ else ():
        found = vars(import_module(f"{__name__}.{module}"))
        if name in found:
            return found[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
