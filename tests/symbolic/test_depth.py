"""Equations of thousands of levels: no stage after the language may call itself for each of them."""

from __future__ import annotations

import math
from functools import reduce
from itertools import pairwise

import pytest

import mbm
from mbm.cli.main import run
from mbm.expression.algebra import apply, constant_value
from mbm.expression.inference import Declared, Inference
from mbm.expression.nodes import Component, Constant, Operation
from mbm.expression.units import parse_unit

START = 0.3
PIECES = [
    ("(sin x)", 3000, lambda x: math.sin(x)),
    ("(+ x (sin a))", 3000, lambda x: x + math.sin(START)),
    ("(max (sin x) a)", 800, lambda x: max(math.sin(x), START)),
    ("(min (* 2 x) (cos a))", 800, lambda x: min(2 * x, math.cos(START))),
    ("(atan2 x a)", 1500, lambda x: math.atan2(x, START)),
    ("(if (< x a) (* 2 x) (sin x))", 250, lambda x: 2 * x if x < START else math.sin(x)),
    ("(if (and (< x a) (< a 1)) (* 3 x) (sin x))", 250, lambda x: 3 * x if x < START else math.sin(x)),
]


def problem(piece, count):
    return (
        f"(problem p (unknowns (a :init {START})) (observe (= 0 (reduce (lambda (x i) {piece}) (range 1 {count}) a)) "
        ":sigma 1))"
    )


@pytest.mark.parametrize(("piece", "count", "step"), PIECES, ids=[p[0] for p in PIECES])
def test_deep_equations_are_derived(piece, count, step):
    compiled = mbm.loads(problem(piece, count)).compile()
    expected = reduce(lambda x, _: step(x), range(count), START)
    # The same operations in the same order: what differs is the last digit of a library's sine, at most.
    assert compiled.residuals([0.0]) == pytest.approx([expected], rel=1e-12)
    h = 1e-6
    change = compiled.residuals([h]) - compiled.residuals([-h])
    # Central differences: the error is h² times the third derivative, which grows with the depth.
    assert compiled.jacobian([0.0])[0] == pytest.approx(change / (2 * h), rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("options", [[], ["--latex"], ["--stage", "symbolic"]])
@pytest.mark.parametrize(("piece", "count"), [(p[0], p[1]) for p in PIECES], ids=[p[0] for p in PIECES])
def test_deep_equations_are_explained(piece, count, options, tmp_path, capfd):
    file = tmp_path / "deep.mbm"
    file.write_text(problem(piece, count))
    assert run(["explain", str(file), *options]) == 0
    assert max(map(len, capfd.readouterr().out.splitlines())) < 4000


def test_conditions_and_extremes_are_kept_as_written():
    text = "(problem p (unknowns (a :init 1)) (observe o (= 0 (if (and (< a 2) (< 0 a)) (max 3 a) (min a 4)))))"
    (equation,) = mbm.loads(text).equations()["o"]
    (largest, condition), (smallest, _) = equation.args
    (a,) = equation.free_symbols
    assert (largest.args, smallest.args) == ((3, a), (a, 4))
    assert [side.args for side in condition.args] == [(a, 2), (0, a)]


def test_the_value_of_a_shared_constant_is_computed_once():
    node = Constant("c", 1.5)
    for _ in range(200):
        node = apply(Operation.ADD, node, node)
    assert constant_value(node) == 1.5 * 2.0**200


def test_dimensions_of_long_sums_of_literals():
    inference = Inference(Declared(components={}, columns={}, same_column={}))
    nodes = [Component("a", (i,)) for i in range(5000)]
    for first, second in pairwise(nodes):
        inference.equate(first, second, None)
    unit = parse_unit("m")
    assert unit is not None
    metre = Constant("m", 1.0, unit.dimension)
    inference.equate(nodes[-1], metre, None)
    assert all(inference.dimension(node) == metre.dimension for node in nodes)
    assert inference.clashes == []
