"""Solvers of a step, behind one interface: `solve` a problem and report.

`plain.PlainSolver` is DOLFINx's NonlinearProblem as it comes, `fast.FastSolver` what a scan uses.
"""

from tactile_fem.runtime import backend

__all__ = ["backend"]
