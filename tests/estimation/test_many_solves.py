"""What many solves of one problem share: layouts where no table decides them, and prepared kernels within bounds."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.equations import binding
from mbm.equations.binding import EvaluationCache
from mbm.equations.layouts import Layouts

GROUPS = "(data d (table (g x y) (1 1 2) (1 2 4) (2 1 3) (2 2 6) (2 3 9)))"
TEXT = "(problem p {data} (unknowns {unknowns}) (observe d (= y {model}) :sigma 1) (for-each g))"


def made(unknowns, model="(* a x)"):
    """A problem elaborated, with its tables."""
    problem = mbm.loads(TEXT.format(data=GROUPS, unknowns=unknowns, model=model))
    found = problem.compile().elaborated
    return found.problem, found.tables


@pytest.mark.parametrize(
    ("unknowns", "model", "shared"),
    [
        ("(a :init 1)", "(* a x)", True),
        ("(a :init (first d y))", "(* a x)", False),
        ("(a :in (0 (last d y)))", "(* a x)", False),
        ("(a :per d.x :init 1)", "(a x)", False),
    ],
)
def test_a_layout_is_made_once_where_no_table_decides_it(unknowns, model, shared):
    problem, tables = made(unknowns, model)
    layouts = Layouts()
    first, second = layouts.of(problem, tables, {}), layouts.of(problem, tables, {})
    assert (first is second) == shared
    other = layouts.of(problem, tables, {"a": np.full(len(first.start), 5.0)})
    assert other is not first
    assert other.start.tolist() == [5.0] * len(first.start)


def test_starts_that_follow_from_the_rows_differ_between_solves():
    """A sine near the truth in each group, which only a start of its own leads to."""
    text = TEXT.format(data="(data d external)", unknowns="(w :init (first d guess))", model="(sin (* w x))")
    x = np.linspace(0, 40, 60)
    data = {
        "g": np.repeat([1.0, 2.0], 60),
        "x": np.tile(x, 2),
        "guess": np.repeat([1.01, 2.01], 60),
        "y": np.concatenate([np.sin(x), np.sin(2 * x)]),
    }
    solved = mbm.loads(text).solve(data={"d": data})
    assert [float(s.estimates[0].value) for s in solved.solves] == pytest.approx([1, 2], abs=1e-10)


class Counting:
    """A backend that only counts what is prepared."""

    name = "counting"

    def __init__(self):
        self.prepared = []

    def prepare(self, kernel, rows):
        self.prepared.append(rows)
        return object()


def test_kernels_of_every_size_are_not_kept_for_ever(monkeypatch):
    monkeypatch.setattr(binding, "MOST_PREPARED_ROWS", 100)
    backend = Counting()
    cache = EvaluationCache(backend)
    first = cache.evaluation(0, None, 40)
    assert cache.evaluation(0, None, 40) is first
    cache.evaluation(0, None, 50)
    cache.evaluation(0, None, 60)  # 150 rows: the others are given up
    assert cache.evaluation(0, None, 40) is not first
    assert backend.prepared == [40, 50, 60, 40]


def test_data_sets_of_other_sizes_and_weights_follow_one_another():
    """Lines one after the other by one compiled problem, each as the weighted normal equations have it."""
    random = np.random.default_rng(7)
    text = """(problem p (data d external) (unknowns (a :init 0) (b :init 0))
      (observe d (= y (+ a (* b x))) :sigma s))"""
    compiled = None
    for rows in (5, 9, 9, 5, 5, 30):
        x, y, s = random.uniform(0, 5, rows), random.normal(size=rows), random.uniform(0.5, 2, rows)
        compiled = compiled or mbm.loads(text).compile(data={"d": {"x": x, "y": y, "s": s}})
        solved = compiled.solve(data={"d": {"x": x, "y": y, "s": s}})
        slopes = np.column_stack([np.ones(rows), x]) / s[:, None]
        inverse = np.linalg.inv(slopes.T @ slopes)
        # a condition below 30 loses its square of the roundings
        assert [solved["a"].value, solved["b"].value] == pytest.approx(inverse @ slopes.T @ (y / s), abs=1e-11)
        assert [solved["a"].sigma, solved["b"].sigma] == pytest.approx(np.sqrt(np.diag(inverse)), rel=1e-11)
