"""A term of the virtual work: the weight of the tissues."""

import ufl
from dolfinx import fem

from tactile_fem.mechanics.terms.inertia import mass_density
from tactile_fem.mechanics.terms.term import Term


class Gravity(Term):
    """The weight of all tissues; the pad hangs down from the bone, against Z."""

    def __init__(self, tissues, g_mm_s2=9810.0):
        super().__init__(tissues)
        mesh = tissues.domain.mesh
        self.density = mass_density(mesh, tissues.constants.density_kg_m3)
        down = [0.0] * (mesh.geometry.dim - 1) + [-g_mm_s2]
        self.g = fem.Constant(mesh, down)

    def residual(self, v):
        return -self.density * ufl.dot(self.g, v) * self.tissues.dx
