"""A false row that a loss keeps in the place of true ones: at a minimum of which there is a better one, said."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbm
from tests.robust.test_contradiction import solved

TEXT = """
(problem ring
  (data places external :key id)
  (data steps external)
  (unknowns (x :per places :init start :fixed (= id 0)))
  (observe steps (= d (- (x to) (x from))) :sigma (unknown 0.1) :loss {loss}))"""
AWAY = 500.0


def said(loss: str) -> list[str]:
    """What is said of a ring of which five places hang on one step at each end.

    These begin where a false step to one of them wants them.
    """
    return of_ring(mbm.loads(TEXT.format(loss=loss)), 0, AWAY)


def of_ring(problem: Any, seed: int, away: float) -> list[str]:
    """What is said of a ring of ten places on a line, whose last step, to one of five, is ``away`` from the truth."""
    generator = np.random.default_rng(seed)
    pairs = [(i, (i + 1) % 10) for i in range(10)]
    pairs += [(0, 2), (1, 3), (2, 4), (0, 4), (5, 7), (6, 8), (7, 9), (5, 9), (2, 7)]
    first, last = np.array(pairs).T
    d = (last - first).astype(float) + 0.1 * generator.standard_normal(len(first))
    d[-1] += away
    places = {"id": np.arange(10), "start": np.arange(10) + np.where(np.arange(10) > 4, away, 0.0)}
    data = {"places": places, "steps": {"from": first, "to": last, "d": d}}
    found = problem.solve(data=data)
    return [each.message for each in found.diagnostics if each.code.name == "bad-leverage"]


@pytest.mark.parametrize("loss", ["cauchy", "geman-mcclure"])
def test_a_false_row_in_the_place_of_two_true_ones(loss: str) -> None:
    (message,) = said(loss)
    assert message.startswith("row 19 disagrees")


def test_nothing_is_said_of_graphs_without_false_rows() -> None:
    for seed in range(3):
        found, _, _ = solved("plane", 0, seed, ":sigma (unknown [1deg 5cm 5cm]) :loss cauchy")
        assert "bad-leverage" not in [each.code.name for each in found.diagnostics]


@pytest.mark.parametrize("loss", ["cauchy", "(huber 1.5)"])
def test_nothing_is_said_of_clean_rings_whose_noise_is_underestimated(loss: str) -> None:
    """Of 19 steps and nine unknowns, consensus makes the noise a fifth of what it is."""
    problem = mbm.loads(TEXT.format(loss=loss))
    accused = [seed for seed in range(50) if of_ring(problem, seed, 0.0)]
    assert len(accused) <= 1  # two percent
