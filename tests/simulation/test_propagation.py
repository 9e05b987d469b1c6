"""Propagation of distributions through fits, against closed forms and against trials by SciPy and NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import norm, t

import mbm
from mbm.equations.interruption import Interruption
from mbm.report.options import PropagationSettings

TRIALS = 40_000
X = np.arange(10.0)
Y = np.array([1.02, 3.1, 4.9, 7.0, 9.1, 10.9, 13.2, 14.9, 17.05, 19.0])
ROWS = " ".join(f"({x} {y})" for x, y in zip(X, Y, strict=True))
LINE = "(problem line (data d (table (x y) {rows})) (unknowns (a) (b)) (observe d (= y (+ a (* b x))){sigma}){more})"
TRUE = np.linalg.inv(np.vander(X, 2, increasing=True).T @ np.vander(X, 2, increasing=True))


def propagated(text: str, trials: int | str = TRIALS, **more: Any) -> Any:
    return mbm.loads(text).propagate(trials, seed=5, **more)


def line(sigma: str = " :sigma 0.1", more: str = "") -> str:
    return LINE.format(rows=ROWS, sigma=sigma, more=more)


def assert_interval(found: Any, ends: Any, density: float, trials: int = TRIALS) -> None:
    """The ends of a 95 % interval, to four standard deviations of such order statistics."""
    np.testing.assert_allclose(found.interval, ends, atol=4.0 * np.sqrt(0.025 * 0.975 / trials) / density)


def test_estimates_of_a_line_are_normal() -> None:
    made = propagated(line())
    for name, k in (("a", 0), ("b", 1)):
        found, sigma = made[name], 0.1 * np.sqrt(TRUE[k, k])
        value = float(made.result.solves[0].estimates[k].value)
        assert float(found.mean) == pytest.approx(value, abs=4 * sigma / np.sqrt(TRIALS))
        assert float(found.sigma) == pytest.approx(sigma, rel=4 / np.sqrt(2 * TRIALS))
        assert_interval(found, value + sigma * norm.ppf([0.025, 0.975]), norm.pdf(1.96) / sigma)
        assert found.validated
    joint = np.corrcoef(made["a"].samples, made["b"].samples)[0, 1]
    assert joint == pytest.approx(TRUE[0, 1] / np.sqrt(TRUE[0, 0] * TRUE[1, 1]), abs=0.02)


def test_unknown_noise_makes_t_distributions() -> None:
    made = propagated(line(sigma=""))
    design = np.vander(X, 2, increasing=True)
    estimates, cost = np.linalg.lstsq(design, Y, rcond=None)[:2]
    for name, k in (("a", 0), ("b", 1)):
        sigma = float(np.sqrt(cost[0] / 8 * TRUE[k, k]))
        ends = estimates[k] + sigma * t.ppf([0.025, 0.975], 8)
        assert_interval(made[name], ends, t.pdf(t.ppf(0.975, 8), 8) / sigma)
        assert float(made[name].sigma) == pytest.approx(sigma * np.sqrt(8 / 6), rel=0.02)
        assert made[name].validated


def test_a_vague_prior_gives_an_unknown_noise_no_degrees_of_freedom() -> None:
    found = propagated(line(sigma="", more=" (constraints (normal b 0 1e6))"))["b"]
    design = np.vander(X, 2, increasing=True)
    estimates, cost = np.linalg.lstsq(design, Y, rcond=None)[:2]
    sigma = float(np.sqrt(cost[0] / 8 * TRUE[1, 1]))
    ends = estimates[1] + sigma * t.ppf([0.025, 0.975], 8)  # 8 = 10 rows - 2
    assert_interval(found, ends, t.pdf(t.ppf(0.975, 8), 8) / sigma)


def test_two_readings_leave_a_distribution_without_a_standard_deviation() -> None:
    made = propagated("(problem p (data d (table (y) (1) (3))) (unknowns (m)) (observe d (= y m)))")
    found = made["m"]
    ends = 2.0 + t.ppf([0.025, 0.975], 1)  # s/√2 = 1
    assert_interval(found, ends, t.pdf(t.ppf(0.975, 1), 1))
    assert float(found.median) == pytest.approx(2.0, abs=0.05)
    assert np.isnan(found.mean)
    assert np.isnan(found.sigma)
    assert found.validated is None
    written = made.document()["solves"][0]["propagation"]["m"]
    assert (written["mean"], written["sigma"], written["validated"]) == (None, None, None)
    assert written["reason"] == "an input has no variance"


def test_a_rectangular_prior_beside_a_reading() -> None:
    """With weights 1/2 each the estimate is half of a rectangular variate and half of a normal one."""
    u = 1.0 / np.sqrt(3.0)
    text = (
        "(problem p (data d (table (y) (0.2))) (unknowns (x :prior (rectangular -1 1)))"
        f" (observe d (= y x) :sigma {u}))"
    )
    found = propagated(text)["x"]
    grid = np.linspace(-4.0, 4.0, 8001)
    cells = np.linspace(-0.5, 0.5, 2001)
    cumulative = norm.cdf((grid[:, None] - cells[None, ::10]) / (u / 2)).mean(axis=1)
    ends = 0.1 + np.interp([0.025, 0.975], cumulative, grid)
    assert_interval(found, ends, 0.1 / u)
    assert float(found.sigma) == pytest.approx(u / np.sqrt(2.0), rel=0.02)


def test_a_lopsided_prior_keeps_its_side() -> None:
    """Alone, a prior decides: the estimate is its centre, drawn from it."""
    found = propagated("(problem p (unknowns (x :prior (lognormal 5 2))) (derive (y (log x))))")
    assert float(found["x"].median) == pytest.approx(5.0, rel=4 * 1.25 * np.log(2) / np.sqrt(TRIALS))
    assert_interval(found["y"], np.log(5) + np.log(2) * norm.ppf([0.025, 0.975]), norm.pdf(1.96) / np.log(2))


def test_constants_in_a_fit_and_in_what_is_derived() -> None:
    """y = a x + c with c uncertain: a is normal, and what is derived from a and c together too."""
    text = (
        "(problem p (data d (table (x y) (1 3.1) (2 5.0) (3 7.2))) (constants (c 1 :sigma 0.2) (e (* 2 c)))"
        " (unknowns (a)) (observe d (= y (+ (* a x) c)) :sigma 0.1) (derive (q (+ a e))))"
    )
    made = propagated(text)
    x = np.array([1.0, 2.0, 3.0])
    gain = -x.sum() / (x @ x)
    own = 0.1 / np.sqrt(x @ x)
    assert float(made["a"].sigma) == pytest.approx(np.hypot(own, 0.2 * gain), rel=0.02)
    assert float(made["q"].sigma) == pytest.approx(np.hypot(own, 0.2 * (gain + 2.0)), rel=0.02)
    linear = made.result.solves[0]
    assert float(made["q"].sigma) == pytest.approx(float(linear.derived[0].sigma), rel=0.02)
    assert made["q"].validated


@pytest.mark.parametrize("dof", [1, 5])
def test_constants_with_degrees_of_freedom_follow_t_distributions(dof: int) -> None:
    made = propagated(f"(problem p (constants (a 3 :sigma 0.5 :dof {dof})) (derive (y (* 2 a))))")
    end = t.ppf(0.975, dof)
    assert_interval(made["y"], [6.0 - end, 6.0 + end], t.pdf(end, dof))
    assert made["y"].validated is (True if dof > 2 else None)


def test_inputs_without_a_variance_are_for_propagation_only() -> None:
    text = "(problem p (constants (a 1 :prior (student 1 0.1 1))) (derive (y (* 2 a))))"
    with pytest.raises(mbm.MbmError, match="has no variance"):
        mbm.loads(text).solve()
    assert [each.code.name for each in mbm.loads(text).check()] == ["bad-form"]
    made = propagated(text)
    end = 0.2 * t.ppf(0.975, 1)
    assert_interval(made["y"], [2.0 - end, 2.0 + end], t.pdf(end / 0.2, 1) / 0.2)
    written = made.document()["solves"][0]
    assert written["derived"]["y"]["sigma"] is None
    assert written["derived"]["y"]["reason"] == "`a` has no variance"
    assert written["propagation"]["y"]["validated"] is None
    with pytest.raises(mbm.MbmError, match="has no variance"):  # what was propagated is not what is solved
        mbm.loads(text).solve()


def test_a_prior_without_a_variance_decides_alone() -> None:
    found = propagated("(problem p (unknowns (x :prior (student 1 0.1 2))))")["x"]
    end = 0.1 * t.ppf(0.975, 2)
    assert_interval(found, [1.0 - end, 1.0 + end], t.pdf(end / 0.1, 2) / 0.1)


def test_ranges_beside_trials_by_scipy() -> None:
    """A station nearly in line with its anchors: curved, so that mean and interval differ from the linear ones."""
    anchors = np.array([[0.0, 0.0], [4.0, 0.1], [8.0, 0.0], [2.0, -0.1]])
    errors = np.array([0.01, -0.02, 0.01, 0.02])
    ranges = np.linalg.norm(np.array([3.0, 0.4]) - anchors, axis=1) + errors
    rows = " ".join(f"({x} {y} {r})" for (x, y), r in zip(anchors, ranges, strict=True))
    text = (
        f"(problem p (data d (table (x y r) {rows})) (unknowns (p (vector 2) :init [3 0.4]))"
        " (observe d (= r (distance p [x y])) :sigma 0.1))"
    )
    made = propagated(text, 20_000)
    rng = np.random.default_rng(0)
    begin = made.result.solves[0].estimates[0].value

    def fitted(measured: np.ndarray) -> np.ndarray:
        return np.asarray(least_squares(lambda p: np.linalg.norm(p - anchors, axis=1) - measured, begin).x)

    other = np.array([fitted(ranges + 0.1 * rng.standard_normal(4)) for _ in range(500)])
    found = made["p"]
    error = other.std(axis=0) / np.sqrt(len(other))
    assert (np.abs(found.mean - other.mean(axis=0)) < 5 * error).all()
    np.testing.assert_allclose(found.sigma, other.std(axis=0), rtol=0.2)  # a standard deviation of 500 trials: 3 %
    assert not found.validated


def test_angles_and_poses_vary_about_the_estimate() -> None:
    text = (
        "(problem p (data d (table (a) (170) (-175) (179))) (unknowns (h angle :init 180deg))"
        " (observe d (= (angle (* 1deg a)) h) :sigma 4deg) (derive (g (pose2 1 2 h))))"
    )
    made = propagated(text)
    sigma = np.deg2rad(4.0) / np.sqrt(3.0)
    assert float(made["h"].sigma) == pytest.approx(sigma, rel=0.02)
    assert float(made["h"].mean) == pytest.approx(np.deg2rad(178.0), abs=5 * sigma / np.sqrt(TRIALS))
    assert made["h"].interval[1] > np.pi  # beyond the cut, not at the other end of the circle
    np.testing.assert_allclose(made["g"].sigma, [sigma, 0.0, 0.0], rtol=0.02)


def test_limits_cut_the_distribution() -> None:
    text = "(problem p (data d (table (y) (0.05))) (unknowns (a :in (0 1) :init 0.1)) (observe d (= y a) :sigma 0.1))"
    found = propagated(text)["a"]
    assert_interval(found, [0.0, 0.05 + 0.1 * norm.ppf(0.975)], norm.pdf(1.96) / 0.1)


def test_equations_between_estimates_hold_in_every_trial() -> None:
    text = (
        "(problem p (data d (table (a b) (1.1 2.2))) (unknowns (a1) (b1)) (observe d (= a a1) (= b b1) :sigma 0.1)"
        " (constraints (= (+ a1 b1) 3)))"
    )
    made = propagated(text)
    np.testing.assert_allclose(made["a1"].samples + made["b1"].samples, 3.0, atol=1e-9)
    assert float(made["a1"].sigma) == pytest.approx(0.1 / np.sqrt(2.0), rel=0.02)


def test_covariances_and_families() -> None:
    text = (
        '(problem p (data s (table (name) ("a") ("b")) :key name)'
        ' (data d (table (name u v) ("a" 1 2) ("b" 3 4))) (unknowns (w (vector 2) :per s))'
        " (observe d (= [u v] (w name)) :covariance [[0.04 0.03] [0.03 0.09]]))"
    )
    found = propagated(text)["w"]
    assert found.interval.shape == (2, 2, 2)
    np.testing.assert_allclose(found.sigma, [[0.2, 0.3], [0.2, 0.3]], rtol=0.02)
    assert np.corrcoef(found.samples[:, 1, 0], found.samples[:, 1, 1])[0, 1] == pytest.approx(0.5, abs=0.02)
    assert np.corrcoef(found.samples[:, 0, 0], found.samples[:, 1, 1])[0, 1] == pytest.approx(0.0, abs=0.02)


def test_keys_have_trials_of_their_own() -> None:
    text = (
        "(problem p (data d (table (k y) (1 1.0) (1 1.2) (2 5.0) (2 5.4))) (constants (c 0 :sigma 0.3))"
        " (unknowns (m)) (observe d (= y (+ m c)) :sigma 0.1) (for-each k))"
    )
    made = propagated(text, 10_000)
    assert [float(each["m"].median) for each in made.solves] == pytest.approx([1.1, 5.2], abs=0.02)
    samples = made.samples()
    assert sorted(samples) == ["k", "m"]
    assert samples["k"].tolist() == [1.0] * 10_000 + [2.0] * 10_000
    with pytest.raises(LookupError, match="there are 2 solves"):
        _ = made["m"]


def test_many_unknowns_go_the_general_way() -> None:
    rows = " ".join(f"({k} {k * 0.1})" for k in range(1, 91))
    text = f"(problem p (data s (table (k y) {rows}) :key k) (unknowns (v :per s)) (observe s (= y (v k)) :sigma 0.1))"
    found = propagated(text, 60)["v"]
    assert found.samples.shape == (60, 90)
    assert float(np.mean(found.sigma)) == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize("text", [line(), "(problem p (constants (a 1 :sigma 1)) (derive (y (* a a))))"])
def test_the_number_of_threads_changes_nothing(text: str) -> None:
    some, others = (propagated(text, 12_000, workers=workers) for workers in (1, 3))
    for name in some:
        np.testing.assert_array_equal(some[name].samples, others[name].samples)
    assert not np.array_equal(mbm.loads(text).propagate(12_000, seed=6)["y" if "y" in some else "a"].samples, 0)


def test_the_seed_decides_and_that_of_the_solve_is_the_default() -> None:
    text = "(problem p (constants (a 1 :sigma 1)) (derive (y (* a a))) (solve :seed 9))"
    problem = mbm.loads(text)
    own, same, other = (problem.propagate(100, **seed)["y"].samples for seed in ({}, {"seed": 9}, {"seed": 10}))
    np.testing.assert_array_equal(own, same)
    assert not np.array_equal(own, other)
    np.testing.assert_array_equal(problem.solve().propagate(100)["y"].samples, own)


def test_adaptive_trials_settle_to_two_digits() -> None:
    made = propagated("(problem p (constants (a 0 :sigma 1)) (derive (y (+ a 1))))", "auto")
    assert made.only.sampled.settled
    assert made.trials % 10_000 == 0
    assert made.trials <= 200_000  # δ = 0.05; an end scatters by 2.7/√N
    np.testing.assert_allclose(made["y"].interval, 1.0 + norm.ppf([0.025, 0.975]), atol=0.05)
    assert made["y"].validated


def test_what_does_not_settle_ends_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mbm.simulation.trials.run.MOST_ADAPTIVE", 20_000)
    made = propagated("(problem p (constants (a 0.5 :sigma 1)) (derive (y (/ 1 a))))", "auto")  # it has no mean
    assert made.trials == 20_000
    assert made.only.sampled.settled is False
    assert [each.code.name for each in made.diagnostics] == ["not-settled"]
    assert made.document()["solves"][0]["propagation"]["settled"] is False


def test_an_interruption_ends_the_trials() -> None:
    interruption = Interruption()
    done: list[int] = []

    def progress(count: int, total: int) -> None:
        assert count <= total
        done.append(count)
        interruption.request()

    settings = PropagationSettings(trials=50_000, progress=progress, interruption=interruption)
    made = mbm.loads("(problem p (constants (a 0 :sigma 1)) (derive (y (+ 1 a))))").solve().propagated(settings)
    assert done == [made.trials] == [10_000]
    assert "interrupted after 10,000 trials" in made.diagnostics[0].message


def test_trials_that_do_not_converge_are_counted() -> None:
    """Where c is not above 0 the equation has no value."""
    made = propagated("(problem p (constants (c 1 :sigma 1)) (unknowns (a)) (observe (= 0 (+ a (log c))) :sigma 0.1))")
    failed = norm.cdf(-1.0)
    assert made.only.sampled.failed / TRIALS == pytest.approx(failed, abs=4 * np.sqrt(failed / TRIALS))
    assert [each.code.name for each in made.diagnostics] == ["failed-trials"]
    assert made.document()["solves"][0]["propagation"]["failed"] == made.only.sampled.failed


def test_a_quantity_without_a_value_in_some_trials_leaves_the_others_whole() -> None:
    """a is normal, and √(a − 1) is there for the upper half of it: a − 1 is then half-normal."""
    made = propagated(
        "(problem p (constants (a 1 :sigma 1)) (derive (y (sqrt (- a 1))) (z (+ a 1)) (w (log (- a 9)))))"
    )
    assert made.only.sampled.failed == 0
    assert not made.diagnostics
    chance = 4.0 / np.sqrt(TRIALS)
    assert float(made["z"].mean) == pytest.approx(2.0, abs=chance)
    assert float(made["z"].sigma) == pytest.approx(1.0, abs=chance)
    assert made["z"].undefined == 0
    assert made["y"].undefined / TRIALS == pytest.approx(0.5, abs=chance)
    assert float(np.nanmean(made["y"].samples ** 2)) == pytest.approx(np.sqrt(2.0 / np.pi), abs=2.0 * chance)
    assert float(made["y"].mean) == pytest.approx(0.8222, abs=2.0 * chance)  # Γ(3/4) 2^¼/√π
    written = made.document()["solves"][0]["propagation"]
    assert written["y"]["undefined"] == made["y"].undefined
    assert written["y"]["validated"] is None
    assert "undefined" not in written["z"]
    assert (written["w"]["mean"], written["w"]["reason"]) == (None, "the value is not finite")
    text = made.table()
    assert f"no value in {int(made['y'].undefined):,} trials" in text
    assert "the value is not finite" in text


def test_only_what_depends_on_an_input_without_variance_has_none() -> None:
    more = "(c 3 :prior (student 3 0.1 1.5)) (d 2 :sigma 0.1)"
    made = propagated(f"(problem p (constants {more}) (derive (heavy (* c d)) (light (* 2 d))))")
    assert np.isnan(made["heavy"].sigma)
    assert float(made["light"].sigma) == pytest.approx(0.2, abs=0.2 * 4 / np.sqrt(2 * TRIALS))
    assert made["heavy"].validated is None
    assert made.document()["solves"][0]["propagation"]["heavy"]["reason"] == "an input has no variance"


REFUSED = {
    "`:robust` of `line` cannot be propagated": line(more=" (solve :robust lmeds)"),
    "the loss of `d` cannot be propagated": line(sigma=" :sigma 0.1 :loss (huber 1.5)"),
    "no distribution": line(sigma=" :bound 1", more=" (solve :method (interval))"),
    "`:sigma` must be known": line(sigma=" :sigma s", more=" (constants (s 0.1 :sigma 0.01))"),
    "no degrees of freedom": "(problem p (data d (table (y) (1))) (unknowns (m)) (observe d (= y m)))",
    "no input of this problem": "(problem p (constants (a 1)) (derive (y (* a a))))",
    "free": line(more=" (unknowns (z)) (constraints (normal (+ z a) 1 1) (normal (+ z a) 2 1))").replace(
        "(+ a (* b x))", "(* b x)"
    ),
    "`:correlation` of `d` cannot be propagated": line(sigma=" :correlation (ar1 unknown)"),
    "`:common` of `d` cannot be propagated": line(sigma=" :sigma unknown :common ((0.1 :per x))"),
    "`:distribution poisson` of `d` cannot be propagated": (
        "(problem p (data d (table (n) (3) (5))) (unknowns (b)) (observe d (= n b) :distribution poisson))"
    ),
    "`model` in the noise of `d` cannot be propagated": line(sigma=" :sigma (* 5% model)"),
    "it is a matrix": "(problem p (constants (m [[1 2] [3 4]] :sigma 1)) (derive (y (m 1 2))))",
    "computed from another": "(problem p (constants (a 1 :sigma 1) (b (* 2 a) :sigma 1)) (derive (y (* a b))))",
    "no coordinates": (
        "(problem p (data d (table (x) (1))) (unknowns (n direction)) (observe d (= [0 0 x] n) :sigma 1))"
    ),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_cannot_be_propagated_says_why(why: str) -> None:
    with pytest.raises(mbm.MbmError, match=r"not-propagated|nothing-drawn") as caught:
        propagated(REFUSED[why])
    assert why in str(caught.value)


@pytest.mark.parametrize("given", [{"trials": 1}, {"trials": "many"}, {"trials": True}, {"workers": 0}, {"seed": -1}])
def test_arguments_that_are_none(given: dict[str, Any]) -> None:
    solved = mbm.loads(line()).solve()
    with pytest.raises(mbm.MbmError, match="wrong-argument"):
        solved.propagate(**given)


def test_too_many_trials_are_refused_before_any_is_made() -> None:
    with pytest.raises(mbm.MbmError, match="too-many-trials"):
        propagated(line(), 10**9)


def test_few_trials_do_not_tell_whether_an_interval_beside_a_limit_agrees() -> None:
    rows = "(0 0.5) (1 0.4) (2 0.7) (3 0.45)"
    text = LINE.format(rows=rows, sigma="", more=" (constraints (>= b 0.5))")
    few, many = propagated(text, 500), propagated(text, 20_000)
    assert few["b"].validated is None
    assert "too few trials to tell" in str(few)
    assert few.document()["solves"][0]["propagation"]["b"]["reason"] == "too few trials to tell"
    assert many["b"].validated is False
    assert propagated(line(), 500)["b"].validated
