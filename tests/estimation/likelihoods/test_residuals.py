"""Signed roots of deviances and of normal probabilities, against extended precision, near zero and in the tails."""

from __future__ import annotations

from collections.abc import Callable

import mpmath as mp
import numpy as np
import pytest

from mbm.expression.derivative import derivatives
from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Column, Expression, Leaf
from mbm.expression.terms import Term
from mbm.problem.likelihoods import making, tails


def value(of: Callable[..., Term], *numbers: float, slope: int | None = None) -> float:
    """A formula at numbers, or its derivative by one of them."""
    columns = [Column("t", str(i)) for i in range(len(numbers))]
    node: Expression = of(*map(Term, columns)).node
    if slope is not None:
        (node,) = derivatives((node,), columns[slope])

    def looked_up(leaf: Leaf) -> np.ndarray:
        assert isinstance(leaf, Column)
        return np.array([numbers[int(leaf.name)]])

    with np.errstate(all="ignore"):
        return float(np.asarray(next(iter(evaluate((node,), looked_up)))).ravel()[0])


def root(square: mp.mpf, sign: float) -> float:
    return float(mp.sign(sign) * mp.sqrt(square))


@pytest.mark.parametrize("off", [1e-12, 1e-5, 0.19, 0.21, 3.0, 1e3, -1e-12, -0.19, -0.21, -0.99])
@pytest.mark.parametrize("counted", [1.0, 7.0, 1e6])
def test_counts(counted: float, off: float) -> None:
    mean = counted * (1 + off)
    with mp.workdps(60):
        y, m = mp.mpf(counted), mp.mpf(mean)
        wanted = root(2 * (m - y + y * mp.log(y / m)), mean - counted)
        slope = float((1 - y / m) / mp.sqrt(2 * (m - y + y * mp.log(y / m))) * mp.sign(m - y))
    assert value(making.poisson_deviance, counted, mean) == pytest.approx(wanted, rel=1e-14)
    assert value(making.poisson_deviance, counted, mean, slope=1) == pytest.approx(slope, rel=1e-12)


def test_counts_of_nothing_and_where_model_and_count_meet() -> None:
    assert value(making.poisson_deviance, 0.0, 3.0) == pytest.approx(6.0**0.5)
    assert value(making.poisson_deviance, 4.0, 4.0) == 0.0
    assert value(making.poisson_deviance, 4.0, 4.0, slope=1) == pytest.approx(0.5)
    assert np.isnan(value(making.poisson_deviance, 4.0, -1.0))


@pytest.mark.parametrize("share", [1e-3, 0.2, 0.4999999, 0.5, 0.9, 0.9999])
@pytest.mark.parametrize(("counted", "trials"), [(0.0, 5.0), (5.0, 5.0), (2.0, 5.0), (500.0, 1000.0)])
def test_trials(counted: float, trials: float, share: float) -> None:
    mean = trials * share
    with mp.workdps(60):
        y, n, m = mp.mpf(counted), mp.mpf(trials), mp.mpf(mean)
        own = y * mp.log(y / m) if counted else mp.mpf(0)
        rest = (n - y) * mp.log((n - y) / (n - m)) if counted < trials else mp.mpf(0)
        wanted = root(2 * (own + rest), mean - counted)
    assert value(making.binomial_deviance, counted, trials, mean) == pytest.approx(wanted, rel=1e-14, abs=1e-300)


@pytest.mark.parametrize("freedom", [1.0, 3.0, 30.5])
@pytest.mark.parametrize("ratio", [1e-9, 0.3, 0.44, 0.45, -2.0, 1e5])
def test_student(ratio: float, freedom: float) -> None:
    with mp.workdps(60):
        wanted = root((freedom + 1) * mp.log(1 + mp.mpf(ratio) ** 2 / freedom), ratio)
    assert value(making.student_deviance, ratio, freedom) == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("x", [-9.0, -3.0, -0.01, 0.0, 0.01, 2.0, 9.0, 40.0, 1e4])
def test_the_normal_tail(x: float) -> None:
    with mp.workdps(60):
        share = mp.erfc(mp.mpf(x) / mp.sqrt(2)) / 2
        wanted, mills = mp.log(share), mp.exp(-(mp.mpf(x) ** 2) / 2) / mp.sqrt(2 * mp.pi) / share
    # where the share is near 1, its log is as right as 1 - share
    assert value(tails.log_upper, x) == pytest.approx(float(wanted), rel=5e-14)
    assert value(tails.log_upper, x, slope=0) == pytest.approx(-float(mills), rel=1e-12)


def within(u: float, d: float) -> mp.mpf:
    u, d = mp.mpf(abs(u)), mp.mpf(d)
    if u > d:
        return mp.log((mp.erfc((u - d) / mp.sqrt(2)) - mp.erfc((u + d) / mp.sqrt(2))) / 2)
    return mp.log((mp.erf((u + d) / mp.sqrt(2)) - mp.erf((u - d) / mp.sqrt(2))) / 2)


@pytest.mark.parametrize("half", [1e-5, 2e-3, 0.1, 1.0, 3.0, 6.0])
@pytest.mark.parametrize("ratio", [1e-9, 0.04, 0.06, 1.0, -1.0, 4.0, 40.0])
def test_a_rounded_reading(ratio: float, half: float) -> None:
    with mp.workdps(500):
        wanted = root(2 * (within(0.0, half) - within(ratio, half)), ratio)
        slope = mp.diff(lambda u: within(u, half), mp.mpf(ratio))
    # its square is a difference of logarithms, right to 1e-16/half; roots of small ones have twice the relative error
    assert value(tails.within, ratio, half) == pytest.approx(wanted, rel=1e-11, abs=1e-10)
    if half > 1e-3 and abs(wanted) > 1e-3:
        found = value(tails.within, ratio, half) * value(tails.within, ratio, half, slope=0)
        assert found == pytest.approx(float(-slope), rel=1e-9)


@pytest.mark.parametrize("half", [2e-3, 0.1, 1.0, 3.0])
@pytest.mark.parametrize("ratio", [1e-9, 0.3, 1.0, -2.0, 6.0])
def test_what_a_rounded_reading_tells(ratio: float, half: float) -> None:
    with mp.workdps(60):
        wanted = mp.sqrt(-mp.diff(lambda u: within(u, half), mp.mpf(ratio or 1e-30), 2))
    found = value(tails.within_information, ratio, half, slope=0)
    assert found == pytest.approx(float(wanted), rel=1e-6)


@pytest.mark.parametrize("ratio", [-30.0, -1.0, 0.0, 2.0, 8.0])
def test_what_a_limit_tells(ratio: float) -> None:
    with mp.workdps(60):
        wanted = mp.sqrt(-mp.diff(lambda z: mp.log(mp.erfc(-z / mp.sqrt(2)) / 2), mp.mpf(ratio), 2))
    assert value(tails.below_information, ratio, slope=0) == pytest.approx(float(wanted), rel=1e-10)
