"""UFL at a point, in C, for several points at once.

FFCx compiles expressions in which all that is given at a point is a coefficient, see `AtPoint`. The
result has no loops, so that C compilers can evaluate it in several cells at once.
"""

from __future__ import annotations

from typing import Any

import ffcx.naming
import numpy as np
from dolfinx import fem
from ffcx.analysis import analyze_ufl_objects
from ffcx.codegeneration.backend import FFCXBackend
from ffcx.codegeneration.C.formatter import Formatter
from ffcx.codegeneration.expression_generator import ExpressionGenerator
from ffcx.ir.representation import compute_ir
from ffcx.options import get_options
from ufl.algorithms.analysis import extract_coefficients, extract_constants
from ufl.core.expr import Expr

from tactile_fem.assembly.at_points import AtPoint
from tactile_fem.assembly.compile import with_own_labels

# The C library can evaluate a function several times at once, which has to be said where not all of
# -ffast-math is on.
PREAMBLE = """
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
typedef double lanes __attribute__((vector_size(8 * LANES)));
#define fmax(x, y) ((x) > (y) ? (x) : (y))
#define fmin(x, y) ((x) < (y) ? (x) : (y))
#if defined(__x86_64__) && defined(__GLIBC__) && !defined(__clang__)
__attribute__((__simd__("notinbranch"))) double pow(double, double);
__attribute__((__simd__("notinbranch"))) double exp(double);
__attribute__((__simd__("notinbranch"))) double log(double);
#if __GLIBC_PREREQ(2, 35)
__attribute__((__simd__("notinbranch"))) double cbrt(double);
#endif
#endif
"""
# What FFCx generates, and its call in each lane, without loops that would keep the lanes apart.
_FUNCTION = """
static inline __attribute__((always_inline)) void {name}_of(
  double *restrict A, const double *restrict w, const double *restrict c)
{{
{code}
}}
static void {name}(const lanes *given_, const double *c, lanes *found_)
{{
  const double (*given)[LANES] = (const double (*)[LANES])given_;
  double (*found)[LANES] = (double (*)[LANES])found_;
#pragma GCC ivdep
  for (int l = 0; l < LANES; ++l) {{
    double w[{given}], A[{found}] = {{0}};
    (void)given;
    {take}
    {name}_of(A, w, c);
    {give}
  }}
}}
"""


class PointFunction:
    """An expression at a point as a function in C.

    Parameters
    ----------
    name
        Name of the function in C.
    value
        A vector of what is given by `at`.

    Attributes
    ----------
    key
        Changes with the code.
    """

    def __init__(self, name: str, value: Expr, at: AtPoint) -> None:
        self.name, self._value = name, with_own_labels(value)
        # Of each coefficient the places of its numbers among all that are given.
        self._places = [at.places(own) for own in extract_coefficients(self._value)]
        self._point = np.zeros((1, at.dim))
        signature = ffcx.naming.compute_signature([(self._value, self._point)], name)
        self.key = repr((name, signature, self._places, PREAMBLE, _FUNCTION))
        self._constants: list[fem.Constant] = extract_constants(self._value)

    def constants(self) -> np.ndarray:
        """Return the present values of the constants that the function takes."""
        return np.concatenate([np.zeros(0), *(np.ravel(own.value) for own in self._constants)])

    def code(self) -> str:
        """Return the function of ``given``, constants and ``found``."""
        # FFCx's stages one by one: its last would wrap the statements in a file.
        options = get_options({"scalar_type": np.float64})
        analysis = analyze_ufl_objects([(self._value, self._point)], options["scalar_type"])
        (ir,) = compute_ir(analysis, {}, self.name, options, False).expressions
        generator: Any = ExpressionGenerator(ir, FFCXBackend(ir, options))
        given = [place for k in ir.original_coefficient_positions for place in self._places[k]]
        results = range(len(self._value))
        return _FUNCTION.format(
            name=self.name,
            code=Formatter(options["scalar_type"])(generator.generate()),
            given=len(given) + 1,
            found=len(results),
            take="\n".join(f"w[{k}] = given[{place}][l];" for k, place in enumerate(given)),
            give="\n".join(f"found[{k}][l] = A[{k}];" for k in results),
        )
