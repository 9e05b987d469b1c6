"""The rank decision, the free combinations, and what keeps its covariance."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

import mbm
from mbm.estimation.uncertainty.freedom import free_combinations
from mbm.estimation.uncertainty.observability import covariance, observability, propagate
from tests.estimation.nist import Regression
from tests.estimation.nist_typed import TYPED


def observe(jacobian, point, fixed=()):
    mask = np.zeros(len(point), bool)
    mask[list(fixed)] = True
    return observability(np.asarray(jacobian, float), np.asarray(point, float), mask)


@pytest.mark.parametrize("reference", TYPED, ids=lambda s: s.name)
def test_ill_conditioned_sets_are_not_deficient(reference):
    problem = Regression(reference)
    observed = observe(problem.jacobian(reference.certified), reference.certified)
    assert observed.observable
    assert observed.combinations == ()
    assert observed.estimable.all()


def test_high_degree_polynomial_is_not_deficient():
    # Condition 5e9 after scaling, as in StRD's Filip: singular values that fall step by step.
    x = np.linspace(-8.8, -3.1, 82)
    observed = observe(x[:, None] ** np.arange(11), np.ones(11))
    assert observed.condition > 1e8
    assert observed.rank == 11


def test_product_pair_is_one_free_combination_and_the_rest_keeps_its_sigma():
    # r = a b y_i + c - d_i at a = 2, b = 3e5: only a b is determined.
    y = np.linspace(1, 2, 9)
    jacobian = np.stack([3e5 * y, 2 * y, np.ones(9)], axis=1)
    observed = observe(jacobian, [2.0, 3e5, 1.0])
    assert (observed.dimension, observed.rank) == (3, 2)
    (combination,) = observed.combinations
    assert combination.indices == (0, 1)
    # δa/a = -δb/b, to the rounding of the null vector.
    assert combination.relative == pytest.approx((1.0, -1.0), rel=1e-9) or combination.relative == pytest.approx(
        (-1.0, 1.0), rel=1e-9
    )
    assert combination.coefficients[0] / combination.coefficients[1] == pytest.approx(-2.0 / 3e5, rel=1e-9)
    assert observed.estimable.tolist() == [False, False, True]
    estimated = covariance(observed)
    assert np.isnan(estimated.sigma[:2]).all()
    # The same problem in q = a b and c has a covariance by the textbook.
    textbook = np.linalg.inv(np.stack([y, np.ones(9)], axis=1).T @ np.stack([y, np.ones(9)], axis=1))
    assert estimated.sigma[2] == pytest.approx(np.sqrt(textbook[1, 1]), rel=1e-12)
    derived = propagate(np.array([[3e5, 2.0, 0.0], [1.0, 0.0, 0.0], [3e5, 2.0, 1.0]]), observed, estimated)
    assert derived.estimable.tolist() == [True, False, True]
    assert derived.sigma[0] == pytest.approx(np.sqrt(textbook[0, 0]), rel=1e-9)
    assert derived.matrix[0, 2] == pytest.approx(textbook[0, 0] + textbook[0, 1], rel=1e-9)
    assert np.isnan(derived.sigma[1])


def test_unused_unknown_is_named_apart():
    observed = observe([[1, 0, 2], [1, 0, -1], [0, 0, 1]], [1, 1, 1])
    assert observed.unused == (1,)
    assert observed.combinations == ()
    assert (observed.dimension, observed.rank) == (3, 2)
    assert observed.estimable.tolist() == [True, False, True]
    sigma = covariance(observed).sigma
    assert np.isnan(sigma[1])
    assert np.isfinite(sigma[[0, 2]]).all()


def test_separate_groups_come_apart():
    # Two pairs known only by their sums, in one matrix mixed by an orthogonal transformation of the rows.
    random = np.random.default_rng(1)
    block = np.zeros((12, 5))
    block[:, 0] = block[:, 3] = random.normal(size=12)
    block[:, 1] = random.normal(size=12)
    block[:, 2] = random.normal(size=12)
    block[:, 4] = 2 * block[:, 2]
    mixed = np.linalg.qr(random.normal(size=(12, 12)))[0] @ block
    observed = observe(mixed, [1.0, 2.0, 0.0, 4.0, 5.0])
    assert [c.indices for c in observed.combinations] == [(0, 3), (2, 4)]
    by_group = {c.indices: c for c in observed.combinations}
    first = by_group[(0, 3)]
    assert first.coefficients[0] == pytest.approx(-first.coefficients[1], rel=1e-9)
    second = by_group[(2, 4)]
    # Coordinate 2 is zero: there is no relative change of it.
    assert second.relative is None
    assert second.coefficients[0] == pytest.approx(-2 * second.coefficients[1], rel=1e-9)
    assert observed.estimable.tolist() == [False, True, False, False, False]


def test_common_scale_of_a_monocular_view():
    # Bearings fix positions up to a common factor: δx/x equal for all.
    point = np.array([2.0, -3.0, 0.5, 4.0])
    rows = np.array([[1 / 2, 1 / 3, 0, 0], [0, 1 / 3, 2, 0], [0, 0, 2, -1 / 4], [1 / 2, 0, 0, -1 / 4]])
    observed = observe(rows, point)
    (combination,) = observed.combinations
    assert combination.indices == (0, 1, 2, 3)
    np.testing.assert_allclose(combination.relative, np.ones(4), rtol=1e-9)
    ratios = propagate(np.array([[1 / 2, 1 / 3, 0, 0]]), observed, covariance(observed))
    assert ratios.estimable.tolist() == [True]


def test_dependence_blurred_by_large_coordinates_is_found():
    random = np.random.default_rng(5)
    jacobian = random.normal(size=(30, 4))
    jacobian[:, 3] = (jacobian[:, 0] + jacobian[:, 1]) * (1 + 1e-10 * random.normal(size=30))
    assert observe(jacobian, np.ones(4)).rank == 3


def test_decision_does_not_depend_on_units():
    jacobian = np.random.default_rng(2).normal(size=(10, 3)) * np.array([1e-12, 1.0, 1e15])
    assert observe(jacobian, np.ones(3)).rank == 3


def test_coordinate_at_a_bound_is_known():
    random = np.random.default_rng(4)
    jacobian = random.normal(size=(10, 3))
    observed = observe(jacobian, np.ones(3), fixed=[1])
    assert (observed.dimension, observed.rank) == (2, 2)
    estimated = covariance(observed, variance=4.0)
    expected = 4 * np.linalg.inv(jacobian[:, [0, 2]].T @ jacobian[:, [0, 2]])
    np.testing.assert_allclose(estimated.matrix[np.ix_([0, 2], [0, 2])], expected, rtol=1e-12)
    assert (estimated.matrix[1] == 0).all()
    assert estimated.sigma[1] == 0


def test_fewer_equations_than_unknowns():
    observed = observe([[1.0, 1.0, 1.0]], [1, 2, 3])
    assert (observed.rank, len(observed.combinations)) == (1, 2)
    assert not observed.estimable.any()


def test_nothing_used_at_all():
    observed = observe(np.zeros((4, 2)), [1, 2])
    assert (observed.rank, observed.unused) == (0, (0, 1))
    assert np.isnan(covariance(observed).sigma).all()


def test_free_combinations_span_the_null_space():
    """Each has a coordinate of its own; together they are what the rows leave free (by SVD of the same rows)."""
    generator = np.random.default_rng(5)
    jacobian = generator.normal(size=(3, 40)) * np.geomspace(1e-3, 1e3, 40)
    observed = observe(jacobian, np.ones(40))
    found = np.zeros((37, 40))
    for row, combination in zip(found, observed.combinations, strict=True):
        row[list(combination.indices)] = combination.coefficients
    assert np.linalg.matrix_rank(found / np.abs(found).max(axis=1)[:, None] * np.linalg.norm(jacobian, axis=0)) == 37
    sizes = np.abs(jacobian) @ np.abs(found).T  # what cancels, to the share below which coefficients are not named
    assert (np.abs(jacobian @ found.T) <= 1e-6 * sizes).all()
    own = [
        set(c.indices) - set().union(*(o.indices for o in observed.combinations if o is not c))
        for c in observed.combinations
    ]
    assert all(own)


def test_few_directions_of_very_many_unknowns_take_little_memory():
    """100,000 unknowns would be 80 GB as a square; two of the directions move ten unknowns each."""
    null_space = np.zeros((100_000, 2))
    null_space[10:20, 0] = null_space[99_000:99_010, 1] = 10**-0.5
    found = free_combinations(null_space, np.ones(100_000), np.ones(100_000))
    assert [c.indices for c in found] == [tuple(range(10, 20)), tuple(range(99_000, 99_010))]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_points_of_a_line_leave_the_turn_about_it_open(axis: int) -> None:
    """The derivative by a turn about an axis of coordinates is the rounding of a product with zeros, or zero."""
    rng = np.random.default_rng(3)
    sets, points = 60, 2
    places = np.zeros((points, 3))
    places[:, axis] = np.arange(points)
    turns = np.linalg.qr(rng.normal(size=(sets, 3, 3)))[0]
    turns[:, :, 0] *= np.linalg.det(turns)[:, None]
    seen = places @ turns.transpose(0, 2, 1) + rng.normal(size=(sets, 1, 3)) + 0.01 * rng.normal(size=(sets, points, 3))
    columns = dict(zip("xyz", np.tile(places, (sets, 1)).T, strict=True)) | dict(
        zip("uvw", seen.reshape(-1, 3).T, strict=True)
    )
    text = """(problem line (data d external) (unknowns (T (pose 3) :init (pose3)))
      (observe d (= [u v w] (transform T [x y z])) :sigma 0.01) (for-each g))"""
    solves = mbm.loads(text).solve(data={"d": {"g": np.repeat(np.arange(sets), points)} | columns}).solves
    assert {solve.observability.rank for solve in solves} == {5}
    assert all(np.isnan(solve["T"].sigma[axis]) for solve in solves)


JULIAN = 2450000.0 + np.arange(20)
PARABOLA = "(unknowns (a :init 0) (b :init 0) (c :init 0)) (observe d (= y (+ a (* b x) (* c x x))) {more})"
COLUMN_ERRORS = 20 * 2.2e-16
"""Of columns of length 1: the rounding of their elements and of sums over twenty rows."""


@pytest.mark.parametrize("more", [":sigma 0.1", ":sigma unknown", ":sigma 0.1 :loss (huber 100)"])
def test_a_parabola_of_julian_dates_has_the_sigmas_of_fifty_digits(more):
    y = np.round(1.0 + 0.5 * np.arange(20) - 0.011 * np.arange(20) ** 2 + 0.1 * np.cos(np.arange(20) ** 2), 6)
    rows = " ".join(f"({x!r} {v!r})" for x, v in zip(JULIAN.tolist(), y.tolist(), strict=True))
    text = f"(problem p (data d (table (x y) {rows})) {PARABOLA.format(more=more)} (derive (top (/ b (* -2 c)))))"
    solve = mbm.loads(text).solve().solves[0]
    # Losses that cut nothing off take the noise from the residuals, as an unknown one.
    with mpmath.workdps(50):
        columns = mpmath.matrix([[1, x, x * x] for x in map(mpmath.mpf, JULIAN.tolist())])
        inverse = (columns.T * columns) ** -1
        found = inverse * columns.T * mpmath.matrix(y.tolist())
        left = mpmath.matrix(y.tolist()) - columns * found
        noise = mpmath.sqrt(sum(r * r for r in left) / 17) if more != ":sigma 0.1" else mpmath.mpf(0.1)
        sigmas = [float(noise * mpmath.sqrt(inverse[i, i])) for i in range(3)]
        top = -found[1] / (2 * found[2])
        slopes = mpmath.matrix([[0, -1 / (2 * found[2]), found[1] / (2 * found[2] ** 2)]])
        sigma = float(noise * mpmath.sqrt((slopes * inverse * slopes.T)[0]))
    scaled = JULIAN[:, None] ** np.arange(3)
    share = COLUMN_ERRORS * np.linalg.cond(scaled / np.linalg.norm(scaled, axis=0))
    assert share < 0.01
    for name, expected, value in zip("abc", sigmas, found, strict=True):
        assert solve[name].sigma == pytest.approx(expected, rel=share)
        assert abs(float(solve[name].value) - float(value)) < 0.1 * expected
    assert solve["top"].sigma == pytest.approx(sigma, rel=0.01)
    assert float(solve["top"].value) == pytest.approx(float(top), abs=0.1 * sigma)


def test_states_at_millisecond_steps_keep_the_offset_that_only_priors_part():
    """Of o + x, known to 0.1 mm, and two priors of 1 m: half of each variance is left, 1e-8 of it from the rows."""
    rows = " ".join(f"({k}ms {0.3 + 0.001 * k:.3f}m)" for k in range(6))
    text = f"""(problem p (data d (table (t y) {rows})) (unknowns (o :init 0m :sigma 1m))
      (states :over t (x :init 0m :sigma 1m)) (dynamics (constant-velocity x :acceleration 0.1m/s^2))
      (observe d (= y (+ x o)) :sigma 0.1mm)"""
    batch, smoother = (mbm.loads(f"{text} {more})").solve().solves[0] for more in ("", "(solve :method smoother)"))
    assert batch["o"].sigma == pytest.approx(np.sqrt(0.5), rel=1e-6)
    for name in ("o", "x", "x.rate"):
        np.testing.assert_allclose(batch[name].sigma, smoother[name].sigma, rtol=1e-4)
        np.testing.assert_allclose(batch[name].value, smoother[name].value, atol=1e-6)


def test_what_cannot_be_told_in_affine_equations_stays_so():
    """Decimal numbers of all sizes, one column the sum of two others: as `math.fsum` rounds it."""
    random = np.random.default_rng(7)
    for size in np.geomspace(1e-6, 1e9, 16):
        parts = np.round(size * random.normal([1.0, 1e3, 0.0], 1.0, size=(40, 3)), 3 - int(np.log10(size)))
        jacobian = np.column_stack([parts, [math.fsum(row[:2]) for row in parts]])
        observed = observability(jacobian, np.ones(4), np.zeros(4, bool), affine=True)
        assert observed.rank == 3
        assert observed.estimable.tolist() == [False, False, True, False]


@pytest.mark.parametrize(
    ("apart", "rate"),
    [(1, 0.00066501245), (5, 0.0014541524), (20, 0.00267678), (100, 0.0041330424), (500, 0.0044544932)],
)
def test_weak_directions_of_large_problems_keep_their_digits(apart, rate):
    """801 unknowns: the normal equations, of a condition of 1e17 to 1e25, have none of what parts o from x.

    The last rate's deviation is that of the smoother, which never forms them. Half of the first reading is in o.
    """
    rows = " ".join(f"({apart * k}ms {0.3 + 0.001 * k:.4f}m)" for k in range(400))
    text = f"""(problem p (data d (table (t y) {rows})) (unknowns (o :init 0m :sigma 1m))
      (states :over t (x :init 0m :sigma 1m)) (dynamics (constant-velocity x :acceleration 0.1m/s^2))
      (observe d (= y (+ x o)) :sigma 0.1mm))"""
    solve = mbm.loads(text).solve().solves[0]
    assert str(solve.status) == "converged"
    assert solve["o"].value == pytest.approx(0.15, abs=1e-6)
    assert solve["o"].sigma == pytest.approx(np.sqrt(0.5), rel=1e-6)
    # What is left of the condition; and equations without noise weigh 1e-4 in the batch, nothing in the smoother.
    assert solve["x.rate"].sigma[-1] == pytest.approx(rate, rel=2e-3 if apart < 5 else 1e-4)


@pytest.mark.parametrize("each", ["", "(for-each k)"])
@pytest.mark.parametrize("noise", ["1mm", "unknown"])
def test_dependences_through_differences_of_large_coordinates_are_exact(each: str, noise: str) -> None:
    """Points of one line tell no plane; the differences of their grid coordinates have errors of 1e-10."""
    text = f"""(problem plane (data d external) (unknowns (a :init 0m) (b :init 0) (c :init 0)) {each}
      (observe d (= z (+ a (* b (- e 500000m)) (* c (- n 5400000m)))) :sigma {noise}))"""
    along = np.round(np.arange(12) * 0.2 + 0.1, 1)
    data = {"e": 500000 + along, "n": np.round(5400000 + 2 * along + 0.1, 1), "z": 100 + 0.05 * along, "k": along * 0}
    data["z"] = data["z"] + 1e-3 * np.cos(np.arange(12.0))
    found = mbm.loads(text).solve(data={"d": data}).solves[0]
    assert found.status == "unobservable"
    assert found.observability.rank == 2
