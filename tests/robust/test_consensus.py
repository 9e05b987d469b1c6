"""Consensus on problems written in NumPy: subsets, scores, fixed points, noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from mbm.problem.types import Consensus, ConsensusKind
from mbm.solution.robust.agree import agree
from mbm.solution.robust.subsets import minimal_subsets, trials_for
from mbm.solution.robust.units import Units, consistency, limits, medians, quantile, robust_variance
from mbm.target.decisions import STATED
from tests.robust.scenes import CEILING, linear_model, range_model, scalar_units

EVERY = tuple(ConsensusKind)
START = np.array([[1.75, 1.75, 1.0]])


def ranges(generator, outliers, sigma=0.005):
    place = generator.uniform([0.8, 0.8, 0.3], [2.7, 2.7, 1.3])
    measured = np.linalg.norm(place - CEILING, axis=1) + sigma * generator.normal(size=48)
    bad = np.zeros(48, dtype=bool)
    bad[generator.choice(48, outliers, replace=False)] = True
    return place, measured + 0.5 * bad, bad


@pytest.mark.parametrize("kind", EVERY)
@pytest.mark.parametrize("outliers", [0, 1, 5, 14])
@pytest.mark.parametrize("unknown", [False, True])
def test_outliers_are_found_and_the_place_is_that_of_the_others(kind, outliers, unknown):
    generator = np.random.default_rng(7)
    for _ in range(5):
        place, measured, bad = ranges(generator, outliers)
        model = range_model(CEILING, measured, 1.0 if unknown else 0.005, unknown=unknown)
        found = agree(model, model.units, START, Consensus(kind=kind), 1)
        assert not found.inliers[bad].any()
        assert (~found.inliers[~bad]).sum() <= 4
        # 5 mm of noise over 34 and more ranges in this geometry: 4 to 5 mm, 20 in the worst of thousands.
        assert np.linalg.norm(found.point - place) < 0.02
        if unknown:
            assert 0.003 < np.sqrt(found.variances[0]) < 0.007


def test_the_answer_follows_from_the_seed_alone():
    _, measured, _ = ranges(np.random.default_rng(3), 10)
    model = range_model(CEILING, measured, 0.005)
    first, again, other = (agree(model, model.units, START, Consensus(kind=ConsensusKind.LMEDS), s) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.point, again.point)
    # Another seed tries other subsets; the fixed point is the same to the rounding of the last fit.
    np.testing.assert_allclose(first.point, other.point, atol=1e-8)


def test_exact_data_with_outliers():
    generator = np.random.default_rng(2)
    design = np.column_stack([np.ones(20), generator.normal(size=20)])
    values = design @ [3.0, -2.0]
    values[[4, 9, 15]] += [1.0, -7.0, 2.0]
    model = linear_model(design, values, unknown=True)
    found = agree(model, model.units, np.zeros((1, 2)), Consensus(kind=ConsensusKind.LMEDS), 1)
    np.testing.assert_allclose(found.point, [3.0, -2.0], atol=1e-12)
    assert np.flatnonzero(~found.inliers).tolist() == [4, 9, 15]


def test_a_stated_noise_that_the_data_contradict_gives_way_to_the_robust_one():
    generator = np.random.default_rng(5)
    place, measured, bad = ranges(generator, 5)
    model = range_model(CEILING, measured, 0.0015)  # the noise is more than three times as large
    found = agree(model, model.units, START, Consensus(kind=ConsensusKind.LMEDS), 1)
    assert not found.inliers[bad].any()
    assert (~found.inliers[~bad]).sum() <= 4
    assert np.linalg.norm(found.point - place) < 0.02


def test_two_equal_halves_are_ambiguous():
    values = np.concatenate([np.zeros(10), np.full(10, 50.0)]) + 0.1 * np.random.default_rng(1).normal(size=20)
    model = linear_model(np.ones((20, 1)), values, unknown=False)
    found = agree(model, model.units, np.zeros((1, 1)), Consensus(kind=ConsensusKind.LMEDS), 1)
    assert found.ambiguous
    clear = linear_model(np.ones((20, 1)), values[:14], unknown=False)
    assert not agree(
        linear_model(np.ones((14, 1)), values[:14], unknown=False),
        scalar_units(14),
        np.zeros((1, 1)),
        Consensus(kind=ConsensusKind.LMEDS),
        1,
    ).ambiguous
    assert clear.dimension == 1


def test_a_threshold_is_kept_to():
    values = np.array([0.0, 0.1, -0.1, 0.2, 1.4, 1.8, -0.2, 0.05])
    model = linear_model(np.ones((8, 1)), values, unknown=False)
    consensus = Consensus(kind=ConsensusKind.RANSAC, threshold=1.0)
    found = agree(model, model.units, np.zeros((1, 1)), consensus, 1)
    np.testing.assert_array_equal(found.inliers, np.abs(values - found.point[0]) <= 1.0)
    assert found.point[0] == pytest.approx(values[found.inliers].mean(), abs=1e-12)


def two_families(members, per_member):
    """Rows that each see one of several unknowns, and one unknown that all share."""
    of_row = np.repeat(np.arange(members), per_member)
    jacobian = np.zeros((len(of_row), members + 1))
    jacobian[np.arange(len(of_row)), of_row] = 1.0
    jacobian[:, -1] = np.random.default_rng(4).normal(size=len(of_row))
    return jacobian, of_row


def test_subsets_take_from_each_member_what_it_needs():
    jacobian, of_row = two_families(5, 8)
    subsets = minimal_subsets(jacobian, scalar_units(40), 200, 1)
    assert subsets.shape == (200, 6)
    for subset in subsets:
        assert np.linalg.matrix_rank(jacobian[subset]) == 6
        assert set(of_row[subset]) == set(range(5))


def test_repeated_rows_are_passed_over():
    jacobian = np.repeat(np.eye(3), 4, axis=0)
    for subset in minimal_subsets(jacobian, scalar_units(12), 300, 1):
        assert sorted(subset // 4) == [0, 1, 2]


def test_all_subsets_are_tried_where_they_are_few():
    jacobian = np.random.default_rng(1).normal(size=(7, 3))
    subsets = minimal_subsets(jacobian, scalar_units(7), None, 1)
    assert {tuple(s) for s in subsets} == {
        (i, j, k) for i in range(7) for j in range(i + 1, 7) for k in range(j + 1, 7)
    }


def test_units_of_two_components_fill_the_rank_in_half_as_many():
    jacobian = np.random.default_rng(1).normal(size=(40, 6))
    units = Units(
        of_row=np.repeat(np.arange(20), 2),
        components=np.full(20, 2),
        group=np.full(20, STATED),
        number=np.arange(20),
        rounding=np.zeros(20),
    )
    assert minimal_subsets(jacobian, units, 50, 1).shape == (50, 3)
    assert units.squares(np.arange(40.0))[1] == 2.0**2 + 3.0**2


def test_default_trials_miss_once_in_a_million_at_40_percent():
    for size in (3, 4, 6):
        trials = trials_for(500, size, None)
        assert (1 - 0.6**size) ** trials <= 1.01e-6
    assert trials_for(500, 3, 17) == 17
    assert trials_for(5, 3, 1000) == 10


@pytest.mark.parametrize("components", [1, 2, 3, 6, 9])
def test_quantiles_and_truncation_against_scipy(components):
    sizes = np.array([components])
    assert medians(sizes)[0] == pytest.approx(chi2.median(components), rel=1e-12)
    tail = 2 * 0.006209665325776132  # P(|z| > 2.5), tables of the normal distribution
    assert limits(sizes, 2.5)[0] == pytest.approx(chi2.isf(tail, components), rel=1e-9)
    assert quantile(0.1, components) == pytest.approx(chi2.isf(0.1, components), rel=1e-12)
    cut = chi2.isf(0.02, components)
    expected = chi2.expect(lambda s: s, args=(components,), lb=0, ub=cut) / components / 0.98
    assert consistency(sizes, np.array([cut]))[0] == pytest.approx(expected, rel=1e-6)


def test_robust_variance_is_the_papers_formula():
    residuals = np.array([0.1, -0.5, 2.0, 0.3, -0.2, 40.0])
    found = robust_variance(residuals**2, scalar_units(6), 2)
    # 1.4826 is rounded in the papers.
    assert np.sqrt(found) == pytest.approx(1.4826 * (1 + 5 / 4) * np.sqrt(np.median(residuals**2)), rel=1e-4)
