"""Unknown noise of readings with a loss, where transitions tell states too: against the truth of simulations."""

from __future__ import annotations

import numpy as np
import pytest

import mbm


@pytest.mark.parametrize("loss", ["huber", "tukey"])
@pytest.mark.parametrize("unit", [1.0, pytest.param(1e3, marks=pytest.mark.slow)])
def test_the_noise_of_readings_with_a_loss_may_be_unknown(loss, unit):
    """It is the truth's, with a tenth of the readings grossly wrong: of 24 walks the mean of s is within 10 %.

    One s of 100 readings, of which less than a half is left by the states, scatters by some 13 %: that is 3.7 of the
    mean's deviations. The squared errors of states, correlated along some ten steps, are 1 on average, ± 0.06.
    """
    rng = np.random.default_rng(6)
    steps, runs = 100, 24
    p = unit * np.cumsum(rng.normal(0, 0.3, (runs, steps)), axis=1)
    x = p + unit * (rng.normal(0, 0.5, p.shape) + (rng.random(p.shape) < 0.1) * rng.normal(0, 20, p.shape))
    text = f"""(problem walk (data gps external) (states :over t (p :init 0 :sigma {unit}))
      (dynamics (random-walk p :sigma {0.3 * unit})) (observe gps (= x p) :sigma unknown :loss {loss})
      (for-each run))"""
    data = {"run": np.repeat(np.arange(runs), steps), "t": np.tile(np.arange(1.0 * steps), runs), "x": x.ravel()}
    result = mbm.loads(text).solve(data={"gps": data})
    assert np.mean([each.noise["gps"] for each in result.solves]) == pytest.approx(0.5 * unit, rel=0.1)
    errors = [(each["p"].value - true) / each["p"].sigma for each, true in zip(result.solves, p, strict=True)]
    assert np.mean(np.square(errors)) == pytest.approx(1.0, abs=0.2)


def test_readings_with_a_loss_and_transitions_may_both_have_unknown_noise():
    """Of 24 walks the means of both are within 20 %: transitions that are much noisier at first leave nothing open."""
    rng = np.random.default_rng(7)
    steps, runs = 100, 24
    p = np.cumsum(rng.normal(0, 0.3, (runs, steps)), axis=1)
    x = p + rng.normal(0, 0.5, p.shape)
    text = """(problem walk (data gps external) (states :over t (p :init 0 :sigma 1))
      (dynamics (= (next p) p :sigma unknown)) (observe gps (= x p) :sigma unknown :loss tukey) (for-each run))"""
    data = {"run": np.repeat(np.arange(runs), steps), "t": np.tile(np.arange(1.0 * steps), runs), "x": x.ravel()}
    noise = [each.noise for each in mbm.loads(text).solve(data={"gps": data}).solves]
    assert np.mean([each["gps"] for each in noise]) == pytest.approx(0.5, rel=0.2)
    assert np.mean([each["next p"] for each in noise]) == pytest.approx(0.3, rel=0.2)
