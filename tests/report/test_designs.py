"""Designs: accuracies as linear algebra and simulation have them, sets as textbooks and all subsets have them."""

from __future__ import annotations

import json
from itertools import combinations, combinations_with_replacement
from math import inf

import numpy as np
import pytest

import mbm
from mbm.cli.main import run

T = np.array([0.0, 1.0, 2.0, 3.0, 5.0])
LINE = """
(problem p
  (data d external)
  (unknowns (a) (b))
  (observe d (= y (+ a (* b t))) :sigma (* 0.1 s))
  (derive (f (+ a (* 10 b)))))
"""
S = np.array([1.0, 1.0, 2.0, 1.0, 3.0])


def rows_of(times, spread):
    """The whitened Jacobian of a line with the standard deviations 0.1 spread."""
    return np.column_stack([np.ones(len(times)), times]) / (0.1 * np.asarray(spread))[:, None]


def sigma_of(rows, gradient):
    """Textbook: √(cᵀ(HᵀH)⁻¹c)."""
    return float(np.sqrt(np.asarray(gradient) @ np.linalg.inv(rows.T @ rows) @ np.asarray(gradient)))


def expected(design):
    return {each.name: each.sigma for each in design.expected}


def test_what_is_measured_may_be_missing_or_empty_or_there():
    problem, base = mbm.loads(LINE), rows_of(T, S)
    wanted = {"a": [1, 0], "b": [0, 1], "f": [1, 10]}
    for more in ({}, {"y": np.full(5, np.nan)}, {"y": [1.0, np.nan, 3.0, 4.0, 5.0]}, {"y": 1 + 2 * T}):
        design = problem.design(data={"d": {"t": T, "s": S, **more}})
        for name, gradient in wanted.items():
            # both decompose a 5 × 2 matrix of condition 4: some roundings
            assert expected(design)[name] == pytest.approx(sigma_of(base, gradient), rel=1e-10)
        assert design.observable
        assert design.point == ("estimates" if "y" in more and np.isfinite(more["y"]).all() else "start")


def test_the_point_decides_where_the_model_is_not_linear():
    text = "(problem p (data d external) (unknowns (k :init 1)) (observe d (= y (exp (* -1 k t))) :sigma 0.1))"
    problem = mbm.loads(text)
    for at, point in (({"k": 0.3}, 0.3), (None, 1.0)):
        design = problem.design(at=at, data={"d": {"t": T}})
        assert design.expected[0].value == pytest.approx(point)
        assert design.expected[0].sigma == pytest.approx(0.1 / np.linalg.norm(T * np.exp(-point * T)), rel=1e-9)
    y = np.exp(-0.7 * T)
    assert problem.design(data={"d": {"t": T, "y": y}}).expected[0].value == pytest.approx(0.7)


def test_noise_that_depends_on_the_reading_is_that_of_the_prediction():
    text = "(problem p (data d external) (unknowns (a :init 2)) (observe d (= y (* a t)) :sigma (* 0.01 y)))"
    design = mbm.loads(text).design(data={"d": {"t": T[1:]}})
    assert design.expected[0].sigma == pytest.approx(0.01 * 2 / np.sqrt(4), rel=1e-9)


@pytest.mark.parametrize("quantity", ["a", "f", None])
def test_rows_are_worth_what_is_lost_without_them(quantity):
    base, gradients = rows_of(T, S), {"a": [1, 0], "b": [0, 1], "f": [1, 10]}
    design = mbm.loads(LINE).design(quantity, data={"d": {"t": T, "s": S}})
    names = [quantity] if quantity is not None else ["a", "b"]
    assert {each.row for each in design.worth} == {1, 2, 3, 4, 5}
    for each in design.worth:
        without = np.delete(base, each.row - 1, axis=0)
        growth = {name: sigma_of(without, gradients[name]) / sigma_of(base, gradients[name]) for name in names}
        assert each.growth == pytest.approx(max(growth.values()), rel=1e-8)
        assert growth[each.quantity] == pytest.approx(each.growth, rel=1e-8)
    assert [each.growth for each in design.worth] == sorted((each.growth for each in design.worth), reverse=True)


