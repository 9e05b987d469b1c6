"""Intervals of likelihoods at a limit, against closed forms, and against sums of the likelihood over a grid."""

from __future__ import annotations

from math import log

import numpy as np
import pytest
from scipy.optimize import brentq, linprog
from scipy.stats import norm

import mbm

NEAR = 5e-3
"""Relative accuracy of an end: −log L is known to 0.01 between the places where it was looked at."""

COUNTS = "(problem p (data d external) (unknowns (m {option})) (observe d (= k m) :distribution poisson))"
TRIALS = """(problem p (data d external) (unknowns (p :in (0 1)))
    (observe d (= k (* {n} p)) :distribution (binomial {n})))"""


@pytest.mark.parametrize("option", ["positive", ":in (0 100)", ""])
@pytest.mark.parametrize("count", [1, 4])
def test_no_counts_tell_a_rate_as_far_as_its_likelihood_falls(option: str, count: int) -> None:
    """exp(−n m): 95 % of it lie below −log(0.05)/n, the one-sided limit of n intervals without a count."""
    found = mbm.loads(COUNTS.format(option=option)).solve(data={"d": {"k": np.zeros(count)}})
    assert found.solves[0].record.status == "converged"
    assert found["m"].interval() == pytest.approx([0.0, -log(0.05) / count], rel=NEAR, abs=1e-10)
    assert found["m"].interval(0.9)[1] == pytest.approx(-log(0.1) / count, rel=NEAR)
    assert np.isnan(found["m"].sigma)
    assert [each.code.name for each in found.solves[0].record.diagnostics] == ["near-bound"]


@pytest.mark.parametrize("trials", [10, 50])
def test_all_trials_alike_tell_a_share(trials: int) -> None:
    """(1 − p)ⁿ is the probability of none: 5 % of it is the one-sided limit of Clopper and Pearson."""
    problem = mbm.loads(TRIALS.format(n=trials))
    none, every = (problem.solve(data={"d": {"k": np.array([k])}})["p"] for k in (0.0, float(trials)))
    end = 1 - 0.05 ** (1 / trials)
    assert none.interval() == pytest.approx([0.0, end], rel=NEAR)
    assert every.interval() == pytest.approx([1.0 - end, 1.0], rel=NEAR)
    assert none.interval_kind == every.interval_kind == "limited"
    assert np.isnan(none.sigma) and np.isnan(every.sigma)


def test_a_share_by_its_logarithm_has_no_maximum() -> None:
    """0 of 10 by a logit: no value is the most likely; the end is where none of 10 has a probability of 5 %."""
    text = """(problem p (data d (table (k) (0))) (unknowns (a :init 0))
        (observe d (= k (/ 10 (+ 1 (exp (- a))))) :distribution (binomial 10)) (derive (p (/ 1 (+ 1 (exp (- a)))))))"""
    found = mbm.loads(text).solve()
    share = 1 - 0.05 ** (1 / 10)
    assert found.solves[0].record.status == "unobservable"
    assert np.isnan(found["a"].sigma) and found["a"].reason is not None
    low, high = found["a"].interval()
    assert low == -np.inf
    assert high == pytest.approx(log(share / (1 - share)), abs=NEAR)
    assert np.isnan(found["p"].sigma)
    assert found["p"].interval() == pytest.approx([0.0, share], rel=NEAR)


@pytest.mark.parametrize("count", [1, 3])
def test_readings_below_the_limit_of_detection_alone(count: int) -> None:
    """Up to where all of them are below in 5 % of all cases: Φ((1 − a)/σ)ⁿ = 0.05."""
    rows = "(1)" * count
    text = (
        f"(problem p (data d (table (c) {rows})) (unknowns (a :in (0 10))) (observe d (= c a) :sigma 0.5 :below true))"
    )
    wanted = 1.0 - 0.5 * norm.ppf(0.05 ** (1 / count))
    assert mbm.loads(text).solve()["a"].interval() == pytest.approx([0.0, wanted], rel=NEAR)


