"""Losses and estimators by their names in the language, and the scores of the estimators worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from mbm.problem.kinds import LossKind
from mbm.problem.types import ConsensusKind
from mbm.solution.robust.estimators.standard import BY_KIND
from mbm.solution.robust.losses.standard import BY_KIND as LOSSES
from tests.robust.scenes import scalar_units

SQUARES = np.array([[0.0, 1.0, 4.0, 16.0, 25.0], [2.0, 2.0, 2.0, 2.0, 100.0]])
"""Two trials, five units: with the limit 9 the first leaves three in, the second four."""
LIMITS = np.full(5, 9.0)


def test_each_name_of_the_language_has_one_value():
    assert sorted(LOSSES) == sorted(LossKind)
    assert sorted(BY_KIND) == sorted(ConsensusKind)


def test_losses_are_values():
    for loss in LOSSES.values():
        assert loss == type(loss)()
        assert hash(loss) == hash(type(loss)())


@pytest.mark.parametrize("kind", [ConsensusKind.MSAC, ConsensusKind.GNC])
def test_truncated_squares_are_summed(kind):
    found = BY_KIND[kind].scores(SQUARES, scalar_units(5), 2, LIMITS)
    np.testing.assert_allclose(found, [5 / 9 + 2, 8 / 9 + 1], rtol=1e-15)


def test_ransac_counts_outliers_and_ties_go_to_the_closer_one():
    found = BY_KIND[ConsensusKind.RANSAC].scores(SQUARES, scalar_units(5), 2, LIMITS)
    np.testing.assert_allclose(found, [2 + (5 / 9 + 2) / 6, 1 + (8 / 9 + 1) / 6], rtol=1e-15)


def test_least_median_takes_the_order_statistic_and_no_limits():
    # Five units, subsets of two: rank 5 // 2 + 3 // 2 = 3, over the median of χ² with one degree of freedom.
    found = BY_KIND[ConsensusKind.LMEDS].scores(SQUARES, scalar_units(5), 2, np.full(5, np.nan))
    np.testing.assert_allclose(found, 5 * np.log(np.array([4.0, 2.0]) / chi2.ppf(0.5, 1)), rtol=1e-9)


def test_only_graduated_non_convexity_does_without_subsets_and_only_the_median_without_limits():
    assert [kind for kind, each in BY_KIND.items() if not each.samples] == [ConsensusKind.GNC]
    assert [kind for kind, each in BY_KIND.items() if not each.knows_limits] == [ConsensusKind.LMEDS]
