"""Parts of consensus: numbers that are drawn, order statistics, scores worked out by hand."""

from __future__ import annotations

from math import comb, inf
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import chi2, hypergeom

from mbm.estimation.consensus.rules import KINDS, first_states
from mbm.problem.kinds import ConsensusKind
from mbm.solver.consensus_records import CANDIDATES
from mbm.solver.consensus_refine import gnc_weight
from mbm.solver.consensus_sample import (
    combinations_of,
    drawn_below,
    next_combination,
    trials_for_share,
)
from mbm.solver.consensus_scores import inlier_count, least_median, median, outlier_count, selected, truncated
from mbm.solver.consensus_subset import solve_free
from mbm.solver.consensus_trials import put_in_list

NUMBERS = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40)


def test_drawn_numbers_are_uniform():
    state = np.array(first_states(1))
    counts = np.bincount([drawn_below(state, 7) for _ in range(7000)], minlength=7)
    # Seven cells of 1000: 22.5 is exceeded once in a thousand seeds, and the seed is fixed.
    assert ((counts - 1000.0) ** 2 / 1000.0).sum() < 22.5


def test_combinations_come_in_order_and_all_of_them():
    combination = np.arange(3)
    seen = [combination.tolist()]
    while next_combination(6, 3, combination):
        seen.append(combination.tolist())
    assert seen == sorted(seen)
    assert len(seen) == combinations_of(6, 3, 3000) == comb(6, 3)
    assert combinations_of(20, 18, 3000) == comb(20, 18)
    assert combinations_of(50, 25, 3000) == 3001
    assert combinations_of(2, 3, 3000) == 0


@given(values=NUMBERS, share=st.floats(0, 0.999))
def test_order_statistics(values, share):
    place = int(share * len(values))
    assert selected(len(values), place, np.array(values)) == sorted(values)[place]
    assert median(len(values), np.array(values)) == pytest.approx(np.median(values))


@given(seed=st.integers(0, 1000), unknown=st.booleans())
def test_the_least_median_is_given_up_only_where_it_is_above_the_bound(seed, unknown):
    generator = np.random.default_rng(seed)
    squares, ones = generator.chisquare(1, 21) * 10 ** generator.uniform(-8, 4), np.ones(21)
    groups = np.full(21, 0 if unknown else -1)
    scratch = np.zeros(21)
    whole = least_median(21, int(unknown), np.full(21, 3), squares, ones, groups, inf, scratch)
    for bound in (whole - 1.0, whole, whole + 1.0):
        found = least_median(21, int(unknown), np.full(21, 3), squares, ones, groups, bound, scratch)
        assert found == whole or (found == inf and bound < whole)


SQUARES = np.array([[0.0, 1.0, 4.0, 16.0, 25.0], [2.0, 2.0, 2.0, 2.0, 100.0]])
"""Two trials, five units: with the limit 9 the first leaves three in, the second four."""
LIMITS = np.full(5, 9.0)


def test_each_name_of_the_language_has_one_score():
    assert sorted(KINDS) == sorted(ConsensusKind)
    assert len(set(KINDS.values())) == len(KINDS)


def test_truncated_squares_are_summed():
    found = [truncated(5, 1.0, squares, LIMITS) for squares in SQUARES]
    np.testing.assert_allclose(found, [5 / 9 + 2, 8 / 9 + 1], rtol=1e-15)
    assert truncated(5, 16.0, SQUARES[0], LIMITS) == pytest.approx(46 / 144, rel=1e-15)


def test_each_unit_has_its_own_limit():
    generator = np.random.default_rng(1)
    squares, limits = generator.uniform(0, 4, 11), generator.uniform(3, 15, 11)
    squares[4] = 1e3  # beyond its limit
    wanted = np.minimum(squares / (2.0 * limits), 1.0).sum()
    assert truncated(11, 2.0, squares, limits) == pytest.approx(wanted, rel=1e-14)  # another order of the sum


@pytest.mark.parametrize("control", [1e-3, 0.5, 1.0, 40.0])
def test_weights_of_graduated_non_convexity_are_those_of_the_paper(control):
    """Yang, Antonante, Tzoumas and Carlone 2020, eq. 14, with the squared limit 9."""
    low, high = control / (control + 1) * 9, (control + 1) / control * 9
    assert gnc_weight(0.999 * low, 9.0, control) == 1.0
    assert gnc_weight(1.001 * high, 9.0, control) == 0.0
    for square in np.geomspace(low, high, 9)[1:-1]:
        wanted = np.sqrt(9 * control * (control + 1) / square) - control
        assert gnc_weight(float(square), 9.0, control) == pytest.approx(wanted, rel=1e-12, abs=1e-14)


