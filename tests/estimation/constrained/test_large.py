"""Large sparse problems with constraints, against Newton's method on the KKT conditions with dense NumPy matrices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mbm
from mbm.report.types import SolveReport

Array = NDArray[Any]
Function = Callable[[Array], Array]

POINTS = 170
"""340 unknowns: above what is solved densely."""


class Network:
    """A traverse of points in the plane: each roughly known, distances to the next ones measured."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        course = np.cumsum(random.uniform(-0.8, 0.8, POINTS))
        steps = random.uniform(4.0, 6.0, POINTS)[:, None] * np.column_stack([np.cos(course), np.sin(course)])
        self.true = np.cumsum(steps, axis=0) + 50.0
        self.pairs = np.array([(i, j) for i in range(POINTS) for j in (i + 1, i + 2, i + 5) if j < POINTS]).T
        self.seen = self.true + random.normal(scale=0.5, size=self.true.shape)
        self.lengths = self.distances(self.true.ravel()) + random.normal(scale=0.05, size=self.pairs.shape[1])

    def distances(self, x: Array) -> Array:
        """Those of the pairs at x (2 points,), complex steps allowed."""
        away = x.reshape(-1, 2)[self.pairs[0]] - x.reshape(-1, 2)[self.pairs[1]]
        found: Array = np.sqrt((away * away).sum(axis=1))
        return found

    def residuals(self, x: Array) -> Array:
        """Whitened."""
        return np.concatenate([(x - self.seen.ravel()) / 0.5, (self.distances(x) - self.lengths) / 0.05])

    def gradient(self, x: Array) -> Array:
        """Half the gradient of the sum of squares."""
        i, j = self.pairs
        away = x.reshape(-1, 2)[i] - x.reshape(-1, 2)[j]
        found = (x - self.seen.ravel()).reshape(-1, 2) / 0.25
        length = self.distances(x)
        force = away * ((length - self.lengths) / 0.0025 / length)[:, None]
        np.add.at(found, i, force)
        np.add.at(found, j, -force)
        return found.ravel()

    def solved(self, constraints: str, options: str = "", clauses: str = "") -> SolveReport:
        """What mbm answers."""
        text = f"""(problem net (data p external :key k) (data r external) (data s external)
          (unknowns (q (vector 2) :per p :init [x y] {options}))
          (observe p (= [x y] (q k)) :sigma 0.5)
          (observe r (= d (distance (q a) (q b))) :sigma 0.05)
          (constraints {constraints}) (derive (span (distance (q 0) (q 30)))) (solve :max-iterations 300) {clauses})"""
        a, b = self.pairs.astype(float)
        tables = {
            "p": {"k": np.arange(float(POINTS)), "x": self.seen[:, 0], "y": self.seen[:, 1]},
            "r": {"a": a, "b": b, "d": self.lengths},
            "s": {"k": np.arange(0.0, POINTS, 10.0), "level": self.true[::10, 1]},
        }
        return mbm.loads(text).solve(data=tables).first


def slopes(function: Function, x: Array) -> Array:
    """Derivatives (…, n) by complex steps, exact to rounding."""
    found = np.empty((len(function(x)), len(x)))
    for j in range(len(x)):
        step = x.astype(complex)
        step[j] += 1e-30j
        found[:, j] = function(step).imag / 1e-30
    return found


@dataclass(frozen=True)
class Held:
    """What is zero (k,) at x, and the sum of its gradients times multipliers (k,)."""

    values: Function
    pull: Callable[[Array, Array], Array]


def fixed(weights: Array, values: Array) -> Held:
    """Linear equations ``weights @ x = values``."""
    return Held(lambda x: weights @ x - values, lambda x, multipliers: weights.T @ multipliers + 0 * x)


def line(weights: Mapping[int, float]) -> Array:
    """A row of weights (n,) for some coordinates."""
    found = np.zeros(2 * POINTS)
    found[list(weights)] = list(weights.values())
    return found


def rows(weights: Mapping[int, float], value: float) -> Held:
    """One linear equation."""
    return fixed(line(weights)[None], np.array([value]))


