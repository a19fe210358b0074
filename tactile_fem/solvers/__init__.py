"""Solvers of a step, behind one interface: `solve` a problem and report.

`plain.PlainSolver` is DOLFINx's NonlinearProblem as it comes, `fast.FastSolver` what a scan uses.
"""

from typing import TYPE_CHECKING

from tactile_fem.runtime import backend
from tactile_fem.runtime.lazy import lazily

if TYPE_CHECKING:
    from tactile_fem.solvers.finger_problem import FingerProblem

__all__ = [
    "FingerProblem",
    "backend",
]

__getattr__ = lazily(
    __name__,
    {
        "finger_problem": ["FingerProblem"],
    },
)
