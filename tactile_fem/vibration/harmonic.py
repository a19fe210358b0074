"""Small vibrations about an accepted state: the finger's answer to one frequency.

With ``u = u_0 + Re[û exp(i w t)]`` the finger answers to a body that moves by ``Re[b̂ exp(i w t)]``
with

    (K(w) - w^2 M) û = f(w) b̂,    K(w) = K_0 + sum_j c_j(w) D_j,

`M` the mass, `K_0` the tangent with no chain of any network broken. A change of strain at frequency
`w` breaks the share ``c_j = 1/(1 + i w tau_j)`` of the chains of relaxation time ``tau_j``
(`tactile_fem.tissue.relaxation`: ``dA/dt`` is linear in `A`), so ``D_j`` is how the tangent changes
if all of them break. Kelvin and Voigt's viscosity adds ``c = i w tau_v``. Together these are the
complex moduli of the tissues at their present strain.

The contact stays that of the state: what touches goes on touching and what does not stays free;
what sticks goes on sticking, and what slides goes on in its direction with Coulomb's friction. With
`m` the motion of the skin relative to the body, ``dt`` the change of the tissue's traction `t` and
`H` the curvature of the body,

    ds = ds_n nu + s_n dnu + ds_t - (s_t.dnu) nu,    dnu = H m       where s_n > 0
    ds_n = c (dt.nu + t.dnu - gamma_h m.nu)
    ds_t = (dt - gamma_h m)_t - (t.nu) dnu                           where it sticks
    ds_t = (d(mu s_n)/ds_n) ds_n s_t/|s_t|                           where it slides

`c` is 1 but where the onset of contact is regularized. `mu` is that of the last step's slip speed
and place; how it changes with them in the vibration is left out.

A bone on its joint (`tactile_fem.finger.joint`) turns by an angle ``a``. With `r` the motion of all
places with the bone per angle, ``û = x + a r``, where `x` is 0 at what is held, and the moments
about the joint are in balance:

    (k + i w d - w^2 I) a + r.(K(w) û - f(w) b̂) + r'.h a - w^2 r.M û = 0,

where `h` are the forces that hold the finger and ``r'`` is how `r` changes per angle. `I` is what
the meshed tissues leave of the joint's moment of inertia, at least 0.

The equations are solved with one factorization per frequency
(`tactile_fem.vibration.complex_solver`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import common, fem
from dolfinx.fem import petsc as fem_petsc
from numpy.typing import ArrayLike
from ufl.core.expr import Expr

from tactile_fem.assembly import Constant
from tactile_fem.mechanics import (
    ContactLaw,
    Delay,
    Problem,
    SkinPart,
    mass_density,
    moment_of_inertia,
)
from tactile_fem.study import Joint
from tactile_fem.vibration.complex_solver import complex_solver

Array = np.ndarray
# Share of Coulomb's bound from which on skin slides.
_SLIDING_SHARE = 0.99
_TINY_MPa = 1e-12


@dataclass
class _Parts:
    """What the forms assemble to on this rank with one set of coefficients."""

    stiffness: PETSc.Mat
    loads: Array  # of a motion of the body along each axis, of a turn of the bone, (3 or 4, dofs)
    forces: Array  # on the finger along each axis, moment that turns the bone, over displacement
    direct: Array  # those without displacement, over motions of the body and turn, (3 or 4, same)


@dataclass(frozen=True)
class HarmonicResponse:
    """The answer to a vibration of 1 mm."""

    frequency_Hz: float
    u: Array  # complex amplitude of this rank's displacement, absolute, as `State.u` holds it, mm
    force_N: Array  # complex amplitude of the force on the finger, (3,)
    iterations: int  # of GMRES
    turn_rad: complex = 0.0  # amplitude of the bone's turn about its joint


class Harmonic:
    """The finger about the last accepted state of a problem, with one density of all tissues.

    What is held is clamped, or turns about a joint. Nothing of the problem changes but the duration
    of its time step, which each solve sets.
    `delays` are what depends on the frequency besides inertia.
    """

    def __init__(self, problem: Problem, density_kg_m3: float, joint: Joint | None = None) -> None:
        self._problem, self._comm, self._joint = problem, problem.domain.comm, joint
        self._u = problem.u
        V = self._u.function_space
        problem.state.reset()
        self.freeze(None)
        self._compile = compile_ = problem.contact.obstacle.compile
        # Unit vectors of the body's motion and of the force on it, for forms compiled once.
        zero = np.zeros(V.mesh.geometry.dim)
        self._motion, self._axis = Constant(V.mesh, zero), Constant(V.mesh, zero)
        self._stiffness, self._load, self._force, self._direct = self._forms()
        u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
        density, dx = mass_density(V.mesh, density_kg_m3), problem.tissues.dx
        mass = compile_(density * ufl.inner(u, v) * dx)
        pull = compile_(density * ufl.dot(self._axis, v) * dx)
        self._is_free = self._where_free()
        self._places = self._where()
        self._arms = joint.arms(self._places).ravel() if joint else np.zeros(0)
        self._inertia = [self._vector(pull) * self._is_free for _ in _along(self._axis)]
        self._mass = fem_petsc.assemble_matrix(mass, problem.bcs, diag=0.0)
        self._mass.assemble()
        if joint:
            turned, _ = self._of_turn(mass)
            self._turned_mass = turned * self._is_free
            tissues = self._comm.allreduce(self._arms @ turned)
            at_rest = moment_of_inertia(problem.tissues, density_kg_m3, joint.centre_mm)
            self._moment_of_inertia = tissues + joint.inertia_beyond(at_rest)
            held = self._vector(compile_(problem.bulk.static_residual(v))) * (1 - self._is_free)
            inwards = joint.inwards(self._places).ravel()
            self._per_turn_of_held = self._comm.allreduce(inwards @ held)
        self.delays = problem.bulk.delays
        self._at_once = self._assembled(None)
        self._late = [self._without_at_once(self._assembled(delay)) for delay in self.delays]
        self._field = fem.Function(V)

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

        Seen from the bone, the body moves by the difference and inertia pulls at all tissues. A
        bone on its joint also turns; then `bone_mm` is 0.

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
        amounts = [delay.amount(w) for delay in self.delays]
        bone = np.asarray(bone_mm)
        motion = np.asarray(body_mm) - bone
        parts = [(1.0, self._at_once), *zip(amounts, self._late, strict=True)]
        loads, forces, direct = (
            sum(c * getattr(part, name) for c, part in parts)
            for name in ("loads", "forces", "direct")
        )
        right = motion @ loads[:3] + w**2 * np.tensordot(bone, self._inertia, 1)
        if load is not None:
            right = right + load
        with self._solver(w, amounts) as solve:
            x, iterations = solve(right)
            owned, turn = len(right), 0j
            force = self._comm.allreduce(forces @ x[:owned] + direct[:, :3] @ motion)
            if self._joint:
                inertia = w**2 * self._turned_mass
                of_turn, more = solve(loads[3] + inertia)
                moments = inertia @ np.array([x[:owned], of_turn[:owned]]).T
                if load is not None:
                    moments[0] += self._arms @ load
                of_loads, of_inertia = self._comm.allreduce(moments)
                per_turn = self._comm.allreduce(forces @ of_turn[:owned] + direct[:, 3])
                own = self._joint.moment_per_angle(frequency_Hz) + self._per_turn_of_held
                own -= w**2 * self._moment_of_inertia
                turn = (of_loads - force[3]) / (own + per_turn[3] - of_inertia)
                x = x + turn * (of_turn + self._with_ghosts(self._arms))
                force, iterations = force + turn * per_turn, iterations + more
        u = x + np.tile(bone, len(x) // len(bone))
        return HarmonicResponse(frequency_Hz, u, force[:3], iterations, complex(turn))

    def _forms(self) -> tuple[fem.Form, fem.Form, fem.Form, fem.Form]:
        """Return the compiled forms of what `_Parts` has."""
        problem, V = self._problem, self._u.function_space
        u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
        still = ufl.as_vector([0.0] * len(self._u))
        touch = _Touch.of(problem)
        # Here the viscous stress pulls at the skin as well, and the contact is as much stiffer.
        skin = problem.contact.skin(problem.bulk)

        def traction(of_skin: Expr | None, motion: Expr, on: Expr) -> ufl.Form:
            """Return the work of the change of traction in `on`."""
            form = ufl.Form([])
            for part in skin:
                dt = still if of_skin is None else ufl.derivative(part.law.t, self._u, of_skin)
                form += ufl.dot(touch.change(part.law, dt, motion), on) * part.ds
            return form

        stiffness = ufl.derivative(problem.bulk.static_residual(v), self._u, u)
        compile_, relative = self._compile, -self._motion  # of the skin to the body
        return (
            compile_(stiffness - traction(u, u, v)),
            compile_(traction(None, relative, v)),
            compile_(traction(v, v, self._axis)),
            compile_(traction(None, relative, self._axis)),
        )

    def _assembled(self, delay: Delay | None) -> _Parts:
        self.freeze(delay)
        with common.Timer("tactile: harmonic tangent"):
            K = fem_petsc.assemble_matrix(self._stiffness, self._problem.bcs)
            K.assemble()
            loads = np.array([self._vector(self._load) for _ in _along(self._motion)])
            forces = np.array([self._vector(self._force) for _ in _along(self._axis)])
            direct = np.array(
                [
                    [fem.assemble_scalar(self._direct) for _ in _along(self._motion)]
                    for _ in _along(self._axis)
                ]
            )
            if self._joint:
                right, left = self._of_turn(self._stiffness)
                arms = self._arms
                direct = np.block([[direct, forces @ arms[:, None]], [-loads @ arms, right @ arms]])
                loads, forces = np.vstack([loads, -right]), np.vstack([forces, left])
            return _Parts(K, loads * self._is_free, forces * self._is_free, direct)

    def _vector(self, form: fem.Form) -> Array:
        """Return this rank's owned entries of an assembled vector."""
        b = fem_petsc.assemble_vector(form)
        b.ghostUpdate(PETSc.InsertMode.ADD, PETSc.ScatterMode.REVERSE)
        values = b.array.copy()
        b.destroy()
        return values

    def _where_free(self) -> Array:
        """Return 1 where this rank's owned dofs are free and 0 where they are held."""
        b = self._u.x.petsc_vec.duplicate()
        b.set(1.0)
        fem_petsc.set_bc(b, self._problem.bcs, alpha=0.0)
        values = b.array.copy()
        b.destroy()
        return values

    def _where(self) -> Array:
        """Return where this rank's owned nodes are, (n, dimension)."""
        V = self._u.function_space
        places = V.tabulate_dof_coordinates()[:, : len(self._u)]
        return (places + self._u.x.array.reshape(places.shape))[: V.dofmap.index_map.size_local]

    def _of_turn(self, form: fem.Form) -> tuple[Array, Array]:
        """Return a matrix, nothing held, times the motion with the bone, and the transpose."""
        matrix = fem_petsc.assemble_matrix(form)
        matrix.assemble()
        arms, product = matrix.createVecs()
        arms.array[:] = self._arms
        found = []
        for multiply in (matrix.mult, matrix.multTranspose):
            multiply(arms, product)
            found.append(product.array.copy())
        for made in (matrix, arms, product):
            made.destroy()
        return found[0], found[1]

    def _without_at_once(self, parts: _Parts) -> _Parts:
        """Take away what there is without any delay."""
        own = self._at_once
        parts.stiffness.axpy(-1.0, own.stiffness, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        return _Parts(
            parts.stiffness,
            parts.loads - own.loads,
            parts.forces - own.forces,
            parts.direct - own.direct,
        )

    @contextmanager
    def _solver(
        self, w: float, amounts: list[complex]
    ) -> Iterator[Callable[[Array], tuple[Array, int]]]:
        """Provide the solver, which returns complex amplitudes, with ghosts, and iterations."""
        same = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
        A = self._at_once.stiffness.duplicate(copy=True)
        B = self._at_once.stiffness.duplicate(copy=False)
        B.zeroEntries()
        A.axpy(-(w**2), self._mass, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        for amount, part in zip(amounts, self._late, strict=True):
            A.axpy(amount.real, part.stiffness, same)
            B.axpy(amount.imag, part.stiffness, same)
        with common.Timer("tactile: harmonic solve"), complex_solver(A, B) as solve:

            def solution(right: Array) -> tuple[Array, int]:
                real, imag, iterations = solve(right.real, right.imag)
                return self._with_ghosts(real) + 1j * self._with_ghosts(imag), iterations

            yield solution

    def _with_ghosts(self, owned: Array) -> Array:
        self._field.x.array[: len(owned)] = owned
        self._field.x.scatter_forward()
        return self._field.x.array.copy()


def _along(vector: fem.Constant) -> Iterator[None]:
    """Make a constant vector each unit vector in turn."""
    for unit in np.eye(len(vector.value)):
        vector.value[:] = unit
        yield


# --- small motions of the contact --------------------------------------------------------------


@dataclass(frozen=True)
class _Touch:
    """The contact of the accepted state at the quadrature points."""

    pressure: fem.Function  # MPa
    coefficient: fem.Function  # of friction
    slope: fem.Function  # how the bound of friction grows with the pressure
    closed: fem.Function  # how it grows with what it would be without regularization, 0 to 1
    friction: fem.Function  # MPa
    traction: fem.Function  # of the tissue, MPa

    @classmethod
    def of(cls, problem: Problem) -> _Touch:
        """Read it at the accepted state, the coefficient of friction at the end of its step."""
        contact, obstacle = problem.contact, problem.contact.obstacle
        scalars = [obstacle.quadrature_function(()) for _ in range(4)]
        vectors = [obstacle.quadrature_function(obstacle.u.ufl_shape) for _ in range(2)]
        touch = cls(*scalars, *vectors)

        def read(function: fem.Function, of: Callable[[SkinPart], Expr]) -> None:
            found = contact.at_points(of).read()
            function.x.array[: len(found)] = found

        with problem.reopened() if problem.state.dt_old_s else nullcontext():
            read(touch.coefficient, lambda part: part.law.coefficient(part.law.s_n))
            read(touch.slope, lambda part: part.law.bound_slope())
        problem.terms.freeze(None)
        read(touch.pressure, lambda part: part.law.s_n)
        read(touch.closed, lambda part: part.law.closed())
        read(touch.friction, lambda part: _transmitted(part.law))
        read(touch.traction, lambda part: part.law.t)
        return touch

    def change(self, law: ContactLaw, dt: Expr, motion: Expr) -> Expr:
        """Return how the traction `s` on the finger changes, in MPa.

        `dt` is the change of the traction of the tissue, `motion` that of the skin relative to the
        body, mm.
        """
        nu, stiffness = law.obstacle.normal, law.stiffness
        q, dnu = dt - stiffness * motion, law.obstacle.hessian * motion
        ds_n = self.closed * (ufl.dot(q, nu) + ufl.dot(self.traction, dnu))
        size = ufl.sqrt(ufl.dot(self.friction, self.friction) + _TINY_MPa**2)
        slides = ufl.ge(size, _SLIDING_SHARE * self.coefficient * self.pressure)
        follows = self.slope * ds_n * self.friction / size
        sticks = law.tangential(q) - ufl.dot(self.traction, nu) * dnu
        ds_t = ufl.conditional(slides, follows, sticks) - ufl.dot(self.friction, dnu) * nu
        ds = ds_n * nu + self.pressure * dnu + ds_t
        return ufl.conditional(ufl.gt(self.pressure, 0.0), ds, 0.0 * ds)


def _transmitted(law: ContactLaw) -> Expr:
    """Return the friction that the last accepted step ended with, in MPa; see `terms.contact`."""
    return law.tangential(law.t) - law.untransmitted_old
