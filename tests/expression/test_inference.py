"""Dimensions through expressions and through whole problems: what follows from what, and both places of a clash."""

from __future__ import annotations

from fractions import Fraction

import pytest

import mbm
from mbm.expression.inference import Declared, Inference
from mbm.expression.nodes import Column, Component
from mbm.expression.units import NONE, base, parse_unit
from tests.expression.texts import COLUMNS, expression

M, KG, S = (base(n) for n in ("m", "kg", "s"))
X, Y, Z = COLUMNS.values()


def inference(**columns):
    stated = {("t", name): parse_unit(unit).dimension for name, unit in columns.items()}
    return Inference(Declared(components={}, columns=stated, same_column={}))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(* x y)", M * S), ("(/ x y)", M / S), ("(^ x 3)", M**3), ("(^ x -1/2)", M ** Fraction(-1, 2)),
        ("(sqrt (* x x))", M), ("(sqrt x)", M ** Fraction(1, 2)), ("(* (sqrt x) (sqrt x))", M), ("(- x)", M),
        ("(abs x)", M), ("(floor x)", M), ("(mod x 2)", M), ("(min x 1)", M), ("(hypot x x)", M), ("(sign x)", NONE),
        ("(atan2 x x)", NONE), ("(if (< x 1) y (* 2 y))", S), ("(/ x x)", NONE), ("(exp (/ x x))", NONE),
        ("(^ x 1.5)", M ** Fraction(3, 2)), ("(^ (/ x x) (/ y y))", NONE), ("(* x x 3)", None), ("(* x 3rad)", M),
        ("(+ x (* 3 y))", M), ("(norm [x x x])", M), ("(distance [x 0] [0 x])", M),
    ],
)  # fmt: skip
def test_dimension_of_an_expression(text, expected):
    found = inference(x="m", y="s")
    assert found.dimension(expression(text)) == expected
    assert found.clashes == []


def test_what_is_not_stated_follows_from_its_use():
    found = inference(x="m", y="s")
    node = expression("(+ x (* z (^ y 2)))")
    assert found.dimension(node) == M
    assert found.dimension(Z) == M / S**2


def test_what_is_used_later_settles_what_came_before():
    found = inference(x="kg")
    product = expression("(* y z)")
    assert found.dimension(product) is None
    found.visit((expression("(+ y x)"), expression("(= z (/ x 2s))")))
    assert found.dimension(product) == KG**2 / S


def test_roots_determine_what_stands_under_them():
    found = inference(x="m")
    found.visit((expression("(+ x (sqrt z))"),))
    assert found.dimension(Z) == M**2
    found.visit((expression("(+ (^ y 3/2) (^ x 3))"),))
    assert found.dimension(Y) == M**2
    assert found.clashes == []


def test_literal_takes_what_its_use_asks_for_each_time_anew():
    """One text, used where metres and where seconds are wanted."""
    found = inference(x="m", y="s")
    for text in ("(+ x 1)", "(+ y 1)", "(< 0 x)", "(< 0 y)", "(max x 0)"):
        found.visit((expression(text),))
    assert found.clashes == []


@pytest.mark.parametrize(
    ("text", "left", "right"),
    [
        ("(+ x 3s)", M, S), ("(- x y)", M, S), ("(min x y)", M, S), ("(< x y)", M, S), ("(atan2 x y)", M, S),
        ("(hypot x y)", M, S), ("(if (< x 1) x y)", M, S), ("(= x 3kg)", M, KG), ("(sin x)", M, NONE),
        ("(exp (* x 1m))", M**2, NONE), ("(^ 2 x)", M, NONE), ("(^ x (/ y y y))", S**-1, NONE), ("(+ 1m 1s)", M, S),
        ("(log x)", M, NONE), ("(+ (angle 1) x)", NONE, M),
    ],
)  # fmt: skip
def test_clash_names_both_dimensions(text, left, right):
    found = inference(x="m", y="s")
    found.visit((expression(text),))
    assert [(c.left_dimension, c.right_dimension) for c in found.clashes][:1] == [(left, right)]


def test_angle_unknowns_have_no_dimension():
    found = inference(x="m")
    found.visit((expression("(+ x a)", {"a": Component("a", angle=True)}),))
    assert [(c.left_dimension, c.right_dimension) for c in found.clashes] == [(M, NONE)]


def test_joined_columns_are_the_columns_they_come_from():
    found = Inference(Declared(components={}, columns={("s", "h"): M}, same_column={("t", "s.h"): ("s", "h")}))
    assert found.dimension(Column("t", "s.h")) == M


def diagnostics(text):
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text).solve()
    return caught.value.diagnostics


def test_column_used_as_length_and_as_time_shows_both_places():
    text = """(problem p
  (data t (table (x y) (1 2) (2 3)))
  (unknowns (v :init 1m/s) (d :init 1m))
  (observe t (= x (+ d 2m)))
  (observe t (= (+ x 1s) (* 3 y))))"""
    (found,) = diagnostics(text)
    assert found.code.name == "unit-clash"
    assert "a length (m)" in found.message
    assert "a time (s)" in found.message
    assert text[found.place.start : found.place.end] == "(+ x 1s)"
    pieces = {text[label.place.start : label.place.end]: label.message for label in found.labels}
    assert pieces
    assert all("a length (m)" in said or "a time (s)" in said for said in pieces.values())


def test_files_without_units_just_work():
    solved = mbm.loads("""(problem p (data t (table (x y) (0 1) (1 3) (2 5)))
        (unknowns (a :init 0) (b :init 0)) (observe t (= y (+ a (* b x)))))""").solve()
    assert (float(solved["a"].value), float(solved["b"].value)) == pytest.approx((1, 2), abs=1e-12)


def test_units_of_unknowns_are_found_through_the_problem():
    solved = mbm.loads("""(problem p (data t (table (x y) (0 1) (1 3) (2 5.5)) :columns ((x x :unit s) (y y :unit mm)))
        (unknowns (a :init 0) (b :init 0)) (observe t (= y (+ a (* b x)))))""").solve()
    assert (solved["a"].unit, solved["b"].unit) == ("m", "m/s")


def test_fractional_powers_of_units_are_named_as_they_are():
    assert (M ** Fraction(3, 2)).describe() == "of dimension m^(3/2)"
    assert (M ** Fraction(1, 2) / S).symbol() == "m^(1/2)/s"
    assert (M ** Fraction(1, 2)) ** 2 == M