def test_a_row_that_alone_determines_something_has_no_growth():
    design = mbm.loads(LINE).design(data={"d": {"t": [0.0, 0.0, 3.0], "s": [1, 1, 1]}})
    worth = {each.row: each.growth for each in design.worth}
    assert worth[3] is None
    assert worth[1] == pytest.approx(np.sqrt(2), rel=1e-9)  # a of two readings, and of one


def test_each_candidate_adds_its_row():
    base, gradient = rows_of(T, S), [1, 10]
    at, spread = np.array([0.5, 8.0, 20.0]), np.array([1.0, 0.5, 10.0])
    design = mbm.loads(LINE).design("f", {"t": at, "s": spread, "cost": [1, 2, 3]}, data={"d": {"t": T, "s": S}})
    before = sigma_of(base, gradient)
    assert design.sigma == pytest.approx(before, rel=1e-10)
    for i, each in enumerate(design.candidates):
        then = sigma_of(np.vstack([base, rows_of(at[i : i + 1], spread[i : i + 1])]), gradient)
        assert each.sigma == pytest.approx(then, rel=1e-9)
        assert each.gain == pytest.approx(before / then, rel=1e-9)
        assert (each.row, each.cost, each.cells["t"], each.observable) == (i + 1, i + 1.0, at[i], False)


def test_a_candidate_makes_observable_what_was_not():
    design = mbm.loads(LINE).design("b", {"t": [2.0, 3.0], "s": [1, 1]}, data={"d": {"t": [2.0, 2.0], "s": [1, 1]}})
    assert (design.determined, design.sigma, design.observable) == (False, None, False)
    same, other = design.candidates
    assert (same.determined, same.observable, same.sigma) == (False, False, None)
    assert (other.determined, other.observable) == (True, True)
    assert other.sigma == pytest.approx(0.1 * np.sqrt(1.5), rel=1e-9)  # the mean of two, and one, a unit apart


def test_nothing_needs_to_be_measured_before():
    """With an external table that is not given, candidates are all that there is."""
    design = mbm.loads(LINE).design(candidates={"t": T, "s": np.ones(5)}, choose=2, criterion="D")
    assert design.chosen.rows == (1, 5)
    assert expected(design) == {"a": None, "b": None, "f": None}
    assert design.chosen.determined


@pytest.mark.parametrize("wanted", [0.2, "0.1", 0.05])
def test_repeats_reach_a_wanted_deviation_and_no_fewer_do(wanted):
    base, gradient = rows_of(T, S), [1, 10]
    at = np.array([0.0, 8.0, 12.0])
    design = mbm.loads(LINE).design("f", {"t": at, "s": np.ones(3)}, data={"d": {"t": T, "s": S}}, sigma=wanted)
    for each in design.candidates:
        row = rows_of(at[each.row - 1 : each.row], [1.0])

        def sigma(count, row=row):
            return sigma_of(np.vstack([base, np.sqrt(count) * row]), gradient)

        if each.repeats is None:
            assert sigma(1e8) > float(wanted)
        else:
            assert sigma(each.repeats) <= float(wanted)
            assert each.repeats == 0 or sigma(each.repeats - 1) > float(wanted)
    assert design.candidates[0].repeats is None
    assert design.candidates[1].repeats is not None


def test_a_wanted_deviation_has_a_unit():
    text = """(problem p (data d external :columns ((y :unit mm))) (unknowns (a :unit mm))
      (observe d (= y (* a w)) :sigma 2mm))"""
    design = mbm.loads(text).design("a", {"w": [1.0]}, data={"d": {"w": [1.0]}}, sigma="0.05cm")
    assert design.wanted == pytest.approx(0.5)
    assert design.candidates[0].repeats == 15  # 2 mm/√16


