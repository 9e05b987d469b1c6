"""The examples of GUM Supplement 1 (JCGM 101:2008), clause 9: published results, and exact distributions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import ncx2, norm

import mbm

TRIALS = 200_000
"""In the tests of every run; the published results are of a million."""

ADDITIVE = """
(problem additive
  (constants (x1 {0}) (x2 {0}) (x3 {0}) (x4 {1}))
  (derive (y (+ x1 x2 x3 x4))))
"""
NORMAL, RECTANGULAR = "0 :sigma 1", "0 :prior (rectangular (- (sqrt 3)) (sqrt 3))"
WIDE = "0 :prior (rectangular (* -10 (sqrt 3)) (* 10 (sqrt 3)))"

MASS = """
(problem mass
  (constants (mr 100000.000mg :sigma 0.050mg) (dmr 1.234mg :sigma 0.020mg)
             (rho-a 1.20kg/m^3 :prior (rectangular 1.10kg/m^3 1.30kg/m^3))
             (rho-w 8000kg/m^3 :prior (rectangular 7000kg/m^3 9000kg/m^3))
             (rho-r 8000kg/m^3 :prior (rectangular 7950kg/m^3 8050kg/m^3)))
  (derive (dm (- (* (+ mr dmr) (+ 1 (* (- rho-a 1.2kg/m^3) (- (/ 1 rho-w) (/ 1 rho-r))))) 100g) :unit mg)))
"""

LOSS = """
(problem loss
  (constants (x1 {x1} :sigma 0.005) (z 0 :sigma 0.005) (r {r}))
  (define (x2 (+ (* r (- x1 {x1})) (* (sqrt (- 1 (^ r 2))) z))))
  (derive (y (+ (^ x1 2) (^ x2 2)))))
"""

GAUGE = """
(problem gauge
  (constants (ls 50000623 :prior (student 50000623 25 18)) (d 215 :prior (student 215 6 24))
             (d1 0 :prior (student 0 4 5)) (d2 0 :prior (student 0 7 8))
             (as 11.5e-6 :prior (rectangular 9.5e-6 13.5e-6)) (t0 -0.1 :sigma 0.2) (dt0 0 :prior (arcsine -0.5 0.5))
             (da 0 :prior (rectangular -1e-6 1e-6)) (dt 0 :prior (rectangular -0.05 0.05)))
  (derive (dl (- (+ ls d d1 d2) (* ls (+ (* da (+ t0 dt0)) (* as dt))) 50000000)))
  (solve :coverage 99%))
