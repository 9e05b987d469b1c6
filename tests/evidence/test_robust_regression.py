"""Classic regression sets with outliers, against what the literature flags and estimates."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.evidence.regression_sets import EDUCATION, HBK, PILOT_PLANT, STACK_LOSS, TELEPHONE

TEXT = """
(problem regression
  (data t external)
  (unknowns (a) (b (vector {count})))
  (observe t (= y (+ a (dot b [{columns}]))) {loss})
  {solve})
"""


def solved(table, *, robust="none", loss="none", **options):
    explaining = [name for name in table if name != "y"]
    text = TEXT.format(
        count=len(explaining),
        columns=" ".join(explaining),
        loss=f":loss {loss}",
        solve=f"(solve :robust {robust})",
    )
    return mbm.loads(text).solve(data={"t": table}, **options).solves[0]


def outliers(solve):
    return list(solve.residual_summaries["t"].outliers)


@pytest.mark.parametrize("robust", ["lmeds", "(lmeds :trials 500)", "ransac", "msac"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_hawkins_bradu_kass_flags_exactly_the_ten_bad_rows(robust, seed):
    """Hawkins, Bradu and Kass (1984): rows 1-10 are bad leverage points, 11-14 good ones that attract least squares."""
    solve = solved(HBK, robust=robust, seed=seed)
    assert outliers(solve) == list(range(1, 11))
    design = np.column_stack([np.ones(75), HBK["x1"], HBK["x2"], HBK["x3"]])[10:]
    expected, cost, *_ = np.linalg.lstsq(design, HBK["y"][10:], rcond=None)
    found = np.concatenate([np.ravel(e.value) for e in solve.estimates])
    # Both are least squares on the same 65 rows.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    assert solve.cost == pytest.approx(float(cost[0]), rel=1e-9)
    assert solve.residual_summaries["t"].used == 65
    assert solve.dof == 61


@pytest.mark.parametrize("loss", ["tukey", "geman-mcclure"])
def test_redescending_losses_find_the_same_rows(loss):
    solve = solved(HBK, loss=loss)
    assert outliers(solve) == list(range(1, 11))
    rows = [r for r in solve.rows() if r.row is not None and r.row <= 10]
    assert max(r.weight for r in rows) < 0.05
    assert solve.robust_cost is not None
    assert solve.robust_cost < solve.cost


def test_stack_loss_gives_the_published_reweighted_fit():
    """Rousseeuw and Leroy (1987), chapter 3, table 2: without 1, 3, 4, 21: -37.652, 0.798, 0.577, -0.067, s = 1.253."""
    solve = solved(STACK_LOSS, robust="lmeds")
    assert outliers(solve) == [1, 3, 4, 21]
    found = np.concatenate([np.ravel(e.value) for e in solve.estimates])
    np.testing.assert_allclose(found, [-37.652, 0.798, 0.577, -0.067], rtol=0, atol=5e-4)
    assert solve.sigma0 == pytest.approx(1.253, abs=5e-4)


def test_telephone_calls_gives_the_published_line():
    """Rousseeuw and Leroy (1987), chapter 2: 1964-69 counted minutes, not calls; slope 0.110, intercept -5.26."""
    solve = solved(TELEPHONE, robust="lmeds")
    assert set(range(15, 21)) <= set(outliers(solve)) <= set(range(14, 22))
    assert float(np.ravel(solve.estimates[1].value)[0]) == pytest.approx(0.110, abs=1e-3)


def test_the_state_that_spends_most_on_schools_is_left_out():
    """Rousseeuw and Leroy (1987), chapter 3: case 50 alone is an outlier. Least trimmed squares with reweighting, as
    R's robustbase prints it: -277.57731, 0.06679, 0.04829, 0.88693."""
    solve = solved(EDUCATION, robust="lmeds")
    assert outliers(solve) == [50]
    found = np.concatenate([np.ravel(e.value) for e in solve.estimates])
    np.testing.assert_allclose(found, [-277.57731, 0.06679, 0.04829, 0.88693], rtol=0, atol=5e-6)


def test_nothing_is_left_out_where_nothing_is_wrong():
    """Rousseeuw and Leroy (1987), chapter 2: the pilot plant has no outliers; least squares: 0.322 x + 35.458."""
    solve = solved(PILOT_PLANT, robust="lmeds")
    assert outliers(solve) == []
    found = np.concatenate([np.ravel(e.value) for e in solve.estimates])
    np.testing.assert_allclose(found, [35.458, 0.322], rtol=0, atol=5e-4)


def test_least_squares_is_carried_away():
    """What robustness is for: plain least squares follows the bad leverage points and blames the good ones."""
    solve = solved(HBK)
    rows = sorted(solve.rows(), key=lambda r: -abs(r.residual))
    assert {r.row for r in rows[:3]} <= {11, 12, 13, 14}