def apart(i: int, j: int, length: float) -> Held:
    """Two points a length apart."""

    def distance(x: Array) -> Array:
        away = x.reshape(-1, 2)[i] - x.reshape(-1, 2)[j]
        found: Array = np.sqrt((away * away).sum())
        return found

    def pull(x: Array, multipliers: Array) -> Array:
        away = x.reshape(-1, 2)[i] - x.reshape(-1, 2)[j]
        found = np.zeros(x.reshape(-1, 2).shape, dtype=x.dtype)
        found[i] += away / distance(x) * multipliers[0]
        found[j] -= away / distance(x) * multipliers[0]
        return found.ravel()

    return Held(lambda x: np.array([distance(x) - length]), pull)


def both(one: Held, other: Held, first: int) -> Held:
    """Two sets of equations, ``first`` of them in the one."""
    return Held(
        lambda x: np.concatenate([one.values(x), other.values(x)]),
        lambda x, multipliers: one.pull(x, multipliers[:first]) + other.pull(x, multipliers[first:]),
    )


def kkt(network: Network, held: Held, x: Array) -> tuple[Array, Array]:
    """The constrained minimum near x by Newton's method, and its covariance: the corner of the inverse of the matrix of
    normal equations, bordered by the constraints.
    """
    n, multipliers = len(x), np.zeros(len(held.values(x)))
    for _ in range(30):
        J, C = slopes(network.residuals, x), slopes(held.values, x)
        gradient = network.gradient(x)
        multipliers = np.linalg.lstsq(C.T, -gradient, rcond=None)[0]
        H = slopes(lambda z, fixed=multipliers: network.gradient(z) + held.pull(z, fixed), x)  # type: ignore[misc]
        border = np.zeros((len(C), len(C)))
        right = -np.concatenate([gradient + C.T @ multipliers, held.values(x)])
        step = np.linalg.solve(np.block([[H, C.T], [C, border]]), right)[:n]
        x = x + step
        if np.abs(step).max() < 1e-11:
            break
    assert np.abs(step).max() < 1e-9
    return x, np.linalg.inv(np.block([[J.T @ J, C.T], [C, border]]))[:n, :n]


