"""States drawn from their dynamics, and estimates of them that are as good as they say."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

WALK = """(problem walk (data gps external) (states :over t (p :init 0 :sigma 3) (b :init 1 :sigma 0.5))
  (dynamics (constant-velocity p :acceleration 0.5 :velocity 1 :velocity-sigma 0.4) (static b))
  (observe gps (= x p) :sigma 0.3) (data ref external) (observe ref (= y (+ p b)) :sigma 0.2))"""


def tables(times):
    zero = np.zeros(len(times))
    return {"gps": {"t": times, "x": zero}, "ref": {"t": times[::3], "y": zero[::3]}}


def true(simulated):
    return {name: np.asarray(e["value"]) for name, e in simulated.truth["solves"][0]["estimates"].items()}


def test_process_noise_is_that_of_the_dynamics():
    """White acceleration, constant within a step: exact in the place, of the stated deviation in the rate."""
    times = np.cumsum(np.random.default_rng(1).uniform(0.5, 2.0, 2000))
    simulated = mbm.loads(WALK).simulate(data=tables(times), seed=4)
    found, dt = true(simulated), np.diff(times)
    acceleration = np.diff(found["p.rate"]) / dt
    assert acceleration.std() == pytest.approx(0.5, rel=0.05)
    assert np.diff(found["p"]) == pytest.approx(dt * (found["p.rate"][1:] + found["p.rate"][:-1]) / 2, abs=1e-9)
    assert found["p"][0] == 0
    assert found["p.rate"][0] == 1
    assert (found["b"] == 1).all()
    assert (np.asarray(simulated["gps"]["x"]) - found["p"]).std() == pytest.approx(0.3, rel=0.05)


UNKNOWN = """(problem u (data gps external) (states :over t (x :init 1m :sigma 1m)) (dynamics (= (next x) (* 0.9 x)))
  (observe gps (= z x) :sigma 0.2m) (solve :method batch))"""


def test_process_noise_that_is_unknown_is_drawn_as_asked_and_told_as_estimated():
    """A factor that 400 steps tell to 1/sqrt(800), and a little worse by the noise of the readings."""
    times = np.arange(401.0)
    data = {"gps": {"t": times, "z": np.zeros(401)}}
    problem = mbm.loads(UNKNOWN)
    assumed = problem.simulate(data=data, seed=4)
    assert "`next x`" in next(note.message for note in assumed.notes if note.code.name == "assumed-noise")
    made = problem.simulate(data=data, seed=4, noise={"next x": "0.5m"})
    assert "assumed-noise" not in [note.code.name for note in made.notes]
    for each, deviation in ((assumed, 1.0), (made, 0.5)):
        x = true(each)["x"]
        assert (x[1:] - 0.9 * x[:-1]).std() == pytest.approx(deviation, rel=0.12)
    solve = problem.solve(data={"gps": dict(made["gps"])}).first
    assert solve.noise["next x"] == pytest.approx(0.5, rel=0.16)
    assert solve.noise["gps"] is None


def test_process_noise_that_is_stated_has_no_factor():
    solve = mbm.loads(WALK).solve(data=tables(np.arange(6.0))).first
    assert set(solve.noise) == {"gps", "ref"}


def test_a_draw_follows_from_its_seed():
    times = np.arange(6.0)
    one, again, other = (true(mbm.loads(WALK).simulate(data=tables(times), seed=s)) for s in (1, 1, 2))
    assert (one["p"] == again["p"]).all()
    assert (one["p"] != other["p"])[1:].all()


def test_states_that_are_given_are_not_drawn():
    times = np.arange(5.0)
    at = {"p": [0.0, 1.0, 4.0, 9.0, 16.0], "p.rate": [0.0, 2.0, 4.0, 6.0, 8.0], "b": 2.0}
    simulated = mbm.loads(WALK).simulate(data=tables(times), at=at, seed=1)
    assert true(simulated)["p"].tolist() == at["p"]
    again = mbm.loads(WALK).simulate(data=tables(times), at=simulated.truth, seed=1)
    assert true(again)["p"].tolist() == at["p"]
    assert (np.asarray(again["gps"]["x"]) == np.asarray(simulated["gps"]["x"])).all()


def test_the_first_step_may_be_given_alone():
    found = true(mbm.loads(WALK).simulate(data=tables(np.arange(5.0)), at={"p": 7.0}, seed=1))
    assert found["p"][0] == 7
    assert found["p"][1] != 7


def test_each_key_has_a_trajectory_of_its_own():
    text = WALK[:-1] + " (for-each run))"
    data = tables(np.array([0.0, 1, 2, 0, 1, 2]))
    data["gps"]["run"], data["ref"]["run"] = [1, 1, 1, 2, 2, 2], [1, 2]
    solves = mbm.loads(text).simulate(data=data, seed=1).truth["solves"]
    first, second = (solve["estimates"]["p"]["value"] for solve in solves)
    assert len(first) == len(second) == 3
    assert first[1] != second[1]


@pytest.mark.slow
def test_estimates_are_as_good_as_they_say():
    """300 draws from priors, dynamics and noise: normalised errors have variance 1, the cost is chi-squared."""
    times = np.array([0.0, 0.5, 1.5, 2.0, 4.0, 4.5, 6.0])
    compiled, errors, costs = mbm.loads(WALK).compile(data=tables(times)), [], []
    for seed in range(300):
        simulated = mbm.loads(WALK).simulate(data=tables(times), seed=seed, draw_priors=True)
        result, found = compiled.solve(data=dict(simulated)), true(simulated)
        errors.append([(result[n].value - found[n]) / result[n].sigma for n in ("p", "p.rate", "b")])
        costs.append(result.solves[0].cost)
    variance = np.square(errors).mean(axis=0)
    assert np.abs(variance - 1).max() < 5 * np.sqrt(2 / 300)
    dof = result.solves[0].dof
    assert dof == 10
    assert np.mean(costs) == pytest.approx(dof, abs=5 * np.sqrt(2 * dof / 300))