@pytest.mark.parametrize(
    ("unit", "sigma", "code", "says"),
    [
        ("deg", "0.5s", "unit-clash", "does not go with `a`"),
        ("mm", "0.5deg", "unit-clash", "does not go with `a`"),
        ("degC", "0.3degC", "temperature-and-difference", "`0.3degC` is the temperature 273.45K"),
        ("K", "0.3degF", "temperature-and-difference", "here a difference of temperatures is wanted"),
        ("s", "0.3degC", "unit-clash", "does not go with `a`"),
    ],
)
def test_a_wanted_deviation_of_another_dimension_is_refused(unit, sigma, code, says):
    with pytest.raises(mbm.MbmError, match=says) as caught:
        mbm.loads(UNITED.replace("UNIT", unit)).design("a", {"k": [1.0]}, sigma=sigma)
    assert caught.value.diagnostics[0].code.name == code


@pytest.mark.parametrize(
    ("unit", "sigma", "wanted"),
    [("degC", "0.3K", 0.3), ("degF", "0.5K", 0.9), ("degF", "0.5degR", 0.5), ("deg", "6arcmin", 0.1), ("deg", "1", 1)],
)
def test_a_wanted_deviation_of_what_has_a_zero_is_a_difference(unit, sigma, wanted):
    design = mbm.loads(UNITED.replace("UNIT", unit)).design("a", {"k": [1.0]}, sigma=sigma)
    assert design.wanted == pytest.approx(wanted)


UNITED = """(problem p (data d external :columns ((y :unit UNIT))) (unknowns (a :unit UNIT) (u :unit UNIT))
  (observe d (= y (if (> k 0) a u)) :sigma (- 3UNIT 1UNIT)))"""

CURVE = "(problem p (data d external) (unknowns (a) (b) (c)) (observe d (= y (+ a (* b x) (* c x x))) :sigma 1) {})"
POINTS = np.linspace(-1, 1, 9)


def at_points(design):
    """The chosen values of x, each as often as it is chosen."""
    chosen = design.chosen
    return sorted(float(POINTS[r - 1]) for r, n in zip(chosen.rows, chosen.counts, strict=True) for _ in range(n))


@pytest.mark.parametrize(
    ("more", "quantity", "criterion", "count", "wanted"),
    [
        # D-optimal for a polynomial: equal weights at the roots of (1 − x²)P′ (Fedorov 1972, §2.3): −1, 0, 1
        ("", None, "D", 3, [-1, 0, 1]),
        ("", None, "D", 6, [-1, -1, 0, 0, 1, 1]),
        # A-optimal quadratic: weights 1/4, 1/2, 1/4 (Pukelsheim 2006, §9.6)
        ("", None, "A", 4, [-1, 0, 0, 1]),
        ("", None, "A", 8, [-1, -1, 0, 0, 0, 0, 1, 1]),
        # c-optimal for the slope at 0 of a quadratic: half at each end; for the curvature 1/4, 1/2, 1/4 (Chebyshev)
        ("", "b", "c", 4, [-1, -1, 1, 1]),
        ("", "c", "c", 4, [-1, 0, 0, 1]),
    ],
)
def test_textbook_designs(more, quantity, criterion, count, wanted):
    text = CURVE.format(more)
    if quantity == "b":  # the curvature is known well enough for the slope alone to be sought
        text = text.replace("(c))", "(c :init 0 :sigma 1e-3) )").replace(
            "(unknowns (a)", "(unknowns (a :init 0 :sigma 1e3)"
        )
    design = mbm.loads(text).design(quantity, {"x": POINTS}, choose=count, criterion=criterion, repeats=True, seed=3)
    assert at_points(design) == wanted


