"""Smoothers under losses: standard deviations of the sandwich, as all steps at once have them, and their coverage."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

WALK = "(random-walk x :sigma 0.3)"
VELOCITY = "(constant-velocity x :acceleration 0.1)"


def drawn(seed: int, steps: int, spread: float, *, moving: bool = False):
    """A walk (steps,), and readings of it, a tenth of which are grossly wrong."""
    random = np.random.default_rng(seed)
    x = random.normal() + np.append(0.0, np.cumsum(random.normal(0, 0.3, steps - 1)))
    z = (np.sqrt(4 + x * x) if moving else x) + random.normal(0, 0.5, steps)
    return x, z + np.where(random.random(steps) < 0.1, random.normal(0, spread, steps), 0.0)


def solved(z, dynamics: str, loss: str, method: str, model: str = "x"):
    rows = " ".join(f"({k} {value:.6f})" for k, value in enumerate(z.tolist()))
    text = f"""(problem p (data d (table (t z) {rows})) (states :over t (x :init 0.1 :sigma 1)) (dynamics {dynamics})
      (observe d (= z {model}) :sigma 0.5 :loss {loss}) (derive (end (* 2 (x 30)))) (solve :method {method}))"""
    return mbm.loads(text).solve().solves[0]


@pytest.mark.parametrize("loss", ["(huber 1.5)", "(tukey 4.7)", "soft-l1"])
@pytest.mark.parametrize(
    ("dynamics", "model"), [(WALK, "x"), (VELOCITY, "x"), (WALK, "(sqrt (+ 4 (* x x)))")], ids=["walk", "rate", "bent"]
)
def test_sigmas_are_those_of_all_steps_at_once(loss, dynamics, model):
    """The batch of so few steps is dense, and has the sandwich itself; covariances are differenced to a millionth."""
    _, z = drawn(5, 35, 8.0, moving=model != "x")
    smoother, batch = (solved(z, dynamics, loss, method, model) for method in ("smoother", "batch"))
    assert str(smoother.status) == str(batch.status) == "converged"
    np.testing.assert_allclose(smoother["x"].value, batch["x"].value, atol=1e-6)
    # What ends a smoother's and a batch's search moves weights by some 1e-6.
    np.testing.assert_allclose(smoother["x"].sigma, batch["x"].sigma, rtol=1e-4)
    assert smoother["end"].sigma == pytest.approx(batch["end"].sigma, rel=1e-4)


def test_a_table_without_rows_leaves_the_sandwich_as_it_is():
    text = """(problem p (data d external) (data e external) (states :over t (x :init 0.1 :sigma 1))
      (dynamics (random-walk x :sigma 0.3)) (observe d (= z x) :sigma 0.5 :loss (huber 1.5))
      (observe e (= [u v] [x (* 2 x)]) :sigma 1 {}) (solve :method smoother))"""
    _, z = drawn(5, 35, 8.0)
    none = np.zeros(0)
    data = {"d": {"t": np.arange(35.0), "z": z}, "e": {"t": none, "u": none, "v": none}}
    alone = solved(z, WALK, "(huber 1.5)", "batch")
    for rest in ("", ":loss (tukey 4.7)"):
        beside = mbm.loads(text.format(rest)).solve(data=data).solves[0]
        np.testing.assert_allclose(beside["x"].sigma, alone["x"].sigma, rtol=1e-4)


STEPWISE = """(problem p (data d external) (states :over t (x :init 0 :sigma 1)) (dynamics {dynamics})
  (observe d (= z x) :sigma 0.5 :loss {loss}) {rest} (solve :method {method}))"""


def stepwise(dynamics, loss, method, data, rest=""):
    text = STEPWISE.format(dynamics=dynamics, loss=loss, method=method, rest=rest)
    return mbm.loads(text).solve(data={"d": data}).solves


@pytest.mark.parametrize("method", ["iterated-ekf", "(smoother :lag 2)"])
@pytest.mark.parametrize("loss", ["(huber 1.5)", "(cauchy 2.4)", "(tukey 4.7)"])
def test_sigmas_of_one_step_are_those_of_the_sandwich(method, loss):
    """Of one step a filter is all steps at once."""
    generator = np.random.default_rng(3)
    z = 0.4 + 0.5 * generator.standard_normal(40)
    z[:12] += generator.normal(0.0, 8.0, 12)
    data = {"t": np.zeros(40), "z": z}
    (batch,), (found,) = (stepwise(WALK, loss, each, data) for each in ("batch", method))
    # What ends the searches moves weights by some 1e-6.
    assert found["x"].sigma == pytest.approx(batch["x"].sigma, rel=1e-4)


@pytest.mark.parametrize("loss", ["(huber 1.5)", "(tukey 4.7)"])
def test_a_lag_of_all_steps_tells_what_all_steps_at_once_do(loss):
    """The factors of the sandwich follow from the rows so far: a tenth may differ."""
    _, z = drawn(5, 35, 8.0)
    lag, batch = (solved(z, WALK, loss, method) for method in ("(smoother :lag 40)", "batch"))
    np.testing.assert_allclose(lag["x"].value, batch["x"].value, atol=1e-4)
    np.testing.assert_allclose(lag["x"].sigma, batch["x"].sigma, rtol=0.1)


def walks(count, steps, share, spread):
    """Sequences of rows, so large a share of which is grossly wrong, and their truth (count, steps)."""
    truth, readings = [], []
    for seed in range(count):
        random = np.random.default_rng(seed)
        truth.append(random.normal() + np.append(0.0, np.cumsum(random.normal(0, 0.3, steps - 1))))
        wrong = random.random(steps) < share
        readings.append(truth[-1] + random.normal(0, 0.5, steps) + wrong * random.normal(0, spread, steps))
    runs, times = np.repeat(np.arange(count), steps), np.tile(np.arange(steps), count)
    return np.array(truth), {"run": runs * 1.0, "t": times * 1.0, "z": np.concatenate(readings)}


@pytest.mark.parametrize("method", ["iterated-ekf", "(smoother :lag 2)"])
@pytest.mark.parametrize("loss", ["(huber 1.345)", "(cauchy 2.385)", "(tukey 4.685)"])
@pytest.mark.parametrize("share", [0.1, 0.3])
def test_intervals_of_filters_hold_where_readings_are_wrong(method, loss, share):
    """80 walks of 60 steps, alike in some five: the share of 960 has a deviation of 0.7 %."""
    truth, data = walks(80, 60, share, 8.0)
    solves = stepwise(WALK, loss, method, data, "(for-each run)")
    errors = np.array([(solve["x"].value - x) / solve["x"].sigma for solve, x in zip(solves, truth, strict=True)])
    assert 0.92 <= np.mean(np.abs(errors) < 1.96) <= 0.97


@pytest.mark.parametrize("method", ["iterated-ekf", "(smoother :lag 2)"])
def test_two_readings_that_contradict_one_another_leave_the_first_where_nothing_was_known(method):
    """Least squares lead between them, where the loss leaves both out: either alone costs half of that."""
    text = STEPWISE.format(dynamics=WALK, loss="(tukey 4.685)", rest="", method=method).replace(":sigma 1)", ")")
    z = np.array([-9.1, -3.82])
    for count in (1, 2):
        (found,) = mbm.loads(text).solve(data={"d": {"t": np.arange(1.0 * count), "z": z[:count]}}).solves
        assert str(found.status) == "converged"
        np.testing.assert_allclose(found["x"].value, np.full(count, z[0]), atol=1e-4)


def test_what_nothing_is_known_of_begins_where_most_readings_are():
    """40 walks far from where they begin, a fifth of whose readings is wrong: a lag of five steps finds almost all."""
    truth, data = walks(40, 30, 0.2, 8.0)
    data["z"] += 50.0
    text = STEPWISE.format(dynamics=WALK, loss="(tukey 4.685)", rest="(for-each run)", method="(smoother :lag 5)")
    solves = mbm.loads(text.replace(":sigma 1)", ")")).solve(data={"d": data}).solves
    assert all(str(solve.status) == "converged" for solve in solves)
    near = [
        np.abs(s["x"].value - 50.0 - x).max() < 6.0 * np.max(s["x"].sigma) for s, x in zip(solves, truth, strict=True)
    ]
    assert np.mean(near) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["(huber 1.345)", "(tukey 4.685)"])
@pytest.mark.parametrize("spread", [5.0, 50.0])
def test_intervals_hold_where_a_tenth_of_the_readings_is_wrong(loss, spread):
    """1,000 walks of 50 steps: the share of 50,000 steps, alike in some ten, has a deviation of 0.3 %."""
    inside = []
    for seed in range(1000):
        x, z = drawn(seed, 50, spread)
        found = solved(z, WALK, loss, "smoother")["x"]
        inside.append(np.mean(np.abs(found.value - x) < 1.96 * found.sigma))
    assert 0.93 <= np.mean(inside) <= 0.97
