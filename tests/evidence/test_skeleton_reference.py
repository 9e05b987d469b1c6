"""The figure of 25 degrees of freedom, from starts near the truth: one of the listed solutions, and its joints."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.evidence.material import shared_json, write_problem
from tests.evidence.skeleton import POSE, TEXT, joints_at, tables

SEEDS = range(12)
SPREAD = 0.05
"""Standard deviation of the starts about the truth, rad and m."""


@pytest.fixture(scope="module")
def expected():
    return shared_json("reference", "skeleton", "expected.json")


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    truth = shared_json("reference", "skeleton", "truth.json")
    return mbm.load(write_problem(tmp_path_factory.mktemp("skeleton"), TEXT, tables(truth))).compile()


def start_near(truth, seed):
    moved = np.random.default_rng(seed).normal(0.0, SPREAD, len(truth))
    near = {name: value + step for (name, value), step in zip(truth.items(), moved, strict=True)}
    return {**{n: near[n] for n in POSE}, "q": [v for n, v in near.items() if n not in POSE]}


def solution_of(solved):
    angles = solved["q"]
    return {**{n: float(solved[n].value) for n in POSE}, **dict(zip(angles.keys, angles.value.tolist(), strict=True))}


@pytest.mark.parametrize("seed", SEEDS)
def test_a_start_near_the_truth_reaches_a_listed_solution(seed, compiled, expected):
    truth = shared_json("reference", "skeleton", "truth.json")
    solved = compiled.solve(init=start_near(truth, seed))
    assert solved.status == "ok"
    costs = [m["cost"] for m in expected["torso_minima"]]
    # The listed costs are exact to 1e-8; each torso minimum carries up to 512 postures of the same cost.
    assert min(abs(solved.first.cost / c - 1) for c in costs) < 1e-8
    assert (solved.first.dof, solved.observability.rank) == (5, 25)
    joints = joints_at(solution_of(solved))
    measured = tables(truth)["joints"]
    derived = solved["joint-at"]
    assert derived.keys == tuple(range(1, 16))
    chain = np.array([joints[name] for name in measured["joint"]])
    # The same chain in another order of operations.
    np.testing.assert_allclose(derived.value, chain, rtol=0, atol=1e-12)
    image = 800 * chain[:, 1:] / chain[:, :1]
    residuals = (image - np.column_stack([measured["X"], measured["Y"]])) / 0.5
    assert np.sum(np.square(residuals)) == pytest.approx(solved.first.cost, rel=1e-9)


def test_the_torso_of_the_best_solution(compiled, expected):
    """From the truth itself: torso minimum 0, whose pose and waist are the same in all of its postures."""
    truth = shared_json("reference", "skeleton", "truth.json")
    angles = [v for n, v in truth.items() if n not in POSE]
    solved = compiled.solve(init={**{n: truth[n] for n in POSE}, "q": angles})
    best = expected["nearest_to_truth"]
    assert solved.first.cost == pytest.approx(expected["global_cost"], rel=1e-8)
    found = solution_of(solved)
    for name in (*POSE, "waist"):
        assert found[name] == pytest.approx(best["x"][name], abs=1e-7)
    sigma = [float(solved[n].sigma) for n in POSE]
    np.testing.assert_allclose(sigma, [best["stderr"][n] for n in POSE], rtol=1e-5)
