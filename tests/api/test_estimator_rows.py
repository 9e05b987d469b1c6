"""Estimators take any number of rows where inputs are all that equations use of a table."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import mbm
from mbm.kernels.native.engine import available
from tests.api.test_estimator import agree

GROWTH = """
(problem growth (data d external :columns ((x x :unit mm)))
  (unknowns (a :init 1) (b :init 0.1) (c :init 0))
  (observe d (= y (+ c (* a (exp (* b x))))) :sigma {sigma}){more})"""

RANGES = """
(problem tag (data marks (table (id mx my mz) ("a" 0 0 2) ("b" 4 0 2) ("c" 0 4 2) ("e" 4 4 2.5)) :key id)
  (data d external :with (marks mark)) (unknowns (p (vector 3) :in [[0 0 0] [5 5 1.9]]))
  (observe d (= r (distance p [marks.mx marks.my marks.mz])) :sigma 0.01){more})"""


def growth(rows: int, seed: int) -> dict[str, np.ndarray]:
    x = np.linspace(0.0, 9.0, rows)
    noise = 0.01 * np.random.default_rng(seed).standard_normal(rows)
    return {"x": 1000.0 * x, "y": 0.3 + 1.2 * np.exp(0.2 * x) + noise}


PLACES = {"a": (0.0, 0.0, 2.0), "b": (4.0, 0.0, 2.0), "c": (0.0, 4.0, 2.0), "e": (4.0, 4.0, 2.5)}


def ranges(marks: str, seed: int) -> dict[str, np.ndarray]:
    length = np.linalg.norm(np.array([PLACES[mark] for mark in marks]) - [1.0, 1.5, 0.5], axis=1)
    noise = 0.01 * np.random.default_rng(seed).standard_normal(len(marks))
    return {"mark": np.array(list(marks)), "r": length + noise}


@pytest.mark.parametrize("more", ["", "(solve :robust lmeds)", "(constraints (normal c 0.3 0.05))"])
def test_answers_of_more_and_of_fewer_rows_are_those_of_whole_solves(more: str) -> None:
    compiled = mbm.loads(GROWTH.format(sigma=0.01, more=more)).compile(data={"d": growth(20, 0)})
    estimator = compiled.estimator("x", "y")
    for rows in (20, 15, 9, 33, 15):
        data = growth(rows, rows)
        found = estimator(data["x"], data["y"])
        agree(found, compiled.solve(data={"d": data}), ("a", "b", "c"))
        assert found.clean is estimator.fast


def test_unknown_noise_has_the_redundancy_of_the_rows_that_are_given() -> None:
    text = "(problem line (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma unknown))"
    compiled = mbm.loads(text).compile(data={"d": growth(12, 0)})
    estimator = compiled.estimator("x", "y")
    for rows in (3, 7, 40):
        data = growth(rows, rows)
        found = estimator(data["x"], data["y"])
        design = np.column_stack([np.ones(rows), data["x"]])
        best, square, *_ = np.linalg.lstsq(design, data["y"], rcond=None)
        # The condition of the columns is 1e4, so that 1e-16 becomes 1e-12 of the larger and more of the smaller.
        np.testing.assert_allclose(found.values, best, rtol=1e-9)
        # Errors of mbm's own rounding in s² are those of residuals of some 0.1 in numbers of 7.
        np.testing.assert_allclose(
            found.covariance, np.linalg.inv(design.T @ design) * square / (rows - 2), rtol=1e-8, atol=0
        )


def test_many_with_lines_filled_up_are_those_of_one_by_one() -> None:
    compiled = mbm.loads(GROWTH.format(sigma=0.01, more="")).compile(data={"d": growth(20, 0)})
    estimator = compiled.estimator("x", "y")
    lengths = np.array([20, 5, 15, 7, 15, 20, 5])
    x, y = np.full((2, 7, 24), np.nan)
    sets = [growth(rows, t) for t, rows in enumerate(lengths.tolist())]
    for t, data in enumerate(sets):
        x[t, : lengths[t]], y[t, : lengths[t]] = data["x"], data["y"]
    many = estimator.many(x, y, rows=lengths)
    each = [estimator(data["x"], data["y"]) for data in sets]
    for name in ("values", "covariance", "cost", "status", "clean"):
        np.testing.assert_array_equal(getattr(many, name), np.array([getattr(one, name) for one in each]))
    assert estimator.many(x[:0], y[:0], rows=np.empty(0, dtype=int)).values.shape == (0, 3)


def test_rows_with_values_of_other_tables_when_these_are_inputs() -> None:
    """Ranges to the marks that answered, whichever these are."""
    compiled = mbm.loads(RANGES.format(more="")).compile(data={"d": ranges("abce", 0)})
    estimator = compiled.estimator("r", "marks.mx", "marks.my", "marks.mz")
    for marks in ("abce", "cbae", "acebcc", "bae"):
        data = ranges(marks, len(marks))
        found = estimator(data["r"], *np.array([PLACES[mark] for mark in marks]).T)
        agree(found, compiled.solve(data={"d": data}), ("p",))


def test_too_few_rows_are_told_as_whole_solves_tell_it() -> None:
    compiled = mbm.loads(GROWTH.format(sigma=0.01, more="")).compile(data={"d": growth(20, 0)})
    estimator = compiled.estimator("x", "y")
    found = estimator([1000.0], [1.7])
    assert (found.status, found.clean) == ("unobservable", False)
    with pytest.raises(mbm.MbmError, match="no-equations"):
        estimator([], [])


@pytest.mark.parametrize("sigma", ["unknown", "0.01"])
def test_other_numbers_of_rows_go_the_fast_way_too(sigma: str) -> None:
    compiled = mbm.loads(GROWTH.format(sigma=sigma, more="")).compile(data={"d": growth(20, 0)})
    estimator = compiled.estimator("x", "y")
    assert estimator.fast is available()
    data = growth(11, 1)
    assert estimator(data["x"], data["y"]).clean is estimator.fast


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ("(solve :method dogleg)", None),
        ("(solve :method direct-search)", "`:method` names a way of its own"),
        ("(observe d (= x (* 900 b)) :sigma unknown)", "several noises are unknown"),
        ("(solve :robust lmeds)", "consensus finds unknown noise in several passes"),
    ],
)
def test_why_estimators_go_the_general_way(more: str, why: str | None) -> None:
    compiled = mbm.loads(GROWTH.format(sigma="unknown", more=more)).compile(data={"d": growth(20, 0)})
    estimator = compiled.estimator("y")
    assert estimator.fast is (estimator.reason is None)
    if available():
        assert estimator.reason == why


def test_consensus_of_very_many_connected_unknowns_is_none_of_subsets() -> None:
    text = """(problem chain (data s external) (unknowns (h (array 61) :init 0)) (solve :robust lmeds)
      (observe s (= rise (- (h j) (h k))) :sigma 1))"""
    steps = {"j": np.arange(2, 62), "k": np.arange(1, 61)}
    table = {name: np.concatenate([column, column]) for name, column in steps.items()}
    compiled = mbm.loads(text).compile(data={"s": {**table, "rise": np.ones(120)}})
    estimator = compiled.estimator("rise")
    if available():
        assert estimator.reason == "consensus of more than 60 unknowns takes losses in place of subsets"


def refusal(call: Callable[[], object]) -> tuple[str, str, str]:
    with pytest.raises(mbm.MbmError) as caught:
        call()
    (found,) = caught.value.diagnostics
    return found.code.name, found.message, found.hint or ""


def test_what_keeps_the_rows_of_a_table_is_said() -> None:
    compiled = mbm.loads(GROWTH.format(sigma=0.01, more="")).compile(data={"d": growth(20, 0)})
    data = growth(15, 1)
    code, message, hint = refusal(lambda: compiled.estimator("y")(data["y"]))
    assert (code, message) == (
        "wrong-input",
        "`d.y` has 15 numbers; 20 are wanted, one for each row of its table",
    )
    assert hint == "for any number of rows name what else equations use of `d` among the inputs: `d.x`"
    noisy = mbm.loads(GROWTH.format(sigma="s", more="")).compile(data={"d": {**growth(20, 0), "s": np.full(20, 0.1)}})
    *_, hint = refusal(lambda: noisy.estimator("x", "y")(data["x"], data["y"]))
    assert hint == "`d` keeps its rows: `d.s` decides the noise; `compiled.solve(data=…)` takes tables of any length"
    estimator = compiled.estimator("x", "y")
    *_, hint = refusal(lambda: estimator(data["x"], data["y"][1:]))
    assert hint == "inputs of one table have as many numbers, for as many data sets"
    lines = np.ones((3, 5))
    for rows in ([5, 5], [5, 5, 6], [5, -1, 2], [5.0, 4.0, 3.0], 5):
        _, message, _ = refusal(lambda rows=rows: estimator.many(lines, lines, rows=rows))
        assert message == "`rows` is not one whole number from 0 to 5 for each of 3 data sets"


def test_members_of_families_keep_the_rows_of_their_table() -> None:
    text = """
    (problem days (data d external) (unknowns (a :per d.day :init 0)) (observe d (= y (a day)) :sigma 0.1))"""
    compiled = mbm.loads(text).compile(data={"d": {"day": [1.0, 1.0, 2.0], "y": [1.0, 2.0, 3.0]}})
    *_, hint = refusal(lambda: compiled.estimator("y")([1.0, 2.0]))
    assert "`d` keeps its rows: `d.day` decides the member" in hint
