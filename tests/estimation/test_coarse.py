"""Readings in steps that are coarse beside their scatter are doubted, and others are not."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.estimation.trust.coarse import coarse

CODE = "coarse-readings"


def problem(model: str, unknowns: str, noise: str = ":sigma unknown", more: str = "", unit: str = "") -> str:
    columns = f":columns ((y :unit {unit}))" if unit else ""
    return f"(problem p (data d external {columns}) (unknowns {unknowns}) (observe d (= y {model}) {noise}) {more})"


def doubted(text: str, **columns: np.ndarray) -> list[bool]:
    solves = mbm.loads(text).solve(data={"d": {name: each.tolist() for name, each in columns.items()}}).solves
    return [CODE in [each.code.name for each in solve.diagnostics] for solve in solves]


def readings(runs: int, rows: int, sigma: float, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return 5 + rng.random((runs, 1)) + sigma * rng.normal(size=(runs, rows))


MEAN = problem("a", "(a)")


@pytest.mark.parametrize("step", [1.0, 0.1, 25.0])
def test_rounded_readings_of_one_value_are_doubted(step: float) -> None:
    y = np.round(readings(1, 12, 0.25)[0]) * step
    assert doubted(MEAN, y=y) == [True]


def test_in_another_unit() -> None:
    assert doubted(problem("a", "(a :unit m)", unit="mm"), y=np.round(readings(1, 12, 0.25)[0])) == [True]


def test_two_values_of_a_factor() -> None:
    """Rows whose model goes from step to step in no order that averages rounding errors out."""
    g = np.tile([1.0, 2.0], 6)
    y = np.round(5.3 + 4.0 * g + 0.2 * np.random.default_rng(2).normal(size=12))
    assert doubted(problem("(+ a (* b g))", "(a) (b)"), g=g, y=y) == [True]


def test_fine_steps_are_not_doubted() -> None:
    assert doubted(MEAN, y=np.round(readings(1, 30, 1.0)[0])) == [False]
    assert doubted(MEAN, y=readings(1, 12, 0.25)[0]) == [False]
    assert doubted(MEAN, y=np.round(readings(1, 12, 0.25)[0], 1)) == [False]


def test_a_line_through_many_steps_averages_rounding_errors_out() -> None:
    x = np.linspace(0.0, 1.0, 40)
    y = np.round(2.0 + 13.3 * x + 0.1 * np.random.default_rng(3).normal(size=40))
    assert len(set(y.tolist())) < len(y)
    assert doubted(problem("(+ a (* b x))", "(a) (b)"), x=x, y=y) == [False]


def test_what_is_stated_is_not_doubted() -> None:
    y = np.round(readings(1, 12, 0.25)[0])
    assert doubted(problem("a", "(a)", ":sigma 0.25 :resolution 1"), y=y) == [False]
    assert doubted(problem("a", "(a)", ":sigma 0.4"), y=y) == [False]


def test_many_solves_are_judged_as_one_by_one() -> None:
    fine, coarse = readings(20, 10, 1.0, 4), np.round(readings(20, 10, 0.4, 5))
    y = np.concatenate([fine, coarse])
    apart = [doubted(MEAN, y=each)[0] for each in y]
    run = np.repeat(np.arange(40.0), 10)
    assert doubted(problem("a", "(a)", more="(for-each run)"), run=run, y=y.ravel()) == apart
    assert not any(apart[:20])
    assert 5 < sum(apart[20:]) < 20  # residuals about the limit: both answers are compared


def test_several_noises_in_many_solves() -> None:
    i = np.tile(np.repeat([1.0, 2.0], 8), 10)
    y = np.where(i == 1, np.round(readings(10, 16, 0.25, 6).ravel()), readings(10, 16, 1.0, 7).ravel())
    clauses = " ".join(f"(observe i{k} d (= y a) :sigma unknown :when (= i {k}))" for k in (1, 2))
    text = f"(problem p (data d external) (unknowns (a)) {clauses} {{more}})"
    apart = [doubted(text.format(more=""), i=i[:16], y=each)[0] for each in y.reshape(10, 16)]
    run = np.repeat(np.arange(10.0), 16)
    assert doubted(text.format(more="(for-each run)"), run=run, i=i, y=y) == apart
    assert any(apart)


def test_solves_without_rows_or_deviations_stay_silent_beside_others():
    """Also NumPy, whose warning of a median of nothing would reach the user."""
    readings = np.array([[1.0, 2.0, 2.0, 3.0, 1.0], [np.nan] * 5, [1.0, 2.0, 2.0, 3.0, 1.0]])
    deviations = np.array([[0.01] * 5, [0.01] * 5, [np.nan] * 5])
    basis = np.full((3, 5, 1), 5**-0.5)
    found = coarse(readings, np.zeros((3, 5)), deviations, basis)
    assert found.shape == (3,)
    assert not found[1:].any()


def test_counts_are_told_how_to_be_counted():
    """Whole numbers from 0 on may be counts; half steps and temperatures below zero are none."""
    for shift, step, counted in ((0.0, 1.0, True), (0.0, 0.5, False), (-9.0, 1.0, False)):
        y = step * np.array([5.0, 5.0, 6.0, 5.0, 5.0, 5.0, 6.0, 5.0]) + shift
        found = mbm.loads(problem("a", "(a)")).solve(data={"d": {"y": y}}).diagnostics
        (hint,) = (each.hint for each in found if each.code.name == "coarse-readings")
        assert ("poisson" in hint) == counted
        assert ":resolution STEP" in hint
