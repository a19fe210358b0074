# %% [markdown]
# # A ring is drawn in circles over a finger with a fat of its own
#
# This demo emphasizes
# - how an own tissue law, body, path, transduction and observer go through a scan with everything
#   else as usual: checkpoints, results folder, pictures,
# - that none of them needs a base class or a change to the package.
#
# If it is killed, the same command continues from the last step, on any number of ranks.
#
#     python demos/own_parts.py results/own_parts
#     mpirun -n 2 python demos/own_parts.py results/own_parts

# %%
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
import ufl

from tactile_fem import (
    Distance,
    Motion,
    Parts,
    Path,
    Population,
    Results,
    Study,
    draw,
    run_script,
    scan,
)
from tactile_fem.neuron import ExponentialSum, Segment
from tactile_fem.path import Hold, Lift, Press
from tactile_fem.study import Finger, Output, Receptors

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)


# %% [markdown]
# ## A tissue law
#
# A law states its energy in MPa; stress, tangent and the stiffness that Nitsche's method needs
# follow by UFL's derivatives. Fat that stiffens exponentially (Fung 1967):
#
# $$W = \tfrac{\mu}{2b}\,(e^{b(\bar I_1 - 3)} - 1) + \tfrac{K}{2}(J - 1)^2$$


# %%
@dataclass(frozen=True)
class Fung:
    """Exponential fat; moduli in MPa."""

    shear: float
    bulk: float
    b: float

    def energy(self, F, X):
        """Return the strain energy density of the deformation gradient, MPa."""
        J = ufl.det(F)
        distortion = J ** (-2 / 3) * ufl.tr(F.T * F) - 3
        volume = self.bulk / 2 * (J - 1) ** 2
        return self.in_shear(distortion, X) + volume

    def in_shear(self, a, X):
        """Return the energy of the simple shear gamma^2 = a, MPa, for a tissue that relaxes."""
        return self.shear / (2 * self.b) * (ufl.exp(self.b * a) - 1)


# %% [markdown]
# ## A body
#
# A rigid body answers with its signed distance, gradient and Hessian at points of its own frame;
# its highest plane is $z = 0$. A ring of round wire:


# %%
@dataclass(frozen=True)
class Ring:
    """A torus; mean radius and radius of the wire in mm."""

    radius: float
    wire: float

    def distance(self, points):
        """Return signed distance, gradient and Hessian at points (n, 3)."""
        x, y, z = points.T
        r = np.maximum(np.hypot(x, y), 1e-6)
        out = np.column_stack([x / r, y / r, 0 * r])
        around = np.column_stack([-y / r, x / r, 0 * r])
        up = np.array([0.0, 0.0, 1.0])
        a, b = r - self.radius, z + self.wire
        d = np.maximum(np.hypot(a, b), 1e-6)
        normal = (a[:, None] * out + b[:, None] * up) / d[:, None]
        across = (b[:, None] * out - a[:, None] * up) / d[:, None]
        squares = (np.einsum("ni,nj->nij", v, v) for v in (across, around))
        curvatures = 1 / d, a / (r * d)
        hessian = sum(k[:, None, None] * vv for k, vv in zip(curvatures, squares, strict=True))
        return Distance(d - self.wire, normal, hessian)


# %% [markdown]
# ## A path
#
# A piece is told where the body is and returns its motion; ready-made pieces stand beside it. This
# one draws circles on the pad, beginning and ending in the middle.


# %%
def circles(radius_mm: float, turns: int, speed_mm_s: float):
    """Draw circles through the place where the piece begins."""
    turn_s = 2 * np.pi * radius_mm / speed_mm_s

    def motion(start_mm):
        def place(t):
            angle = 2 * np.pi * t / turn_s
            off = np.array([np.sin(angle), 1 - np.cos(angle), 0.0])
            return start_mm + radius_mm * off

        outputs = turn_s * np.arange(1, 16 * turns + 1) / 16
        return Motion("circle", turns * turn_s, place, outputs)

    return motion


