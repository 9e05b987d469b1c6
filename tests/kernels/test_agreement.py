"""NumPy over the instruction stream and machine code give what CasADi gives, at ties, kinks, missing numbers too."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mbm.kernels.backends import casadi_map, native, numpy_stream
from mbm.kernels.backends.automatic import InterpretingBackend
from mbm.kernels.backends.native import NativeBackend
from tests.symbolic.derivatives import single
from tests.symbolic.test_operation_derivatives import CASES

SPECIAL = (-np.inf, -2.0, -1.0, -0.0, 0.0, 0.5, 1.0, 2.0, np.inf, np.nan)
TEXTS = sorted({t for texts in CASES.values() for t in texts})
MORE = [
    "(max a b x)", "(min a b x)", "(min a (max a b))", "(+ (max a b) (max a x))", "(- (max a b) (max a x))",
    "(- (max a b))", "(* (min a b) (min a b))", "(abs (max a b))", "(sqrt (max 0 a))", "(abs (- a b))",
    "(sign (- a b))", "(if (and (< a b) (not (= x a))) (max a x) (min b x))", "(if (or (= a b) (<= x b)) 1 a)",
    "(if (= a b) (if (< a 1) (sqrt a) (log a)) (/ a b))", "(mod a b)", "(= (angle x) (atan2 a b))", "(hypot a b)",
]  # fmt: skip


def by_all(kernel, inputs):
    found = []
    for backend in (casadi_map.BACKEND, numpy_stream.BACKEND, NativeBackend()):
        evaluation = backend.prepare(kernel, len(inputs))
        evaluation.inputs[:] = inputs
        alone = np.array(evaluation.values())
        values, nonzeros = (np.array(v) for v in evaluation.values_and_jacobian())
        # Values alone and beside the Jacobian: the same instructions in two functions.
        np.testing.assert_allclose(alone, values, rtol=1e-14, atol=0)
        found.append((values, nonzeros))
    return found


@pytest.mark.parametrize("text", [*TEXTS, *MORE])
def test_ties_kinks_and_missing_numbers(text):
    _, kernel = single(text)
    width = len(kernel.variables) + len(kernel.parameters)
    inputs = np.array(list(itertools.product(SPECIAL, repeat=width)))
    if "max" in text or "min" in text:
        # Which of two zeros of different sign is the greater is left open by C: 1/√max(0, −0) has either sign.
        inputs = inputs + 0.0
    (values, slopes), *others = by_all(kernel, inputs)
    # The C library and vector libraries round elementary functions to a few units in the last place; a derivative
    # multiplies a handful of them.
    for other_values, other_slopes in others:
        np.testing.assert_allclose(other_values, values, rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(other_slopes, slopes, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("text", [t for t in TEXTS if "sign" not in t and "floor" not in t and "mod" not in t])
def test_ordinary_numbers(text):
    _, kernel = single(text)
    width = len(kernel.variables) + len(kernel.parameters)
    inputs = np.random.default_rng(3).uniform(0.4, 1.4, (300, width))
    (values, slopes), *others = by_all(kernel, inputs)
    for other_values, other_slopes in others:
        np.testing.assert_allclose(other_values, values, rtol=1e-13, atol=1e-14)
        np.testing.assert_allclose(other_slopes, slopes, rtol=1e-12, atol=1e-13)
    assert np.isfinite(values).all()


@pytest.mark.parametrize(
    ("text", "slopes"),
    [
        ("(max a b)", [0.5, 0.5]),
        ("(min a b)", [0.5, 0.5]),
        ("(+ (max a b) (max a b))", [1.0, 1.0]),
        ("(- (max a b))", [-0.5, -0.5]),
        ("(abs (- a b))", [0.0, 0.0]),
    ],
)
@pytest.mark.parametrize("backend", [casadi_map.BACKEND, numpy_stream.BACKEND, NativeBackend()], ids=lambda b: b.name)
def test_derivative_at_a_tie_is_the_mean_of_both_sides(text, slopes, backend):
    """The slope at a kink is a convention; the mean of the one-sided slopes keeps a symmetric problem symmetric."""
    _, kernel = single(text)
    evaluation = backend.prepare(kernel, 1)
    evaluation.inputs[:] = 1.0
    _, nonzeros = evaluation.values_and_jacobian()
    found = np.zeros(2)
    found[kernel.jacobian_columns] = nonzeros[0]
    assert found.tolist() == slopes


class Shelf:
    """A store in memory."""

    def __init__(self):
        self.held = {}

    def get(self, kind, key):
        return self.held.get((kind, key))

    def put(self, kind, key, content):
        self.held[kind, key] = content


def test_many_rows_get_code_that_runs_fast_and_gives_the_same(monkeypatch):
    _, kernel = single("(* (sin (* a x)) (exp b))")
    inputs = np.random.default_rng(1).uniform(0.4, 1.4, (7, 3))
    monkeypatch.setattr(native, "MANY", 1)
    monkeypatch.setattr(native, "EVALUATIONS", 3 * len(inputs))

    def found(store, times):
        evaluation = NativeBackend(store).prepare(kernel, len(inputs))
        evaluation.inputs[:] = inputs
        pairs = [evaluation.values_and_jacobian() for _ in range(times)]
        return [np.hstack(pair).tolist() for pair in pairs]

    shelf = Shelf()
    wanted = np.sin(inputs[:, 0] * inputs[:, 2]) * np.exp(inputs[:, 1])  # a, b, x
    few = found(shelf, 2)
    np.testing.assert_allclose(np.array(few[0])[:, 0], wanted, rtol=1e-14)
    before = len(shelf.held)
    assert found(shelf, 5) == [few[0]] * 5
    assert len(shelf.held) == before + 1
    assert found(shelf, 1) == few[:1]  # what is kept of it is taken at once
    assert len(shelf.held) == before + 1


@pytest.mark.parametrize("rows", [1, 5, 191, 192, 1500])
def test_without_machine_code_it_is_either_of_them(rows):
    _, kernel = single("(* (sin (* a x)) (exp b))")
    inputs = np.random.default_rng(rows).uniform(0.4, 1.4, (rows, 3))
    evaluation = InterpretingBackend().prepare(kernel, rows)
    evaluation.inputs[:] = inputs
    (values, slopes), *_ = by_all(kernel, inputs)
    found = evaluation.values_and_jacobian()
    np.testing.assert_allclose(found[0], values, rtol=1e-14)
    np.testing.assert_allclose(found[1], slopes, rtol=1e-13)
