"""Series of scans: passes over one receptor, and sweeps over values of a study."""

from tactile_fem.series.members import Member, single_fibre, sweep
from tactile_fem.series.run import Outcome, Task, complete_scans, run_series
from tactile_fem.series.table import numbers_of, write_summary

__all__ = [
    "Member",
    "Outcome",
    "Task",
    "complete_scans",
    "numbers_of",
    "run_series",
    "single_fibre",
    "sweep",
    "write_summary",
]
