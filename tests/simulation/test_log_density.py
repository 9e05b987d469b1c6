"""The posterior density of the unknowns, against densities by SciPy and closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

import mbm

X = np.arange(6.0)
Y = np.array([1.02, 3.1, 4.9, 7.0, 9.1, 10.9])
ROWS = " ".join(f"({x} {y})" for x, y in zip(X, Y, strict=True))


def line(sigma: str = ":sigma 0.1", more: str = "") -> Any:
    text = (
        f"(problem line (data d (table (x y) {ROWS})) (unknowns (a :init 1) (b :init 2))"
        f" (observe d (= y (+ a (* b x))) {sigma}) {more})"
    )
    return mbm.loads(text).compile()


def misfits(steps: np.ndarray) -> np.ndarray:
    """Model − measured (K, rows) at steps from (1, 2)."""
    return (1.0 + steps[:, :1]) + (2.0 + steps[:, 1:]) * X - Y


STEPS = np.random.default_rng(0).normal(0.0, 0.1, (7, 2))


def test_it_is_the_likelihood_times_the_priors() -> None:
    found = line(more="(constraints (normal b 2.1 0.3) (normal a 0 2))").log_density(STEPS)
    wanted = stats.norm.logpdf(misfits(STEPS), 0.0, 0.1).sum(axis=1)
    wanted += stats.norm.logpdf(2.0 + STEPS[:, 1], 2.1, 0.3) + stats.norm.logpdf(1.0 + STEPS[:, 0], 0.0, 2.0)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_points_one_by_one_and_together_are_the_same() -> None:
    compiled = line()
    together = compiled.log_density(STEPS)
    assert together.shape == (7,)
    one = [compiled.log_density(step) for step in STEPS]
    assert one[0].shape == ()
    np.testing.assert_array_equal(together, one)


def test_covariances_have_their_determinant() -> None:
    text = (
        "(problem p (data d (table (u v) (1 2) (1.3 2.2))) (unknowns (w (vector 2) :init [0 0]))"
        " (observe d (= [u v] w) :covariance [[0.04 0.03] [0.03 0.09]]))"
    )
    steps = np.array([[1.0, 2.0], [1.2, 1.9]])
    normal = stats.multivariate_normal(cov=[[0.04, 0.03], [0.03, 0.09]])
    wanted = [sum(normal.logpdf(np.array(row) - w) for row in ((1, 2), (1.3, 2.2))) for w in steps]
    np.testing.assert_allclose(mbm.loads(text).compile().log_density(steps), wanted, rtol=1e-12)


LAWS = {
    "(normal 3 0.5)": stats.norm(3, 0.5),
    "(rectangular 2 4)": stats.uniform(2, 2),
    "(triangular 2 4)": stats.triang(0.5, 2, 2),
    "(trapezoidal 2 4 0.4)": stats.trapezoid(0.3, 0.7, 2, 2),
    "(trapezoidal 2 4 1)": stats.uniform(2, 2),
    "(arcsine 2 4)": stats.arcsine(2, 2),
    "(student 3 0.5 4)": stats.t(4, 3, 0.5),
    "(lognormal 3 1.4)": stats.lognorm(np.log(1.4), scale=3),
}


@pytest.mark.parametrize("law", LAWS)
def test_priors_have_the_density_of_their_law(law: str) -> None:
    compiled = mbm.loads(f"(problem p (unknowns (x :init 3 :prior {law})))").compile()
    at = np.array([1.5, 2.1, 2.3, 2.8, 3.0, 3.4, 3.9, 4.5])
    np.testing.assert_allclose(compiled.log_density((at - 3.0)[:, None]), LAWS[law].logpdf(at), rtol=1e-10)


def test_unknown_noise_is_integrated_out() -> None:
    """By quadrature over log s."""
    found = line(sigma="").log_density(STEPS)
    logs = np.linspace(-8.0, 8.0, 20_001)
    scales = np.exp(logs)
    for value, misfit in zip(found, misfits(STEPS), strict=True):
        likelihood = np.exp(stats.norm.logpdf(misfit[:, None], 0.0, scales).sum(axis=0))
        assert value == pytest.approx(np.log(np.trapezoid(likelihood, logs)), rel=1e-9)


def test_losses_count_as_the_solve_counts_them() -> None:
    compiled = line(sigma=":sigma 0.1 :loss (huber 1.5)")
    found = compiled.log_density(STEPS)
    costs = np.array([np.square(compiled.residuals(step)).sum() for step in STEPS])
    np.testing.assert_allclose(found - found[0], -0.5 * (costs - costs[0]), rtol=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "(problem p (unknowns (x :init 1 :in (0 2) :sigma 1)))",
        "(problem p (unknowns (x positive :init 1 :sigma 1)) (constraints (<= x 2)))",
    ],
)
def test_it_is_nothing_beyond_limits(text: str) -> None:
    found = mbm.loads(text).compile().log_density([[-1.1], [-0.5], [0.9], [1.1]])
    np.testing.assert_array_equal(np.isfinite(found), [False, True, True, False])


def test_where_the_model_has_no_value_there_is_no_density() -> None:
    text = "(problem p (data d (table (y) (1))) (unknowns (x :init 1)) (observe d (= y (log x)) :sigma 1))"
    assert mbm.loads(text).compile().log_density([[-2.0]]).tolist() == [-np.inf]


def test_rotations_are_uniform_beforehand() -> None:
    """Seen from two starts, one rotation differs by how much of the group a step covers: det J = 2 (1 − cos θ)/θ²."""
    text = (
        "(problem p (data d (table (x y z u v w) (1 0 0 0.1 0.9 0.2) (0 1 0 -1 0.1 0)))"
        " (unknowns (R (rotation 3) :init {})) (observe d (= [u v w] (rotate R [x y z])) :sigma 0.3))"
    )

    def covered(angle: float) -> float:
        return float(np.log(2.0 * (1.0 - np.cos(angle)) / angle**2))

    one = mbm.loads(text.format("(rot-z 0)")).compile().log_density([0.0, 0.0, 1.2])
    other = mbm.loads(text.format("(rot-z 0.7)")).compile().log_density([0.0, 0.0, 0.5])
    assert float(one) - covered(1.2) == pytest.approx(float(other) - covered(0.5), rel=1e-10)


REFUSED = {
    "equations among the constraints": (
        "(problem p (unknowns (x :init 1 :sigma 1) (y :init 1 :sigma 1)) (constraints (= x y)))"
    ),
    "the uncertain constant `c`": "(problem p (constants (c 1 :sigma 1)) (unknowns (x :init c :sigma 1)))",
    "`model` in the noise beside an unknown factor, in `d`": (
        "(problem p (data d (table (n) (3) (5))) (unknowns (b :init 1)) (observe d (= n b) :sigma (unknown model)))"
    ),
    "`:correlation` of unknown noise, in `d`": (
        "(problem p (data d (table (n) (3) (5) (4) (6))) (unknowns (b :init 1))"
        " (observe d (= n b) :correlation (ar1 unknown)))"
    ),
    "`:errors` of `d`": (
        "(problem p (data d (table (x y) (0 0) (1 1) (2 2))) (unknowns (b :init 1))"
        " (observe d (= y (* b x)) :sigma 1 :errors ((x 0.1))))"
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_problems_without_a_density_say_so(what: str) -> None:
    compiled = mbm.loads(REFUSED[what]).compile()
    with pytest.raises(mbm.MbmError, match="no-density") as caught:
        compiled.log_density(np.zeros(len(compiled.solve().covariance.names)))
    assert what in str(caught.value)


@pytest.mark.parametrize("x", [[0.0], [[[0.0, 0.0]]], ["a", "b"]])
def test_other_shapes_are_refused(x: Any) -> None:
    with pytest.raises(mbm.MbmError, match="wrong-argument"):
        line().log_density(x)


def test_a_sampler_finds_the_posterior_and_the_trials_too() -> None:
    """Of a linear problem both are the normal distribution of the estimates."""
    emcee = pytest.importorskip("emcee")
    compiled = line()
    cov = 0.1**2 * np.linalg.inv(np.vander(X, 2, increasing=True).T @ np.vander(X, 2, increasing=True))
    solved = compiled.solve()
    mean = np.array([float(solved["a"].value) - 1.0, float(solved["b"].value) - 2.0])
    sampler = emcee.EnsembleSampler(20, 2, compiled.log_density, vectorize=True)
    random = np.random.RandomState(3)
    sampler.random_state = random.get_state()
    sampler.run_mcmc(mean + 0.01 * random.standard_normal((20, 2)), 1500)
    chain = sampler.get_chain(discard=200, thin=10, flat=True)
    trials = solved.propagate(20_000)
    for k, name in enumerate("ab"):
        sigma = np.sqrt(cov[k, k])
        assert chain[:, k].mean() == pytest.approx(mean[k], abs=0.15 * sigma)
        assert chain[:, k].std() == pytest.approx(sigma, rel=0.1)
        assert float(trials[name].sigma) == pytest.approx(sigma, rel=0.03)


LINE_ROWS = " ".join(f"({x:g} {y})" for x, y in zip(X, (3, 0, 7, 9, 12, 20), strict=True))


def means(steps: np.ndarray) -> np.ndarray:
    """The model 4 + 2 x at steps (K, rows)."""
    return (4.0 + steps[:, :1]) + (2.0 + steps[:, 1:]) * X


COUNTS = np.array([3.0, 0, 7, 9, 12, 20])
LIKELIHOODS = {
    ":distribution poisson": lambda m: stats.poisson.logpmf(COUNTS, m),
    ":distribution (binomial 40)": lambda m: stats.binom.logpmf(COUNTS, 40, m / 40),
    ":distribution (student 3) :sigma 0.8": lambda m: stats.t.logpdf(COUNTS, 3, m, 0.8),
    ":sigma (hypot 1 (* 20% model))": lambda m: stats.norm.logpdf(COUNTS, m, np.hypot(1, 0.2 * m)),
    ":sigma 2 :below (= y 0) :above (> y 15)": lambda m: np.select(
        [COUNTS == 0, COUNTS > 15],
        [stats.norm.logcdf(COUNTS, m, 2), stats.norm.logsf(COUNTS, m, 2)],
        stats.norm.logpdf(COUNTS, m, 2),
    ),
    ":sigma 2 :resolution 1": lambda m: np.log(stats.norm.cdf(COUNTS + 0.5, m, 2) - stats.norm.cdf(COUNTS - 0.5, m, 2)),
}


@pytest.mark.parametrize("option", LIKELIHOODS)
def test_likelihoods_are_those_of_scipy(option: str) -> None:
    text = (
        f"(problem p (data d (table (x y) {LINE_ROWS})) (unknowns (a :init 4) (b :init 2))"
        f" (observe d (= y (+ a (* b x))) {option}))"
    )
    compiled = mbm.loads(text).compile()
    wanted = LIKELIHOODS[option](means(STEPS)).sum(axis=1)
    np.testing.assert_allclose(compiled.log_density(STEPS), wanted, rtol=1e-10)
    check_gradient(compiled, STEPS[:3])


SHARED = {
    ":sigma 0.3 :common ((0.5 :per day) (0.2 :per x))": 0.09 * np.eye(6) + 0.25 * np.kron(np.eye(2), np.ones((3, 3)))
    + 0.04 * np.eye(6),
    ":sigma 0.3 :correlation (ar1 0.6)": 0.09 * 0.6 ** np.abs(np.subtract.outer(X, X)),
}  # fmt: skip


@pytest.mark.parametrize("option", SHARED)
def test_rows_that_share_noise_have_the_density_of_all_together(option: str) -> None:
    rows = " ".join(f"({x:g} {y} {day})" for x, y, day in zip(X, Y, (1, 1, 1, 2, 2, 2), strict=True))
    text = (
        f"(problem p (data d (table (x y day) {rows})) (unknowns (a :init 1) (b :init 2))"
        f" (observe d (= y (+ a (* b x))) {option}))"
    )
    compiled = mbm.loads(text).compile()
    wanted = stats.multivariate_normal(cov=SHARED[option]).logpdf(misfits(STEPS))
    np.testing.assert_allclose(compiled.log_density(STEPS), wanted, rtol=1e-10)
    check_gradient(compiled, STEPS[:3])


def check_gradient(compiled: Any, points: np.ndarray, tolerance: float = 1e-6) -> None:
    """Against central differences of the density, which are right to 1e-7 of it or so."""
    found = compiled.log_density_gradient(points)
    assert found.shape == points.shape
    for k, point in enumerate(points):
        for i in range(points.shape[1]):
            moved = np.zeros(points.shape[1])
            moved[i] = 1e-5
            ends = compiled.log_density([point + moved, point - moved])
            wanted = (ends[0] - ends[1]) / 2e-5
            assert found[k, i] == pytest.approx(wanted, rel=tolerance, abs=tolerance * (1 + abs(ends[0])))


@pytest.mark.parametrize("law", [law for law in LAWS if "rect" not in law])
def test_gradients_of_priors(law: str) -> None:
    compiled = mbm.loads(f"(problem p (unknowns (x :init 3 :prior {law})))").compile()
    check_gradient(compiled, np.array([[-0.45], [0.3]]))


@pytest.mark.parametrize(
    ("sigma", "more"), [("", ""), (":sigma 0.1 :loss (huber 1.5)", "(constraints (normal b 2 1))")]
)
def test_gradients_of_unknown_noise_and_losses(sigma: str, more: str) -> None:
    check_gradient(line(sigma=sigma, more=more), STEPS)


def test_gradients_over_rotations_and_directions() -> None:
    text = (
        "(problem p (data d (table (x y z u v w) (1 0 0 0.1 0.9 0.2) (0 1 0 -1 0.1 0)))"
        " (unknowns (R (rotation 3) :init (rot-z 0.3)) (n direction :init [0 0.6 0.8]))"
        " (observe d (= [u v w] (rotate R [x y z])) :sigma 0.3) (observe d (= u (dot n [x y z])) :sigma 0.3))"
    )
    check_gradient(mbm.loads(text).compile(), np.array([[0.4, -0.2, 0.9, 0.5, 0.3], [0, 0, 0, 0, 0.0]]), 1e-5)


def test_there_is_no_gradient_where_there_is_no_density() -> None:
    compiled = mbm.loads("(problem p (unknowns (x :init 1 :in (0 2) :sigma 1)))").compile()
    assert compiled.log_density_gradient([[-1.5], [0.5]]).tolist() == [[0.0], [pytest.approx(-0.5)]]
    assert compiled.log_density_gradient([0.5]).shape == (1,)
