"""Designs with uncertain constants, and of one of many solves: against linear algebra, solves and simulation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbm

T = np.array([0.0, 1.0, 2.0, 3.0, 5.0])
SCALED = """
(problem p
  (constants (g 2 :sigma 0.05) (c 1 :prior (rectangular 0.9 1.1)) (e [1 2] :sigma [0.01 0.02]))
  (data d external)
  (unknowns (a :init 3) (b :init 1))
  (observe d (= y (+ (* a g t) b (* c t t) (* (e 2) w))) :sigma (* 0.1 s))
  (derive (f (+ a (* 10 b) g)) (h (* a g))))
"""
S, W = np.array([1.0, 1.0, 2.0, 1.0, 3.0]), np.array([0.0, 2.0, 1.0, 0.5, 1.0])
UNITS = np.array([0.05, 0.2 / np.sqrt(12), 0.02])


def deviations(t: Any, s: Any, w: Any) -> dict[str, float]:
    """By hand: weighted least squares, and what the constants change (Bierman 1977, chapter 8)."""
    t, s, w = (np.asarray(each, dtype=float) for each in (t, s, w))
    rows = np.column_stack([2.0 * t, np.ones(len(t))]) / (0.1 * s)[:, None]
    moved = np.column_stack([3.0 * t, t * t, w]) / (0.1 * s)[:, None] * UNITS
    own = np.linalg.inv(rows.T @ rows)
    pull = -own @ rows.T @ moved
    direct = {"a": [0, 0, 0], "b": [0, 0, 0], "f": [1, 0, 0], "h": [3, 0, 0]}
    slopes = {"a": [1, 0], "b": [0, 1], "f": [1, 10], "h": [2, 0]}
    found = {}
    for name, slope in slopes.items():
        g = np.array(slope, dtype=float)
        found[name] = float(np.sqrt(g @ own @ g + np.square(g @ pull + np.array(direct[name]) * UNITS).sum()))
    return found


def test_uncertain_constants_count_as_in_a_solve() -> None:
    problem = mbm.loads(SCALED)
    given = {"t": T, "s": S, "w": W}
    design = problem.design(data={"d": given})
    wanted = deviations(T, S, W)
    # half of a difference over a hundredth of u of a problem with a·g in it: off by (0.01·0.05/2)²
    assert {each.name: each.sigma for each in design.expected} == pytest.approx(wanted, rel=1e-6)
    y = 6 * T + 1 + T * T + 2 * W
    solved = problem.solve(data={"d": {**given, "y": y}})
    assert wanted == pytest.approx({name: float(solved[name].sigma) for name in wanted}, rel=1e-6)


@pytest.mark.parametrize("quantity", ["a", "f", "h"])
def test_candidates_sets_and_rows_with_uncertain_constants(quantity: str) -> None:
    at, s, w = np.array([0.5, 8.0, 20.0]), np.array([1.0, 0.5, 10.0]), np.array([0.0, 3.0, 1.0])
    design = mbm.loads(SCALED).design(
        quantity, {"t": at, "s": s, "w": w}, data={"d": {"t": T, "s": S, "w": W}}, choose=2
    )

    def with_rows(places: list[int]) -> float:
        more = [np.append(own, new[places]) for own, new in ((T, at), (S, s), (W, w))]
        return deviations(*more)[quantity]

    for i, each in enumerate(design.candidates):
        assert each.sigma == pytest.approx(with_rows([i]), rel=1e-6)
    best = min(([0, 1], [0, 2], [1, 2]), key=with_rows)
    assert design.chosen is not None
    assert [row - 1 for row in design.chosen.rows] == best
    assert design.chosen.sigma == pytest.approx(with_rows(best), rel=1e-6)
    before = deviations(T, S, W)[quantity]
    for worth in design.worth:
        assert worth.row is not None
        without = deviations(*(np.delete(each, worth.row - 1) for each in (T, S, W)))[quantity]
        assert worth.growth == pytest.approx(without / before, rel=1e-6)


def test_no_number_of_readings_gets_below_what_a_constant_brings() -> None:
    text = """(problem p (constants (c 1 :sigma 0.02)) (data d external) (unknowns (a :init 1))
      (observe d (= y (+ a (* c t))) :sigma 0.1))"""
    found = [mbm.loads(text).design("a", {"t": [1.0]}, data={"d": {"t": [1.0]}}, sigma=s) for s in (0.019, 0.03)]
    assert found[0].candidates[0].repeats is None
    assert found[1].candidates[0].repeats == 19  # 0.1²/(0.03² − 0.02²) = 20 readings


def test_constants_in_constraints_and_priors_move_what_they_hold() -> None:
    text = """(problem p (constants (c 2 :sigma 0.1) (m 5 :sigma 0.3)) (data d external)
      (unknowns (a :init 1) (b :init 2) (q :init m :sigma 0.4)) (constraints (= b (* c a)))
      (observe d (= y (+ (* a t) b (* q w))) :sigma 0.2))"""
    problem, given = mbm.loads(text), {"t": T, "w": W}
    design = problem.design(data={"d": given})
    solved = problem.solve(data={"d": {**given, "y": T + 2 + 5 * W}})
    for each in design.expected:
        assert each.sigma == pytest.approx(float(solved[each.name].sigma), rel=1e-6)
    more = problem.design("a", {"t": [4.0], "w": [3.0]}, data={"d": given}).candidates[0]
    t, w = np.append(T, 4.0), np.append(W, 3.0)
    again = problem.solve(data={"d": {"t": t, "w": w, "y": t + 2 + 5 * w}})
    assert more.sigma == pytest.approx(float(again["a"].sigma), rel=1e-6)


KEYED = """
(problem p
  (data d external) (data e external)
  (unknowns (a :init 1) (k :init 0.3))
  (observe d (= y (* a n (exp (* -1 k t)))) :sigma 0.01)
  (observe e (= z a) :sigma 0.02)
  (for-each n))
