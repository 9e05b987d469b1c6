"""Streams with consensus: the answers of whole solves, data set by data set, by any number of threads."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.estimation.native.test_consensus import CEILING, POSE, RANGES, marks, ranges

pytest.importorskip("llvmlite")

STARTLESS = RANGES.replace(" :init [1.75m 1.75m 1m]", "")


def pose_estimator(rule="msac", count=20):
    compiled = mbm.loads(POSE.format(rule=rule)).compile(data=marks(0, count, 4), backend="native")
    return compiled, compiled.estimator("x", "y", "z", "u", "v")


def columns(data):
    return [np.asarray(data["marks"][name]) for name in "xyzuv"]


def assert_same(found, solved, names):
    expected = np.concatenate([np.ravel(solved[name].value) for name in names])
    # One algorithm from one start: whole solves differ by the unit of the report at most.
    np.testing.assert_allclose(found.values, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.covariance, solved.covariance.matrix, rtol=1e-9)
    assert found.cost == pytest.approx(solved.first.cost, rel=1e-9)
    assert found.status == solved.first.status


@pytest.mark.parametrize("rule", ["lmeds", "msac", "(ransac :threshold 2.5)"])
def test_poses_are_those_of_whole_solves(rule):
    compiled, estimator = pose_estimator(rule)
    assert estimator.fast
    for seed in range(1, 6):
        data = marks(seed, 20, 2 * (seed % 4))
        assert_same(estimator(*columns(data)), compiled.solve(data=data), ("T",))


@pytest.mark.parametrize("text", [RANGES, STARTLESS])
def test_places_are_those_of_whole_solves(text):
    compiled = mbm.loads(text.format(rule="lmeds", noise=":sigma 5mm")).compile(data=ranges(0, 5), backend="native")
    estimator = compiled.estimator("range")
    assert estimator.fast
    for seed, outliers in enumerate((0, 1, 5, 14)):
        data = ranges(seed, outliers)
        found = estimator(data["ranges"]["range"])
        assert found.clean
        assert_same(found, compiled.solve(data=data), ("p",))


def test_without_a_start_places_are_on_the_same_side_of_the_stations_for_all():
    """Both sides of the ceiling fit equally well: backends, first solves and later ones take the same."""
    text = STARTLESS.format(rule="lmeds", noise=":sigma 5mm")
    sets = [ranges(seed, 5) for seed in range(12)]
    general = [mbm.loads(text).compile(data=each, backend="casadi").solve()["p"].value for each in sets]
    first = [mbm.loads(text).compile(data=each, backend="native").solve()["p"].value for each in sets]
    estimator = mbm.loads(text).compile(data=sets[0], backend="native").estimator("range")
    many = estimator.many(np.stack([each["ranges"]["range"] for each in sets])).values
    # Minima are met to 1e-8 standard deviations of some millimetres; the sides are metres apart.
    np.testing.assert_allclose(first, general, rtol=0, atol=1e-6)
    np.testing.assert_allclose(many, general, rtol=0, atol=1e-6)


def test_errors_are_as_large_as_stated():
    """The covariance accounts for the good rows that were cut off with the bad ones."""
    generator = np.random.default_rng(4)
    places = generator.uniform([0.8, 0.8, 0.3], [2.7, 2.7, 1.3], (2000, 3))
    measured = np.linalg.norm(places[:, None] - CEILING, axis=2) + 0.005 * generator.normal(size=(2000, 48))
    measured[:, :5] += 0.5
    compiled = mbm.loads(RANGES.format(rule="lmeds", noise=":sigma 5mm")).compile(data=ranges(0, 5))
    found = compiled.estimator("range").many(measured)
    errors = found.values - places
    # χ² with 6,000 degrees of freedom over these: 1 ± 0.018; within four standard deviations.
    scaled = np.einsum("ti,tij,tj->t", errors, np.linalg.inv(found.covariance), errors).mean() / 3
    assert scaled == pytest.approx(1.0, abs=0.075)


def test_many_are_those_of_one_by_one_whatever_the_threads():
    _, estimator = pose_estimator()
    given = [np.stack(each) for each in zip(*(columns(marks(k, 20, k % 9)) for k in range(210)), strict=True)]
    one = [estimator(*(column[t] for column in given)) for t in range(0, 210, 10)]
    alone = estimator.many(*given, workers=1)
    for workers in (2, 3):
        many = estimator.many(*given, workers=workers)
        for name in ("values", "covariance", "cost", "status", "clean"):
            np.testing.assert_array_equal(getattr(many, name), getattr(alone, name))
    np.testing.assert_array_equal(alone.values[::10], np.array([each.values for each in one]))
    np.testing.assert_array_equal(alone.covariance[::10], np.array([each.covariance for each in one]))


def test_too_few_that_agree_are_left_to_the_general_path():
    compiled, estimator = pose_estimator()
    data = marks(3, 20, 14)
    found = estimator(*columns(data))
    assert not found.clean
    assert found.status == compiled.solve(data=data).first.status == "not-converged"


@pytest.mark.parametrize("cell", [np.nan, np.inf])
def test_cells_that_are_no_numbers_are_refused_not_left_out(cell):
    compiled = mbm.loads(RANGES.format(rule="lmeds", noise=":sigma 5mm")).compile(data=ranges(0, 5))
    estimator = compiled.estimator("range")
    measured = ranges(0, 5)["ranges"]["range"]
    measured[3] = cell
    for ask in (lambda: estimator(measured), lambda: estimator.many(measured[None])):
        with pytest.raises(mbm.MbmError, match="not-finite-cell"):
            ask()


def test_an_outlier_of_any_size_is_left_out():
    compiled = mbm.loads(RANGES.format(rule="lmeds", noise=":sigma 5mm")).compile(data=ranges(0, 5))
    data = ranges(3, 5)
    data["ranges"]["range"][7] = 1e300
    found = compiled.estimator("range")(data["ranges"]["range"])
    assert found.clean
    assert_same(found, compiled.solve(data=data), ("p",))


def test_data_sets_with_other_planes_of_stations_are_as_they_are_alone():
    """Places mirror one another in each plane by itself, though not in all planes together."""
    compiled = mbm.loads(RANGES.format(rule="lmeds", noise=":sigma 5mm")).compile(data=ranges(0, 5))
    estimator = compiled.estimator("z", "range")
    heights = np.repeat([2.7, 2.7, 3.1, 4.0], 48).reshape(4, 48)
    measured = np.stack([ranges(seed, 5)["ranges"]["range"] for seed in range(4)])
    many = estimator.many(heights, measured)
    for k in range(4):
        alone = estimator(heights[k], measured[k])
        np.testing.assert_array_equal(many.values[k], alone.values)
        np.testing.assert_array_equal(many.covariance[k], alone.covariance)


def test_no_data_sets_have_no_answers():
    _, estimator = pose_estimator()
    found = estimator.many(*np.empty((5, 0, 20)))
    assert found.values.shape == (0, 7)
    assert found.covariance.shape == (0, 6, 6)
    assert found.cost.shape == found.status.shape == found.clean.shape == (0,)


@pytest.mark.parametrize(("rule", "noise"), [("lmeds", ""), ("gnc", ":sigma 5mm"), ("none", ":sigma 5mm :loss tukey")])
def test_what_has_no_native_stream_is_answered_all_the_same(rule, noise):
    text = (STARTLESS if rule == "gnc" else RANGES).format(rule=rule, noise=noise)
    compiled = mbm.loads(text).compile(data=ranges(0, 5), backend="native")
    estimator = compiled.estimator("range")
    assert not estimator.fast
    data = ranges(1, 5)
    assert_same(estimator(data["ranges"]["range"]), compiled.solve(data=data), ("p",))
