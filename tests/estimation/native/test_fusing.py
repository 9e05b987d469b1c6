"""Rows of small groups in one function: the answers of the kernels one by one, and only where all rows are there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mbm
from mbm.estimation.minimise.native.fusing import MOST_RESIDUALS, unitable
from mbm.estimation.minimise.native.system import system_of
from mbm.solver import description as of

PLACES = "(unknowns (p (vector 2) :init [0.4 0.3]) (h angle :init 20deg) (s :init 1.1))"
ERRORS = (0.004, -0.007, 0.003, 0.01, -0.005)
MARKS = "".join(
    f"(observe (= {1.1 * np.cos(0.3 + k) + 0.5 + 0.3 * k + error} (+ (* s (cos (+ h {k}))) (p 1) (* {k} (p 2))))"
    f" :sigma 0.00{5 + k})"
    for k, error in enumerate(ERRORS)
)
PROBLEMS = {
    "marks": PLACES + MARKS,
    "a prior": PLACES + MARKS + "(constraints (normal s 1.1 0.01) (normal h 17deg 2deg))",
    "a bound": PLACES.replace("1.1", "1.1 :in [1 1.09]") + MARKS,
    "a fixed unknown": PLACES.replace("1.1", "1.1 :fixed true") + MARKS,
    "a surface": PLACES + MARKS + "(constraints (= (+ (p 1) (p 2)) 0.8))",
    "a table": PLACES + MARKS + "(observe t (= y (* s (exp (* (p 1) x)))) :sigma 0.01)",
    "a matrix": PLACES + MARKS + "(observe (= [0.55 0.34] (* s p)) :covariance [[4e-4 1e-4] [1e-4 2e-4]])",
    "a turn": "(unknowns (R (rotation 3)))"
    + "".join(
        f"(observe (= {value} (transform R {point})) :sigma 0.01)"
        for value, point in (("[0 1 0]", "[1 0 0]"), ("[-1 0 0.01]", "[0 1 0]"), ("[0.02 0 1]", "[0 0 1]"))
    ),
}
X = np.linspace(0.0, 1.0, 6)
TABLE = {"x": X, "y": 1.1 * np.exp(0.5 * X) + 0.01 * np.cos(40.0 * X)}


def systems(both, name):
    """The system with fused rows, that without, and the start of the last minimum that the problem asks for."""
    text = f"(problem p (data t external) {PROBLEMS[name]})"
    text = text if "observe t" in text else text.replace("(data t external)", "")
    given = {"t": TABLE} if "observe t" in text else {}
    equations, start, settings, *_ = both.of(text, **given)[-1]
    return system_of(equations, settings, often=True), system_of(equations, settings), start


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_same_ends(both, name):
    together, apart, start = systems(both, name)
    assert together.system[of.Problem.fused_reals] > 0
    assert apart.system[of.Problem.fused_reals] == 0
    one, two = together.one(start), apart.one(start)
    assert two.clean[0]
    assert one.clean[0]
    sigma = np.sqrt(np.diag(two.covariances[0]))
    # Both end where the next step is below 1e-8 standard deviations; numbers of rotations are some units of sigma.
    np.testing.assert_allclose(one.numbers[0], two.numbers[0], rtol=0, atol=1e-7 * sigma.max() + 1e-12)
    np.testing.assert_allclose(one.covariances[0], two.covariances[0], rtol=0, atol=1e-9 * sigma.max() ** 2)
    np.testing.assert_array_equal(one.sides, two.sides)
    np.testing.assert_array_equal(one.states[:, of.FREEDOM], two.states[:, of.FREEDOM])
    # Rows in another order are rounded differently; multipliers follow from a violation of 1e-12 units.
    assert one.results[0, of.COST] == pytest.approx(two.results[0, of.COST], rel=1e-9, abs=1e-18)
    np.testing.assert_allclose(one.multipliers, two.multipliers, rtol=1e-5)


def test_rows_that_do_not_count_leave_the_kernels_to_themselves(both):
    together, apart, start = systems(both, "marks")
    for system in (together, apart):
        system.rows.weights[0] = 0.0
        system.rows.parameters[0] = np.nan
    for a, b in zip(together.one(start).arrays().values(), apart.one(start).arrays().values(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_data_sets_with_other_rows_leave_the_kernels_to_themselves(both):
    """A group without rows in one data set, beside one in which it has some: each as it is alone."""
    together, apart, start = systems(both, "marks")
    fewer = together.rows.data.copy()
    fewer[0, of.DataSet.count] -= 1
    fewer[0, of.DATA_HEAD + of.DataBlock.rows] = 0
    sets = np.vstack([together.rows.data, fewer, together.rows.data])
    found = replace(together, rows=replace(together.rows, data=sets)).solve(np.tile(start, (3, 1)), np.arange(3))
    alone = replace(apart, rows=replace(apart.rows, data=fewer)).one(start)
    for many, other, one in zip(
        found.arrays().values(), alone.arrays().values(), together.one(start).arrays().values(), strict=True
    ):
        np.testing.assert_array_equal(many[1], other[0])
        np.testing.assert_array_equal(many[0], one[0])
        np.testing.assert_array_equal(many[2], one[0])


def test_large_groups_losses_and_constraints_stay_by_themselves(both):
    text = (
        f"(problem p (data t external) {PLACES} {MARKS} (observe t (= y (* s x)) :sigma 1)"
        " (observe (= 1 s) :sigma 0.1 :loss (huber 2)) (constraints (= (+ (p 1) (p 2)) 0.5)))"
    )
    equations, *_ = both.of(text, t=TABLE)[-1]
    groups = (*equations.groups, *equations.constraints)
    rows = [group.rows for group in groups]
    found = dict(zip((group.kernel.purpose.value + str(k) for k, group in enumerate(groups)), rows, strict=True))
    chosen = unitable(groups, rows)
    assert sum(chosen) == 5, found
    assert [group.rows for group, count in zip(groups, chosen, strict=True) if count] == [1] * 5
    many = [group for group in groups if group.rows == 1 and group.whiteners and not any(group.losses)]
    assert sum(unitable(many * MOST_RESIDUALS, [1] * 5 * MOST_RESIDUALS)) == MOST_RESIDUALS


def test_an_estimator_gives_what_whole_solves_give():
    text = f"(problem p (data t external) {PLACES} {MARKS} (observe t (= [x y] [(* s (p 1)) (* 2 s)]) :sigma 0.1))"
    given = {"x": np.array([0.55]), "y": np.array([2.2])}
    compiled = mbm.loads(text).compile(data={"t": given})
    estimator = compiled.estimator("x", "y")
    assert estimator.fast
    other = {"x": np.array([0.6]), "y": np.array([2.1])}
    found, solved = estimator(*other.values()), compiled.solve(data={"t": other})
    assert found.clean
    for name in ("p", "h", "s"):
        # Both end where the next step is below 1e-8 standard deviations, which are some hundredths.
        np.testing.assert_allclose(found[name], solved[name].value, rtol=0, atol=1e-8)