def brute(rows, gradient, costs, wish):
    """The best objective of all sets that are allowed, by inverses."""
    best = inf
    count, budget, repeats, criterion = wish
    draw = combinations_with_replacement if repeats else combinations
    sizes = [count] if count is not None else range(len(rows) + 1)
    for size in sizes:
        for chosen in draw(range(len(rows)), size):
            if sum(costs[i] for i in chosen) > budget:
                continue
            own = rows[list(chosen)]
            matrix = own.T @ own
            if np.linalg.matrix_rank(matrix) < matrix.shape[0]:
                continue
            covariance = gradient @ np.linalg.inv(matrix) @ gradient.T
            best = min(best, np.linalg.slogdet(covariance)[1] if criterion == "D" else np.trace(covariance))
    return best


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("criterion", ["A", "D", "c"])
@pytest.mark.parametrize(("count", "budget", "repeats"), [(3, None, False), (4, None, True), (None, 7.0, False)])
def test_sets_are_the_best_of_all_subsets(seed, criterion, count, budget, repeats, monkeypatch):
    """By looking at all of them, and by exchanges alone: the same objective."""
    rng = np.random.default_rng(seed)
    x, w, costs = rng.uniform(-1, 1, 7), rng.uniform(0.5, 2, 7), rng.integers(1, 4, 7).astype(float)
    text = """(problem p (data d external) (unknowns (a) (b) (c))
      (observe d (= y (+ a (* b x) (* c x x))) :sigma w))"""
    rows = np.column_stack([np.ones(7), x, x * x]) / w[:, None]
    gradient = np.array([[1.0, 0.5, 0.25]]) if criterion == "c" else np.eye(3)
    quantity = "f" if criterion == "c" else None
    text = text[:-1] + "(derive (f (+ a (* 0.5 b) (* 0.25 c)))))" if criterion == "c" else text
    wish = {"choose": count} if count is not None else {"budget": budget}
    best = brute(rows, gradient, costs, (count, inf if budget is None else budget, repeats, criterion))
    problem, table = mbm.loads(text), {"x": x, "w": w, "cost": costs}
    for most in (3_000, 0):
        monkeypatch.setattr("mbm.estimation.design.choice.EXHAUSTIVE", max(most, 1))
        design = problem.design(quantity, table, criterion=criterion, repeats=repeats, seed=seed, **wish)
        assert design.chosen.exhaustive is (most > 0)
        assert design.chosen.objective == pytest.approx(best, rel=1e-7, abs=1e-9)
        assert budget is None or design.chosen.cost <= budget


def test_vectors_poses_and_constraints_are_what_a_solve_says():
    """Σ of a fit with an equality constraint and a vector, against a solve of simulated measurements."""
    text = """(problem p (data d external) (unknowns (p (vector 2) :init [1 2]) (q :init 1))
      (observe d (= r (hypot (- (p 1) u) (- (p 2) v))) :sigma 0.01) (constraints (= q (* 2 (p 1))))
      (derive (s (+ (p 1) (p 2)))))"""
    given = {"u": [0.0, 4.0, 4.0], "v": [0.0, 0.0, 4.0]}
    problem = mbm.loads(text)
    r = np.hypot(1 - np.array(given["u"]), 2 - np.array(given["v"]))
    solve = problem.solve(data={"d": {**given, "r": r}})
    design = problem.design(data={"d": given})
    for name in ("p", "q", "s"):
        wanted = np.ravel(solve[name].sigma)
        found = [each.sigma for each in design.expected if each.name.split("[")[0] == name]
        np.testing.assert_allclose(found, wanted, rtol=1e-7)


