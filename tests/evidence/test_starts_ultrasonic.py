"""Ultrasonic tags without initial values: closed form, then least squares, and the same from random points."""

from __future__ import annotations

from functools import cache

import numpy as np

import mbm
from tests.evidence.ultrasonic import EPOCHS, PLACES, best_places, ranges, receivers

TEXT = """
(problem tags
  (data ranges external)
  (unknowns (p (vector 3)))
  (observe ranges (= range (distance p [x y z])) :sigma 10mm)
  (for-each position epoch)
  (solve :method %s))
"""


@cache
def measured() -> dict[str, np.ndarray]:
    """All ranges with the places of their receivers."""
    found, stations = ranges(), receivers()
    place = np.searchsorted(stations["id"], found["receiver"])
    return {**found, **{name: stations[name][place] for name in "xyz"}}


def positions(method: str) -> np.ndarray:
    """The estimates of all epochs."""
    solved = mbm.loads(TEXT % method).solve(data={"ranges": measured()})
    return np.array([np.ravel(each.estimates[0].value) for each in solved.solves])


def test_least_squares_needs_no_initial_value() -> None:
    """The mirror image above the ceiling fits as well; the tag below is taken, as a start below would lead to."""
    # The reference is rounded at 1e-10 m and computed to 1e-8 m.
    np.testing.assert_allclose(positions("auto"), best_places(), rtol=0, atol=1e-8)


def test_the_closed_form_alone_is_the_linear_method_of_the_paper() -> None:
    """LIN in a plane: (x, y) by differences, z from the mean of the squares."""
    truth = np.repeat(PLACES, EPOCHS, axis=0)
    exact = np.linalg.norm(best_places() - truth, axis=1).mean()
    error = np.linalg.norm(positions("closed-form") - truth, axis=1).mean()
    # With weights 1/l² the squares cost next to nothing; without them it would be some percent of the accuracy.
    assert abs(error - exact) <= 0.02 * exact


def test_random_search_of_the_room_ends_at_the_same_place() -> None:
    """Nishida's direct substitution, the best of 30,000 points, then descent."""
    text = (TEXT % "direct-search").replace("(p (vector 3))", "(p (vector 3) :in ([0 0 0] [3.5 3.5 2.7]))")
    first = measured()["epoch"] == 0
    solved = mbm.loads(text).solve(data={"ranges": {n: c[first] for n, c in measured().items()}})
    found = [np.ravel(each.estimates[0].value) for each in solved.solves]
    np.testing.assert_allclose(found, best_places()[::EPOCHS], rtol=0, atol=1e-8)
