"""Other values of constants in equations that were compiled once: answers are those of problems compiled anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mbm
from mbm import compiler
from mbm.problem.elaborated import Elaborated
from mbm.problem.other_numbers import with_numbers

X = np.arange(1.0, 11.0)
Y = 1.0 + 2.0 * X + 0.2 * np.random.default_rng(1).normal(size=10)
DATA = {"d": {"x": X, "y": Y}}
TEXT = "(problem p (data d external) (constants (h 1.1 :sigma 0.2) (k [2 3])) {})"
LINE = "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.3)"

NUMBERS = [
    "(unknowns (a) (b)) (observe d (= y (+ (* a h) (k 1) (* b x))) :sigma 0.3) (derive (q (* h a b (k 2))))",
    "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma (* h 0.3))",
    "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma (* h 10% model))",
    "(unknowns (a :prior (normal h 0.1)) (b)) (observe d (= y (+ a (* b x))) :sigma 0.3)",
    "(unknowns (a :in (h 10)) (b :in (0 (k 2)))) (observe d (= y (+ a (* b x))) :sigma 0.3)",
    f"{LINE} (constraints (= (+ a b) (* (k 2) h)) (<= a (k 1)))",
    "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.3 :errors ((x (* h 0.1))))",
    "(unknowns (a) (b)) (observe d (= y (+ a (* b (first d (* h x)) x))) :sigma 0.3)",
    f"{LINE} (derive (q (if (> h 1.2) a b)))",
    f"{LINE} (derive (f (+ a (* h t)) :over (grid t 0 10 5)) (s (mean d (* h b x))))",
    # g and both are made of h, before and after it
    "(constants (both [(* 2 g) (* h (k 1))]) (g (* h h))) (unknowns (a) (b))"
    " (observe d (= y (+ (* a g) (* b x (both 2)))) :sigma 0.3) (derive (q (* (both 1) b)))",
]
DECIDING = [
    "(unknowns (a) (b)) (observe d (= y (+ a (* b (^ x h)))) :sigma 0.3)",
    "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.3 :loss (huber h))",
    "(constants (g (* h h))) (unknowns (a) (b)) (observe d (= y (+ a (* b (^ x g)))) :sigma 0.3)",
]
"""What is compiled depends on the number, or its unit may."""


def elaborated(text: str) -> Elaborated:
    return mbm.loads(text).compile(data=DATA).elaborated


@pytest.mark.parametrize("text", NUMBERS)
def test_other_numbers_of_constants_need_no_compiling(text: str) -> None:
    problem = mbm.loads(TEXT.format(text).replace(":sigma 0.2", ""))
    anew = problem.compile(data=DATA, constants={"h": 1.3, "k": [2.5, 3.0]}).solve().solves[0]
    compiled = problem.compile(data=DATA)
    before = compiled.solve().solves[0]
    moved = with_numbers(compiled.elaborated, {"h": 1.3, "k[1]": 2.5})
    assert moved is not None
    assert compiled.kept.compilation is not None
    compiled.kept.compilation = replace(compiled.kept.compilation, elaborated=compiler.checked(moved))
    found = compiled.solve().solves[0]
    assert [str(item) for item in (*found.estimates, *found.derived)] != [
        str(item) for item in (*before.estimates, *before.derived)
    ]
    assert found.cost == pytest.approx(anew.cost, rel=1e-10)
    for one, other in zip((*found.estimates, *found.derived), (*anew.estimates, *anew.derived), strict=True):
        # 1e-8: searches stop that near
        assert one.value == pytest.approx(other.value, rel=1e-8, abs=1e-10)
        assert one.sigma == pytest.approx(other.sigma, rel=1e-8, abs=1e-10, nan_ok=True)


@pytest.mark.parametrize("text", DECIDING)
def test_numbers_that_decide_what_is_compiled_are_told(text: str) -> None:
    found = elaborated(TEXT.format(text))
    assert with_numbers(found, {"h": 1.3}) is None
    assert with_numbers(found, {"k[1]": 2.5}) is not None


def test_ends_of_grids_are_told() -> None:
    found = elaborated(TEXT.format(f"{LINE} (derive (f (* a t) :over (grid t 0 (k 2) 5)))"))
    assert with_numbers(found, {"k[2]": 4.0}) is None
    assert with_numbers(found, {"h": 1.3}) is not None


def test_rows_that_constants_keep_are_told() -> None:
    text = TEXT.format(LINE).replace("(data d external)", "(data d external :where (> x h))")
    assert with_numbers(elaborated(text), {"h": 2.5}) is None


def test_uncertain_constants_are_solved_for_in_equations_compiled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = mbm.loads(TEXT.format(NUMBERS[0])).compile(data=DATA)

    def refused(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(compiler, "elaborated", refused)
    monkeypatch.setattr(compiler, "derived", refused)
    found = compiled.solve().solves[0]
    assert found["q"].sigma > 0.2 * abs(found["q"].value) / 1.1 * 0.01
