"""What residuals say against standard deviations: correlated rows, wrong noise, leverage, few rows, bent surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbm
from mbm.estimation.native.callbacks import InterpretedCode
from mbm.estimation.native.code import NativeCode
from mbm.estimation.trust.alike import lag_scores

X = np.linspace(0.0, 1.0, 30)
RUNS = 400
LINE = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) {options}) {each})"


def solves(options: str, x: Any, y: Any) -> list[dict[str, Any]]:
    """Lines through the rows of ``y`` (runs, rows), all at once."""
    runs, rows = y.shape
    data = {"run": np.repeat(np.arange(float(runs)), rows), "x": np.tile(x, runs), "y": y.ravel()}
    text = LINE.format(options=options, each="(for-each run)")
    return list(mbm.loads(text).solve(data={"d": data}).document()["solves"])


def alone(options: str, x: Any, y: Any) -> dict[str, Any]:
    return mbm.loads(LINE.format(options=options, each="")).solve(data={"d": {"x": x, "y": y}}).document()["solves"][0]


def codes(solve: dict[str, Any]) -> list[str]:
    return [each["code"] for each in solve["diagnostics"]]


def share(found: list[dict[str, Any]], code: str) -> float:
    return float(np.mean([code in codes(solve) for solve in found]))


@pytest.mark.parametrize("alone", [False, True])
def test_the_moments_of_the_lag_are_those_of_whole_matrices(alone: bool) -> None:
    """E and Var of eᵀBe / eᵀSe for e = Mu from traces of n × n matrices, where M is a projector and S picks the rows
    that follow or are followed: exact where these are all, the first order of a ratio elsewhere. Two data sets at once.
    """
    rng = np.random.default_rng(2)
    count = 14
    following = np.stack([np.append(np.arange(1, count), -1), np.append(np.arange(1, count), -1)])
    following[1, 3:5] = -1  # nothing follows the fourth row, and the fifth stands alone
    basis = np.linalg.qr(rng.normal(size=(2, count, 3)))[0]
    residuals = rng.normal(size=(2, count))
    residuals -= np.einsum("tmk,tnk,tn->tm", basis, basis, residuals)
    code = NativeCode(None).lags if alone else InterpretedCode("solver")
    found, mean, spread, freedom = lag_scores(code, residuals, basis, following)
    for t in range(2):
        first = np.flatnonzero(following[t] >= 0)
        neighbours = np.zeros((count, count))
        neighbours[first, following[t, first]] = neighbours[following[t, first], first] = 0.5
        there = np.diag((neighbours.sum(axis=0) > 0).astype(float))
        assert there.trace() == count - t
        e, projector = residuals[t], np.eye(count) - basis[t] @ basis[t].T
        assert found[t] == pytest.approx(e @ neighbours @ e / (e @ there @ e))
        product, inner = projector @ neighbours, projector @ there
        free = inner.trace()
        assert freedom[t] == pytest.approx(free)
        assert mean[t] == pytest.approx(product.trace() / free)
        square = 2 * (product @ product).trace() + product.trace() ** 2
        square /= free**2 + 2 * (inner @ inner).trace()
        assert spread[t] == pytest.approx(np.sqrt(square - (product.trace() / free) ** 2))


def test_too_few_rows_tell_no_lag() -> None:
    basis = np.full((5, 1), 5**-0.5)
    following = np.append(np.arange(1, 5), -1)
    told = lag_scores(InterpretedCode("solver"), np.arange(5.0), basis, following)
    assert np.isnan(told[2])  # four degrees of freedom: not even a drift without noise is beyond chance


@pytest.mark.parametrize("count", [7, 8, 9])
def test_few_rows_tell_a_curve_that_is_taken_for_a_line(count: int) -> None:
    """A calibration of so few points: seldom said of lines (2 % ± 0.45 % of 1,000), and of curves above the noise."""
    x = np.linspace(-1.0, 1.0, count)
    noise = 0.05 * np.random.default_rng(5).normal(size=(1_000, count))
    assert share(solves(":sigma unknown", x, 2 - x + noise), "autocorrelated-residuals") < 0.035
    curved = 2 - x + x**2 + 0.2 * noise[:200]
    assert share(solves(":sigma unknown", x, curved), "autocorrelated-residuals") > 0.8


def test_few_readings_tell_a_drift() -> None:
    """Six readings that are taken for a constant: a drift of four times the noise from one to the next."""
    y = np.arange(6.0) + 0.25 * np.random.default_rng(6).normal(size=(200, 6))
    data = {"run": np.repeat(np.arange(200.0), 6), "y": y.ravel()}
    text = "(problem p (data d external) (unknowns (a)) (observe d (= y a)) (for-each run))"
    found = list(mbm.loads(text).solve(data={"d": data}).document()["solves"])
    assert share(found, "autocorrelated-residuals") > 0.69  # 78 % ± 2.9 % by NumPy alone


@pytest.mark.parametrize("sigma", ["0.1", "unknown"])
def test_independent_rows_are_seldom_taken_for_correlated(sigma: str) -> None:
    y = 2 - X + 0.1 * np.random.default_rng(3).normal(size=(RUNS, 30))
    # 5 % ± 1.1 % of 400 runs
    assert 0.02 < share(solves(f":sigma {sigma}", X, y), "autocorrelated-residuals") < 0.085


def test_correlated_rows_are_found_out() -> None:
    noise = np.random.default_rng(4).normal(size=(RUNS, 90))
    for place in range(1, 90):
        noise[:, place] = 0.5 * noise[:, place - 1] + np.sqrt(0.75) * noise[:, place]
    x = np.linspace(0.0, 1.0, 90)
    assert share(solves(":sigma unknown", x, 2 - x + 0.1 * noise), "autocorrelated-residuals") > 0.97


@pytest.mark.parametrize(("stated", "least", "most"), [("0.1", 0.0, 0.05), ("0.3", 0.99, 1.0), ("0.055", 0.9, 1.0)])
def test_noise_that_is_stated_wrongly_is_improbable(stated: str, least: float, most: float) -> None:
    y = 2 - X + 0.1 * np.random.default_rng(5).normal(size=(RUNS, 30))
    found = solves(f":sigma {stated}", X, y)
    assert least <= share(found, "improbable-noise") + share(found, "noise-against-data") <= most


@pytest.mark.parametrize(
    ("loss", "said"), [("", True), (" :loss huber", False), (" :loss huber :when (> x 0.5)", True)]
)
def test_noise_that_is_stated_too_large_is_doubted_where_deviations_follow_it(loss: str, said: bool) -> None:
    """Under a loss they follow the residuals, of rows without one beside it the statement."""
    plain = "(observe e d (= y (+ a (* b x))) :sigma 0.3 :when (<= x 0.5))" if "when" in loss else ""
    y = 2 - X + 0.1 * np.random.default_rng(5).normal(size=30)
    text = f"(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.3{loss}) {plain})"
    found = mbm.loads(text).solve(data={"d": {"x": X, "y": y}}).document()["solves"][0]
    assert ("improbable-noise" in codes(found)) is said


def test_data_without_noise_say_nothing_about_it() -> None:
    assert codes(alone(":sigma 0.1", X, 2 - X)) == []


def test_each_solve_of_many_says_what_it_says_alone() -> None:
    y = 2 - X + 0.1 * np.random.default_rng(6).normal(size=(60, 30)).cumsum(axis=1)
    y[::2] = 2 - X + 0.01 * np.random.default_rng(7).normal(size=(30, 30))
    made = solves(":sigma 0.1", X, y)
    assert {code for solve in made for code in codes(solve)} >= {"autocorrelated-residuals", "improbable-noise"}
    for run in range(0, 60, 5):
        assert made[run]["diagnostics"] == alone(":sigma 0.1", X, y[run])["diagnostics"]


FAR = np.append(np.linspace(0.0, 1.0, 24), 10.0)


@pytest.mark.parametrize(("error", "said"), [(5.0, ["bad-leverage"]), (0.0, [])])
def test_a_row_far_from_the_others_is_named_if_it_disagrees(error: float, said: list[str]) -> None:
    y = 2 - FAR + 0.1 * np.random.default_rng(8).normal(size=25)
    y[-1] += error
    found = alone(":sigma 0.1 :loss (huber 1.5)", FAR, y)
    assert [code for code in codes(found) if code != "autocorrelated-residuals"] == said
    assert not said or found["diagnostics"][-1]["message"].startswith("row 25 disagrees")


def test_an_outlier_without_leverage_is_what_losses_are_for() -> None:
    y = 2 - X + 0.1 * np.random.default_rng(9).normal(size=30)
    y[15] += 5.0
    assert "bad-leverage" not in codes(alone(":sigma 0.1 :loss (huber 1.5)", X, y))


@pytest.mark.parametrize(("rows", "said"), [((2, 2, 2), True), ((2, 2), True), ((4, 4), False), ((2, 30), False)])
def test_pairs_of_readings_tell_no_noise(rows: tuple[int, ...], said: bool) -> None:
    y = np.random.default_rng(10).normal(size=sum(rows))
    i = np.repeat(np.arange(1.0, len(rows) + 1), rows)
    clauses = " ".join(f"(observe i{k} d (= y a) :sigma unknown :when (= i {k}))" for k in range(1, len(rows) + 1))
    text = f"(problem p (data d external) (unknowns (a)) {clauses})"
    found = mbm.loads(text).solve(data={"d": {"i": i, "y": y}}).document()["solves"][0]
    assert ("small-sample" in codes(found)) is said


CIRCLE = """(problem p (data d (table (u v) (0.7 0.5) (0.9 0.6)))
  (unknowns (x :init 0.8) (y :init 0.6))
  (observe d (= [u v] [x y]) :sigma {sigma})
  (constraints (= (+ (^ x 2) (^ y 2)) 1)))"""


def test_intervals_follow_the_surface_of_a_constraint() -> None:
    """Against the angles where the cost has grown by less than 1.96²."""
    found = mbm.loads(CIRCLE.format(sigma=0.5)).solve()
    turn = np.linspace(-np.pi, np.pi, 100_001)
    cost = sum(((u - np.cos(turn)) / 0.5) ** 2 + ((v - np.sin(turn)) / 0.5) ** 2 for u, v in ((0.7, 0.5), (0.9, 0.6)))
    inside = cost <= cost.min() + 1.959964**2
    for name, values in (("x", np.cos(turn[inside])), ("y", np.sin(turn[inside]))):
        assert found[name].interval_kind == "profile"
        # ends are found to 1/1000 of the interval, where the cost is flat along it to a few times that
        assert found[name].interval() == pytest.approx([values.min(), values.max()], abs=5e-3)
    assert [each.code.name for each in found.first.diagnostics].count("too-nonlinear") == 2


def test_a_surface_that_hardly_bends_is_not_doubted() -> None:
    found = mbm.loads(CIRCLE.format(sigma=0.05)).solve()
    assert found["x"].interval_kind == "t"
    assert not [each for each in found.first.diagnostics if each.code.name == "too-nonlinear"]


def test_rows_of_derived_quantities_bend_one_by_one() -> None:
    text = """(problem p (data d (table (y x) (1 0.0) (1.1 2.0) (0.9 20.0) (1 5.0))) (unknowns (b :init 1))
      (observe d (= y b) :sigma 1) (derive (q (/ 1 (+ b x)) :over d)))"""
    found = mbm.loads(text).solve()
    (said,) = [each.message for each in found.first.diagnostics if each.code.name == "too-nonlinear"]
    assert "`q[1]`" in said
    assert "`q[3]`" not in said
    kinds = found.document()["solves"][0]["derived"]["q"]["interval_kind"]
    assert kinds[0] == "profile"
    assert kinds[2] == "t"
