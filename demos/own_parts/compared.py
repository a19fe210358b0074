"""A solver: the fast one, compared with the plain one in each step."""

import numpy as np

from tactile_fem.solvers.fast import FastSolver
from tactile_fem.solvers.plain import PlainSolver


class Compared:
    """Both solve each step from the same guess; the result is that of the fast one."""

    def __init__(self, problem):
        self.u_mm = problem.u.x.array
        self.plain, self.fast = PlainSolver(problem), FastSolver(problem)
        self.difference_mm = 0.0

    def solve(self):
        """Solve a step with both; return the report of the fast one."""
        guess = self.u_mm.copy()
        self.plain.solve()
        expected = self.u_mm.copy()
        self.u_mm[:] = guess
        report = self.fast.solve()
        self.difference_mm = max(self.difference_mm, np.abs(self.u_mm - expected).max())
        return report

    def close(self):
        """Free both solvers; all ranks must call it."""
        self.plain.close()
        self.fast.close()

    def __getattr__(self, name):  # everything else: options, residual, end_step, ...
        return getattr(self.fast, name)
