"""Estimates and standard deviations of maximum likelihood, against likelihoods written anew (`peers`)."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

import mbm
from tests.estimation.likelihoods import peers

Floats = NDArray[np.float64]

X = np.arange(8.0)
COUNTS = np.array([3.0, 5, 4, 9, 11, 19, 22, 31])
SIZES = np.array([2.1, 3.7, 6.3, 7.6, 10.4, 11.6, 14.1, 16.9])
TRIALS = np.array([59.0, 60, 62, 56, 63, 59, 62, 60])
HITS = np.array([6.0, 13, 18, 28, 52, 53, 61, 60])
DOSES = np.array([1.69, 1.72, 1.75, 1.78, 1.81, 1.83, 1.86, 1.88])


def table(**columns: Floats) -> str:
    """A table in the text of a problem."""
    rows = zip(*columns.values(), strict=True)
    cells = " ".join("(" + " ".join(repr(float(cell)) for cell in row) + ")" for row in rows)
    return f"(data t (table ({' '.join(columns)}) {cells}))"


def line(p: Floats) -> Floats:
    """a + b x."""
    return p[0] + p[1] * (X + 1)


def solved(clauses: str, backend: str = "auto") -> mbm.Result:
    """A line (or what the clauses say) through a table."""
    return mbm.loads(f"(problem p {clauses})").solve(backend=backend)


def agree(found: mbm.Result, best: Floats, deviations: Floats) -> None:
    """The peer's minimum is good to 1e-7 of a deviation, its differences to 1e-6 of one."""
    for name, value, sigma in zip("ab", best, deviations, strict=True):
        assert float(found[name].value) == pytest.approx(value, abs=1e-6 * sigma)
        assert float(found[name].sigma) == pytest.approx(sigma, rel=1e-5)


BACKENDS = ("casadi", "numpy")
"""Machine code is what the tests without this parameter, and those of many solves, run."""
LINE = "(unknowns (a) (b)) (observe t (= y (+ a (* b x))) "


