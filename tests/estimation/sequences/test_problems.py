"""Problems with states by filters and smoothers, from their text to their document."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import mbm

METHODS = ("ekf", "iterated-ekf", "truncated-ekf", "smoother", "(smoother :lag 3)")
STEPS = 12


def walk(method, more="", rest="", options="", observe="(= y (+ x b)) :sigma s", dynamics=None):
    """A place with a velocity, and an offset that stays; two rows at every fifth step, none at the third."""
    generator = np.random.default_rng(1)
    rows = [k for k in range(STEPS) for _ in range(2 if k % 5 == 0 else 1) if k != 3]
    cells = " ".join(f"({k} {np.sin(0.3 * k) + 0.3 + 0.2 * generator.standard_normal():.6f} 0.2)" for k in rows)
    every = " ".join(f"({k})" for k in range(STEPS))
    dynamics = dynamics or "(constant-velocity x :acceleration 0.3 :velocity 0.1 :velocity-sigma 1)"
    return f"""
(problem walk
  (data z (table (k y s) {cells}))
  (data frames (table (k) {every}))
  (unknowns (b :init 0.3 :sigma 0.7) {more})
  (states :over k (x :init -0.2 :sigma 1.4 {options}))
  (dynamics {dynamics})
  (observe z {observe})
  {rest}
  (solve :method {method}))"""


class Found:
    """The one solve of a text: estimates by name, and what the solve says."""

    def __init__(self, text):
        self._result = mbm.loads(text).solve()

    def __getitem__(self, name):
        return self._result[name]

    def __getattr__(self, name):
        return getattr(self._result.solves[0], name)


def solved(method, **given):
    """The one solve."""
    return Found(walk(method, **given))


def known(rows_up_to=STEPS - 1):
    """Dense least squares over the offset, the first state and the accelerations, with the rows up to a step."""
    cells = re.findall(r"\((\d+) (-?[\d.]+) 0\.2\)", walk("batch"))
    size = 3 + STEPS - 1
    step = np.zeros((2, size))
    step[0, 1], step[1, 2] = 1.4, 1.0
    at = [step]
    for k in range(STEPS - 1):
        step = np.array([[1.0, 1.0], [0.0, 1.0]]) @ at[-1]
        step[:, 3 + k] += np.array([0.15, 0.3])
        at.append(step)
    means = np.array([-0.2 + 0.1 * k for k in range(STEPS)])
    offset = np.zeros(size)
    offset[0] = 0.7
    used = [(int(k), float(y)) for k, y in cells if int(k) <= rows_up_to]
    A = np.vstack([np.eye(size), *((at[k][0] + offset) / 0.2 for k, _ in used)])
    b = np.concatenate([np.zeros(size), [(y - means[k] - 0.3) / 0.2 for k, y in used]])
    theta = np.linalg.lstsq(A, b, rcond=None)[0]
    spread = np.linalg.inv(A.T @ A)
    x = np.array([m + s[0] @ theta for m, s in zip(means, at, strict=True)])
    sigma = np.array([np.sqrt(s[0] @ spread @ s[0]) for s in at])
    both = np.array([np.sqrt((2 * s[0] + offset) @ spread @ (2 * s[0] + offset)) for s in at])
    return (
        x,
        sigma,
        (0.3 + offset @ theta, np.sqrt(offset @ spread @ offset)),
        both,
        float(np.sum((A @ theta - b) ** 2)),
    )


@pytest.mark.parametrize("method", METHODS)
def test_each_step_is_given_the_rows_that_its_method_says(method):
    derive = "(derive (d (+ b (* 2 x))))"
    found = solved(method, rest=derive)
    lag = {"smoother": STEPS, "(smoother :lag 3)": 3}.get(method, 0)
    assert found.status == "converged"
    for k in range(STEPS):
        x, sigma, now, both, _ = known(k + lag)
        assert found["x"].value[k] == pytest.approx(x[k], abs=1e-10)
        assert found["x"].sigma[k] == pytest.approx(sigma[k], rel=1e-10)
        assert found["d"].value[k] == pytest.approx(now[0] + 2 * x[k], abs=1e-10)
        assert found["d"].sigma[k] == pytest.approx(both[k], rel=1e-10)
    _, _, offset, _, cost = known()
    assert (found["b"].value, found["b"].sigma) == pytest.approx(offset, rel=1e-10)
    assert found.cost == pytest.approx(cost, rel=1e-10)
    # 14 rows, and everything has a prior
    assert found.dof == 14


@pytest.mark.parametrize("method", METHODS)
def test_a_step_without_rows_is_a_prediction(method):
    found = solved(method)
    assert found["x"].sigma[3] > 0
    if method == "ekf":
        assert found["x"].value[3] == pytest.approx(found["x"].value[2] + found["x.rate"].value[2], abs=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_what_has_no_prior_is_determined_by_rows_and_costs_degrees_of_freedom(method):
    text = walk(method, dynamics="(constant-velocity x :acceleration 0.3)", options="").replace(":sigma 1.4", "")
    found = Found(text)
    assert found.status == "converged"
    assert found.dof == 14 - 2
    first = found["x"].sigma[0], found["x.rate"].sigma[0]
    if method in ("ekf", "iterated-ekf", "truncated-ekf"):
        assert np.isfinite(first[0])
        assert np.isnan(first[1])
    else:
        assert np.isfinite(first).all()


def test_what_no_row_determines_is_said():
    found = solved("ekf", more="(c :init 0)", observe="(= y (+ x b (* 0 c))) :sigma s")
    assert found.status == "unobservable"
    assert np.isnan(found["c"].sigma)
    assert np.isfinite(found["x"].sigma).all()


@pytest.mark.parametrize("method", METHODS)
def test_the_document_says_over_which_steps(method):
    document = json.loads(mbm.loads(walk(method)).solve().to_json())
    (solve,) = document["solves"]
    x = solve["estimates"]["x"]
    assert x["keys"] == list(range(STEPS))
    assert "over" in x
    assert solve["method"].startswith(method.strip("()").split()[0])


def test_inequalities_are_cut_by_the_truncated_filter_and_reported_by_the_others():
    limit = "(constraints (<= x 0.4 :name top))"
    cut, plain = solved("truncated-ekf", rest=limit), solved("ekf", rest=limit)
    assert cut.status == "converged"
    assert (cut["x"].value <= 0.4).all()
    assert plain.status == "infeasible"
    assert max(plain["x"].value) > 0.4
    np.testing.assert_allclose(plain["x"].value, solved("ekf")["x"].value, rtol=0, atol=1e-14)


def test_constraints_on_plain_unknowns_are_cut_once():
    """N(0.3, 0.7²) of an offset without rows of its own, cut at 0.3, after the first step with rows."""
    given = {"more": "(c :init 0 :sigma 1)", "rest": "(constraints (<= c 0))"}
    found = solved("truncated-ekf", **given)
    assert found["c"].value == pytest.approx(-np.sqrt(2 / np.pi), abs=1e-12)
    assert found["c"].sigma == pytest.approx(np.sqrt(1 - 2 / np.pi), abs=1e-12)


def test_a_static_state_is_cut_at_every_step():
    text = walk("truncated-ekf", rest="(constraints (<= c 0))")
    text = text.replace("(states :over k", "(states :over k (c :init 0 :sigma 1)").replace(
        "(dynamics ", "(dynamics (static c) "
    )
    found = Found(text)
    # the reference's README: −1.029 ± 0.380 after ten cuts
    assert found["c"].value[-1] < -1.029
    assert found["c"].sigma[-1] < 0.380


def test_an_equality_holds_in_filters():
    found = solved("ekf", more="(c :init 0 :sigma 1)", rest="(constraints (= (+ b c) 1))")
    assert found["b"].value + found["c"].value == pytest.approx(1.0, abs=1e-12)
    assert found["b"].sigma == pytest.approx(found["c"].sigma, rel=1e-10)


STEADY = """(problem steady
  (data d (table (t y) (0 0.1) (1 0.9) (2.5 2.2) (4 4.5) (7 6.8)))
  (states :over t (x :init 0 :sigma 2) (z :init 1 :sigma 1))
  (dynamics (constant-velocity x :acceleration 0.5 :velocity 0 :velocity-sigma 1) (static z))
  (observe d (= y (+ x z)) :sigma 0.2)
  (constraints {constraint})
  (solve :method {method}))"""


@pytest.mark.parametrize(
    "constraint", ["(= x 0.5 :at first)", "(= (rate x) 1)", "(= z 0)", "(= (+ x z) (* 2 z) :at first)"]
)
def test_an_equality_adds_its_innovation_to_the_cost_of_a_filter(constraint):
    """For linear problems Σ vᵀS⁻¹v is the least weighted sum; an equation met to rounding is met."""
    filtered = mbm.loads(STEADY.format(constraint=constraint, method="ekf")).solve()
    batch = mbm.loads(STEADY.format(constraint=constraint, method="batch")).solve()
    assert filtered.status == "ok"
    assert filtered.cost == pytest.approx(batch.cost, rel=1e-6)  # batch has the noise-free part by a small variance


def test_a_loss_holds_an_outlier_down():
    wrong = walk("iterated-ekf", observe="(= y (+ x b)) :sigma s :loss (huber 1.5)").replace("(11 ", "(11 9", 1)
    found = Found(wrong)
    plain = Found(wrong.replace(":loss (huber 1.5)", ""))
    right = solved("iterated-ekf")
    assert abs(found["x"].value[-1] - right["x"].value[-1]) < 0.2 * abs(plain["x"].value[-1] - right["x"].value[-1])


@pytest.mark.parametrize(
    ("method", "given", "said"),
    [
        ("ekf", {"observe": "(= y (+ x b)) :sigma unknown"}, "needs the noise"),
        ("ekf", {"observe": "(= y (+ x b)) :sigma s :loss (huber 1.5)"}, "linearises once"),
        ("smoother", {"observe": "(= y (+ x b)) :errors ((y s))"}, "takes no `:errors`"),
        ("smoother", {"rest": "(constraints (= x b))"}, "takes no equations"),
    ],
)
def test_what_filters_do_not_take(method, given, said):
    with pytest.raises(mbm.MbmError) as caught:
        solved(method, **given)
    (first,) = caught.value.diagnostics
    assert first.code.name == "not-for-filters"
    assert said in first.message


def test_a_filter_that_trusts_itself_too_much_says_so():
    text = walk("ekf").replace(":acceleration 0.3", ":acceleration 0.001").replace("0.2)", "0.01)")
    found = Found(text)
    assert found.chi2_p < 1e-6
    assert "overconfident-filter" in [d.code.name for d in found.diagnostics]


def test_a_curved_problem_without_a_start_says_which():
    text = walk("ekf", more="(c :sigma 1)", observe="(= y (+ x b (exp c))) :sigma s")
    with pytest.raises(mbm.MbmError):
        mbm.loads(text).solve()


def test_an_absolute_value_is_cut_on_both_sides_in_order():
    """``(<= (abs a) b)`` as a ≤ b, then −a ≤ b: linearising |a| would cut on one side only."""
    given = {"more": "(c :init 0.2 :sigma 1)"}
    both = solved("truncated-ekf", rest="(constraints (<= (abs c) 0.5))", **given)
    apart = solved("truncated-ekf", rest="(constraints (<= c 0.5) (<= (- c) 0.5))", **given)
    assert both["c"].value == pytest.approx(apart["c"].value, rel=1e-13)
    assert both["c"].sigma == pytest.approx(apart["c"].sigma, rel=1e-13)
    one = solved("truncated-ekf", rest="(constraints (<= c 0.5))", **given)
    assert both["c"].sigma < 0.9 * one["c"].sigma


def test_cuts_may_follow_iterated_updates():
    """Without a cut that matters it is the iterated filter; a loss is allowed."""
    curved = {"observe": "(= y (+ (exp x) b)) :sigma s", "rest": "(constraints (<= x 50))"}
    cut, plain = solved("(truncated-ekf :iterated true)", **curved), solved("iterated-ekf", **curved)
    np.testing.assert_allclose(cut["x"].value, plain["x"].value, rtol=0, atol=1e-12)
    assert np.abs(cut["x"].value - solved("truncated-ekf", **curved)["x"].value).max() > 1e-4
    lossy = solved("(truncated-ekf :iterated true)", observe="(= y (+ x b)) :sigma s :loss (huber 1.5)")
    assert lossy.status == "converged"
    with pytest.raises(mbm.MbmError, match="is true or false"):
        solved("(truncated-ekf :iterated 3)")


@pytest.mark.parametrize("method", ["batch", "ekf"])
def test_check_takes_noise_of_rank_one(method):
    """The acceleration of constant-velocity is one number, of which place and rate follow."""
    assert mbm.loads(walk(method)).check() == ()


LIMITED = "(constraints (<= x 0.8) (>= b 0))"


@pytest.mark.parametrize(
    ("method", "same"), [("ekf", "truncated-ekf"), ("iterated-ekf", "(truncated-ekf :iterated true)")]
)
def test_any_filter_may_cut(method, same):
    found = solved(f"{method} :constraints truncate", rest=LIMITED)
    wanted = solved(same, rest=LIMITED)
    for name in ("x", "b"):
        np.testing.assert_array_equal(found[name].value, wanted[name].value)
        np.testing.assert_array_equal(found[name].sigma, wanted[name].sigma)
    assert (found["x"].value != solved(method, rest=LIMITED)["x"].value).any()


def test_a_name_from_outside_keeps_the_cuts():
    problem = mbm.loads(walk("truncated-ekf :constraints truncate", rest=LIMITED))
    np.testing.assert_array_equal(problem.solve(method="ekf")["x"].value, problem.solve()["x"].value)
    with pytest.raises(mbm.MbmError, match="`batch` meets constraints"):
        problem.solve(method="batch")


@pytest.mark.parametrize("method", ["batch", "(smoother :lag 2)"])
def test_what_meets_or_refuses_limits_cuts_nothing(method):
    with pytest.raises(mbm.MbmError, match="bad-form: `:constraints truncate` cuts what a filter, or the smoother"):
        mbm.loads(walk(f"{method} :constraints truncate", rest=LIMITED)).solve()
