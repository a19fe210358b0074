"""Small vibrations about an accepted state: the finger's answer to one frequency.

With ``u = u_0 + Re[û exp(i w t)]`` the finger answers to a body that moves by ``Re[b̂ exp(i w t)]``
with

    (K(w) - w^2 M) û = f(w) b̂,    K(w) = K_0 + sum_j c_j(w) D_j,

`M` the mass, `K_0` the tangent with no chain of any network broken. A change of strain at frequency
`w` breaks the share ``c_j = 1/(1 + i w tau_j)`` of the chains of relaxation time ``tau_j``
(`tactile_fem.tissue.relaxation`: ``dA/dt`` is linear in `A`), so ``D_j`` is how the tangent changes
if all of them break. Kelvin and Voigt's viscosity adds ``c = i w tau_v``. Together these are the
complex moduli of the tissues at their present strain. Contact is that of the state
(`tactile_fem.vibration.small_contact`).

They are solved with one factorization per frequency (`tactile_fem.vibration.complex_solver`).
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import ArrayLike

from tactile_fem.mechanics.problem import Problem
from tactile_fem.mechanics.terms.inertia import mass_density
from tactile_fem.mechanics.terms.term import Delay
from tactile_fem.vibration.complex_solver import complex_solver
from tactile_fem.vibration.small_contact import Touch

Array = np.ndarray


@dataclass(frozen=True)
class _Forms:
    """Compiled: stiffness, load of the body's three motions, force on the body's three axes."""

    stiffness: fem.Form
    loads: list[fem.Form]
    forces: list[fem.Form]
    direct: list[list[fem.Form]]


@dataclass
class _Parts:
    """What the forms assemble to on this rank with one set of coefficients."""

    stiffness: PETSc.Mat
    loads: list[Array]
    forces: list[Array]
    direct: Array


@dataclass(frozen=True)
class HarmonicResponse:
    """The answer to a vibration of 1 mm.

    Attributes
    ----------
    frequency_Hz
        Of the vibration.
    u
        Complex amplitude of this rank's displacement, absolute, as `State.u` holds it, mm.
    force_N
        Complex amplitude of the force on the finger, (3,).
    iterations
        Of GMRES.
    """

    frequency_Hz: float
    u: Array
    force_N: Array
    iterations: int


class Harmonic:
    """The finger about an accepted state.

    Parameters
    ----------
    problem
        Its last accepted state is taken; nothing of it changes but the time step's duration, which
        each solve sets.
    density_kg_m3
        Of all tissues.
    """

    def __init__(self, problem: Problem, density_kg_m3: float) -> None:
        self._problem, self._comm = problem, problem.domain.comm
        self._u = problem.u
        V = self._u.function_space
        problem.state.reset()
        self.freeze(None)
        self._compile_form = compile_ = problem.contact.obstacle.compile
        self._forms = self._compile(Touch.of(problem.contact))
        u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
        density = mass_density(V.mesh, density_kg_m3)
        dx, dim = problem.tissues.dx, V.mesh.geometry.dim
        mass = compile_(density * ufl.inner(u, v) * dx)
        pulls = [compile_(density * v[k] * dx) for k in range(dim)]
        self._inertia = [self._vector(pull, problem.bcs) for pull in pulls]
        self._mass = fem_petsc.assemble_matrix(mass, problem.bcs, diag=0.0)
        self._mass.assemble()
        self._delays = problem.bulk.delays
        self._at_once = self._assembled(None)
        self._late = [self._without_at_once(self._assembled(delay)) for delay in self._delays]
        self._field = fem.Function(V)

    @property
    def delays(self) -> list[Delay]:
        """What depends on the frequency besides inertia."""
        return self._delays

    def freeze(self, delay: Delay | None) -> None:
        """Set the forms to the accepted state, with all of one delay or with none."""
        self._problem.terms.freeze(delay)

    def respond(
        self,
        frequency_Hz: float,
        body_mm: ArrayLike,
        bone_mm: ArrayLike = (0.0, 0.0, 0.0),
        load: Array | None = None,
    ) -> HarmonicResponse:
        """Return the answer to motions of the body and of the bone, and to nodal forces.

        Seen from the bone, the body moves by the difference and inertia pulls at all tissues.

        Parameters
        ----------
        frequency_Hz
            Not negative.
        body_mm, bone_mm
            Complex or real amplitudes (3,) of the body and of what is held, mm.
        load
            This rank's complex amplitudes of nodal forces, N, as its owned part of `State.u`.

        Raises
        ------
        TactileError
            The linear equations could not be solved.
        """
        w = 2 * np.pi * frequency_Hz
        amounts = [delay.amount(w) for delay in self._delays]
        bone = np.asarray(bone_mm)
        motion = np.asarray(body_mm) - bone
        parts = [(1.0, self._at_once), *zip(amounts, self._late, strict=True)]
        right = sum(c * np.tensordot(motion, part.loads, 1) for c, part in parts)
        right = right + w**2 * np.tensordot(bone, self._inertia, 1)
        if load is not None:
            right = right + load
        x, iterations = self._solve(w, amounts, right)
        owned = len(right)
        force = sum(
            c * (np.array(part.forces) @ x[:owned] + part.direct @ motion) for c, part in parts
        )
        u = x + np.tile(bone, len(x) // len(bone))
        return HarmonicResponse(frequency_Hz, u, self._comm.allreduce(force), iterations)

    def _compile(self, touch: Touch) -> _Forms:
        problem, V = self._problem, self._u.function_space
        u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
        dim = V.mesh.geometry.dim
        axes = [ufl.as_vector([float(i == k) for i in range(dim)]) for k in range(dim)]
        still = ufl.as_vector([0.0] * dim)
        # Here the viscous stress pulls at the skin as well, and the contact is as much stiffer.
        skin = problem.contact.skin(problem.bulk)

        def traction(of_skin: ufl.core.expr.Expr | None, motion, on) -> ufl.Form:
            """Return the work of the change of traction in `on`."""
            form = ufl.Form([])
            for part in skin:
                dt = still if of_skin is None else ufl.derivative(part.law.t, self._u, of_skin)
                form += ufl.dot(touch.change(part.law, dt, motion), on) * part.ds
            return form

        stiffness = ufl.derivative(problem.bulk.static_residual(v), self._u, u)
        compile_ = self._compile_form
        return _Forms(
            compile_(stiffness - traction(u, u, v)),
            [compile_(traction(None, -axis, v)) for axis in axes],
            [compile_(traction(v, v, axis)) for axis in axes],
            [[compile_(traction(None, -b, on)) for b in axes] for on in axes],
        )

    def _assembled(self, delay: Delay | None) -> _Parts:
        self.freeze(delay)
        forms, bcs = self._forms, self._problem.bcs
        with common.Timer("tactile: harmonic tangent"):
            K = fem_petsc.assemble_matrix(forms.stiffness, bcs)
            K.assemble()
            direct = [[fem.assemble_scalar(form) for form in row] for row in forms.direct]
            return _Parts(
                K,
                [self._vector(form, bcs) for form in forms.loads],
                [self._vector(form, bcs) for form in forms.forces],
                np.array(direct),
            )

    def _vector(self, form: fem.Form, bcs: list[fem.DirichletBC]) -> Array:
        """Return this rank's owned entries of an assembled vector, zero where held."""
        b = fem_petsc.assemble_vector(form)
        b.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        fem_petsc.set_bc(b, bcs, alpha=0.0)
        values = b.array.copy()
        b.destroy()
        return values

    def _without_at_once(self, parts: _Parts) -> _Parts:
        """Take away what there is without any delay."""
        own = self._at_once
        parts.stiffness.axpy(-1.0, own.stiffness, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        return _Parts(
            parts.stiffness,
            [b - a for a, b in zip(own.loads, parts.loads, strict=True)],
            [b - a for a, b in zip(own.forces, parts.forces, strict=True)],
            parts.direct - own.direct,
        )

    def _solve(self, w: float, amounts: list[complex], right: Array) -> tuple[Array, int]:
        """Return the displacement's complex amplitude, with ghosts, and the iterations."""
        same = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
        A = self._at_once.stiffness.duplicate(copy=True)
        B = self._at_once.stiffness.duplicate(copy=False)
        B.zeroEntries()
        A.axpy(-(w**2), self._mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        for amount, part in zip(amounts, self._late, strict=True):
            A.axpy(amount.real, part.stiffness, same)
            B.axpy(amount.imag, part.stiffness, same)
        with common.Timer("tactile: harmonic solve"), complex_solver(A, B) as solve:
            real, imag, iterations = solve(right.real, right.imag)
        return self._with_ghosts(real) + 1j * self._with_ghosts(imag), iterations

    def _with_ghosts(self, owned: Array) -> Array:
        self._field.x.array[: len(owned)] = owned
        self._field.x.scatter_forward()
        return self._field.x.array.copy()