"""


def propagated(text: str, trials: int = TRIALS) -> Any:
    return mbm.loads(text).propagate(trials, seed=7)


def quantile_error(width: float, density: float, trials: int = TRIALS) -> float:
    """Four standard deviations of an end of a 95 % interval whose distribution has this ``density`` there."""
    del width
    return 4.0 * float(np.sqrt(0.025 * 0.975 / trials)) / density


def test_additive_normal() -> None:
    """Clause 9.2.2: u = 2.00, [−3.92, 3.92]; exactly N(0, 4). The linear answer is right."""
    found = propagated(ADDITIVE.format(NORMAL, NORMAL))["y"]
    error = quantile_error(3.92, norm.pdf(1.96) / 2.0)
    np.testing.assert_allclose(found.interval, 2.0 * norm.ppf([0.025, 0.975]), atol=error)
    assert float(found.sigma) == pytest.approx(2.0, abs=4 * 2.0 / np.sqrt(2 * TRIALS))
    assert float(found.mean) == pytest.approx(0.0, abs=4 * 2.0 / np.sqrt(TRIALS))
    assert found.validated


def test_additive_rectangular() -> None:
    """Clause 9.2.3: u = 2.00, [−3.88, 3.88], by the distribution of Irwin and Hall of four."""
    found = propagated(ADDITIVE.format(RECTANGULAR, RECTANGULAR))["y"]
    # of the sum s of four of [0, 1]: P(s < 1) = s⁴/24, with y = 2 √3 (s − 2)
    end = 2.0 * np.sqrt(3.0) * ((24 * 0.025) ** 0.25 - 2.0)
    density = (24 * 0.025) ** 0.75 / 6.0 / (2.0 * np.sqrt(3.0))
    assert round(float(end), 2) == -3.88
    np.testing.assert_allclose(found.interval, [end, -end], atol=quantile_error(3.88, density))
    assert float(found.sigma) == pytest.approx(2.0, abs=0.02)
    assert found.validated  # 3.92 and 3.88 are the same to two digits of 2.0


def test_additive_rectangular_of_different_widths() -> None:
    """Clause 9.2.4: u = 10.1, [−17.0, 17.0], where the linear answer is [−19.9, 19.9]: not validated."""
    made = propagated(ADDITIVE.format(RECTANGULAR, WIDE))
    found = made["y"]
    assert np.sqrt(103.0) == pytest.approx(float(found.sigma), abs=0.06)
    assert float(found.sigma) == pytest.approx(10.1, abs=0.1)
    np.testing.assert_allclose(found.interval, [-17.0, 17.0], atol=0.1)
    np.testing.assert_allclose(made.only.parts[0].linear[0], [-19.9, 19.9], atol=0.05)
    assert not found.validated


def test_two_rectangulars_make_a_trapezoid() -> None:
    """A closed form: the ends of a trapezoid of half widths 1 and 3 are 4 − √(2·0.025·12) away from the middle."""
    text = (
        "(problem p (constants (a 0 :prior (rectangular -1 1)) (b 0 :prior (rectangular -3 3))) (derive (y (+ a b))))"
    )
    found = propagated(text)["y"]
    end = 4.0 - np.sqrt(2 * 0.025 * 12.0)
    np.testing.assert_allclose(found.interval, [-end, end], atol=quantile_error(end, (4.0 - end) / 12.0))
    same = mbm.loads("(problem p (constants (y 0 :prior (trapezoidal -4 4 1/2))) (derive (z (+ y 0))))")
    np.testing.assert_allclose(same.propagate(TRIALS)["z"].interval, [-end, end], atol=0.03)


@pytest.mark.parametrize("trials", [TRIALS, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_mass_calibration(trials: int) -> None:
    """Clause 9.3, table 6: 1.2341, 0.0754, shortest [1.0834, 1.3825]; linear 1.2340, 0.0539, [1.1285, 1.3395]."""
    made = propagated(MASS, trials)
    found = made["dm"]
    assert float(found.mean) == pytest.approx(1.2341, abs=0.0005)
    assert float(found.sigma) == pytest.approx(0.0754, abs=0.0005)
    np.testing.assert_allclose(found.shortest, [1.0834, 1.3825], atol=0.005)  # n_dig = 1, as published
    np.testing.assert_allclose(made.only.parts[0].linear[0], [1.1285, 1.3395], atol=1e-4)
    assert found.unit == "mg"
    assert not found.validated


@pytest.mark.parametrize(
    ("x1", "mean", "sigma"), [(0.0, 50e-6, 50e-6), (0.010, 150e-6, 112e-6), (0.050, 2551e-6, 502e-6)]
)
def test_comparison_loss(x1: float, mean: float, sigma: float) -> None:
    """Clause 9.4.2: exactly u² times a non-central χ² of two degrees of freedom."""
    found = propagated(LOSS.format(x1=x1, r=0))["y"]
    exact = ncx2(2, (x1 / 0.005) ** 2, scale=0.005**2) if x1 else ncx2(2, 1e-12, scale=0.005**2)
    scatter = float(exact.std()) / np.sqrt(TRIALS)
    assert float(found.mean) == pytest.approx(float(exact.mean()), abs=4 * scatter)
    assert (float(found.mean), float(found.sigma)) == (
        pytest.approx(mean, abs=1.5e-6 + 4 * scatter),
        pytest.approx(sigma, rel=0.02),
    )
    ends = exact.ppf([0.025, 0.975])
    error = 4 * np.sqrt(0.025 * 0.975 / TRIALS) / exact.pdf(ends)
    assert (np.abs(found.interval - ends) < error).all()
    width = minimize_scalar(lambda p: exact.ppf(p + 0.95) - exact.ppf(p), bounds=(0.0, 0.05), method="bounded").fun
    assert float(np.diff(found.shortest)[0]) == pytest.approx(min(width, exact.ppf(0.95)), rel=0.01)


def test_comparison_loss_with_correlated_inputs() -> None:
    """Clause 9.4.3, r = 0.9 and x1 = 0: 50e-6, 67e-6, shortest [0, 185e-6]."""
    found = propagated(LOSS.format(x1=0, r=0.9))["y"]
    assert float(found.mean) == pytest.approx(50e-6, abs=0.6e-6)
    assert float(found.sigma) == pytest.approx(5e-5 * np.sqrt(1.0 + 0.9**2), rel=0.01)
    np.testing.assert_allclose(found.shortest, [0.0, 185e-6], atol=3e-6)


def test_gauge_block() -> None:
    """Clause 9.5 with the rectangular inputs where it has curvilinear trapezoids: 838 nm, u = 36 nm; the linear answer
    is an interval 838 ± 93 nm of another width. Against draws by NumPy of the same inputs.
    """
    found = propagated(GAUGE)["dl"]
    rng = np.random.default_rng(1)
    n = 1_000_000
    t = [m + s * rng.standard_t(v, n) for m, s, v in ((50000623, 25, 18), (215, 6, 24), (0, 4, 5), (0, 7, 8))]
    t0 = rng.normal(-0.1, 0.2, n) + 0.5 * np.cos(np.pi * rng.random(n))
    da, dt, a = rng.uniform(-1e-6, 1e-6, n), rng.uniform(-0.05, 0.05, n), rng.uniform(9.5e-6, 13.5e-6, n)
    other = sum(t) - t[0] * (da * t0 + a * dt) - 50_000_000
    assert float(found.mean) == pytest.approx(838.0, abs=0.5)
    assert float(found.sigma) == pytest.approx(36.0, abs=1.0)
    assert float(found.sigma) == pytest.approx(float(other.std()), rel=0.01)
    np.testing.assert_allclose(found.interval, np.quantile(other, [0.005, 0.995]), atol=1.5)


def test_beside_a_limit_trials_are_compared_with_the_stated_interval() -> None:
    """No linear interval lies beyond a hard limit: the one of the normal distribution of 0.175 ± 0.2 from 0 on."""
    text = """(problem p (data d (table (y) (0.1) (0.4) (-0.1) (0.3))) (unknowns (a :in (0 10)))
        (observe d (= y a) :sigma 0.4) (derive (twice (* 2 a))))"""
    made = propagated(text, 2000)
    held = norm.cdf(0.175 / 0.2)
    end = 0.175 + 0.2 * norm.ppf(1.0 - 0.05 * held)
    np.testing.assert_allclose(made.only.parts[0].linear, [[0.0, end]], atol=1e-4)
    np.testing.assert_allclose(made.only.parts[1].linear, [[0.0, 2 * end]], rtol=0.01, atol=1e-4)