ROUNDED = "(problem p (data d (table (y) {rows})) (unknowns (a)) (observe d (= y a) :sigma unknown :resolution 1))"


def test_readings_in_one_step_tell_the_step() -> None:
    """Any value of the step explains them without scatter, and values beyond it half of them at most."""
    found = mbm.loads(ROUNDED.format(rows="(3) (3) (3) (3) (3)")).solve()
    assert found["a"].interval() == pytest.approx([2.5, 3.5], abs=1e-3)
    low, high = found["d-sigma"].interval()
    assert low == 0.0
    assert 0.2 < high < 1.0
    for name in ("a", "d-sigma"):
        assert np.isnan(found[name].sigma) and found[name].reason is not None


def test_a_line_through_steps_is_as_free_as_the_steps_leave_it() -> None:
    """All lines through the six steps explain them without scatter: the ends are those of a linear programme."""
    x, y = np.arange(1.0, 7.0), np.array([3.0, 5.0, 8.0, 10.0, 12.0, 15.0])
    text = """(problem p (data d external) (unknowns (a) (b))
        (observe d (= y (+ a (* b x))) :sigma unknown :resolution 1))"""
    found = mbm.loads(text).solve(data={"d": {"x": x, "y": y}})
    rows = np.column_stack([np.ones(6), x])
    within, most = np.vstack([rows, -rows]), np.concatenate([y + 0.5, 0.5 - y])
    for name, cost in (("a", [1.0, 0.0]), ("b", [0.0, 1.0])):
        low, high = (
            sign * linprog(sign * np.array(cost), within, most, bounds=(None, None)).fun for sign in (1.0, -1.0)
        )
        assert found[name].interval() == pytest.approx([low, high], abs=2e-3)
        assert np.isnan(found[name].sigma)


def test_readings_in_two_neighbouring_steps_tell_no_scatter() -> None:
    """The likelihood is (2/3)²/3 all along σ → 0, a → 3.5, and no more anywhere."""
    text = (
        "(problem p (data d (table (y) (3) (4) (3))) (unknowns (a)) (observe d (= y a) :sigma unknown :resolution 1))"
    )
    found = mbm.loads(text).solve()
    assert np.isnan(found["a"].sigma) and np.isnan(found["d-sigma"].sigma)
    low, high = found["a"].interval()
    assert 2.0 < low < 3.0
    assert 3.5 < high < 5.0
    assert found["d-sigma"].interval()[0] == 0.0


def test_few_counts_have_the_interval_of_their_profile_alone_and_together() -> None:
    """2 (μ − n + n log(n/μ)) = 1.96², which is no ellipse up to 40 counts; two rows tell half of it each."""
    totals = np.array([6.0, 15.0, 30.0])
    rows = {"key": np.repeat(totals, 2), "k": np.stack([totals / 3, 2 * totals / 3], axis=1).ravel()}
    text = COUNTS.format(option="positive :init 3")
    together = mbm.loads(text.replace("(unknowns", "(for-each key) (unknowns")).solve(data={"d": rows})
    for total, solve in zip(totals, together.solves, strict=True):
        alone = mbm.loads(text).solve(data={"d": {"k": rows["k"][rows["key"] == total]}})

        def grown(mean: float, total: float = total) -> float:
            return float(2 * (mean - total + total * log(total / mean)) - norm.ppf(0.975) ** 2)

        ends = [brentq(grown, 1e-3, total) / 2, brentq(grown, total, 5 * total) / 2]
        assert alone["m"].interval_kind == solve["m"].interval_kind == "profile"
        assert alone["m"].interval() == pytest.approx(ends, rel=2e-3)  # ends are found to 1e-3 of their distance
        assert solve["m"].interval() == pytest.approx(alone["m"].interval(), rel=1e-6)


