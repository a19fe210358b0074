"""What receptors feel of a small vibration, from the displacement's complex amplitude."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from tactile_fem.mechanics.problem import Problem
from tactile_fem.receptors.probe import Probe
from tactile_fem.vibration.harmonic import Harmonic, Response

Array = np.ndarray
# Largest displacement of the central differences, mm: small against strains that matter, large
# against rounding.
_MOVED_MM = 1e-5


class Felt:
    """Complex amplitudes of the receptors' quantities for a vibration of 1 mm.

    With `q` a quantity, ``dq = q_u û + sum_j c_j (dq_j - dq_0)``: like the tangent it is that with
    no chain broken and what each delay adds (`tactile_fem.vibration.harmonic`). The derivatives
    are central differences of the probe's readings.

    Parameters
    ----------
    problem, probe
        The finger in an accepted state, and its receptors.
    harmonic
        Its linearization.
    """

    def __init__(self, problem: Problem, probe: Probe, harmonic: Harmonic) -> None:
        self._problem, self._probe, self._harmonic = problem, probe, harmonic

    def amplitudes(self, response: Response) -> tuple[Array, Array, Array]:
        """Return displacement (r, 3), SED in kPa (r,) and stretches (r, 3), complex, per mm."""
        delays = self._harmonic.delays
        w = 2 * np.pi * response.frequency_Hz
        at_once = self._difference(response.u)
        total = at_once.copy()
        for delay in delays:
            self._harmonic.freeze(delay)
            total += delay.amount(w) * (self._difference(response.u) - at_once)
        self._harmonic.freeze(None)
        return total[:, :3], total[:, 3], total[:, 4:]

    def _difference(self, u: Array) -> Array:
        """Return the change with a displacement, (receptors, 7), with the present coefficients."""
        return self._along(u.real) + 1j * self._along(u.imag)

    def _along(self, direction: Array) -> Array:
        largest = self._problem.domain.comm.allreduce(np.abs(direction).max(initial=0.0), MPI.MAX)
        if not largest:
            return np.zeros((self._probe.weights.shape[0], 7))
        size, u = _MOVED_MM / largest, self._problem.u.x.array
        saved, found = u.copy(), []
        for step in (size, -size):
            u[:] = saved + step * direction
            state = self._probe.read()
            columns = state.moved_mm, state.sed_kPa[:, None], state.stretches
            found.append(np.concatenate(columns, axis=1))
        u[:] = saved
        return (found[0] - found[1]) / (2 * size)
