"""What the integrals of a virtual work may be taken over, and their tags as DOLFINx wants them."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
import ufl
from dolfinx import mesh
from dolfinx.fem import IntegralType
from dolfinx.fem.forms import get_integration_domains
from ufl.algorithms import compute_form_data
from ufl.algorithms.check_arities import ArityMismatch

from tactile_fem.errors import StudyError

_TYPES = "cell", "exterior_facet"
_EVERYWHERE = "everywhere"


def check_work(form: ufl.Form, v: ufl.Argument, name: str) -> None:
    """Check the virtual work of a user's own term.

    Parameters
    ----------
    form
        What the term returned.
    v
        Test function, in which the work has to be linear.
    name
        Of the term.

    Raises
    ------
    StudyError
        It is no virtual work, or its integrals are not over tissues and their surface.
    """
    work = f"parts.terms: the virtual work of {name}"
    if not isinstance(form, ufl.Form):
        what = type(form).__name__
        raise StudyError(
            f"{work} is of type {what} but must be a form: an integrand times dx or ds."
        )
    for integral in form.integrals():
        kind, tag, tags = _where(integral)
        if kind not in _TYPES:
            raise StudyError(f'{work} has integrals of the type "{kind}"; allowed: dx and ds.')
        if tag != _EVERYWHERE and not isinstance(tags, mesh.MeshTags):
            raise StudyError(
                f'{work} has an integral over the part "{tag}" but its measure has no tags: give '
                "it MeshTags as subdomain_data, or take self.tissues.dx."
            )
    if form.empty():
        return
    if form.arguments() != (v,):
        raise StudyError(f"{work} must contain the test function v that it is given, and no other.")
    try:  # as before a form is compiled
        compute_form_data(
            form,
            do_apply_function_pullbacks=True,
            do_apply_integral_scaling=True,
            do_apply_geometry_lowering=True,
            do_apply_restrictions=True,
            do_append_everywhere_integrals=False,
        )
    except (ArityMismatch, Exception) as error:  # UFL has errors of many types
        raise StudyError(f"{work} is not valid: {str(error).strip().rstrip('.')}.") from error


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
        kind, tag, tags = _where(integral)
        if kind not in several:
            (own,) = tags_of[kind].values() or (None,)
            return integral.reconstruct(subdomain_data=own)
        if tag != _EVERYWHERE:
            key = kind, tag, id(tags)
            if key not in numbers:
                numbers[key] = len(numbers)
                ((_, entities),) = get_integration_domains(IntegralType[kind], tags, [tag])
                several[kind].append((numbers[key], entities))
            tag = numbers[key]
        return integral.reconstruct(subdomain_id=tag, subdomain_data=several[kind])

    return ufl.Form([shared(integral) for integral in form.integrals()])


def _where(integral: ufl.Integral) -> tuple[str, Any, Any]:
    """Return over what an integral is taken: type, part, and tags of the parts."""
    return integral.integral_type(), integral.subdomain_id(), integral.subdomain_data()