X = np.arange(8.0)
REGRESSION = """(problem p (data d external) {each} (unknowns (a :init 1) (b :init 0.2 {bound})) {limit}
    (observe d (= k (exp (+ a (* b x)))) :distribution poisson))"""


def counts() -> np.ndarray:
    """Twelve sets of counts (12, 8) that grow by a factor of exp(0.3)."""
    return np.random.default_rng(3).poisson(np.exp(1 + 0.3 * X), (12, 8)).astype(float)


def shortest(own: np.ndarray) -> tuple[float, float]:
    """Of b ≤ 0.31: given its sum, counts are multinomial, which is the profile of the likelihood over a."""
    grid = np.linspace(-0.3, 0.31, 20001)
    share = np.exp(grid[:, None] * X)
    logs = (np.log(share / share.sum(axis=1, keepdims=True)) * own).sum(axis=1)
    left = np.exp(logs - logs.max())
    order = np.argsort(-left, kind="stable")
    inside = order[: np.searchsorted(np.cumsum(left[order]), 0.95 * left.sum()) + 1]
    return float(grid[inside].min()), float(grid[inside].max())


def shortest_intercept(own: np.ndarray) -> tuple[float, float]:
    """The same of a, beside the best b ≤ 0.31 for each."""
    grid, slopes = np.linspace(-0.5, 2.5, 3001), np.linspace(-0.5, 0.31, 2001)
    # log L is own·(a + b x) − exp(a) Σ exp(b x)
    sums, tilt = np.exp(np.outer(slopes, X)).sum(axis=1), slopes * (own @ X)
    logs = np.array([own.sum() * a + (tilt - np.exp(a) * sums).max() for a in grid])
    left = np.exp(logs - logs.max())
    order = np.argsort(-left, kind="stable")
    inside = order[: np.searchsorted(np.cumsum(left[order]), 0.95 * left.sum()) + 1]
    return float(grid[inside].min()), float(grid[inside].max())


def test_beside_an_estimate_at_its_limit_the_others_reach_to_where_it_leaves_it() -> None:
    problem, held = mbm.loads(REGRESSION.format(each="", bound=":in (-5 0.31)", limit="")), 0
    for own in counts():
        found = problem.solve(data={"d": {"x": X, "k": own}})
        if found["b"].at_bound:
            held += 1
            # the grids have steps of 0.001 and 0.0004
            assert found["a"].interval() == pytest.approx(shortest_intercept(own), abs=5e-3)
    assert held > 2


@pytest.mark.parametrize(("bound", "limit"), [(":in (-5 0.31)", ""), ("", "(constraints (<= b 0.31))")])
def test_regressions_at_a_limit_alone_and_together(bound: str, limit: str) -> None:
    data = counts()
    many = mbm.loads(REGRESSION.format(each="(for-each key)", bound=bound, limit=limit)).solve(
        data={"d": {"key": np.repeat(np.arange(12), 8), "x": np.tile(X, 12), "k": data.ravel()}}
    )
    one = mbm.loads(REGRESSION.format(each="", bound=bound, limit=limit))
    kinds = set()
    for own, together in zip(data, many.solves, strict=True):
        alone = one.solve(data={"d": {"x": X, "k": own}})
        kinds.add(str(alone["b"].interval_kind))
        # the grid has steps of 3e-5, ends are found to some 1e-3 of the length
        assert alone["b"].interval() == pytest.approx(shortest(own), abs=2e-4)
        for name in ("a", "b"):
            # both descents end within 1e-6 deviations of the minimum
            assert together[name].interval() == pytest.approx(alone[name].interval(), abs=1e-6)
    assert "limited" in kinds