# %% [markdown]
# ## An observer
#
# It is called on all ranks after each accepted step; what it returns becomes columns of
# `trace.npz`. The centre of pressure follows from force and moment, the stretch of the skin from
# the displacement itself.


# %%
def centre_of_pressure(seen):
    """Return X and Y, mm, where the normal force acts at the depth of the body's top."""
    force, moment, z = seen.step.force_N, seen.step.moment_Nmm, seen.step.depth_mm
    normal = max(force[2], 1e-9)
    x, y = (z * force[0] - moment[1]) / normal, (z * force[1] + moment[0]) / normal
    return {"centre_of_pressure_mm": [x, y]}


@dataclass
class FarthestNode:
    """How far the node goes that goes farthest."""

    comm: MPI.Comm

    def __call__(self, seen):
        """Return the distance, mm."""
        u = seen.state.u.x.array.reshape(-1, 3)
        here = float(np.linalg.norm(u, axis=1).max()) if len(u) else 0.0
        return {"farthest_mm": self.comm.allreduce(here, MPI.MAX)}


# %% [markdown]
# ## A transduction
#
# It yields the current in time segments, each a line plus exponentials; the membrane turns them
# into spikes. This one responds to changes in both directions, as rapidly adapting afferents do:
# $I = \beta\, |dS/dt|$.


# %%
@dataclass(frozen=True)
class ChangeDetector:
    """The gain is in pA s/kPa."""

    gain: float

    def segments(self, time_s, drive):
        """Yield the current of each step, in pA."""
        for k, h in enumerate(np.diff(time_s)):
            current = self.gain * np.abs(drive[k + 1] - drive[k]) / h
            no_exponentials = np.empty((0, len(current))), np.empty(0)
            yield Segment(time_s[k], h, ExponentialSum(current, 0 * current, *no_exponentials))


# %% [markdown]
# ## The scan
#
# The study states everything else. `scan` continues an unfinished scan in the folder; a checkpoint
# knows what the own parts do and refuses others.


# %%
def main(folder: FilePath, *, depth: float = 1.2, radius: float = 1.5, speed: float = 20.0) -> None:
    """Press the ring, draw a circle, lift it off; print what was felt."""
    study = Study(
        finger=Finger(pad_size_mm=3.0, far_size_mm=6.0),
        receptors=Receptors(half_width_mm=4.0, spacing_mm=0.5),
        output=Output(fields_mm=1.0),
    )
    pieces = (
        Press(depth_mm=depth, speed_mm_s=speed),
        Hold(time_s=0.05, output_s=0.01),
        circles(radius, 1, speed),
        Lift(speed_mm_s=speed),
    )
    parts = Parts(
        laws={"subcutaneous": Fung(shear=0.8e-3, bulk=0.02, b=2.0)},
        body=Ring(radius=2.0, wire=0.8),
        path=Path(pieces),
        populations=(Population(transduction=ChangeDetector(gain=30.0)),),
    )
    comm = MPI.COMM_WORLD
    result = scan(study, folder, observers=[centre_of_pressure, FarthestNode(comm)], parts=parts)
    if comm.rank == 0:
        tell(result)
        for file in draw(folder):
            print(file)


# %%
def tell(result) -> None:
    """Print the numbers of a scan, by phase of the path."""
    trace = Results.open(result.folder).trace
    for phase in dict.fromkeys(trace["phase"][1:].tolist()):
        own = trace["phase"] == phase
        x, y = trace["centre_of_pressure_mm"][own][-1]
        print(
            f"{phase:7s} to {trace['time_s'][own][-1]:6.3f} s  "
            f"normal force {trace['force_N'][own, 2][-1]:.3f} N at X {x:5.2f}, Y {y:5.2f} mm, "
            f"farthest node {trace['farthest_mm'][own][-1]:.2f} mm"
        )
    print(f"spikes  {sum(map(len, result.response.spikes))}")


# %%
if __name__ == "__main__":
    run_script(main)
