"""A term of the virtual work: the weight of the tissues."""

from tactile_fem.mechanics.terms.inertia import mass_density
from tactile_fem.mechanics.terms.term import Term


class Gravity(Term):
    """The weight of all tissues, against Z: the pad hangs from the bone."""

    def __init__(self, tissues, g_mm_s2=9810.0):
        super().__init__(tissues)
        density = tissues.constants.density_kg_m3
        self.weight_N_mm3 = mass_density(tissues.domain.mesh, g_mm_s2 * density)

    def residual(self, v):
        """Return the virtual work in `v`, that of the inner forces less that of the weight."""
        return self.weight_N_mm3 * v[len(v) - 1] * self.tissues.dx
