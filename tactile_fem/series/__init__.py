"""Series of scans: passes over one receptor, and sweeps over values of a study."""

from tactile_fem.series.members import Member, single_fibre, sweep
from tactile_fem.series.run import Outcome, Task, run_series
from tactile_fem.series.table import write_summary

__all__ = ["Member", "Outcome", "Task", "run_series", "single_fibre", "sweep", "write_summary"]
