"""What a kernel says about linearity is what second differences of its outputs show."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mbm.kernels.serialised import function_of
from tests.symbolic.derivatives import single

TEXTS = [
    "(+ (* 2 a) (* x b) c)", "(* a b)", "(+ (* a (sin c)) b)", "(* a b c)", "(/ a b)", "(+ (* a b) (* b c))",
    "(exp (- a b))", "(+ a (^ b 2) (* x c))", "(- (+ a b) (* y (- a c)))", "(if (< x y) (* a b) (+ a c))",
    "(* x (+ a (* 2 (+ b c))))", "(+ (/ (* a x) (exp y)) b)", "(+ (sqrt (+ 1 (* a a))) c)", "[(* a b) (+ b c)]",
    "(* 3 x)",
]  # fmt: skip


def second_difference(kernel, inputs, mask, random):
    """The largest |f(z+2d) − 2f(z+d) + f(z)| over some directions d in the masked variables."""
    largest = 0.0
    for _ in range(4):
        step = np.zeros_like(inputs)
        step[: len(mask)] = 0.2 * random.uniform(0.5, 1, len(mask)) * mask
        parts = [
            np.asarray(function_of("values", kernel.value_program)(inputs + k * step)).reshape(-1) for k in (0, 1, 2)
        ]
        largest = max(largest, float(np.abs(parts[2] - 2 * parts[1] + parts[0]).max()))
    return largest


@pytest.mark.parametrize("text", TEXTS)
def test_affine_in_every_set_of_variables(text):
    _, kernel = single(text, names="a b c")
    random = np.random.default_rng(len(text))
    count = len(kernel.variables)
    for chosen in itertools.product((False, True), repeat=count):
        mask = np.array(chosen, dtype=bool)
        inputs = random.uniform(0.8, 1.2, count + len(kernel.parameters))
        if "(if" in text:
            inputs[count:] = np.sort(inputs[count:])  # the branch with the product
        curved = second_difference(kernel, inputs, mask, random)
        # Rounding of values near 1 is 1e-16; a curvature of 1 over steps of 0.1 shows with 1e-2.
        assert kernel.affine_in(mask) == (curved < 1e-12), (text, chosen, curved)


def test_dependence_names_the_variables_of_each_nonzero():
    block, kernel = single("(* a (sin b))")
    names = [s.name for s in block.variable_symbols]
    table = {
        names[column]: {n for n, depends in zip(names, row, strict=True) if depends}
        for column, row in zip(kernel.jacobian_columns, kernel.dependence, strict=True)
    }
    # ∂/∂a = sin b, ∂/∂b = a cos b.
    assert table == {"a": {"b"}, "b": {"a", "b"}}


def test_jacobian_holds_no_entry_for_what_an_output_does_not_depend_on():
    _, kernel = single("[(* a b) (+ b c) 3 (* x c)]", names="a b c")
    assert sorted(zip(kernel.jacobian_rows.tolist(), kernel.jacobian_columns.tolist(), strict=True)) == [
        (0, 0), (0, 1), (1, 1), (1, 2), (3, 2),
    ]  # fmt: skip
