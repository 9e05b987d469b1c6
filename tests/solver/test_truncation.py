"""Moments of a cut normal distribution, against extended precision and quadrature."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from mbm.solver.filter_cuts import cut_mean, cut_variance, put_moments

CUTS = (-1e5, -300.0, -40.0, -12.0, -8.0, -5.0, -3.0, -1.7, -1.0, -0.999, -0.3, 0.0, 1e-3, 0.8, 2.0, 3.0, 7.0, 37.9)


@pytest.mark.parametrize("cut", CUTS)
def test_mean_and_variance_are_those_of_extended_precision(solver, cut):
    """Far on the left equation (27) as printed is 0/0, and (26) loses all digits."""
    with mpmath.workdps(60):
        c = mpmath.mpf(cut)
        mean = -mpmath.npdf(c) / mpmath.ncdf(c)
        variance = 1 + c * mean - mean**2
    assert solver("cut_mean", cut) == pytest.approx(float(mean), rel=1e-13, abs=1e-300)
    # for moderate cuts 1 + c ν − ν² is what it is: its terms are up to ten times the sum
    assert solver("cut_variance", cut) == pytest.approx(float(variance), rel=1e-13)


def test_the_mean_is_that_of_quadrature():
    for cut in (-6.0, -2.5, -0.4, 0.0, 1.1):
        lowest = cut - 20  # below it there is 1e-89 of the whole
        whole = mpmath.quad(mpmath.npdf, np.linspace(lowest, cut, 9))
        mean = mpmath.quad(lambda x: x * mpmath.npdf(x), np.linspace(lowest, cut, 9)) / whole
        square = mpmath.quad(lambda x: x * x * mpmath.npdf(x), np.linspace(lowest, cut, 9)) / whole
        assert cut_mean(cut) == pytest.approx(float(mean), rel=1e-12)
        assert cut_variance(cut) == pytest.approx(float(square - mean**2), rel=1e-11)


def within(cut, width):
    """How far the mean of N(0, 1) between ``cut − width`` and ``cut`` is below ``cut``, and its variance."""
    with mpmath.workdps(80):
        high, low = mpmath.mpf(cut), mpmath.mpf(cut) - mpmath.mpf(width)
        if low > 0:  # Φ has all its digits on the left
            high, low = -low, -high
        whole = mpmath.ncdf(high) - mpmath.ncdf(low)
        mean = (mpmath.npdf(low) - mpmath.npdf(high)) / whole
        variance = 1 + (low * mpmath.npdf(low) - high * mpmath.npdf(high)) / whole - mean**2
        below = high - mean
        return float(below if cut - width <= 0 else mpmath.mpf(width) - below), float(variance)


def test_moments_between_two_limits_are_those_of_extended_precision():
    for cut in (-100.0, -30.0, -8.0, -2.0, -0.5, 0.0, 0.3, 1.0, 3.0, 8.0, 12.0, 30.0, 101.0):
        for width in (1e-9, 1e-3, 0.1, 0.5, 1.0, 2.0, 5.0, 9.0, 12.0, 17.0, 25.0, 60.0):
            found = np.zeros(2)
            put_moments(cut, width, found)
            # the quadrature is good to 1e-12
            np.testing.assert_allclose(found, within(cut, width), rtol=1e-11, err_msg=f"{cut} {width}")


def test_compiled_moments_between_two_limits_are_the_same(solver):
    found, expected = np.zeros(2), np.zeros(2)
    for cut, width in ((0.3, 1.2), (-4.0, 0.01), (5.0, 5.5), (2.0, np.inf)):
        solver("put_moments", cut, width, found)
        put_moments(cut, width, expected)
        np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_a_cut_beyond_all_that_is_there_cuts_nothing():
    """Between 37.7 and 38 deviations 1/φ overflowed where the text is interpreted."""
    assert cut_mean(37.9) == pytest.approx(0.0, abs=1e-300)
    assert cut_variance(37.9) == pytest.approx(1.0, abs=1e-300)
