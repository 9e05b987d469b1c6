"""What consensus computes of units, group by group and component by component: NumPy and SciPy on a few numbers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from mbm.machine.kinds import LANES
from mbm.solver.consensus_fixed_point import contradicted, group_noise
from mbm.solver.consensus_forms import points_in_closed_form
from mbm.solver.consensus_records import SPHERES
from mbm.solver.consensus_scores import robust_variance
from mbm.solver.consensus_units import norm_directions, unruled_square
from mbm.solver.decisions import CONTRADICTED, STATED


def test_directions_of_units_are_rows_of_the_scaled_jacobian():
    """Three units of one, two and three components; component i of a row stands i groups of lanes behind the first."""
    n, components = 4, np.array([1, 2, 3])
    stride = 4 * LANES
    jacobian = np.random.default_rng(1).normal(size=(6, n)) * [1.0, 10.0, 0.1, 0.0]
    chunk, first, place = np.zeros(n * stride), np.array([0, 1, 3]), np.array([0, 1, 2])
    for u in range(3):
        for i in range(components[u]):
            chunk[np.arange(n) * stride + place[u] + i * LANES] = jacobian[first[u] + i]
    units = SimpleNamespace(count=3, scalars=6, first=first, place=place, components=components)
    work = SimpleNamespace(
        units=units, here=SimpleNamespace(chunk=chunk), coordinates=np.zeros(n), directions=np.full(6 * n, np.nan)
    )
    norm_directions(SimpleNamespace(n=n, chunk=stride), work)
    norms = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(norms > 0, norms, 1.0)
    wanted = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    np.testing.assert_allclose(work.directions.reshape(6, n), wanted, rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize(("share", "wanted"), [(0.99, 0), (1.01, 1)])
def test_inliers_contradict_the_noise_where_they_scatter_more_than_four_deviations(share, wanted):
    """Units of one and of two components have one cut but are cut by different laws; those of other groups are none."""
    components, group = np.array([1, 2, 1, 2, 2, 1, 1, 2]), np.array([STATED] * 6 + [0, STATED])
    inlier, cuts = np.array([1, 1, 1, 1, 1, 1, 1, 0]), np.full(8, 3.0)
    counted = np.flatnonzero((group == STATED) & (inlier == 1))
    total = components[counted].sum()
    freedom = total - 2
    # the variance that χ² truncated at the cut has left, by its recurrence: F(c, k + 2) / F(c, k)
    left = chi2.cdf(3.0, components + 2) / chi2.cdf(3.0, components)
    expected = (components * left)[counted].sum()
    limit = (CONTRADICTED * np.sqrt(2 / freedom) + 1) * expected * freedom / total
    squares = np.full(8, 1e6)
    squares[counted] = share * limit / len(counted)
    units = SimpleNamespace(count=8, inlier=inlier, group=group, cuts=cuts, components=components)
    work = SimpleNamespace(units=units, here=SimpleNamespace(squares=squares), left=2)
    assert contradicted(work) == wanted


def test_squares_that_no_rule_touches():
    residuals, ruled = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.0, 1.0, 0.0, 1.0])
    for simple, wanted in ((0, 10.0), (1, 0.0)):
        work = SimpleNamespace(units=SimpleNamespace(simple=simple), ruled=ruled)
        assert unruled_square(4, residuals, work) == wanted
    work = SimpleNamespace(units=SimpleNamespace(simple=0), ruled=ruled)
    assert unruled_square(4, np.array([np.nan, 0.0, 0.0, 0.0]), work) == np.inf


def test_the_noise_of_a_group_is_that_of_its_inliers_over_their_freedom():
    """Limits so wide that nothing is cut off: SSE / (count · freedom of each), in this group alone."""
    group, inlier = np.array([0, 1, 1, 1, 0, 1]), np.array([1, 1, 1, 0, 1, 1])
    components, squares = np.array([1, 2, 1, 1, 2, 2]), np.array([1.0, 5.0, 2.0, 1e9, 3.0, 4.0])
    units = SimpleNamespace(
        count=6, group=group, inlier=inlier, components=components, rounding=np.zeros(6), noise=np.full(6, -1.0),
        redundancy=0.25 * components,
        limits=np.full(6, 1e6), cuts=np.full(6, 1e6), reaches=np.full(6, 1e6),
    )  # fmt: skip
    work = SimpleNamespace(units=units, rules=SimpleNamespace(thresholded=0))
    group_noise(1, squares, work)
    wanted = 11.0 / (5 * 0.25)
    np.testing.assert_allclose(units.noise, [-1, wanted, wanted, wanted, -1, wanted], rtol=1e-9)


@pytest.mark.parametrize("offset", [0, 1])
def test_chosen_ranges_meet_in_a_point(offset):
    generator = np.random.default_rng(offset)
    stations, truth = generator.uniform(-3, 3, (6, 2)), np.array([1.5, -0.7, 0.4][: 2 + offset])
    lengths = np.linalg.norm(stations - truth[:2], axis=1) - (truth[2] if offset else 0.0)
    forms = np.column_stack([stations, lengths, np.zeros(6), np.ones(6)])
    m, numbers, order = 2 + offset, 5, [4, 0, 2][: 2 + offset]
    work = SimpleNamespace(
        rules=SimpleNamespace(form=SPHERES, form_width=5, about=np.array([2, offset, 0, *order])),
        forms=forms.ravel(), chosen=np.array([5, 1, 3][:m]), form_scratch=np.zeros(400),
        form_order=np.zeros(8, dtype=np.int64), one_side=0,
    )  # fmt: skip
    base, target = np.arange(10.0, 15.0), np.zeros(4 * numbers)
    found = points_in_closed_form(SimpleNamespace(numbers=numbers), m, base, work, target)
    points = target.reshape(4, numbers)[:found]
    rest = [place for place in range(numbers) if place not in order]
    assert (points[:, rest] == base[rest]).all()
    assert np.abs(points[:, order] - truth).max(axis=1).min() < 1e-9


def test_the_robust_variance_is_that_of_rousseeuw_and_leroy():
    """``(1 + 5/(n − p))²`` times the median over that of the law (1987, p. 202); n counts the scalars of all groups."""
    group, squares = np.array([0, 1, 0, 0, 1, 0]), np.array([4.0, 100.0, 1.0, np.inf, 100.0, 9.0])
    medians = np.full(6, chi2.ppf(0.5, 1))
    units = SimpleNamespace(count=6, group=group, medians=medians, scalars=9)
    wanted = (1 + 5 / (9 - 3)) ** 2 * np.median([4.0, 1.0, np.inf, 9.0]) / medians[0]
    assert robust_variance(units, 3, squares, 0, np.zeros(6)) == pytest.approx(wanted, rel=1e-14)
    assert robust_variance(units, 9, squares, 0, np.zeros(6)) == pytest.approx(36 * 6.5 / medians[0], rel=1e-14)
    assert robust_variance(units, 3, squares, 2, np.zeros(6)) == 0.0