def test_ransac_counts_outliers_and_ties_go_to_the_closer_one():
    found = [outlier_count(5, squares, LIMITS, truncated(5, 1.0, squares, LIMITS)) for squares in SQUARES]
    np.testing.assert_allclose(found, [2 + (5 / 9 + 2) / 6, 1 + (8 / 9 + 1) / 6], rtol=1e-15)
    assert [inlier_count(5, squares, LIMITS) for squares in SQUARES] == [3, 4]


def test_least_median_takes_the_order_statistic():
    """Five units, subsets of two: rank 5 // 2 + 3 // 2 = 3, over the median of χ² with one degree of freedom."""
    medians, groups, scratch = np.full(5, chi2.ppf(0.5, 1)), np.full(5, -1), np.zeros(5)
    found = [least_median(5, 0, np.full(5, 2), squares, medians, groups, inf, scratch) for squares in SQUARES]
    np.testing.assert_allclose(found, 5 * np.log(np.array([4.0, 2.0]) / chi2.ppf(0.5, 1)), rtol=1e-12)


@pytest.mark.parametrize(("inside", "units", "size"), [(30, 48, 3), (12, 20, 3), (5, 10, 5), (48, 48, 3), (2, 9, 3)])
def test_trials_for_a_share_miss_once_in_a_million(inside, units, size):
    found = trials_for_share(inside, units, size)
    hit = hypergeom(units, inside, size).pmf(size)
    if hit == 0.0:
        assert found == inf
    elif hit == 1.0:
        assert found == 0.0
    else:
        # rel: the logarithms of a few products of shares, all near their rounding
        assert (1.0 - hit) ** found == pytest.approx(1e-6, rel=1e-10)


def test_the_least_median_takes_each_group_of_noise_by_itself():
    """``Σ n log q`` over three groups, NumPy's order statistics; stated noise, the first, is no smaller than stated."""
    generator = np.random.default_rng(4)
    squares, groups = generator.chisquare(1, 24), np.repeat([-1, 0, 1], [7, 12, 5])[generator.permutation(24)]
    medians = generator.uniform(0.3, 0.6, 24)
    sizes = np.array([3, 1, 4])  # of groups 0, 1 and -1: how many unknowns each tells
    wanted = 0.0
    for group in (-1, 0, 1):
        own = np.sort((squares / medians)[groups == group])
        place = len(own) // 2 + (sizes[group] + 1) // 2  # Rousseeuw and Leroy 1987, p. 124
        found = own[min(place, len(own)) - 1]
        wanted += len(own) * np.log(max(found, 1.0) if group == -1 else found)
    found = least_median(24, 2, sizes[groups], squares, medians, groups, inf, np.zeros(24))
    assert found == pytest.approx(wanted, rel=1e-12)


@given(scores=st.lists(st.integers(0, 6), min_size=1, max_size=20), most=st.integers(1, 5))
def test_lists_hold_the_best_trials_in_order_and_no_point_twice(scores, most):
    """Trials with one score are at one point here, and that is listed once."""
    work = SimpleNamespace(
        best=np.zeros(CANDIDATES, dtype=np.int64), best_scores=np.zeros(CANDIDATES), listed=np.zeros(1, dtype=np.int64),
        trials=np.array(scores, dtype=float),
    )  # fmt: skip
    problem = SimpleNamespace(numbers=1)
    for trial, score in enumerate(scores):
        put_in_list(problem, 0, most, trial, float(score), work)
    wanted = sorted(set(scores))[:most]
    count = int(work.listed[0])
    assert work.best_scores[:count].tolist() == wanted
    assert [scores[trial] for trial in work.best[:count]] == wanted


@pytest.mark.parametrize("held", [(), (0,), (3,), (1, 2)])
def test_coordinates_that_are_not_held_take_the_step_of_the_normal_equations(held):
    generator, n = np.random.default_rng(3), 4
    jacobian, gradient = generator.normal(size=(9, n)), generator.normal(size=n)
    normal, hold, step = jacobian.T @ jacobian, np.zeros(n), generator.normal(size=n)
    hold[list(held)] = 1.0
    free, kept = np.flatnonzero(hold == 0), step.copy()
    solve_free(n, 0.1, normal.ravel(), gradient, hold, np.zeros(n * n), step)
    right = -gradient[free] - normal[np.ix_(free, held)] @ kept[list(held)]
    wanted = np.linalg.solve(normal[np.ix_(free, free)] + 0.1 * np.eye(len(free)), right)
    np.testing.assert_allclose(step[free], wanted, rtol=1e-9)  # the regularisation is 1e-12 at most of the diagonal
    np.testing.assert_array_equal(step[list(held)], kept[list(held)])
