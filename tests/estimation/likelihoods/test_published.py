"""Published fits of counts, and what is said where a model cannot be the expectation of one."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

BEETLES = """(problem p
  (data d (table (x n y) (1.6907 59 6) (1.7242 60 13) (1.7552 62 18) (1.7842 56 28) (1.8113 63 52) (1.8369 59 53)
                 (1.8610 62 61) (1.8839 60 60)))
  (unknowns (a :init -60) (b :init 33.8))
  (observe d (= y (/ n (+ 1 (exp (- (+ a (* b x))))))) :distribution (binomial n)))"""
"""Bliss (1935)."""


def test_the_beetles_of_bliss() -> None:
    """Dobson (2002), An Introduction to Generalized Linear Models, table 7.4: digits as printed."""
    found = mbm.loads(BEETLES).solve()
    assert [round(float(found[name].value), 3) for name in "ab"] == [-60.717, 34.270]
    assert [round(float(found[name].sigma), 3) for name in "ab"] == [5.181, 2.912]
    assert round(found.solves[0].cost or 0.0, 2) == 11.23
    assert found.solves[0].dof == 6


def test_deaths_by_horse_kicks() -> None:
    """von Bortkiewicz (1898): 196 deaths in 280 corps-years; the mean of counts, whose variance it is."""
    counts = np.repeat([0.0, 1, 2, 3, 4], [144, 91, 32, 11, 2])
    text = "(problem p (data d external) (unknowns (m :init 1)) (observe d (= n m) :distribution poisson))"
    found = mbm.loads(text).solve(data={"d": {"n": counts}})
    assert float(found["m"].value) == pytest.approx(0.7, abs=1e-9)
    assert float(found["m"].sigma) == pytest.approx((0.7 / 280) ** 0.5, rel=1e-7)
    assert found.solves[0].chi2_p is None  # of such counts the deviance follows no χ² law


def test_a_start_at_which_no_count_is_expected() -> None:
    text = """(problem p (data d (table (x n) (1 3) (2 5) (3 9)))
        (unknowns (a :init -4) (b :init 2)) (observe d (= n (+ a (* b x))) :distribution poisson))"""
    solve = mbm.loads(text).solve().solves[0]
    assert solve.status.value == "not-converged"
    (said,) = [d for d in solve.diagnostics if d.code.name == "not-finite-at-start"]
    assert "d" in said.message
    assert "above 0" in (said.hint or "") + said.message


def test_no_trial_step_leaves_where_counts_are_expected() -> None:
    text = """(problem p (data d (table (x n) (0 0) (1 0) (2 1) (3 4) (4 7)))
        (unknowns (a :init 9) (b :init 0)) (observe d (= n (+ a (* b x))) :distribution poisson))"""
    found = mbm.loads(text).solve()
    assert np.isfinite(float(found["b"].value))


def test_names_of_the_user_are_meant_where_there_are_some() -> None:
    data = "(data d (table (x y model) (1 1.1 0.5) (2 2.3 1) (3 2.9 0.25)))"
    text = f"(problem p {data} (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma model))"
    found = mbm.loads(text).solve()
    rows = np.array([[1, 1.1, 0.5], [2, 2.3, 1], [3, 2.9, 0.25]])
    design = np.stack([np.ones(3), rows[:, 0]], axis=1) / rows[:, 2:]
    best, *_ = np.linalg.lstsq(design, rows[:, 1] / rows[:, 2], rcond=None)
    assert [float(found[name].value) for name in "ab"] == pytest.approx(best)
    assert found.solves[0].log_likelihood is None


def test_units_of_relative_noise() -> None:
    columns = "(data d (table (x y) (1 2.1) (2 3.7) (3 6.3)) :columns ((x :unit s) (y :unit mV)))"
    text = f"(problem p {columns} (unknowns (a :unit mV) (b :unit mV/s)) (observe d (= y (+ a (* b x))) :sigma {{}}))"
    rows = "(data d (table (x y) (1 2.1) (2 3.7) (3 6.3)))"
    plain = f"(problem p {rows} (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma {{}}))"
    for one, other in (("(* 5% model)", "(* 5% model)"), ("(hypot 0.1mV (* 2% model))", "(hypot 0.1 (* 2% model))")):
        found, wanted = mbm.loads(text.format(one)).solve(), mbm.loads(plain.format(other)).solve()
        for name in "ab":
            assert float(found[name].value) == pytest.approx(float(wanted[name].value), rel=1e-6)
            assert float(found[name].sigma) == pytest.approx(float(wanted[name].sigma), rel=1e-6)
    with pytest.raises(mbm.MbmError) as error:
        mbm.loads(text.format("(sqrt model)")).solve()
    assert {d.code.name for d in error.value.diagnostics} == {"unit-clash"}
