"""Cuts of a normal distribution, against quadrature and sampling."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from mbm.estimation.sequences.types import Prior, Rules
from tests.estimation.sequences.chains import chained

STILL = """(problem m (data s external) (unknowns (a :init 0) (b :init 0) (c :init 0)) {rows}
  (constraints {cuts}) (for-each k))"""
ROWS = "(observe s (= y (+ a b c)) :sigma 1e9)"
MOVES = """(problem d (data s external) (unknowns (a :init 0) (b :init 0) (c :init 0) (c2 :init 0))
  (observe s (= c2 c) :sigma 1) (for-each k))"""


def once_cut(mean, covariance, cuts, steps=1, once=(), skip=3.0):
    """What is left of a normal distribution of three plain numbers."""
    rows = {"k": np.arange(steps), "y": np.zeros(steps)}
    text = STILL.format(rows=ROWS, cuts=" ".join(cuts))
    moves = {"s": {"k": np.arange(max(steps - 1, 1))}}
    sequence = chained((text, {"s": rows}), (MOVES, moves), np.zeros((max(steps - 1, 1), 1, 1)), still=2, once=once)
    prior = Prior.of(point=np.array(mean), covariance=np.array(covariance), unknown=np.zeros(3, bool))
    return sequence.walk(prior, Rules(cut=True, skip=skip))


COVARIANCE = np.array([[1.0, 0.4, 0.1], [0.4, 2.0, -0.3], [0.1, -0.3, 0.5]])
MEAN = np.array([0.2, -0.5, 1.0])


def test_one_cut_of_several_numbers_is_exact():
    """The moments along the cut are one-dimensional ones; what is across it follows by regression."""
    found = once_cut(MEAN, COVARIANCE, ["(<= (- (* 2 a) b (* -0.5 c)) -2)"])
    direction = np.array([2.0, -1.0, 0.5])
    deviation = np.sqrt(direction @ COVARIANCE @ direction)
    cut = (-2 - direction @ MEAN) / deviation
    whole = mpmath.quad(mpmath.npdf, [-mpmath.inf, cut])
    mean = float(mpmath.quad(lambda x: x * mpmath.npdf(x), [-mpmath.inf, cut]) / whole)
    square = float(mpmath.quad(lambda x: x * x * mpmath.npdf(x), [-mpmath.inf, cut]) / whole)
    gain = COVARIANCE @ direction / deviation
    np.testing.assert_allclose(found.points[0], MEAN + gain * mean, rtol=0, atol=1e-12)
    expected = COVARIANCE + np.outer(gain, gain) * (square - mean**2 - 1)
    np.testing.assert_allclose(found.covariances[0], expected, rtol=0, atol=1e-12)


def test_cuts_one_after_the_other_are_those_of_samples_of_normal_distributions():
    """Each is that of a normal distribution with the moments that the cut before has left."""
    cuts = [([1.0, 0, 0], 0.0), ([0, -1.0, 0], 1.0), ([0, 1.0, 0], 0.3), ([1.0, 1.0, -1.0], -1.5)]
    forms = ["(<= a 0)", "(<= -1 b 0.3)", "(<= (- (+ a b) c) -1.5)"]
    found = once_cut(MEAN, COVARIANCE, forms)
    mean, covariance, generator = MEAN, COVARIANCE, np.random.default_rng(1)
    for direction, limit in cuts:
        sample = generator.multivariate_normal(mean, covariance, 1_000_000)
        kept = sample[sample @ direction <= limit]
        mean, covariance = kept.mean(axis=0), np.cov(kept.T)
    # some hundred thousand are kept each time: means to 0.002 or so
    np.testing.assert_allclose(found.points[0], mean, rtol=0, atol=0.01)
    np.testing.assert_allclose(found.covariances[0], covariance, rtol=0, atol=0.01)


def test_the_order_of_cuts_is_that_of_the_source():
    first = once_cut(MEAN, COVARIANCE, ["(<= a 0)", "(<= (+ a b) -1)"]).points[0]
    second = once_cut(MEAN, COVARIANCE, ["(<= (+ a b) -1)", "(<= a 0)"]).points[0]
    assert np.abs(first - second).max() > 1e-3


def test_a_curved_cut_is_linearised_where_the_cut_before_left():
    found = once_cut([1.0, 1.0, 0.0], np.diag([0.01, 0.01, 0.01]), ["(<= a 0.9)", "(<= (* a a) 0.7)"])
    middle = once_cut([1.0, 1.0, 0.0], np.diag([0.01, 0.01, 0.01]), ["(<= a 0.9)"])
    mean, variance = float(middle.points[0][0]), float(middle.covariances[0][0, 0])
    flat = f"(<= (* {2 * mean!r} (- a {mean!r})) {0.7 - mean**2!r})"
    again = once_cut([mean, 1.0, 0.0], np.diag([variance, 0.01, 0.01]), [flat])
    np.testing.assert_allclose(found.points[0], again.points[0], rtol=0, atol=1e-12)


def test_a_far_cut_is_left_out_and_a_violated_one_is_not():
    far = once_cut([0.0, 0.0, 0.0], np.eye(3), ["(<= a 3.1)"])
    near = once_cut([0.0, 0.0, 0.0], np.eye(3), ["(<= a 3.1)"], skip=4.0)
    assert far.points[0][0] == 0.0
    assert near.points[0][0] < 0.0
    violated = once_cut([0.0, 0.0, 0.0], np.eye(3), ["(<= a -1000)"])
    # Mills: the mean of what is left is c − 1/c, its variance 1/c²
    assert violated.points[0][0] == pytest.approx(-1000 - 1e-3, abs=1e-6)
    assert violated.covariances[0][0, 0] == pytest.approx(1e-6, rel=1e-4)


def test_cutting_a_constant_again_and_again_narrows_it_and_cutting_once_does_not():
    """N(0, 1) cut at 0: -0.798 ± 0.603 once, -1.029 ± 0.380 after 10 times (the reference's README)."""
    again = once_cut([0.0, 0.0, 0.0], np.eye(3), ["(<= a 0)"], steps=10)
    assert again.points[9][0] == pytest.approx(-1.029, abs=1e-3)
    assert np.sqrt(again.covariances[9][0, 0]) == pytest.approx(0.380, abs=1e-3)
    once = once_cut([0.0, 0.0, 0.0], np.eye(3), ["(<= a 0)"], steps=10, once=("(<= a 0)",))
    assert once.points[9][0] == pytest.approx(-np.sqrt(2 / np.pi), abs=1e-12)
    assert once.covariances[9][0, 0] == pytest.approx(1 - 2 / np.pi, abs=1e-12)


def test_an_equality_leaves_no_variance():
    found = once_cut(MEAN, COVARIANCE, ["(= (+ a b) 1)"])
    assert found.points[0][:2].sum() == pytest.approx(1.0, abs=1e-14)
    ones = np.array([1.0, 1.0, 0.0])
    gain = COVARIANCE @ ones / (ones @ COVARIANCE @ ones)
    expected = COVARIANCE - np.outer(gain, COVARIANCE @ ones)
    np.testing.assert_allclose(found.covariances[0], expected, rtol=0, atol=1e-14)
