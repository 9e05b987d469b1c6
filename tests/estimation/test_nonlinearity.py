"""The ends of 95 % intervals against those of the profile likelihood, found by minimising over all other unknowns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares

import mbm
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.estimation.trust.nonlinearity import NORMAL_95, TOLERATED, IntervalEnds, interval_ends, surroundings
from mbm.estimation.uncertainty.observability import covariance, observability
from tests.estimation.nist import MODELS
from tests.estimation.nist_typed import TYPED


@dataclass(frozen=True)
class Curve:
    """A function to be fitted to measured values with noise of variance 1 (protocol ``Equations``)."""

    model: Callable[[np.ndarray], np.ndarray]
    measured: np.ndarray
    dimension: int
    linear: bool = False

    @property
    def count(self) -> int:
        return len(self.measured)

    @property
    def lower(self) -> np.ndarray:
        return np.full(self.dimension, -np.inf)

    @property
    def upper(self) -> np.ndarray:
        return np.full(self.dimension, np.inf)

    @property
    def positive(self) -> np.ndarray:
        return np.zeros(self.dimension, dtype=bool)

    def residuals(self, x: np.ndarray) -> np.ndarray:
        return np.asarray(self.model(x) - self.measured)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        steps = 1e-30j * np.eye(self.dimension)
        return np.stack([np.imag(self.model(x + step)) / 1e-30 for step in steps], axis=1)

    def retract(self, x: np.ndarray, step: np.ndarray) -> np.ndarray:
        return x + step

    def coordinates(self, x: np.ndarray) -> np.ndarray:
        return x

    def placed(self, x: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        return coordinates


def checked(curve: Curve, start: np.ndarray) -> tuple[IntervalEnds, np.ndarray, np.ndarray, float]:
    """The ends, the point, the sigmas, and the variance of unit weight."""
    minimum = minimise(curve, start, Settings())
    observed = observability(minimum.jacobian, minimum.point, minimum.at_bound != 0)
    variance = minimum.cost / (curve.count - curve.dimension)
    estimated = covariance(observed, variance)
    found = surroundings(curve, minimum, estimated)
    assert found is not None
    return interval_ends(found, estimated), minimum.point, estimated.sigma, variance


def profile_end(curve: Curve, x: np.ndarray, place: int, sigma: float, variance: float, sign: int) -> float:
    """Where the cost, minimised over the others, has grown by 1.96² variances: in multiples of 1.96 sigma."""
    least = float(np.sum(curve.residuals(x) ** 2))
    others = np.delete(x, place)

    def growth(times: float) -> float:
        nonlocal others
        value = x[place] + sign * times * NORMAL_95 * sigma

        def held(rest: np.ndarray) -> np.ndarray:
            return curve.residuals(np.insert(rest, place, value))

        def slope(rest: np.ndarray) -> np.ndarray:
            return np.delete(curve.jacobian(np.insert(rest, place, value)), place, axis=1)

        fit = least_squares(held, others, jac=slope, x_scale="jac", xtol=1e-13, ftol=1e-13, gtol=1e-13)
        others = fit.x
        return (2 * fit.cost - least) / variance - NORMAL_95**2

    for times in np.arange(0.2, 5.0, 0.2):  # walk outwards, each fit starting at the last
        if growth(float(times)) > 0:
            return float(brentq(growth, times - 0.2, times, xtol=1e-4))
    return float("inf")


def typed(name: str) -> tuple[Curve, np.ndarray]:
    found = next(each for each in TYPED if each.name == name)
    model = MODELS[name]
    return Curve(lambda b: model(b, found.x), found.y, len(found.certified)), np.array(found.certified, dtype=float)


@pytest.mark.parametrize("name", ["Misra1d", "Eckerle4", "BoxBOD", "MGH09", "MGH17", "Rat43", "Thurber"])
def test_ends_are_those_of_the_profile(name: str) -> None:
    """The quick look agrees to a tenth, half of what makes it look closer; doubtful ends, which are followed until the
    root of the growth is met to 1 %, to 4 %, where the profile flattens."""
    curve, start = typed(name)
    ends, x, sigma, variance = checked(curve, start)
    for place in range(curve.dimension):
        for sign, found in ((-1, ends.lower[place]), (1, ends.upper[place])):
            true = profile_end(curve, x, place, sigma[place], variance, sign)
            assert found == pytest.approx(true, rel=0.04 if place in ends.doubtful else 0.1)
            assert abs(true - 1) < TOLERATED or place in ends.doubtful


def test_a_decay_with_few_points_is_doubtful_and_longer_above() -> None:
    x = np.array([1.0, 2, 3, 5, 7, 10])
    curve = Curve(lambda b: b[0] * (1 - np.exp(-b[1] * x)), np.array([109.0, 149, 149, 191, 213, 224]), 2)
    ends, *_ = checked(curve, np.array([200.0, 0.5]))
    assert ends.doubtful.tolist() == [1]
    assert ends.upper[1] > 1 + TOLERATED
    assert (ends.lower < 1).all()


BEARINGS = """(problem bearings
  (data b external)
  (unknowns (p (vector 2) :init [{far} 0]))
  (observe b (= direction (atan2 (- (p 2) y) (p 1))) :sigma 1deg))"""
"""Two stations 2 m apart sight a target: its distance follows from a small difference of directions."""


def sighted(far: float) -> mbm.Solved:
    y = np.array([-1.0, 1.0, -1.0, 1.0])
    return mbm.loads(BEARINGS.format(far=far)).solve(data={"b": {"y": y, "direction": np.arctan2(-y, far)}})


def test_triangulation_at_long_range_warns_that_the_target_may_be_farther() -> None:
    """At 30 m the two directions differ by 3.8°, known to 1.4°: the far end of the range is nearly open."""
    solve = sighted(30.0).first
    assert solve.status == "converged"
    (warning,) = [d for d in solve.diagnostics if d.code.name == "too-nonlinear"]
    assert "`p[1]`" in warning.message
    assert "above" in warning.message


def test_triangulation_at_short_range_does_not() -> None:
    assert not [d for d in sighted(3.0).first.diagnostics if d.code.name == "too-nonlinear"]


def doubted(text: str) -> list[str]:
    """What is said to be too nonlinear."""
    return [d.message for d in mbm.loads(text).solve().first.diagnostics if d.code.name == "too-nonlinear"]


@pytest.mark.parametrize(("share", "warned"), [(0.6, False), (0.7, True)])
def test_an_unknown_is_doubted_from_a_quarter_on(share: float, warned: bool) -> None:
    """x² = 9 with 1.96 σ = share · 9: the lower end lies 2 / (1 + √(1 - share)) times as far as stated, that is 1.225
    and 1.292 times."""
    sigma = share * 9 / NORMAL_95
    found = doubted(f"(problem p (unknowns (x :init 3)) (observe (= 9 (^ x 2)) :sigma {sigma!r}))")
    assert bool(found) == warned


@pytest.mark.parametrize(("share", "warned"), [(0.48, False), (0.52, True)])
def test_a_derived_quantity_is_doubted_from_a_quarter_on(share: float, warned: bool) -> None:
    """x = 3 with 1.96 σ = share · 3: the ends of x² lie share / 2 nearer and farther than is stated."""
    sigma = share * 3 / NORMAL_95
    found = doubted(f"(problem p (unknowns (x :init 3)) (observe (= 3 x) :sigma {sigma!r}) (derive (square (^ x 2))))")
    assert bool(found) == warned
    assert all("`square`" in message for message in found)


@pytest.mark.parametrize("side", [0.01, 0.0, -0.01])
def test_a_derived_angle_may_have_an_interval_across_the_cut(side: float) -> None:
    """A direction of 180° ± 0.6°: it jumps by a turn within its interval, and is as good as any other."""
    at = f"[-10 {side}]"
    text = f"""(problem p (unknowns (v (vector 2) :init {at})) (observe (= {at} v) :sigma 0.1)
      (derive (direction (atan2 (v 2) (v 1)))))"""
    solved = mbm.loads(text).solve()
    assert float(solved["direction"].sigma) == pytest.approx(0.01, rel=1e-5)  # the distance is 10 to 5e-7
    assert not solved.first.diagnostics


def test_linear_models_end_where_it_is_stated() -> None:
    x = np.linspace(0, 1, 5)
    bent = Curve(lambda b: b[0] + b[1] * x, x**2, 2)
    found, *_ = checked(bent, np.zeros(2))
    np.testing.assert_allclose([found.lower, found.upper], 1.0, rtol=1e-9)  # rounding only


def test_nothing_is_said_where_the_cost_is_not_that_of_the_covariance() -> None:
    """A covariance twice as large in one direction, as a robust loss gives, and a cost of other equations."""
    curve, start = typed("Misra1d")
    minimum = minimise(curve, start, Settings())
    estimated = covariance(observability(minimum.jacobian, minimum.point, minimum.at_bound != 0))
    assert surroundings(curve, minimum, estimated) is not None
    other = replace(estimated, factor=estimated.factor * [1.0, 2.0])
    assert surroundings(curve, minimum, other) is None
    assert surroundings(curve, replace(minimum, cost=2 * minimum.cost), estimated) is None


def test_an_end_without_a_value_of_the_model_counts_as_nearer() -> None:
    """log(b − 0.9) with b = 1 ± 0.07: 1.96 deviations below is less than 0.9, where there is nothing."""
    curve = Curve(
        lambda b: 2 * np.log(np.where(b[0].real > 0.9, b[0] - 0.9, np.nan)) * np.ones(3),
        2 * np.log(0.1) + np.array([2.5, 0, -2.5]),
        1,
    )
    ends, x, sigma, variance = checked(curve, np.array([1.0]))
    assert ends.doubtful.tolist() == [0]
    assert x[0] - NORMAL_95 * sigma[0] < 0.9
    assert ends.lower[0] == pytest.approx(profile_end_alone(curve, x[0], sigma[0], variance), rel=0.02)


def profile_end_alone(curve: Curve, x: float, sigma: float, variance: float) -> float:
    """The lower end where there are no other unknowns."""
    least = np.sum(curve.residuals(np.array([x])) ** 2)

    def growth(b: float) -> float:
        return float(np.sum(curve.residuals(np.array([b])) ** 2) - least - NORMAL_95**2 * variance)

    return (x - float(brentq(growth, 0.9 + 1e-9, x))) / (NORMAL_95 * sigma)
