"""What was not looked at of intervals is said, in single solves and in those made together."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

T = np.linspace(0.1, 3.0, 12)
DECAY = "(unknowns (a :init 3) (k :init 0.6)) (observe d (= y (* a (exp (* -1 k x)))) :sigma 0.05)"


def rows(runs=1):
    """Readings of a decay, with a column that tells runs apart."""
    noise = 0.05 * np.random.default_rng(1).normal(size=(runs, len(T)))
    run = np.repeat(np.arange(runs, dtype=np.float64), len(T))
    return {"d": {"x": np.tile(T, runs), "y": (3 * np.exp(-0.6 * T) + noise).ravel(), "run": run}}


@pytest.mark.parametrize(
    "text",
    [
        f"(problem p (data d external) {DECAY})",
        f"(problem p (data d external) {DECAY} (derive (half (/ (log 2) k))))",
        """(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.1)
          (derive (s (+ a b))))""",
    ],
)
def test_where_all_was_looked_at_nothing_is_said(text):
    result = mbm.loads(text).solve(data=rows())
    assert not result.not_examined
    assert "not_examined" not in result.document()["solves"][0]
    assert "not examined" not in str(result)


def test_poses_that_are_derived_are_named():
    text = f"(problem p (data d external) {DECAY} (derive (there (pose2 1 2 k))))"
    assert list(mbm.loads(text).solve(data=rows()).not_examined) == ["curvature of there"]


def test_too_many_derived_numbers_are_named():
    """201 values of a curve, one more than are looked at."""
    text = f"(problem p (data d external) {DECAY} (derive (f (* a (exp (* -1 k t))) :over (grid t 0 3 201))))"
    result = mbm.loads(text).solve(data=rows())
    assert list(result.not_examined) == ["curvature of f"]
    assert result.document()["solves"][0]["not_examined"].keys() == {"curvature of f"}
    assert "not examined: curvature of f (more than 200 derived numbers)" in str(result)


HELD = """(problem p (data d external) (unknowns (a :init 0.3 :in (0 5)) (b :init 0.1))
    (observe d (= y (+ a (* b x))) :sigma 0.1{loss}){each})"""


@pytest.mark.parametrize("each", ["", " (for-each k)"])
@pytest.mark.parametrize("loss", ["", " :loss huber"])
def test_intervals_beside_limits_are_named_where_nobody_follows_them(loss, each):
    """An intercept that is -0.1 without its limit; the cost of a loss is no likelihood."""
    x = np.arange(10.0, 15.0)
    data = {"d": {"x": x, "y": 0.1 * x - 0.1 + 0.05 * (-1) ** x, "k": np.zeros(5)}}
    found = mbm.loads(HELD.format(loss=loss, each=each)).solve(data=data).solves[0]
    assert found["a"].at_bound.all()
    assert list(found.not_examined) == (["intervals beside limits"] if loss else [])
    assert np.isnan(found["a"].interval()).all() == bool(loss)


def test_solves_made_together_say_the_same():
    derived = "(derive (f (* a (exp (* -1 k t))) :over (grid t 0 3 201)))"
    many = mbm.loads(f"(problem p (data d external) {DECAY} {derived} (for-each run))").solve(data=rows(12))
    assert [list(solve.get("not_examined", {})) for solve in many.document()["solves"]] == [["curvature of f"]] * 12
    assert [list(solve.not_examined) for solve in many.solves] == [["curvature of f"]] * 12


def test_more_than_300_unknowns_are_named():
    """A decay rate for each of 151 groups, with an amplitude each: 302 unknowns."""
    groups = 151
    g = np.repeat(np.arange(1.0, groups + 1), 4)
    x = np.tile([0.2, 1.0, 2.0, 3.0], groups)
    y = 3 * np.exp(-0.6 * x) + 0.05 * np.random.default_rng(2).normal(size=len(x))
    text = f"""(problem p (data d external) (unknowns (a (vector {groups}) :init 3) (k (vector {groups}) :init 0.6))
      (observe d (= y (* (a g) (exp (* -1 (k g) x)))) :sigma 0.05))"""
    result = mbm.loads(text).solve(data={"d": {"g": g, "x": x, "y": y}})
    assert list(result.not_examined) == ["curvature"]


@pytest.mark.parametrize(("limit", "said"), [(0.19, ["intervals beside limits of R"]), (0.5, [])])
def test_rotations_beside_what_a_limit_holds_are_named(limit, said):
    found = mbm.loads(
        f"""(problem p (unknowns (R (rotation 3)) (a))
          (data d (table (x y z u v w) (1 0 0 0.98 0.20 0.02) (0 1 0 -0.21 0.97 0.01) (0 0 1 0.01 -0.02 1.01)))
          (observe d (= [u v w] (rotate R [x y z])) :sigma 0.02) (observe (= 1 a) :sigma 0.1)
          (constraints (<= (dot [0 1 0] (rotate R [1 0 0])) {limit})))"""
    ).solve()
    assert list(found.not_examined) == said
