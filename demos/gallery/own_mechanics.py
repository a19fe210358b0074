"""
Your own tissue, term, observer and solver
==========================================

Exponentially stiffening fat (Fung 1967) and its weight change the force on a plate. A tissue
law states its energy, a term its virtual work, both in UFL; stress and tangent are derived.

.. figure:: /pictures/own_mechanics.png

   At 1.2 mm the forces are 0.179, 0.159 and 0.164 N. Both solvers agree to 1e-7 mm.

Expected time: 2 minutes on one core, most of it compilation.

What to change: the constants of ``Fung``; a law for another tissue; a term with a history
(``PointHistory``); ``protocol.depth_mm``.
"""

# sphinx_gallery_thumbnail_path = 'pictures/own_mechanics.png'

import sys
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import ufl

from tactile_fem import FastSolver, Parts, PlainSolver, Results, Simulation, Term, load_study, scan

# %%
# **Tissue.** The energy is a function of the deformation gradient, of position, ``at.X``, and of
# ``at.fields``, such as fibre directions. A tissue that relaxes also needs ``in_shear``, its energy
# in the simple shear :math:`\gamma^2 = a`.


@dataclass(frozen=True)
class Fung:
    """W = shear (exp(b (I1bar - 3)) - 1) / (2 b) + bulk (J - 1)^2 / 2, in MPa."""

    shear: float
    bulk: float
    b: float

    def energy(self, F, at):
        """Return the energy of the deformation gradient F at a place."""
        J = ufl.det(F)
        distortion = J ** (-2 / 3) * ufl.tr(F.T * F) - 3
        return self.in_shear(distortion, at) + self.bulk / 2 * (J - 1) ** 2

    def in_shear(self, a, at):
        """Return the energy of a simple shear."""
        return self.shear / (2 * self.b) * (ufl.exp(self.b * a) - 1)


# %%
# **Term.** The virtual work is a sum of terms, which may also have histories and stored energy.


class Gravity(Term):
    """The weight of all tissues, against Z: the pad hangs from the bone."""

    is_symmetric = True  # its tangent, which vanishes

    def residual(self, v):
        """Return the virtual work in v, that of the inner forces less that of the weight."""
        weight_N_mm3 = 9810.0 * 1e-12 * self.tissues.constants.density_kg_m3
        return weight_N_mm3 * v[len(v) - 1] * self.tissues.dx


# %%
# **Observer.** It is called on all ranks after each step; what it returns becomes columns of
# ``trace.npz``. Pass the same observers when you continue a scan.


def centre_of_pressure(seen):
    """Return X and Y, mm, where the normal force acts at the depth of the top of the body."""
    load, z = seen.step.load, seen.step.depth_mm
    force, moment = load.force_N, load.moment_Nmm
    normal = max(force[2], 1e-9)
    x, y = (z * force[0] - moment[1]) / normal, (z * force[1] + moment[0]) / normal
    return {"centre_of_pressure_mm": [x, y]}


# %%
# **In a study file** the same classes, in a file ``parts.py`` beside it, are
# ``tissue.subcutaneous = {law = "parts:Fung", shear = 0.8e-3, bulk = 0.02, b = 2.0}`` and
# ``solver.terms = ["parts:Gravity"]``: for sweeps, people and clusters. A law may also be
# a function ``law(F, at, **constants)`` that returns the energy density.

folder = Path(sys.argv[1] if sys.argv[1:] else "results/own_mechanics")
overrides = [
    "finger.pad_size_mm=3",
    "finger.far_size_mm=6",
    "stimulus.kind=plate",
    "protocol.depth_mm=1.2",
    "protocol.distance_mm=0",
    *sys.argv[2:],
]
study = load_study(overrides=overrides)
laws = {"subcutaneous": Fung(shear=0.8e-3, bulk=0.02, b=2.0)}
cases = {
    "default": Parts(),
    "Fung": Parts(laws=laws),
    "Fung, with weight": Parts(laws=laws, terms=(Gravity,)),
}
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
for name, parts in cases.items():
    own = folder / name.replace(", ", "_").replace(" ", "_")
    if not Results(own).complete:
        scan(study, own, observers=[centre_of_pressure], parts=parts)
    trace = Results.open(own).trace
    depth, force = trace["depth_mm"], trace["force_N"][:, 2]
    y = trace["centre_of_pressure_mm"][-1, 1]
    print(f"{name}: {force[-1]:.4f} N at {depth[-1]:.2f} mm, centre of pressure at Y {y:+.2f} mm")
    axes.plot(depth, force, label=name)
axes.set(xlabel="Depth (mm)", ylabel="Normal force (N)")
axes.legend()
figure.savefig(folder / "own_mechanics.png", dpi=120)

# %%
# **Solver.** `FastSolver` is the default, `PlainSolver` DOLFINx's Newton solver with MUMPS. This
# one runs both from the same guess. With `Simulation` a script controls the steps and may read
# ``simulation.state`` and ``simulation.load()`` between them.


class Compared(FastSolver):
    """The fast solver, compared with the plain one in each step."""

    def __init__(self, problem):
        super().__init__(problem)
        self.u_mm, self.plain = problem.u.x.array, PlainSolver(problem)
        self.difference_mm = 0.0

    def solve(self):
        """Solve a step with both; return the report of the fast one."""
        guess = self.u_mm.copy()
        self.plain.solve()
        expected = self.u_mm.copy()
        self.u_mm[:] = guess
        report = super().solve()
        self.difference_mm = max(self.difference_mm, np.abs(self.u_mm - expected).max())
        return report

    def close(self):
        """Free both solvers; all ranks must call it."""
        self.plain.close()
        super().close()


with closing(Simulation(study, make_solver=Compared)) as simulation:
    for step in simulation.steps():
        if step.ends_piece:
            break
    difference_mm = simulation.problem.solver.difference_mm
print(f"displacements of both solvers differ by at most {difference_mm:.0e} mm")
