"""Expressions in SymPy: as they were written, equal parts as one object, every input a symbol of its own."""

from __future__ import annotations

from fractions import Fraction

import pytest
import sympy

import mbm
from mbm.expression.nodes import Apply, Column, Component, LiteralMember, Number, Opaque, Operation
from mbm.symbolic.conversion import Converter
from mbm.text.reader import read
from mbm.text.types import Source
from tests.symbolic.derivatives import single


def test_equal_subexpressions_become_one_object():
    a, b = Component("a"), Component("b")

    def part():
        return Apply(Operation.SIN, (Apply(Operation.MULTIPLY, (Component("a"), Component("b"))),))

    first, second = Converter().convert((Apply(Operation.ADD, (part(), a)), Apply(Operation.ADD, (part(), b))))
    (one,) = (x for x in first.args if x.args)
    (other,) = (x for x in second.args if x.args)
    assert one is other


def test_nothing_is_simplified():
    text = "(- (* a a) (* a a))"
    block, _ = single(text)
    assert block.expressions[0] != 0
    assert sympy.simplify(block.expressions[0]) == 0


@pytest.mark.parametrize(
    ("value", "kind"), [(3, sympy.Integer), (Fraction(1, 3), sympy.Rational), (0.1, sympy.Float), (-2, sympy.Integer)]
)
def test_numbers_are_exact_where_they_were_written_exactly(value, kind):
    (made,) = Converter().convert((Number(value),))
    assert isinstance(made, kind)
    # Doubles keep all their bits.
    assert Fraction(str(sympy.Rational(made))) == Fraction(value)


def test_inputs_of_one_name_are_told_apart():
    converter = Converter()
    nodes = (Column("s", "x"), Column("t", "x"), Component("x"), Component("x", (), LiteralMember(key="k")))
    symbols = converter.convert(nodes)
    assert len({s.name for s in symbols}) == 4
    assert converter.convert((Column("s", "x"),)) == symbols[:1]
    assert all(s.is_real for s in symbols)


def test_names_of_components():
    problem = mbm.loads("""(problem p
      (data s (table (k) (1) (2)) :key k)
      (data t (table (x s) (1 1) (2 2)))
      (unknowns (v (vector 2) :init [1 2]) (M (array 2 2) :init 1) (q :per s :init 0))
      (observe t (= x (+ (v 2) (M 2 1) (q s))))
      (observe (= 0 (- (q 1) (v 1)))))""")
    found = {s.name for (e,) in problem.equations().values() for s in e.free_symbols}
    assert {"v[2]", "M[2,1]", "x", "v[1]"} <= found
    assert {"q[s]", "q[1]"} <= found


def test_form_that_was_never_evaluated_is_an_internal_fault():
    (form,) = read(Source("form", "(a b)"))
    with pytest.raises(TypeError, match="never evaluated"):
        Converter().convert((Opaque(form),))


def test_deep_expressions_need_no_recursion():
    node = Component("a")
    for _ in range(5000):
        node = Apply(Operation.SIN, (node,))
    (made,) = Converter().convert((node,))
    depth = 0
    while made.args:
        (made,), depth = made.args, depth + 1
    assert depth == 5000
