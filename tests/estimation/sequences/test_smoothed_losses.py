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
