"""Consensus of many data sets of which some fall apart: what one solve answers alone."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

COUNT = 14

TEXT = """
(problem heights
  (data marks external :key id)
  (data levels external)
  (data steps external)
  (unknowns (h :per marks :init 0))
  (observe levels (= y (h k)) :sigma 0.1 {loss})
  (observe steps (= y (- (h j) (h k))) :sigma 0.1 {loss})
  {solve} {each})
"""


def data_set(random: np.random.Generator, *, joined: bool) -> dict[str, dict[str, np.ndarray]]:
    """Fourteen heights, of each three of five levels right; steps between neighbours only if ``joined``."""
    heights = 10.0 * np.arange(COUNT)
    k = np.repeat(np.arange(COUNT), 5)
    y = heights[k] + 0.1 * random.normal(size=len(k))
    y[0::5] += 30 * random.normal(size=COUNT)
    y[1::5] += 30 * random.normal(size=COUNT)
    from_ = np.arange(COUNT - 1 if joined else 0)
    steps = heights[from_ + 1] - heights[from_] + 0.1 * random.normal(size=len(from_))
    return {"levels": {"k": k, "y": y}, "steps": {"j": from_ + 1, "k": from_, "y": steps}}


@pytest.mark.parametrize(
    ("loss", "solve"), [("", "(solve :robust lmeds)"), ("", "(solve :robust ransac)"), (":loss tukey", "")]
)
def test_solves_that_fall_apart_are_those_of_one_alone(loss, solve):
    random = np.random.default_rng(2)
    runs = [data_set(random, joined=run == 0) for run in range(4)]
    marks = {"id": np.arange(COUNT)}
    tables = {}
    for name in ("levels", "steps"):
        run = np.concatenate([np.full(len(each[name]["y"]), number) for number, each in enumerate(runs)])
        columns = {column: np.concatenate([each[name][column] for each in runs]) for column in runs[0][name]}
        tables[name] = {"run": run, **columns}
    together = mbm.loads(TEXT.format(loss=loss, solve=solve, each="(for-each run)"))
    found = together.solve(data={"marks": marks, **tables}).solves
    alone = mbm.loads(TEXT.format(loss=loss, solve=solve, each=""))
    for number, each in enumerate(runs):
        one = alone.solve(data={"marks": marks, **each}).first
        assert found[number].status == one.status
        # two ways of the same arithmetic, stopped within a tolerance of 1e-6 deviations
        np.testing.assert_allclose(found[number].estimates[0].value, one.estimates[0].value, atol=1e-5)
        if number:
            np.testing.assert_allclose(one.estimates[0].value, 10.0 * np.arange(COUNT), atol=0.4)