"""


@pytest.mark.parametrize("number", [1, 2])
def test_one_of_many_solves_is_that_of_its_rows_alone(number: int) -> None:
    n, t = np.repeat([1.0, 4.0], 4), np.array([0.0, 1.0, 2.0, 3.0, 0.0, 2.0, 4.0, 8.0])
    candidates = {"t": [5.0, 9.0]}
    found = mbm.loads(KEYED).design(
        "k", candidates, data={"d": {"n": n, "t": t}, "e": {"i": [1.0]}}, solve=number, choose=1
    )
    own = n == (1.0, 4.0)[number - 1]
    alone = mbm.loads(KEYED.replace("(for-each n)", "")).design(
        "k",
        {"t": [5.0, 9.0], "n": [n[own][0]] * 2},
        data={"d": {"n": n[own], "t": t[own]}, "e": {"i": [1.0]}},
        choose=1,
    )
    assert found.key == {"n": (1.0, 4.0)[number - 1]}
    assert found.sigma == pytest.approx(alone.sigma, rel=1e-9)
    assert [each.sigma for each in found.candidates] == pytest.approx([each.sigma for each in alone.candidates])
    assert found.chosen is not None
    assert alone.chosen is not None
    assert found.chosen.rows == alone.chosen.rows
    assert [dict(each.cells) for each in found.candidates] == [{"t": 5.0}, {"t": 9.0}]


def test_the_estimates_of_the_key_are_the_point() -> None:
    n, t = np.repeat([1.0, 4.0], 4), np.tile([0.0, 1.0, 2.0, 3.0], 2)
    y = np.where(n == 1.0, np.exp(-0.2 * t), 4.0 * np.exp(-0.7 * t))
    given = {"d": {"n": n, "t": t, "y": y}, "e": {"z": [1.0]}}
    problem = mbm.loads(KEYED)
    solved = problem.solve(data=given)
    for number, rate in ((1, 0.2), (2, 0.7)):
        design = problem.design("k", data=given, solve=number)
        assert design.point == "estimates"
        assert {each.name: each.value for each in design.expected}["k"] == pytest.approx(rate, abs=1e-6)
        told = solved.document()["solves"][number - 1]["estimates"]["k"]["sigma"]
        assert design.sigma == pytest.approx(told, rel=1e-6)
        assert problem.design("k", data=given, solve=number, at=solved.document()).sigma == pytest.approx(told)


def test_one_of_many_windows_is_that_of_its_rows() -> None:
    text = """(problem p (data d external :columns ((t :unit s))) (unknowns (a) (b)) (observe d
      (= y (+ a (* b (/ t 1s)))) :sigma 0.1) (window t :length 4s :step 2s))"""
    t = np.arange(9.0)
    solved = mbm.loads(text).solve(data={"d": {"t": t, "y": 1 + 2 * t}}).document()["solves"]
    for number, one in list(enumerate(solved, 1))[1:]:  # the first window has one row
        design = mbm.loads(text).design(data={"d": {"t": t}}, solve=number)
        assert dict(design.key) == one["key"]
        wanted = {name: each["sigma"] for name, each in one["estimates"].items()}
        assert {each.name: each.sigma for each in design.expected} == pytest.approx(wanted, rel=1e-9)


def test_there_are_not_so_many() -> None:
    with pytest.raises(mbm.MbmError, match="solve 3 is asked for, and there are 2") as caught:
        mbm.loads(KEYED).design(data={"d": {"n": [1.0, 2.0], "t": [0.0, 1.0]}, "e": {"i": [1.0]}}, solve=3)
    assert caught.value.diagnostics[0].code.name == "not-designed"


@pytest.mark.slow
def test_simulated_experiments_with_drawn_constants_scatter_as_expected() -> None:
    text = """(problem p (constants (l 1.5 :sigma 0.01)) (data d external) (unknowns (g :init 9.8))
      (observe d (= y (* 2 pi (sqrt (/ l g)))) :sigma (* 0.01 s)))"""
    design = mbm.loads(text).design("g", {"s": [1.0, 0.5]}, data={"d": {"s": [1.0, 1.0]}}, choose=1)
    rng, count = np.random.default_rng(5), 4000
    s = np.array([1.0, 1.0, [1.0, 0.5][design.chosen.rows[0] - 1]])  # type: ignore[union-attr]
    length = 1.5 + 0.01 * rng.standard_normal(count)
    y = 2 * np.pi * np.sqrt(length / 9.8)[:, None] + 0.01 * s * rng.standard_normal((count, 3))
    runs = np.repeat(np.arange(count), 3)
    keyed = mbm.loads(text.replace("(observe", "(for-each run) (observe").replace(" :sigma 0.01)", ")"))
    found = keyed.solve(data={"d": {"run": runs, "s": np.tile(s, count), "y": y.ravel()}}).table()
    actual = float(np.std(np.asarray(found["g"], dtype=float), ddof=1))
    assert design.chosen is not None
    assert abs(actual / float(design.chosen.sigma or 0.0) - 1) < 3 / np.sqrt(2 * count)


HEIGHTS = """(problem net
  (data d (table (i j) (1 2) (2 3))) (data c (table (i j) (3 4) (1 3) (1 4) (2 4)))
  (unknowns (h :per (d.i c.j) :init 0))
  (observe d (= dh (- (h i) (h j))) :sigma 1)
  (constraints (= (h 1) 0)))"""


def test_what_a_constraint_fixes_leaves_the_determinant_of_the_rest() -> None:
    """A levelling net: the determinant is 1 over its spanning trees (Kirchhoff): 4 of a square, 3 of the other sets."""
    design = mbm.loads(HEIGHTS).design(None, "c", choose=2, criterion="D")
    assert design.chosen is not None
    assert design.chosen.rows == (1, 3)
    assert design.chosen.objective == pytest.approx(-np.log(4), abs=1e-9)


def test_of_fewer_candidates_than_wanted_all_are_chosen() -> None:
    """Once each: no set of a hundred can be made of four."""
    design = mbm.loads(HEIGHTS).design("h[4]", "c", choose=100)
    assert design.chosen is not None
    assert design.chosen.rows == (1, 2, 3, 4)
