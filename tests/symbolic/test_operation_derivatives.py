"""Every operation of the language: the kernel's Jacobian is SymPy's derivative, and what differences show."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.expression.nodes import Operation
from tests.symbolic.derivatives import by_kernel, by_sympy, check, point_of, single

CASES = {
    Operation.ADD: ["(+ (* a a) b x)"],
    Operation.SUBTRACT: ["(- (* a b) (* x b))"],
    Operation.NEGATE: ["(- (* a a b))"],
    Operation.MULTIPLY: ["(* a b x a)"],
    Operation.DIVIDE: ["(/ a (+ b x))", "(/ x (* a b))", "(/ 1 a)"],
    Operation.POWER: [
        "(^ a 3)",
        "(^ a -2)",
        "(^ a 2.5)",
        "(^ a b)",
        "(^ x (* a b))",
        "(^ a 1/3)",
        "(^ (- a 5) 2)",
        "(^ a x)",
    ],
    Operation.SQRT: ["(sqrt (+ a (* b b)))"],
    Operation.EXP: ["(exp (- (* a b)))"],
    Operation.LOG: ["(log (+ a (* b x)))"],
    Operation.ABS: ["(abs (- a (* 9 b)))", "(abs (* a b))"],
    Operation.SIGN: ["(* a (sign (- b 5)))"],
    Operation.FLOOR: ["(* a (floor (* 7.3 b)))", "(mod (* 5 a) b)"],
    Operation.MINIMUM: ["(min a (* 9 b))", "(min (* 9 a) b x)"],
    Operation.MAXIMUM: ["(max a (* 9 b))", "(max (* 9 a) b x)"],
    Operation.HYPOT: ["(hypot a (* b x))"],
    Operation.SIN: ["(sin (* a b))"],
    Operation.COS: ["(cos (* a b))"],
    Operation.TAN: ["(tan (/ a (+ b 1)))"],
    Operation.ASIN: ["(asin (/ a (+ a b)))"],
    Operation.ACOS: ["(acos (/ a (+ a b)))"],
    Operation.ATAN: ["(atan (* a b))"],
    Operation.ATAN2: ["(atan2 a (- b 3))", "(atan2 (- a) b)", "(atan2 (- a) (- b))"],
    Operation.SINH: ["(sinh (* a b))"],
    Operation.COSH: ["(cosh (* a b))"],
    Operation.TANH: ["(tanh (* a b))"],
    Operation.ASINH: ["(asinh (* a b))"],
    Operation.ACOSH: ["(acosh (+ 1 (* a b)))"],
    Operation.ATANH: ["(atanh (/ a (+ a b)))"],
    Operation.WRAP: ["(= (angle x) (* 40 a b))", "(= 3rad (angle (* -20 a)))"],
    Operation.AS_ANGLE: ["(* b (angle a))"],
    Operation.IF: ["(if (< a (* 9 b)) (* a a) (exp b))", "(* b (if (< b x) 1 (if (< a 9) (sin a) a)))"],
    Operation.LESS: ["(if (< (* a a) b) a b)"],
    Operation.LESS_EQUAL: ["(if (<= b a) (* 2 a) (* a b))"],
    Operation.EQUAL: ["(if (= a b) a (* a b))", "(if (= a a) (* b a) a)"],
    Operation.NOT: ["(if (not (< a b)) (* a b) (/ a b))"],
    Operation.AND: ["(if (and (< a 2) (< 0 b)) (* a b) (/ a b))"],
    Operation.OR: ["(if (or (< 9 a) (< b 9)) (* a b) (/ a b))"],
    Operation.FINITE: ["(if (finite x) (* a b) a)", "(if (and (finite x) (or (< x 9) (not (finite b)))) (* a b) a)"],
}
"""Forms of unknowns a, b and columns x, y, all between 0.4 and 1.4: away from kinks and from the ends of domains."""


def test_every_operation_is_differentiated():
    assert set(CASES) == set(Operation) - {Operation.EXTERNAL}  # whose derivatives are not symbolic


@pytest.mark.parametrize(("operation", "text"), [(o, t) for o, texts in CASES.items() for t in texts])
def test_kernel_is_sympys_derivative_and_what_differences_show(operation, text):
    block, kernel = single(text)
    random = np.random.default_rng(len(text))
    for _ in range(3):
        values = dict(zip("abxyz", random.uniform(0.4, 1.4, 5), strict=True))
        # The column of an equation `(= x …)` is far from the model: the difference wraps.
        check(block, kernel, np.array(point_of(block, values)))


@pytest.mark.parametrize(
    ("text", "value", "slope"),
    [
        ("(if (> a 0) (sqrt a) 0)", 0.0, 0.0),
        ("(if (<= a 0) 0 (sqrt a))", 0.0, 0.0),
        ("(if (< a 0) (- (sqrt (- a))) (sqrt (if (< 0 a) a 1)))", 1.0, 0.0),
        ("(if (> a 0) (if (> a 1) (log (- a 1)) (sqrt a)) (if (> a -1) (* a 2) (/ 1 a)))", 0.0, 2.0),
        ("(if (> a 0) (log a) (if (= a 0) a (log (- a))))", 0.0, 1.0),
        ("(* 3 (+ 1 (if (> a 0) (/ a (sqrt a)) a)))", 3.0, 3.0),
        ("(exp (if (> a 0) (^ a 1/3) (* a (if (> a 0) (/ 1 a) 2))))", 1.0, 2.0),
        ("(norm [(if (> a 0) (sqrt a) 3) (if (> a 0) (log a) 4)])", 5.0, 0.0),
        ("(if (> a 0) (acos (- 1 a)) (asin a))", 0.0, 1.0),
        ("(max 0 (if (> a 0) (sqrt a) -1))", 0.0, 0.0),
    ],
)
def test_branch_that_is_not_taken_leaves_no_trace(text, value, slope):
    """At zero, where a branch not taken has an infinite slope or no value: derivatives by hand."""
    block, kernel = single(text, names="a")
    found, jacobian = by_kernel(kernel, point_of(block, {"a": 0.0}))
    assert found[0] == pytest.approx(value, abs=1e-15)
    assert np.isfinite(jacobian).all()
    assert jacobian.sum() == pytest.approx(slope, rel=1e-14, abs=1e-14)
    # Far into the branches that do not hold at zero: what SymPy says.
    for a in (-0.7, 0.4, 1.9):
        inputs = point_of(block, {"a": a})
        expected = by_sympy(block, dict(zip(block.variable_symbols, inputs, strict=True)))
        for one, other in zip(by_kernel(kernel, inputs), expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-14)


def test_step_functions_have_no_slope_and_wrapping_has_slope_one():
    block, kernel = single("[(floor a) (sign a) (- (angle a) 40rad)]", names="a")
    for a in (-2.5, 0.3, 3.0, 7.9):
        _, jacobian = by_kernel(kernel, point_of(block, {"a": a}))
        assert jacobian[:, 0].tolist() == [0, 0, 1]