@pytest.mark.parametrize("backend", BACKENDS)
def test_counts(backend: str) -> None:
    found = solved(
        table(x=X, y=COUNTS) + "(unknowns (a) (b)) (observe t (= y (exp (+ a (* b x)))) :distribution poisson)", backend
    )

    def log_of(p: Floats) -> float:
        return peers.of_counts(COUNTS, np.exp(p[0] + p[1] * X))

    best = peers.most_likely(log_of, np.array([1.0, 0.3]))
    # the canonical link: what is observed is what is expected
    agree(found, best, peers.sigmas(peers.curvature(log_of, best, np.array([1e-3, 1e-3]))))
    mean = np.exp(best[0] + best[1] * X)
    assert found.solves[0].cost == pytest.approx(2 * (COUNTS * np.log(COUNTS / mean) - COUNTS + mean).sum(), rel=1e-9)
    assert found.solves[0].log_likelihood == pytest.approx(log_of(best), rel=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_counts_of_a_line_have_the_expected_information(backend: str) -> None:
    found = solved(table(x=X + 1, y=COUNTS) + LINE + ":distribution poisson)", backend)
    best = peers.most_likely(lambda p: peers.of_counts(COUNTS, line(p)), np.array([1.0, 3.0]))
    slopes = np.stack([np.ones(8), X + 1], axis=1)
    agree(found, best, peers.sigmas(slopes.T @ (slopes / line(best)[:, None])))


def test_rows_without_a_count() -> None:
    counts = np.array([0.0, 0, 1, 0, 2, 1, 4, 3])
    found = solved(
        table(x=X, y=counts)
        + "(unknowns (a :init 0) (b :init 0)) (observe t (= y (exp (+ a (* b x)))) :distribution poisson)"
    )

    def log_of(p: Floats) -> float:
        return peers.of_counts(counts, np.exp(p[0] + p[1] * X))

    best = peers.most_likely(log_of, np.array([-1.0, 0.3]))
    agree(found, best, peers.sigmas(peers.curvature(log_of, best, np.array([1e-3, 1e-3]))))


@pytest.mark.parametrize("backend", BACKENDS)
def test_trials(backend: str) -> None:
    data = table(x=DOSES, n=TRIALS, y=HITS)
    share = "(/ n (+ 1 (exp (- (+ a (* b (- x 1.8)))))))"
    model = f"(unknowns (a :init 0) (b :init 30)) (observe t (= y {share}) :distribution (binomial n))"
    found = solved(data + model, backend)

    def log_of(p: Floats) -> float:
        return peers.of_trials(HITS, TRIALS, TRIALS / (1 + np.exp(-(p[0] + p[1] * (DOSES - 1.8)))))

    best = peers.most_likely(log_of, np.array([1.0, 34.0]))
    agree(found, best, peers.sigmas(peers.curvature(log_of, best, np.array([1e-3, 1e-2]))))
    assert found.solves[0].log_likelihood == pytest.approx(log_of(best), rel=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_student(backend: str) -> None:
    sizes = SIZES + np.array([0, 0, 0, 9.0, 0, 0, 0, 0])
    found = solved(table(x=X + 1, y=sizes) + LINE + ":distribution (student 4) :sigma 0.3)", backend)
    best = peers.most_likely(lambda p: peers.of_student(sizes, line(p), 0.3, 4.0), np.array([0.0, 2.0]))
    slopes = np.stack([np.ones(8), X + 1], axis=1) / 0.3
    agree(found, best, peers.sigmas(slopes.T @ slopes * (5.0 / 7.0)))
    assert found.solves[0].log_likelihood == pytest.approx(peers.of_student(sizes, line(best), 0.3, 4.0), rel=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_weights_relative_to_the_model(backend: str) -> None:
    found = solved(table(x=X + 1, y=SIZES) + LINE + ":sigma (* 5% model))", backend)
    best = peers.most_likely(lambda p: peers.of_normal(SIZES, line(p), 0.05 * line(p)), np.array([0.1, 2.0]))
    slopes = np.stack([np.ones(8), X + 1], axis=1) / line(best)[:, None]
    agree(found, best, peers.sigmas(slopes.T @ slopes * (1 / 0.05**2 + 2.0)))
    assert found.solves[0].cost == pytest.approx((np.square(SIZES / line(best) - 1) / 0.05**2).sum(), rel=1e-6)
    assert found.solves[0].dof == 6
    assert found.solves[0].log_likelihood == pytest.approx(
        peers.of_normal(SIZES, line(best), 0.05 * line(best)), rel=1e-9
    )


def test_a_constant_part_and_a_relative_one() -> None:
    found = solved(table(x=X + 1, y=SIZES) + LINE + ":sigma (hypot 0.2 (* 3% model)))")

    def sigma(p: Floats) -> Floats:
        return np.hypot(0.2, 0.03 * line(p))

    best = peers.most_likely(lambda p: peers.of_normal(SIZES, line(p), sigma(p)), np.array([0.1, 2.0]))
    slopes = np.stack([np.ones(8), X + 1], axis=1)
    rise = (0.03**2 * line(best) / sigma(best))[:, None] * slopes
    both = np.vstack([slopes, np.sqrt(2) * rise]) / np.tile(sigma(best), 2)[:, None]
    agree(found, best, peers.sigmas(both.T @ both))


def test_roots_of_counts_as_weights() -> None:
    found = solved(table(x=X + 1, y=COUNTS) + LINE + ":sigma (sqrt model))")
    best = peers.most_likely(lambda p: peers.of_normal(COUNTS, line(p), np.sqrt(line(p))), np.array([1.0, 3.0]))
    slopes = np.stack([np.ones(8), X + 1], axis=1)
    weights = 1 / line(best) + 0.5 / np.square(line(best))
    agree(found, best, peers.sigmas(slopes.T @ (slopes * weights[:, None])))


@pytest.mark.parametrize("backend", BACKENDS)
def test_limits(backend: str) -> None:
    below, above = np.array([1.0, 0, 0, 0, 0, 0, 0, 0]), np.array([0, 0, 0, 0, 0, 1.0, 1, 1])
    sizes = np.where(above > 0, 10.5, SIZES)
    data = table(x=X + 1, y=sizes, low=below, high=above)
    found = solved(data + LINE + ":sigma 0.4 :below (= low 1) :above (= high 1))", backend)

    def log_of(p: Floats) -> float:
        return peers.of_limits(sizes, line(p), 0.4, below, above)

    best = peers.most_likely(log_of, np.array([0.1, 2.0]))
    agree(found, best, peers.sigmas(peers.curvature(log_of, best, np.array([1e-3, 1e-3]))))
    assert found.solves[0].log_likelihood == pytest.approx(log_of(best), rel=1e-10)
    assert found.solves[0].chi2_p is None


@pytest.mark.parametrize(("backend", "sigma"), [("auto", 0.5), ("numpy", 0.1), ("numpy", 0.2), ("casadi", 2.0)])
def test_rounded_readings(backend: str, sigma: float) -> None:
    sizes = np.round(SIZES + np.array([0.1, 0.3, -0.4, 0.2, 0, 0.6, 0.3, -0.2]) * min(1.0, 5 * sigma))
    found = solved(table(x=X + 1, y=sizes) + LINE + f":sigma {sigma} :resolution 1)", backend)

    def log_of(p: Floats) -> float:
        return peers.of_rounded(sizes, line(p), sigma, 1.0)

    start = np.array([float(found["a"].value), float(found["b"].value)])
    best = peers.most_likely(log_of, start + 1e-3)
    information = peers.curvature(log_of, best, np.array([1e-3, 1e-3]) * sigma)
    agree(found, best, peers.sigmas(information))
    assert found.solves[0].chi2_p is None


def test_one_unknown_relative_deviation() -> None:
    """s² of the residuals over their redundancy, the weights known by the model: REML of a proportional error."""
    found = solved(table(x=X + 1, y=SIZES) + LINE + ":sigma (unknown (* 1 model)))")
    factor = found.solves[0].noise["t"]

    def log_of(p: Floats) -> float:
        return peers.of_normal(SIZES, line(p), factor * line(p))

    best = peers.most_likely(log_of, np.array([0.1, 2.0]))
    slopes = np.stack([np.ones(8), X + 1], axis=1) / line(best)[:, None]
    information = slopes.T @ slopes * (1 / factor**2 + 2.0)
    agree(found, best, peers.sigmas(information))
    squares = np.square(SIZES / line(best) - 1).sum()
    redundancy = 8 - np.trace(np.linalg.solve(information, slopes.T @ slopes / factor**2))
    assert factor**2 == pytest.approx(squares / redundancy, rel=1e-6)
    assert found.solves[0].cost == pytest.approx(squares, rel=1e-6)


def test_a_matrix_that_the_model_decides() -> None:
    rng = np.random.default_rng(3)
    truth = np.array([2.0, 0.7])
    rows = np.arange(1.0, 11.0)
    model = np.stack([truth[0] * rows, truth[1] * rows], axis=1)
    data = model * (1 + 0.1 * rng.standard_normal((10, 2)) @ np.linalg.cholesky([[1, 0.5], [0.5, 1]]).T)
    text = table(x=rows, u=data[:, 0], v=data[:, 1]) + "(unknowns (a) (b)) "
    cross = "(* 0.005 (model 1) (model 2))"
    covariance = f"[[(* 0.01 (model 1) (model 1)) {cross}] [{cross} (* 0.01 (model 2) (model 2))]]"
    found = solved(text + f"(observe t (= [u v] [(* a x) (* b x)]) :covariance {covariance})")
    shape = np.array([[0.01, 0.005], [0.005, 0.01]])

    def matrices(p: Floats) -> Floats:
        m = p[None, :] * rows[:, None]
        return m[:, :, None] * m[:, None, :] * shape

    def log_of(p: Floats) -> float:
        off = data - p[None, :] * rows[:, None]
        c = matrices(p)
        return float(
            -0.5 * (np.einsum("ri,rij,rj", off, np.linalg.inv(c), off) + np.linalg.slogdet(2 * np.pi * c)[1].sum())
        )

    best = peers.most_likely(log_of, truth)
    inverse = np.linalg.inv(matrices(best))
    moves = [np.array([[2 * best[0], best[1]], [best[1], 0]]), np.array([[0, best[0]], [best[0], 2 * best[1]]])]
    moved = [shape * move * np.square(rows)[:, None, None] for move in moves]
    information = np.einsum("rij,r->ij", inverse, np.square(rows))
    for i in range(2):
        for j in range(2):
            information[i, j] += 0.5 * np.einsum("rab,rbc,rcd,rda", inverse, moved[i], inverse, moved[j])
    agree(found, best, peers.sigmas(information))
    assert found.solves[0].log_likelihood == pytest.approx(log_of(best), rel=1e-9)

    weights = f"(* {4 / 3 * 100} 1)"

    def entry(i: int, j: int, weight: float) -> str:
        return f"(/ (* {weight} {weights}) (* (model {i}) (model {j})))"

    inverse_text = f"[[{entry(1, 1, 1.0)} {entry(1, 2, -0.5)}] [{entry(2, 1, -0.5)} {entry(2, 2, 1.0)}]]"
    other = solved(text + f"(observe t (= [u v] [(* a x) (* b x)]) :information {inverse_text})")
    agree(other, best, peers.sigmas(information))
    assert other.solves[0].log_likelihood == pytest.approx(log_of(best), rel=1e-9)


RISING = (1, 0, 1, 2, 5, 9, 14, 19)
"""A straight line by least squares is below 0 at both of the first two."""


@pytest.mark.parametrize(
    ("law", "turned", "rest"),
    [
        ("poisson", False, ""),
        ("poisson", False, "(constraints (>= a 0))"),
        ("poisson", False, "(constraints (>= b -9))"),
        ("(binomial 40)", False, "(constraints (>= a 0))"),
        ("(binomial 40)", True, ""),
    ],
)
def test_lines_without_a_start_begin_where_all_rates_are_possible(law, turned, rest):
    """``turned``: the counts are of those that were missed, so that the line is beyond the number of trials."""
    x, n = np.arange(8.0), np.array([40 - each if turned else each for each in RISING])
    rows = " ".join(f"({a:g} {b})" for a, b in zip(x.tolist(), n.tolist(), strict=True))
    solve = (
        mbm.loads(f"""(problem p (data d (table (x n) {rows})) (unknowns (a) (b))
      (observe d (= n (+ a (* b x))) :distribution {law}) {rest})""")
        .solve()
        .solves[0]
    )

    most = np.inf if law == "poisson" else 40.0

    def surprise(line):
        rates = line[0] + line[1] * x
        if not ((rates > 0).all() and (rates < most).all()):
            return np.inf
        missed = rates if law == "poisson" else (n - most) * np.log1p(-rates / most)
        return float((missed - n * np.log(rates)).sum())

    settings = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000}
    found = minimize(surprise, [39.0, -2.0] if turned else [1.0, 1.0], method="Nelder-Mead", options=settings)
    assert found.x[0] > 0.0  # so that limits below make no difference
    assert not 0.0 < np.polyfit(x, n, 1)[1] < most
    assert str(solve.status) == "converged"
    # Nelder-Mead's simplex is 1e-9 wide in values that are flat to 1e-8 of the deviations.
    np.testing.assert_allclose([solve["a"].value, solve["b"].value], found.x, atol=1e-5)


def test_readings_below_zero_have_weights_by_the_root_of_the_model() -> None:
    """Σ (y − a)²/a + n log a is least where a² + a = mean y²: whatever signs the readings have."""
    y = np.array([-0.4, 1.3, 0.2, 2.1, -0.1])
    text = "(problem p (data d external) (unknowns (a :in (0 100) :init 1)) (observe d (= y a) :sigma (sqrt model)))"
    found = mbm.loads(text).solve(data={"d": {"y": y}})
    wanted = np.sqrt(0.25 + np.square(y).mean()) - 0.5
    assert found.solves[0].status == "converged"
    assert found["a"].value == pytest.approx(wanted, rel=1e-8)
