"""Which rows are solved together, through whole problems; ``tests/evidence`` compares what comes out."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.equations.corrections import elimination, straight
from mbm.estimation.solve.estimate import assemble

CHAIN = """
(problem chain
  (data places external :key id)
  (data steps external :with (a places from) :with (b places to))
  (unknowns (scale :init 1))
  (observe steps (= d (* scale (- b.x a.x))) :errors ((a.x 0.1) (b.x 0.1)) :sigma 0.2))
"""


def steps(pairs: list[tuple[int, int]]) -> dict[str, dict[str, list[float]]]:
    places = {"id": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "x": [0.0, 1.1, 1.9, 3.2, 3.9, 5.1]}
    rows = {
        "from": [float(a) for a, _ in pairs],
        "to": [float(b) for _, b in pairs],
        "d": [float(b - a) for a, b in pairs],
    }
    return {"places": places, "steps": rows}


def dense_cost(pairs: list[tuple[int, int]], scale: float) -> float:
    """The cost at a given scale: the equations are linear in the places, so S is known in closed form."""
    tables = steps(pairs)
    x, d = np.array(tables["places"]["x"]), np.array(tables["steps"]["d"])
    slopes = np.zeros((len(pairs), 6))
    for i, (a, b) in enumerate(pairs):
        slopes[i, b - 1] += 0.1 * scale
        slopes[i, a - 1] -= 0.1 * scale
    misclosure = scale * (x[[b - 1 for _, b in pairs]] - x[[a - 1 for a, _ in pairs]]) - d
    return float(misclosure @ np.linalg.solve(slopes @ slopes.T + 0.04 * np.eye(len(pairs)), misclosure))


@pytest.mark.parametrize(
    "pairs",
    [
        [(1, 2), (3, 4), (5, 6)],
        [(1, 2), (2, 3), (5, 6)],
        [(1, 2), (2, 3), (4, 5), (5, 6)],
        [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (1, 6), (2, 5)],
        [(1, 2), (1, 2), (1, 2), (2, 1)],
        [(2, 2), (1, 3)],
    ],
    ids=["apart", "one pair shares", "two equal chains", "net", "more equations than places", "twice in one row"],
)
def test_the_cost_is_that_of_all_equations_together(pairs: list[tuple[int, int]]) -> None:
    solved = mbm.loads(CHAIN).solve(data=steps(pairs))
    scale = float(solved["scale"].value)
    cost = solved.first.cost
    assert cost == pytest.approx(dense_cost(pairs, scale), rel=1e-11, abs=1e-14)
    near = min(dense_cost(pairs, scale + h) for h in (-1e-3, 1e-3))
    assert cost <= near
    assert solved.first.dof == len(pairs) - 1


@pytest.mark.parametrize("at_a_time", [1, 10_000])
@pytest.mark.parametrize("pairs", [[(1, 2), (3, 4), (5, 6)], [(1, 2), (2, 3), (4, 5), (5, 6)], [(2, 2), (1, 3)]])
def test_costs_at_many_points_are_those_of_each(
    pairs: list[tuple[int, int]], at_a_time: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(elimination, "INPUTS_AT_A_TIME", at_a_time)
    compiled = mbm.loads(CHAIN).compile(data=steps(pairs))
    found = compiled.elaborated
    equations, _ = assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)
    scales = np.array([1.0, -0.3, 2.5, 0.0])
    costs = np.square(equations.residuals_at(scales[:, None])).sum(axis=1)
    np.testing.assert_allclose(costs, [dense_cost(pairs, scale) for scale in scales], rtol=1e-11)


def test_what_is_too_large_to_solve_at_once_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(straight, "LARGEST", 8)
    with pytest.raises(mbm.MbmError) as refused:
        mbm.loads(CHAIN).solve(data=steps([(1, 2), (2, 3), (3, 4)]))
    assert [d.code.name for d in refused.value.diagnostics] == ["too-many-shared-errors"]


def test_equations_that_are_left_out_pull_at_no_correction() -> None:
    """Two equations a row, and all second ones but one left out: as a problem without them."""
    text = """
    (problem p (data t external) (unknowns (a :init 1) (b :init 0))
      (observe t (= y (+ b (* a x))) (= z (* 2 x)) :errors ((x 0.1)) :sigma 0.2))
    """
    random = np.random.default_rng(1)
    x = np.arange(6.0)
    table = {"x": x, "y": 1.2 * x + 0.2 * random.normal(size=6), "z": 2 * x + random.normal(size=6)}
    compiled = mbm.loads(text).compile(data={"t": table})
    found = compiled.elaborated
    equations, _ = assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)
    units = np.tile([True, False], 6)
    units[1] = True
    kept = equations.kept(units)
    point = np.array([1.1, 0.3])
    misfit = table["y"] - 0.3 - 1.1 * x
    expected = misfit**2 / (0.04 + 0.0121)
    # the first row has both: S = B Bᵀ + Σ with B = 0.1 (1.1, 2)
    both, slopes = np.array([misfit[0], table["z"][0] - 2 * x[0]]), 0.1 * np.array([[1.1], [2.0]])
    expected[0] = both @ np.linalg.solve(slopes @ slopes.T + 0.04 * np.eye(2), both)
    residuals = kept.residuals(point)
    assert residuals.shape == (7,)
    assert residuals @ residuals == pytest.approx(expected.sum(), rel=1e-12)
    assert kept.everything().residuals(point).shape == (12,)
    assert kept.jacobian(point).shape == (7, 2)
