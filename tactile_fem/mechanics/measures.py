"""What the integrals of a user's own virtual work may be taken over."""

from __future__ import annotations

import ufl
from dolfinx import mesh
from ufl.algorithms import compute_form_data
from ufl.algorithms.check_arities import ArityMismatch

from tactile_fem.assembly.tags import EVERYWHERE, where
from tactile_fem.errors import StudyError

_TYPES = "cell", "exterior_facet"


def check_work(form: ufl.Form, v: ufl.Argument, name: str) -> None:
    """Check the virtual work of a user's own term.

    Parameters
    ----------
    form
        What the term returned.
    v
        Test function, in which the work has to be linear.
    name
        Name of the term.

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
        kind, tag, tags = where(integral)
        if kind not in _TYPES:
            raise StudyError(f'{work} has integrals of the type "{kind}"; allowed: dx and ds.')
        if tag != EVERYWHERE and not isinstance(tags, mesh.MeshTags):
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