def compare(solve: SolveReport, network: Network, held: Held) -> None:
    """The search ends at offsets of 1e-10: about as many standard deviations, which are some 0.1. A variance of zero is
    rounding in the inverse, the root of which is 1e-8.
    """
    (q,) = solve.record.estimates
    assert solve.method == "penalty-sparse"
    expected, covariance = kkt(network, held, np.asarray(q.value).ravel())
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    assert q.sigma is not None
    np.testing.assert_allclose(np.asarray(q.value).ravel(), expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(q.sigma.ravel(), sigma, rtol=1e-7, atol=1e-7)
    slope = slopes(lambda x: np.sqrt(((x[0:2] - x[60:62]) ** 2).sum(keepdims=True)), expected)[0]
    (span,) = solve.derived
    np.testing.assert_allclose(span.sigma, np.sqrt(slope @ covariance @ slope), rtol=1e-7, atol=1e-7)
    residuals = network.residuals(expected)
    np.testing.assert_allclose(solve.cost, residuals @ residuals, rtol=1e-9)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_equations(seed: int) -> None:
    network = Network(seed)
    length = float(np.linalg.norm(network.true[0] - network.true[7])) + 0.3
    total = float(network.true[20, 0] + network.true[21, 0]) + 0.1
    solve = network.solved(f"(= (distance (q 0) (q 7)) {length!r}) (= (+ ((q 20) 1) ((q 21) 1)) {total!r})")
    compare(solve, network, both(apart(0, 7, length), rows({40: 1.0, 42: 1.0}, total), 1))
    assert solve.status == "converged"
    assert solve.dof == 2 * POINTS + network.pairs.shape[1] + 2 - 2 * POINTS
    assert [c.active for c in solve.constraints] == [True, True]


def test_inequalities_act_where_the_data_push_against_them() -> None:
    network = Network(3)
    x, y = float(network.true[3, 0]), float(network.true[9, 1])
    solve = network.solved(f"(<= ((q 3) 1) {x - 0.4!r}) (>= ((q 9) 2) {y - 5.0!r})")
    compare(solve, network, rows({6: 1.0}, x - 0.4))
    assert [c.active for c in solve.constraints] == [True, False]
    assert [d.code.name for d in solve.diagnostics if d.code.name == "active-constraint"] == ["active-constraint"]
    assert solve.dof == network.pairs.shape[1] + 1


def test_a_constraint_that_is_stated_twice_counts_once() -> None:
    network = Network(4)
    length = float(np.linalg.norm(network.true[0] - network.true[7]))
    once = f"(= (distance (q 0) (q 7)) {length!r})"
    twice = f"{once} (= (* 2 (distance (q 7) (q 0))) {2 * length!r})"
    solves = [network.solved(each) for each in (once, twice)]
    assert solves[0].dof == solves[1].dof == network.pairs.shape[1] + 1
    np.testing.assert_allclose(solves[1].estimates[0].sigma, solves[0].estimates[0].sigma, rtol=1e-7, atol=1e-12)


def test_constraints_for_each_row_of_a_table() -> None:
    """The second coordinate of each tenth point is the same: a level line."""
    network = Network(5)
    solve = network.solved("(= ((q k) 2) level :over s)")
    every = [{place: 1.0} for place in range(1, 2 * POINTS, 20)]
    compare(solve, network, fixed(np.stack([line(each) for each in every]), network.true[::10, 1]))
    assert solve.constraints[0].rows == POINTS // 10


def test_bounds_beside_constraints() -> None:
    network = Network(6)
    least = float(network.true[:, 0].min()) + 0.3
    total = float(network.true[20, 0] + network.true[21, 0]) + 0.1
    solve = network.solved(f"(= (+ ((q 20) 1) ((q 21) 1)) {total!r})", f":in ({least!r} 1e9)")
    values = np.asarray(solve.estimates[0].value).ravel()
    at = np.flatnonzero(values == least)
    assert len(at)
    lines = np.stack([*(line({int(place): 1.0}) for place in at), line({40: 1.0, 42: 1.0})])
    compare(solve, network, fixed(lines, np.append(np.full(len(at), least), total)))


def test_what_contradicts_is_named() -> None:
    solve = Network(7).solved("(= ((q 3) 1) 0) (= ((q 3) 1) 1) (= ((q 8) 1) 50)")
    assert solve.status == "infeasible"
    (found,) = [d for d in solve.diagnostics if d.code.name == "conflicting-constraints"]
    assert "(q 8)" not in found.message
    assert found.message.count("(q 3)") == 2


def test_a_constraint_without_a_value_at_the_start_is_shown() -> None:
    solve = Network(8).solved("(= (sqrt (- ((q 3) 1) 1000)) 1)")
    assert solve.status == "not-converged"
    assert any("no finite value" in d.message or "not finite" in d.message for d in solve.diagnostics)


LANDMARKS = 260
CAMPS = 40


class Survey:
    """Landmarks seen from camps, as differences of positions, which leave two directions free: all linear."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        self.true = random.uniform(0.0, 100.0, (CAMPS + LANDMARKS, 2))
        self.camp = np.repeat(np.arange(CAMPS), 30)
        self.landmark = CAMPS + random.integers(0, LANDMARKS, len(self.camp))
        self.landmark[:LANDMARKS] = CAMPS + np.arange(LANDMARKS)
        self.seen = self.true[self.landmark] - self.true[self.camp] + random.normal(0, 0.1, (len(self.camp), 2))

    def matrix(self) -> Array:
        """The derivatives (rows, unknowns), whitened."""
        found = np.zeros((2 * len(self.camp), 2 * len(self.true)))
        for axis in (0, 1):
            rows = 2 * np.arange(len(self.camp)) + axis
            found[rows, 2 * self.landmark + axis] += 10.0
            found[rows, 2 * self.camp + axis] -= 10.0
        return found

    def solved(self, constraints: str, noise: str = ":sigma 0.1", clauses: str = "") -> SolveReport:
        """What mbm answers."""
        text = f"""(problem survey (data d external) (data camps external :key k) (data marks external :key k)
          (unknowns (q (vector 2) :per camps :init [0 0]) (l (vector 2) :per marks :init [1 1]))
          (observe d (= [dx dy] (- (l mark) (q camp))) {noise}) (constraints {constraints}) {clauses})"""
        tables = {
            "camps": {"k": np.arange(float(CAMPS))},
            "marks": {"k": np.arange(float(LANDMARKS))},
            "d": {
                "camp": self.camp.astype(float),
                "mark": self.landmark - float(CAMPS),
                "dx": self.seen[:, 0],
                "dy": self.seen[:, 1],
            },
        }
        return mbm.loads(text).solve(data=tables).first


CONSTRAINTS = {
    "a camp": ("(= (q 3) [10 20])", [({6: 1.0}, 10.0), ({7: 1.0}, 20.0)]),
    "landmarks": (
        "(= (l 3) [10 20]) (= ((- (l 5) (l 6)) 1) 4)",
        [({86: 1.0}, 10.0), ({87: 1.0}, 20.0), ({90: 1.0, 92: -1.0}, 4.0)],
    ),
    "both": ("(= (+ (q 0) (l 0)) [7 8])", [({0: 1.0, 80: 1.0}, 7.0), ({1: 1.0, 81: 1.0}, 8.0)]),
}


@pytest.mark.parametrize("case", CONSTRAINTS)
@pytest.mark.parametrize("noise", [":sigma 0.1", ":sigma unknown"])
def test_constraints_settle_what_the_data_leave_free(case: str, noise: str) -> None:
    """Schur elimination with constraints inside, outside and across the family that goes: normal equations, bordered.

    Positions of size 100 to rounding of matrices with condition 1e6.
    """
    survey = Survey(11)
    text, equations = CONSTRAINTS[case]
    solve = survey.solved(text, noise)
    A, n = survey.matrix(), 2 * (CAMPS + LANDMARKS)
    C = np.zeros((len(equations), n))
    for row, (weights, _) in zip(C, equations, strict=True):
        row[list(weights)] = list(weights.values())
    bordered = np.block([[A.T @ A, C.T], [C, np.zeros((len(C), len(C)))]])
    y = 10.0 * survey.seen.ravel()
    expected = np.linalg.solve(bordered, np.concatenate([A.T @ y, [value for _, value in equations]]))[:n]
    covariance = np.linalg.inv(bordered)[:n, :n]
    residuals = y - A @ expected
    dof = len(y) + len(C) - n
    if "unknown" in noise:
        covariance = covariance * (residuals @ residuals / dof)
    found = np.concatenate([np.asarray(each.value).ravel() for each in solve.estimates])
    sigma = np.concatenate([each.sigma.ravel() for each in solve.estimates if each.sigma is not None])
    assert solve.status == "converged"
    assert solve.dof == dof
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(sigma, np.sqrt(np.maximum(np.diag(covariance), 0.0)), rtol=1e-8, atol=1e-7)


def test_constraints_that_leave_something_free() -> None:
    """One coordinate of a camp is held: all others may move along the other one together, and that is said."""
    solve = Survey(12).solved("(= ((q 3) 1) 10)")
    assert solve.status == "unobservable"
    assert solve.observability is not None
    assert solve.observability.rank == solve.observability.dimension - 1
    (q, _) = solve.estimates
    assert q.sigma is not None
    assert np.isfinite(q.sigma[:, 0]).all()
    assert np.isnan(q.sigma[:, 1]).all()
    settled = Survey(12).solved("(= ((q 3) 1) 10)", clauses="(solve :gauge free)")
    assert settled.estimates[0].sigma is not None
    assert np.isfinite(settled.estimates[0].sigma).all()


def test_losses_beside_constraints() -> None:
    """The gradient of Huber's cost has no part along the constraints; without outliers its deviations are those of
    least squares by its efficiency of 95 %, as far as 2,400 residuals tell.
    """
    survey = Survey(13)
    survey.seen[5] += 30.0
    solve = survey.solved("(= (q 3) [10 20])", ":sigma 0.1 :loss (huber 1.345)")
    found = np.concatenate([np.asarray(each.value).ravel() for each in solve.estimates])
    A = survey.matrix()
    r = (A @ found - 10.0 * survey.seen.ravel()).reshape(-1, 2)
    length = np.linalg.norm(r, axis=1)
    gradient = A.T @ (r * np.minimum(1.0, 1.345 / np.maximum(length, 1e-9))[:, None]).ravel()
    np.testing.assert_allclose(np.delete(gradient, [6, 7]), 0.0, atol=1e-6)
    np.testing.assert_allclose(found[6:8], [10.0, 20.0], atol=1e-10)
    plain = Survey(13).solved("(= (q 3) [10 20])")
    sigmas = [np.concatenate([e.sigma.ravel() for e in s.estimates if e.sigma is not None]) for s in (solve, plain)]
    np.testing.assert_allclose(sigmas[0][6:8], 0.0, atol=1e-7)
    ratio = np.delete(sigmas[0], [6, 7]) / np.delete(sigmas[1], [6, 7])
    assert 0.95 < np.median(ratio) < 1.15