def test_a_background_at_its_limit_goes_as_far_as_its_profile() -> None:
    """Counts of a line on a background: the profile over the height, summed up over a grid of backgrounds."""
    shape, counted = np.array([0.0, 0.1, 1.0, 0.1, 0.0]), np.array([0.0, 1.0, 9.0, 2.0, 0.0])
    text = """(problem p (data d external) (unknowns (h :init 5) (b positive :init 1))
        (observe d (= k (+ b (* h s))) :distribution poisson))"""
    found = mbm.loads(text).solve(data={"d": {"s": shape, "k": counted}})["b"]

    def least(b: float) -> float:
        heights = np.linspace(2, 30, 4001)[:, None]
        mean = b + heights * shape + 1e-300
        return float((mean - counted * np.log(mean)).sum(axis=1).min())

    grid = np.linspace(1e-9, 4, 2001)
    left = np.exp(-np.array([least(b) for b in grid]))
    wanted = grid[np.searchsorted(np.cumsum(left), 0.95 * left.sum())]
    low, high = found.interval()
    assert low == 0.0
    # the grid has steps of 0.002
    assert high == pytest.approx(wanted, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "count"), [(0.3, 1), (1.0, 1), (0.3, 3), (0.3, 5), (1.0, 5)])
def test_intervals_of_rates_hold_them(rate: float, count: int) -> None:
    runs = 1000
    drawn = np.random.default_rng(8).poisson(rate, (runs, count)).astype(float)
    text = COUNTS.format(option="positive :init 1").replace("(unknowns", "(for-each key) (unknowns")
    found = mbm.loads(text).solve(data={"d": {"key": np.repeat(np.arange(runs), count), "k": drawn.ravel()}})
    ends = np.array([each["m"].interval() for each in found.solves])
    # counts have gaps: the coverage is between 92.5 % (1 − 3α/2) and 1, and 1000 runs are known to 1.5 %
    assert ((ends[:, 0] <= rate) & (rate <= ends[:, 1])).mean() > 0.93


def test_trials_that_a_place_tells_apart_have_no_estimate_and_break_nothing() -> None:
    """Complete separation (Albert and Anderson 1984): far out the likelihood overflows on the way."""
    x, y = np.linspace(-2, 2, 12), np.repeat([0.0, 1.0], [4, 8])
    result = mbm.loads(
        "(problem p (data d external) (unknowns (a) (b))"
        " (observe d (= y (/ 1 (+ 1 (exp (- (+ a (* b x))))))) :distribution (binomial 1)))"
    ).solve(data={"d": {"x": x, "y": y}})
    assert result.status == "attention"
    assert "NaN" not in result.to_json()


@pytest.mark.parametrize("bound", ["positive", ":in (0 100)"])
def test_a_signal_beside_a_background_without_counts(bound: str) -> None:
    """Two counts are s + b, none half of b. The others have to move along, for a mean below zero has no likelihood.

    Of b alone exp(-b/2) is left, as s makes the first count fit; of s the profile in closed form, summed up on a grid.
    """
    result = mbm.loads(
        f"(problem p (data d (table (k) (2))) (data e (table (k) (0))) (unknowns (s :init 1) (b {bound} :init 1))"
        " (observe d (= k (+ s b)) :distribution poisson) (observe e (= k (* 0.5 b)) :distribution poisson))"
    ).solve()
    assert result["b"].interval() == pytest.approx([0.0, -2.0 * log(0.05)], abs=NEAR * 6)
    s = np.linspace(-60.0, 60.0, 120_001)
    b = np.maximum(0.0, 4.0 / 3.0 - s)
    with np.errstate(all="ignore"):
        left = np.exp(-(s + b - 2.0 - 2.0 * np.log((s + b) / 2.0)) - 0.5 * b)
    left = np.where(np.isfinite(left), left, 0.0)
    order = np.argsort(-left, kind="stable")
    inside = s[order[: 1 + int(np.searchsorted(np.cumsum(left[order]), 0.95 * left.sum()))]]
    assert result["s"].interval() == pytest.approx([inside.min(), inside.max()], abs=NEAR * 6)


