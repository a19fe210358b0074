"""Assembly of virtual works in several cells at once, for any form of a vector field in FEniCSx.

::

    work = VirtualWork(form, u, v)
    work.add_residual(b.array)
    work.add_tangent(A, np.ones(nodes, dtype=bool))
"""

from tactile_fem.runtime import backend  # noqa: F401  # isort: skip  (first: it finds DOLFINx)

from tactile_fem.assembly.compile import Constant
from tactile_fem.assembly.virtual_work import VirtualWork

__all__ = ["Constant", "VirtualWork"]
