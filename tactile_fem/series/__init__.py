"""Series of scans: passes over one receptor, sweeps, what their spikes say, reports."""

from tactile_fem.series.bundles import Bundle, bundles
from tactile_fem.series.image import RateImage, fibre_image, population_image, thinned
from tactile_fem.series.legibility import Reading, correlation, edge_image, read
from tactile_fem.series.members import Member, single_fibre, sweep
from tactile_fem.series.run import Outcome, Task, complete_scans, run_series
from tactile_fem.series.table import numbers_of, write_summary

__all__ = [
    "Bundle",
    "Member",
    "Outcome",
    "RateImage",
    "Reading",
    "Task",
    "bundles",
    "complete_scans",
    "correlation",
    "edge_image",
    "fibre_image",
    "numbers_of",
    "population_image",
    "read",
    "run_series",
    "single_fibre",
    "sweep",
    "thinned",
    "write_summary",
]
