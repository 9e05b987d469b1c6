"""Compiling before the data are there, several solves, and parameters of the contract that are for later."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

EXTERNAL = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.1))"
LINE = {"x": [0.0, 1.0, 2.0], "y": [1.0, 3.0, 5.0]}
"""On the line 1 + 2 x exactly: an intercept of 1 and a slope of 2 to rounding."""


def test_tables_from_outside_may_come_with_the_first_solve() -> None:
    compiled = mbm.loads(EXTERNAL).compile()
    for shift in (0.0, 1.0):
        data = {"d": {**LINE, "y": [y + shift for y in LINE["y"]]}}
        solved = compiled.solve(data=data)
        assert solved["a"].value == pytest.approx(1 + shift, rel=1e-12)
        assert solved["b"].value == pytest.approx(2, rel=1e-12)
        # r = (a + b x − y)/0.1 at the start a = b = 0 that linear problems have, up to the solution: zero there
        steps = compiled.residuals([0.0, 0.0]), compiled.jacobian([0.0, 0.0])
        assert steps[0].shape == (3,)
        np.testing.assert_allclose(steps[1], 10 * np.array([[1, 0], [1, 1], [1, 2]]), rtol=1e-12)
    assert set(compiled.casadi()) == {"d/1"}


def test_without_them_nothing_is_solved() -> None:
    compiled = mbm.loads(EXTERNAL).compile()
    compiled.solve(data={"d": LINE})
    for call in (mbm.loads(EXTERNAL).solve, mbm.loads(EXTERNAL).compile().casadi, compiled.solve):
        with pytest.raises(mbm.MbmError) as caught:
            call()
        assert [d.code.name for d in caught.value.diagnostics] == ["missing-table"]


@pytest.mark.parametrize(
    ("clause", "code"),
    [
        ('(data e (csv "nowhere.csv"))', "missing-file"),
        ("(constants (c (sqrt)))", "wrong-arity"),
    ],
)
def test_other_errors_are_said_at_once(clause: str, code: str) -> None:
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(EXTERNAL.replace("(unknowns", f"{clause} (unknowns")).compile()
    assert [d.code.name for d in caught.value.diagnostics] == [code]
    with pytest.raises(mbm.MbmError):
        mbm.loads(EXTERNAL).compile(backend="abacus")


def test_of_several_solves_none_is_taken_for_the_answer() -> None:
    text = "(problem p (data t (table (e y) (1 4) (2 5))) (unknowns (a)) (for-each e) (observe t (= y a) :sigma 1))"
    solved = mbm.loads(text).solve()
    with pytest.raises(LookupError, match=r"2 solves.*\.table\(\).*\.solves"):
        solved["a"]
    assert [solve.estimates[0].value for solve in solved.solves] == [pytest.approx(4), pytest.approx(5)]


def test_covariances_go_with_the_unit_of_the_sigmas() -> None:
    problem = mbm.loads("(problem p (unknowns (a :unit mm)) (observe (= 1m a) :sigma 2mm))")
    solved = problem.solve()
    assert solved.covariance is not None
    assert solved.covariance.matrix is not None
    # one equation: the standard deviation of the estimate is that of the measurement; a division or two of rounding
    assert solved["a"].sigma == pytest.approx(2.0, rel=1e-14)
    assert solved.covariance.matrix[0, 0] == pytest.approx(4.0, rel=1e-14)


def test_casadi_functions_of_one_name_are_kept_apart() -> None:
    text = "(problem p (unknowns (a :init 1)) (observe d (= 2 a) :sigma 1) (derive (d (* 3 a))))"
    assert len(mbm.loads(text).casadi()) == 2


def test_equations_take_the_tables_that_they_need() -> None:
    (residuals,) = mbm.loads(EXTERNAL).equations(data={"d": LINE}).values()
    assert {s.name for s in residuals[0].free_symbols} == {"a", "b", "x", "y"}