def test_priors_count_and_unknown_noise_is_that_of_the_document():
    text = """(problem p (data d external) (unknowns (a :init 1 :sigma 0.5))
      (observe d (= y (* a t)) :sigma unknown))"""
    problem, data = mbm.loads(text), {"d": {"t": [1.0, 2.0]}}
    design = problem.design(data=data)
    assert design.expected[0].sigma == pytest.approx(1 / np.sqrt(1 / 0.25 + 5))
    assert [note.code.name for note in design.notes] == ["design-assumed"]
    solved = problem.solve(data={"d": {"t": [1.0, 2.0, 3.0], "y": [1.1, 1.9, 3.2]}})
    factor = solved.first.noise["d"]
    design = problem.design(data=data, at=json.loads(solved.to_json()))
    assert design.notes == ()
    assert design.expected[0].sigma == pytest.approx(1 / np.sqrt(1 / 0.25 + 5 / factor**2))


def test_candidates_may_bring_members_of_their_own():
    text = """(problem p (data d (table (cam t y) ("l" 0 1) ("l" 1 3) ("r" 0 2) ("r" 1 5)))
      (unknowns (a :per d.cam) (b)) (observe d (= y (+ (a cam) (* b t))) :sigma 0.1))"""
    design = mbm.loads(text).design("b", {"cam": ["l", "new"], "t": [5.0, 9.0]})
    rows = np.array([[1, 0, 0], [1, 0, 1], [0, 1, 0], [0, 1, 1]]) / 0.1
    assert design.sigma == pytest.approx(sigma_of(rows, [0, 0, 1]), rel=1e-9)
    own = sigma_of(np.vstack([rows, np.array([[1, 0, 5]]) / 0.1]), [0, 0, 1])
    assert [each.sigma for each in design.candidates] == pytest.approx([own, design.sigma], rel=1e-9)


def test_motions_have_coordinates_of_two_kinds():
    text = """(problem p (data d (table (u v) (0 0) (1 0) (0 1))) (unknowns (T (pose 2) :init (pose2)))
      (observe d (= (x y) (transform T (u v))) :sigma 0.1))"""
    design = mbm.loads(text).design("T", {"u": [5.0], "v": [0.0]}, choose=1)
    assert (design.sigma, design.chosen.criterion) == (None, "D")


@pytest.mark.slow
def test_a_thousand_simulated_experiments_scatter_as_expected():
    """The chosen set of a nonlinear problem: the actual standard deviation within three of what chance allows."""
    text = """(problem p (data d external) (unknowns (a :init 1) (k :init 0.3))
      (observe d (= y (* a (exp (* -1 k t)))) :sigma 0.01) (derive (h (/ (log 2) k))))"""
    problem, base, at = mbm.loads(text), np.array([0.0, 1.0]), np.array([2.0, 3.0, 4.0, 6.0, 9.0])
    design = problem.design("h", {"t": at}, data={"d": {"t": base}}, choose=2)
    times = np.concatenate([base, at[[r - 1 for r in design.chosen.rows]]])
    rng, count = np.random.default_rng(11), 1000
    runs = np.repeat(np.arange(count), len(times))
    y = np.exp(-0.3 * np.tile(times, count)) + 0.01 * rng.standard_normal(len(runs))
    keyed = mbm.loads(text.replace("(derive", "(for-each run) (derive"))
    found = keyed.solve(data={"d": {"run": runs, "t": np.tile(times, count), "y": y}}).table()
    actual = float(np.std(np.asarray(found["h"], dtype=float), ddof=1))
    assert abs(actual / design.chosen.sigma - 1) < 3 / np.sqrt(2 * count)