@pytest.mark.parametrize("successes", [0, 20])
def test_a_share_at_the_end_of_its_model_has_no_standard_deviation(successes: int) -> None:
    """Without bounds, too: the likelihood does not bend there, it ends."""
    text = TRIALS.format(n=20).replace("(p :in (0 1))", "(p :init 0.8)")
    found = mbm.loads(text).solve(data={"d": {"k": np.array([float(successes)])}})
    assert found["p"].value == pytest.approx(successes / 20, abs=1e-9)
    assert np.isnan(found["p"].sigma)
    assert "near-bound" in [each.code.name for each in found.diagnostics]


def test_the_last_of_many_rates_has_its_interval_too() -> None:
    counts = " ".join(f"({k} {n})" for k, n in enumerate([9, 7, 8, 6, 9, 5, 7, 8, 9, 6, 7, 5, 8, 0]))
    result = mbm.loads(
        f"(problem p (data d (table (k n) {counts}) :key k) (unknowns (m :per d positive :init 5))"
        " (observe d (= n (m k)) :distribution poisson))"
    ).solve()
    assert np.asarray(result["m"].interval())[-1] == pytest.approx([0.0, -log(0.05)], abs=NEAR * 3)


def test_what_is_derived_from_an_estimate_at_its_limit_says_so() -> None:
    result = mbm.loads(
        "(problem p (data d (table (k) (0) (0))) (data e (table (k) (4))) (unknowns (m positive :init 1) (b :init 1))"
        " (observe d (= k m) :distribution poisson) (observe e (= k b) :distribution poisson)"
        " (derive (twice (* 2 m)) (more (- b m)) (other (* 2 b))))"
    ).solve()
    said = [each.message for each in result.diagnostics if each.code.name == "near-bound"]
    assert len(said) == 1 and "the standard deviations of `more` suppose that it stays there" in said[0]
    assert np.isnan(result["twice"].sigma)
    assert result["twice"].interval() == pytest.approx([0.0, -log(0.05)], rel=NEAR)  # twice the end of two readings


@pytest.mark.parametrize("trials", [12, 13, 14])
def test_no_success_where_the_limit_itself_is_hardly_probable(trials: int) -> None:
    """At p = 0.2, the limit, no success in 13 trials has a probability of 5.5 %: the shortest 95 % reach farther.

    Those of (1 − p)ⁿ from 0.2 on end where (1 − p)ⁿ⁺¹ is 5 % of what it is at 0.2.
    """
    text = TRIALS.format(n=trials).replace("(p :in (0 1))", "(p :in (0.2 1))")
    assert ":in (0.2 1)" in text
    end = 1.0 - 0.8 * 0.05 ** (1 / (trials + 1))
    found = mbm.loads(text).solve(data={"d": {"k": np.array([0.0])}})["p"].interval()
    assert found == pytest.approx([0.2, end], rel=NEAR)


@pytest.mark.parametrize("sigma", [0.3, 1 / np.sqrt(2 * np.pi), 1.0])
def test_data_that_speak_of_something_else_change_nothing(sigma: float) -> None:
    """A family of two, one below the limit of detection and one measured, and an unknown of other data beside them."""
    text = f"""(problem p (data d (table (k c low) ("u" 1 1) ("v" 3 0) ("v" 3.2 0)))
      (unknowns (a :per d.k :in (0 10)) (b))
      (observe d (= c (a k)) :sigma 0.5 :below (= low 1)) (observe (= 3 b) :sigma {sigma}))"""
    result = mbm.loads(text).solve()
    assert result["a"]["u"].interval() == pytest.approx([0.0, 1.0 - 0.5 * norm.ppf(0.05)], rel=NEAR)


