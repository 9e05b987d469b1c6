"""The figure of 25 degrees of freedom, from starts near the truth: one of the listed solutions, and its joints."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.evidence.skeleton import COSTS, POSE, TORSO, TRUTH, joints_at, seen, write_example

SEEDS = range(12)
SPREAD = 0.05
"""Standard deviation of the starts about the truth, rad and m."""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    return mbm.load(write_example(tmp_path_factory.mktemp("skeleton"))).named("skeleton-near").compile()


def start_near(seed, spread=SPREAD):
    moved = np.random.default_rng(seed).normal(0.0, spread, len(TRUTH))
    near = {name: value + step for (name, value), step in zip(TRUTH.items(), moved, strict=True)}
    return {**{n: near[n] for n in POSE}, "q": [v for n, v in near.items() if n not in POSE]}


def solution_of(solved):
    angles = solved["q"]
    return {**{n: float(solved[n].value) for n in POSE}, **dict(zip(angles.keys, angles.value.tolist(), strict=True))}


@pytest.mark.parametrize("seed", SEEDS)
def test_a_start_near_the_truth_reaches_a_listed_solution(seed, compiled):
    solved = compiled.solve(init=start_near(seed))
    assert solved.status == "ok"
    # The listed costs are exact to 1e-8; each torso minimum carries up to 512 postures of the same cost.
    assert min(abs(solved.first.cost / c - 1) for c in COSTS) < 1e-8
    assert (solved.first.dof, solved.observability.rank) == (5, 25)
    joints = joints_at(solution_of(solved))
    derived = solved["joint-at"]
    assert derived.keys == tuple(range(1, 16))
    chain = np.array([joints[name] for name in seen()])
    # The same chain in another order of operations.
    np.testing.assert_allclose(derived.value, chain, rtol=0, atol=1e-12)
    image = 800 * chain[:, 1:] / chain[:, :1]
    residuals = (image - np.array(list(seen().values()))) / 0.5
    assert np.sum(np.square(residuals)) == pytest.approx(solved.first.cost, rel=1e-9)


def test_the_torso_of_the_best_solution(compiled):
    """From the truth itself: torso minimum 0, whose pose and waist are the same in all of its postures."""
    solved = compiled.solve(init=start_near(0, spread=0.0))
    assert solved.first.cost == pytest.approx(COSTS[0], rel=1e-8)
    found = solution_of(solved)
    for name, (value, _) in TORSO.items():
        assert found[name] == pytest.approx(value, abs=1e-7)
    sigma = [float(solved[n].sigma) for n in POSE]
    np.testing.assert_allclose(sigma, [TORSO[n][1] for n in POSE], rtol=1e-5)