@pytest.mark.parametrize(
    ("change", "code", "message"),
    [
        ({"text": LINE.replace("s))", "s) :common ((0.1 :per t)))")}, "not-designed", "`:common`"),
        ({"candidates": {"t": [1.0]}}, "no-candidates", "lack `s`"),
        ({"candidates": {"t": [1.0], "s": [1.0], "cost": [-1.0]}, "choose": 1}, "no-candidates", "cost"),
        ({"candidates": {"t": [1.0], "s": [1.0]}, "observation": "e"}, "no-candidates", "`e` is no observation"),
        ({"candidates": {"t": [1.0], "s": [1.0]}, "choose": 1, "criterion": "E"}, "no-candidates", "no criterion"),
        ({"candidates": {"t": [1.0], "s": [1.0]}, "choose": 1, "criterion": "c"}, "no-candidates", "one number"),
        ({"candidates": {"t": [1.0], "s": [1.0]}, "sigma": "five"}, "no-candidates", "no standard deviation"),
        ({"candidates": {"t": [1.0], "s": [np.nan]}}, "not-finite-cell", "`s`"),
        ({"candidates": {"t": [1.0], "s": [0.0]}}, "bad-noise", "sigma"),
        ({"quantity": "g"}, "unknown-quantity", "`g`"),
        ({"at": {"c": 1}}, "bad-initial-values", "no unknown"),
    ],
)
def test_what_is_no_design(change, code, message):
    given = dict(change)
    problem = mbm.loads(given.pop("text", LINE))
    with pytest.raises(mbm.MbmError, match=message) as caught:
        problem.design(
            given.pop("quantity", None), given.pop("candidates", None), data={"d": {"t": T, "s": S}}, **given
        )
    assert caught.value.diagnostics[0].code.name == code


FILE = """
(problem tank
  (data levels (csv "levels.csv") :columns ((t :unit min) (level :unit cm)))
  (data plan (table (t cost) (1 1) (10 2)) :columns ((t :unit min)))
  (unknowns (full :init 1m :unit cm) (rate :init 0.2))
  (observe levels (= level (* full (exp (* -1 rate (/ t 60s))))) :sigma 2cm)
  (derive (half-time (/ (log 2) rate))))
"""


@pytest.fixture
def tank(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.mbm").write_text(FILE)
    (tmp_path / "levels.csv").write_text("t\n0\n2\n4\n6\n8\n")
    (tmp_path / "more.csv").write_text("t,cost\n1,1\n10,2\n")
    return tmp_path


@pytest.mark.parametrize("candidates", ["plan", "more.csv"])
def test_the_command_line(tank, candidates, capsys):
    call = ["design", "tank.mbm", "--for", "half-time", "--candidates", candidates, "--choose", "1", "--sigma", "0.1"]
    assert run([*call, "--json", "d.json", "--csv", "d.csv"]) == 0
    shown = capsys.readouterr().out
    assert "measure next" in shown
    t = np.array([0.0, 2, 4, 6, 8])

    def sigma(times):
        rows = np.column_stack([np.exp(-0.2 * times), -times * np.exp(-0.2 * times)]) / 0.02
        return sigma_of(rows, [0, np.log(2) / 0.04])

    found = json.loads((tank / "d.json").read_text())["design"]
    assert found["sigma"] == pytest.approx(sigma(t), rel=1e-9)
    assert [each["sigma"] for each in found["candidates"]] == pytest.approx([sigma(np.append(t, x)) for x in (1, 10)])
    assert found["chosen"]["rows"] == [2]
    lines = (tank / "d.csv").read_text().splitlines()
    assert lines[0] == "row,t,cost,sigma,gain,observable,repeats,chosen"
    assert [line.split(",")[-1] for line in lines[1:]] == ["0", "1"]


def test_exit_status_and_files(tank, capsys):
    (tank / "levels.csv").write_text("t\n1\n1\n")
    assert run(["design", "tank.mbm", "--json", "-"]) == 1
    found = json.loads(capsys.readouterr().out)["design"]
    assert found["expected"]["rate"]["sigma"] is None
    assert len(found["free"]) == 2
    assert run(["design", "tank.mbm", "--json", "tank.mbm"]) == 2
    assert run(["design", "tank.mbm", "--candidates", "none.csv"]) == 2
    assert run(["design", "tank.mbm", "--candidates", "tank.mbm"]) == 2
    assert (tank / "tank.mbm").read_text() == FILE