@pytest.mark.parametrize("errors", [":distribution poisson", ":sigma 0.5 :below (> x 5)"])
def test_what_a_combination_leaves_free_has_no_interval(errors: str) -> None:
    """Of two intercepts the data tell the sum, whose interval is that of one; their own were where roundings grow."""
    text = """(problem p (data d (table (x n) (1 1) (2 2) (3 2) (4 5) (5 4) (6 8)))
      (unknowns (a :init 1) (b :init 0.1){more})
      (observe d (= n (+ {sum} (* a x))) {errors}) (derive (w {sum}) (v (- {sum} (* 2 b)))))"""
    one = mbm.loads(text.format(more="", sum="b", errors=errors)).solve()
    two = mbm.loads(text.format(more=" (c :init 0.3)", sum="(+ b c)", errors=errors)).solve()
    for name in ("b", "c", "v"):
        assert np.isnan(two[name].interval()).all()
    for name in ("a", "w"):
        assert two[name].interval() == pytest.approx(one[name].interval(), rel=NEAR, abs=NEAR)


def test_many_estimates_at_limits_have_their_intervals() -> None:
    """Each by itself: N(-0.1, 0.2) above 0, up to 95 % of what is left of it."""
    rows = " ".join(f"({k} {-0.1 if k % 2 else 3.0})" for k in range(80))
    text = f"""(problem p (data d (table (k y) {rows})) (unknowns (a :per d.k :in (0 100)))
      (observe d (= y (a k)) :sigma 0.2) (derive (twice (* 2 (a 1)))))"""
    result = mbm.loads(text).solve()
    left = norm.sf(0.5)
    end = -0.1 + 0.2 * norm.isf(0.05 * left)
    assert result["a"][1].interval() == pytest.approx([0.0, end], rel=1e-6)
    assert result["twice"].interval() == pytest.approx([0.0, 2 * end], rel=1e-6)


@pytest.mark.parametrize("each", ["", "(for-each k)"])
def test_near_a_limit_what_is_derived_of_counts_keeps_to_it(each: str) -> None:
    """A signal beside a background, both not below 0: sums of the profile over a grid, and where it has fallen."""
    text = f"""(problem p (data d external) (unknowns (s :in (0 100)) (b :in (0 100))) {each}
        (observe d (= n (+ s (/ b 3))) :distribution poisson) (observe d (= m b) :distribution poisson)
        (derive (rate (/ s 10)) (root (sqrt (+ s 1))) (net (- s (* 0.5 b))) (ratio (/ s b))))"""
    found = mbm.loads(text).solve(data={"d": {"n": np.array([5.0]), "m": np.array([9.0]), "k": np.zeros(1)}}).solves[0]
    assert np.isfinite(found["s"].sigma)
    low, high = found["s"].interval()
    assert low == 0.0
    assert found["rate"].interval() == pytest.approx([0.0, high / 10], rel=1e-9, abs=1e-9)
    assert found["root"].interval() == pytest.approx([1.0, np.sqrt(high + 1)], rel=1e-9)

    background = np.linspace(0.01, 40.0, 4001)

    def surprise(signal: np.ndarray) -> float:
        """At its least over the backgrounds for which the signal is not below 0."""
        mean = signal + background / 3
        with np.errstate(invalid="ignore", divide="ignore"):
            both = mean - 5.0 * np.log(mean) + background - 9.0 * np.log(background)
        return float(np.where(signal >= 0.0, both, np.inf).min())

    grid = np.linspace(-19.0, 14.0, 3301)
    net = np.array([surprise(each + 0.5 * background) for each in grid])
    left = np.exp(net.min() - net)
    order = np.argsort(-left, kind="stable")
    inside = grid[order[: int(np.searchsorted(np.cumsum(left[order]), 0.95 * left.sum())) + 1]]
    # grids have steps of 0.01
    assert found["net"].interval() == pytest.approx([inside.min(), inside.max()], abs=0.06)
    least = net.min()
    end = brentq(lambda ratio: surprise(ratio * background) - least - 0.5 * norm.ppf(0.975) ** 2, 0.3, 5.0)
    assert found["ratio"].interval() == pytest.approx([0.0, end], rel=NEAR, abs=1e-4)
