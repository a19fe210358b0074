"""Tags of the integrals of a form, as DOLFINx wants them."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import ufl
from dolfinx import mesh
from dolfinx.fem import IntegralType
from dolfinx.fem.forms import get_integration_domains

EVERYWHERE = "everywhere"


def with_shared_tags(form: ufl.Form) -> ufl.Form:
    """Return a form whose integrals of one type have the same tags, as DOLFINx wants them.

    Where they have several, their parts are numbered anew.
    """
    tags_of: defaultdict[str, dict[int, mesh.MeshTags]] = defaultdict(dict)
    for integral in form.integrals():
        tags = integral.subdomain_data()
        if tags is not None:
            tags_of[integral.integral_type()][id(tags)] = tags
    several: dict[str, list[tuple[int, np.ndarray]]] = {
        kind: [] for kind, found in tags_of.items() if len(found) > 1
    }
    numbers: dict[tuple[str, int, int], int] = {}

    def shared(integral: ufl.Integral) -> ufl.Integral:
        kind, tag, tags = where(integral)
        if kind not in several:
            (own,) = tags_of[kind].values() or (None,)
            return integral.reconstruct(subdomain_data=own)
        if tag != EVERYWHERE:
            key = kind, tag, id(tags)
            if key not in numbers:
                numbers[key] = len(numbers)
                ((_, entities),) = get_integration_domains(IntegralType[kind], tags, [tag])
                several[kind].append((numbers[key], entities))
            tag = numbers[key]
        return integral.reconstruct(subdomain_id=tag, subdomain_data=several[kind])

    return ufl.Form([shared(integral) for integral in form.integrals()])


def where(integral: ufl.Integral) -> tuple[str, Any, Any]:
    """Return over what an integral is taken: type, part, and tags of the parts."""
    return integral.integral_type(), integral.subdomain_id(), integral.subdomain_data()
