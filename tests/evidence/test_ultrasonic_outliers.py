"""Ultrasonic tags with one echo that is half a metre long: consensus against the errors of the first paper's method."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.evidence.ultrasonic import LONG, MEAN_ERRORS, PLACES, SUBSETS, ranges, receivers

TEXT = """
(problem tags
  (data receivers external :key id)
  (data ranges external :with (receivers receiver))
  (unknowns (p (vector 3) :init [1.75m 1.75m 1m]))
  (observe ranges
    (= range (distance p [receivers.x receivers.y receivers.z]))
    {noise})
  (for-each position epoch)
  (solve :robust lmeds))
"""


def with_outliers(number: int):
    """The ranges to a subset of the receivers, one of each epoch half a metre too long; and which these are."""
    every = ranges()
    chosen = np.isin(every["receiver"], SUBSETS[number])
    table = {name: column[chosen] for name, column in every.items()}
    long = LONG[number][table["position"].astype(int), table["epoch"].astype(int)] == table["receiver"]
    return {**table, "range": table["range"] + 0.5 * long}, long


def solved(number: int, noise: str):
    table, long = with_outliers(number)
    result = mbm.loads(TEXT.format(noise=noise)).solve(data={"receivers": receivers(), "ranges": table})
    return result, long


def mean_error(result):
    errors = [np.linalg.norm(s.estimates[0].value - PLACES[int(s.key["position"])]) for s in result.solves]
    assert len(errors) == 150
    return float(np.mean(errors))


@pytest.mark.parametrize("number", [6, 9, 24, 48])
def test_mean_error_is_at_most_that_of_lmeds_with_refit(number):
    result, _ = solved(number, ":sigma 10mm")
    assert mean_error(result) <= MEAN_ERRORS[number]


@pytest.mark.parametrize(("number", "share"), [(24, 0.08), (48, 0.05)])
def test_unknown_noise_is_found_beside_the_outliers(number, share):
    result, _ = solved(number, ":sigma unknown")
    assert mean_error(result) <= MEAN_ERRORS[number]
    factors = np.array([s.noise["ranges"] for s in result.solves])
    # Their mean scatters by 1 %; picking the best of many subsets makes few residuals look better than they are.
    assert abs(np.sqrt(np.mean(factors**2)) - 0.010) < share * 0.010


@pytest.mark.parametrize("number", [9, 24, 48])
def test_the_long_echo_is_listed_and_good_ones_rarely(number):
    result, long = solved(number, ":sigma 10mm")
    of_epoch = long.reshape(-1, number)
    first = np.arange(len(of_epoch)) * number
    listed = np.zeros(long.shape, dtype=bool)
    for solve in result.solves:
        listed[np.array(solve.residual_summaries["ranges"].outliers, dtype=int) - 1] = True
    assert listed[first + of_epoch.argmax(axis=1)].all()
    # Three standard deviations leave out 0.27 % of good rows; fewer where the fit follows them. Four deviations up.
    wrong, count = int((listed & ~long).sum()), int((~long).sum())
    assert wrong <= 0.0027 * count + 4 * np.sqrt(0.0027 * count)
