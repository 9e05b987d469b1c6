"""Derivatives by uncertain columns against SymPy's, first and second, on both backends."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm import compiler
from mbm.kernels.backends import casadi_map, numpy_stream
from mbm.kernels.backends.native import NativeBackend
from mbm.kernels.derive import corrections_of
from mbm.kernels.types import Backend
from mbm.symbolic.types import ResidualBlock
from tests.symbolic.derivatives import smooth

PROBLEM = """
(problem sample
  (data rows (table (x y s) (1.2 0.4 0.1) (0.7 1.6 0.1) (2.2 1.1 0.1)))
  (constants (c 2))
  (unknowns (a :init 1.5) (b :init 0.7))
  (observe rows
    [(- (* a (sin (* x y))) (/ c (+ x b))) (if (< x 1) (exp (- (* y b))) (* x x y))]
    (= x (+ a (* b (sqrt (+ 1 (* y y))))))
    :errors ((x s) (y s)) :sigma 0.1))
"""


def block() -> ResidualBlock:
    return compiler.symbolic(mbm.loads(PROBLEM).compile().elaborated).blocks[0]


@pytest.mark.parametrize("backend", [casadi_map.BACKEND, numpy_stream.BACKEND, NativeBackend()], ids=lambda b: b.name)
def test_slopes_and_curvature_are_sympys(backend: Backend) -> None:
    found = block()
    assert [found.parameters[i].name for i in found.corrected] == ["x", "y"]
    corrections = corrections_of(found)
    inputs = (*found.variable_symbols, *found.parameter_symbols)
    rows = np.array([[1.2, 0.4], [0.7, 1.6], [2.2, 1.1]])
    known = {"a": 1.5, "b": 0.7, "c": 2.0}
    multipliers = np.array([0.3, -1.2, 2.0])
    evaluation = backend.prepare(corrections.kernel, len(rows))
    places = [found.parameter_symbols[i] for i in found.corrected]
    values = [[dict(zip(("x", "y"), row, strict=True)).get(s.name, known.get(s.name)) for s in inputs] for row in rows]
    evaluation.inputs[:] = np.hstack([np.array(values), np.tile(multipliers, (3, 1))])
    outputs, nonzeros = evaluation.values_and_jacobian()
    count = len(corrections.slope_rows)
    for i, row in enumerate(values):
        at = dict(zip(inputs, row, strict=True))
        expressions = [smooth(expression, at) for expression in found.expressions]
        slopes, curvature = np.zeros((3, 2)), np.zeros((2, 2))
        slopes[corrections.slope_rows, corrections.slope_columns] = nonzeros[i, :count]
        curvature[corrections.curvature_rows, corrections.curvature_columns] = nonzeros[i, count:]
        expected = np.array([[float(e.diff(p).subs(at)) for p in places] for e in expressions])
        second = np.array(
            [
                [
                    sum(m * float(e.diff(p, q).subs(at)) for m, e in zip(multipliers, expressions, strict=True))
                    for q in places
                ]
                for p in places
            ]
        )
        np.testing.assert_allclose(outputs[i], [float(e.subs(at)) for e in expressions], rtol=1e-12)
        np.testing.assert_allclose(slopes, expected, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(curvature, second, rtol=1e-11, atol=1e-13)


def test_equations_without_errors_have_no_such_kernel() -> None:
    kernels = mbm.loads(PROBLEM.replace(":errors ((x s) (y s))", "")).compile().kernels
    assert all(kernel.corrections is None for kernel in kernels.kernels)
