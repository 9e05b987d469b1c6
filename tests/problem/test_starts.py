"""``:starts`` of the solve, as it is read."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.problem.requests import GivenStarts, RandomStarts

UNKNOWNS = "(unknowns (a :init 1) (p (vector 2) :in (0 1)) (h angle :init 0) (R (rotation 3)))"
PROBLEM = "(problem x (defun half (n) (/ n 2)) {unknowns} (observe o (= 1 (+ a h (dot p p)))) (solve {option}))"


def request(option):
    return mbm.loads(PROBLEM.format(unknowns=UNKNOWNS, option=option)).compile().elaborated.problem.request


def test_random_starts():
    assert request(":starts (random 100)").starts == RandomStarts(count=100)
    assert request(":starts (random (half 14) :seed 3) :seed 5").starts == RandomStarts(count=7, seed=3)
    assert request("").starts is None


def test_given_starts_hold_one_number_for_each_component():
    found = request(":starts (given ((a 2) (h 90deg)) ((p [0.1 (half 1)]) (R (rot-z 90deg))))").starts
    assert isinstance(found, GivenStarts)
    first, second = found.starts
    assert (first["a"], second["p"]) == ((2.0,), (0.1, 0.5))
    assert first["h"] == pytest.approx((np.pi / 2,))
    # A rotation is stated as its matrix, row by row.
    np.testing.assert_allclose(second["R"], [0, -1, 0, 1, 0, 0, 0, 0, 1], atol=1e-15)


@pytest.mark.parametrize(
    ("option", "code", "place"),
    [
        (":starts 20", "bad-form", "20"),
        (":starts random", "bad-form", "random"),
        (":starts (random)", "bad-form", "(random)"),
        (":starts (random 0)", "bad-form", "0"),
        (":starts (random 1000000)", "bad-form", "1000000"),
        (":starts (random 2.5)", "wrong-kind", "2.5"),
        (":starts (random 5 :sed 1)", "bad-form", ":sed"),
        (":starts (given)", "bad-form", "(given)"),
        (":starts (given (a 1))", "bad-form", "a"),
        (":starts (given ((a 1 2)))", "bad-form", "(a 1 2)"),
        (":starts (given ((b 1)))", "unknown-override", "b"),
        (":starts (given ((p [1 2 3])))", "length-clash", "[1 2 3]"),
    ],
)
def test_what_is_refused(option, code, place):
    with pytest.raises(mbm.MbmError) as caught:
        request(option)
    (found,) = caught.value.diagnostics
    assert (found.code.name, found.place.text) == (code, place)


def test_the_caller_decides_over_the_file():
    text = PROBLEM.format(unknowns="(unknowns (a :in (0 1)) (h :in (0 1)) (p (vector 2) :in (0 1)))", option="{}")
    problem = mbm.loads(text.replace("{}", ":starts (random 3 :seed 3)"))
    assert problem.solve().result.options["starts"] == {"random": 3, "seed": 3}
    assert problem.solve(starts=5).result.options["starts"] == {"random": 5, "seed": 3}
    assert problem.solve(starts=5, seed=9).result.options["starts"] == {"random": 5}
    with pytest.raises(mbm.MbmError, match="whole number in 1"):
        problem.solve(starts=0)
