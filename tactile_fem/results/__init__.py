"""The results folder: what a scan keeps, its trace, its fields; read without DOLFINx."""

from typing import TYPE_CHECKING

from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.results.columns import OF_STEP, TRACE
    from tactile_fem.results.histories import central_receptor, mean_over
    from tactile_fem.results.numbers import history, numbers_of
    from tactile_fem.results.results import Results
    from tactile_fem.results.surfaces import SurfaceFields
    from tactile_fem.results.trace import Trace

__all__ = [
    "OF_STEP",
    "TRACE",
    "Results",
    "SurfaceFields",
    "Trace",
    "central_receptor",
    "history",
    "mean_over",
    "numbers_of",
]

__getattr__ = lazily(
    __name__,
    {
        "columns": ["OF_STEP", "TRACE"],
        "histories": ["central_receptor", "mean_over"],
        "numbers": ["history", "numbers_of"],
        "results": ["Results"],
        "surfaces": ["SurfaceFields"],
        "trace": ["Trace"],
    },
)
