"""Errors that grow with what is read are doubted, and errors that are alike are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import spearmanr

import mbm
from mbm.estimation.trust.uneven import Clauses

CODE = "uneven-noise"
X = np.linspace(0.0, 1.0, 60)
NORMAL = np.random.default_rng(4).normal(size=X.size)


def text(noise: str = ":sigma unknown", more: str = "") -> str:
    return f"(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) {noise}) {more})"


def found(y: np.ndarray, noise: str = ":sigma unknown") -> list[str]:
    result = mbm.loads(text(noise)).solve(data={"d": {"x": X, "y": y}})
    return [each.message for each in result.diagnostics if each.code.name == CODE]


def test_errors_that_grow_and_errors_that_shrink() -> None:
    grown = found(10 + 20 * X + NORMAL * (0.1 + 2 * X))
    assert len(grown) == 1 and grown[0].startswith("errors of `d` grow with the size of its readings,")
    (shrunk,) = found(10 + 20 * X + NORMAL * (2.1 - 2 * X))
    assert shrunk.startswith("errors of `d` shrink with the size of its readings,")


def test_errors_that_are_as_stated() -> None:
    y = 10 + 20 * X + NORMAL * (0.1 + 2 * X)
    assert not found(10 + 20 * X + NORMAL)
    assert not found(y, ":sigma (+ 0.1 (* 2 x))")
    assert not found(y, ":sigma (unknown (+ 0.1 (* 2 x)))")


def test_readings_without_noise() -> None:
    assert not found(10 + 20 * X)


def test_units_do_not_matter() -> None:
    y = 10 + 20 * X + NORMAL * (0.1 + 2 * X)
    assert found(1e-9 * y) == found(y)


def test_what_errors_grow_with() -> None:
    """A line through zero has large readings at both ends, and a wave has none in an order."""
    turned = 20 * (X - 0.5)
    for model, noise, grown in (
        (turned, 0.1 + np.abs(turned), "the size of its readings"),
        (turned, 10.1 + turned, "its readings"),
    ):
        (said,) = found(model + NORMAL * noise)
        assert said.startswith(f"errors of `d` grow with {grown},")
    wave = mbm.loads("(problem p (data d external) (unknowns (a)) (observe d (= y (* a (sin x))) :sigma unknown))")
    result = wave.solve(data={"d": {"x": 100.0 * X, "y": 20 * np.sin(100.0 * X) + NORMAL * (0.1 + 2 * X)}})
    assert [d.message.split(",")[0] for d in result.diagnostics] == ["errors of `d` grow with the number of the row"]


def circles(noise: np.ndarray) -> list[list[str]]:
    """What is said of each of some circles whose points have the ``noise`` (runs, 2, points)."""
    runs, _, points = noise.shape
    angle = np.linspace(0.1, 6.0, points)
    x, y = np.moveaxis(10 * np.stack([np.cos(angle), np.sin(angle)]) + noise, 1, 0)
    circle = mbm.loads("""(problem p (data d external) (unknowns (p :init 1) (q :init 1) (r :init 9))
      (observe d (= 0 (- (hypot (- x p) (- y q)) r)) :sigma unknown) (for-each k))""")
    found = circle.solve(data={"d": {"k": np.repeat(np.arange(runs), points), "x": x.ravel(), "y": y.ravel()}})
    return [[d.message.split(",")[0] for d in each.diagnostics if d.code.name == CODE] for each in found.solves]


def test_equations_that_read_nothing() -> None:
    """Distances from a circle are errors and no readings, with which these might grow; they may along the rows."""
    even = np.random.default_rng(6).normal(scale=0.02, size=(200, 2, 40))
    assert sum(map(bool, circles(even))) <= 8  # two by chance
    grown = [said for each in circles(even[:20] * np.linspace(0.1, 3.0, 40)) for said in each]
    assert set(grown) == {"errors of `d` grow with the number of the row"}
    assert len(grown) > 10  # of 20, of which seven in ten are told


@pytest.mark.parametrize("rows", [20, 60])
def test_scores_are_rank_correlations(rows: int) -> None:
    """Without a fit, beside SciPy; model values stand twice, and share ranks."""
    rng = np.random.default_rng(5)
    fitted = np.repeat(rng.normal(size=(1, rows // 2)), 2, axis=1)
    residuals = np.square(fitted) * rng.normal(size=(1, rows))
    clauses = _clauses(fitted, residuals)
    place, grown, correlation = clauses.uneven(1)[0]
    columns = {
        "the size of its readings": np.abs(fitted),
        "its readings": fitted,
        "the number of the row": clauses.rows,
    }
    expected = spearmanr(columns[grown][0], np.abs(residuals[0]))[0]
    assert (place, correlation) == (0, pytest.approx(expected, abs=1e-12))


def _clauses(fitted: np.ndarray, residuals: np.ndarray) -> Clauses:
    none = np.zeros(fitted.shape)
    rows = np.broadcast_to(np.arange(fitted.shape[1]), fitted.shape)
    return Clauses(fitted=fitted, errors=residuals, residuals=residuals, leverage=none, rows=rows)


@pytest.mark.parametrize("clauses", [1, 2])
def test_chance(clauses: int) -> None:
    """Of 20,000 clauses without a fit, whose rows stand by size, so many are accused as there should be.

    Their distribution with 30 rows is nearly normal; its tails are a little shorter.
    """
    rng = np.random.default_rng(7)
    residuals = rng.standard_t(3, size=(20_000, 30))
    found = _clauses(np.sort(rng.random(residuals.shape)), residuals).uneven(clauses)
    share = 0.01 / clauses
    assert share * 0.5 < len(found) / 20_000 < share + 3 * np.sqrt(share / 20_000)


def test_many_solves_say_what_single_ones_say() -> None:
    rng = np.random.default_rng(6)
    runs = [np.arange(30), np.arange(60), np.arange(15), np.arange(60)]
    data = [
        (k, X[rows], 10 + 20 * X[rows] + rng.normal(size=rows.size) * (0.1 + 2 * X[rows]))
        for k, rows in enumerate(runs)
    ]
    columns = {"run": np.concatenate([np.full(x.size, k) for k, x, _ in data])}
    columns |= {"x": np.concatenate([x for _, x, _ in data]), "y": np.concatenate([y for *_, y in data])}
    many = mbm.loads(text(more="(for-each run)")).solve(data={"d": columns})
    for solve, (_, x, y) in zip(many.solves, data, strict=True):
        alone = mbm.loads(text()).solve(data={"d": {"x": x, "y": y}})
        many_said, alone_said = (
            [d.message for d in each.diagnostics if d.code.name == CODE] for each in (solve, alone)
        )
        assert many_said == alone_said
    assert sum(CODE in [d.code.name for d in solve.diagnostics] for solve in many.solves) >= 2


@pytest.mark.parametrize("noise", [100.0, 1e-3])
def test_a_clause_beside_stated_noise(noise: float) -> None:
    """The unknown factor of one clause is no part of its model's values, single or with for-each."""
    rng = np.random.default_rng(5)
    y = 10 + 20 * X + noise * rng.normal(size=(20, X.size))
    clauses = f"(observe e (= z a) :sigma {noise})"
    problem = "(problem p (data d external) (data e (table (z) (10))) (unknowns (a) (b)) "
    problem += f"(observe d (= y (+ a (* b x))) :sigma unknown) {clauses} "
    compiled = mbm.loads(problem + ")").compile()
    alone = [compiled.solve(data={"d": {"x": X, "y": each}}).diagnostics for each in y]
    many = mbm.loads(problem + "(for-each run))").solve(
        data={"d": {"run": np.repeat(np.arange(20), X.size), "x": np.tile(X, 20), "y": y.ravel()}}
    )
    said = [[d.code.name for d in each].count(CODE) for each in alone]
    assert said == [[d.code.name for d in solve.diagnostics].count(CODE) for solve in many.solves]
    assert sum(said) <= 2
