"""Unknowns that nothing connects: each part agrees by itself, and tells of shared noise what it can."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.estimation.consensus.parts import parts_of

MEMBERS = """
(problem members
  (data t external)
  (unknowns (h :per t.name :init 0))
  (observe t (= v (h name)) {noise}) {solve})
"""


def rows(*members: tuple[str, list[float]]) -> dict[str, list]:
    return {"name": [n for n, v in members for _ in v], "v": [x for _, v in members for x in v]}


@pytest.mark.parametrize("loss", ["tukey", "geman-mcclure", "cauchy"])
def test_a_part_that_nothing_checks_does_not_stay_at_its_start(loss):
    near = [5.00, 5.01, 4.99, 5.005, 4.995, 30.0]
    table = rows(("a", near), ("b", near), ("c", near), ("d", [90.0]))
    text = MEMBERS.format(noise=f":sigma 0.01 :loss {loss}", solve="")
    found = mbm.loads(text).solve(data={"t": table})
    assert found["h"].value[3] == pytest.approx(90.0, abs=1e-9)
    assert found["h"].value[0] == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize("robust", ["lmeds", "gnc"])
def test_shared_noise_is_told_by_the_parts_that_have_some(robust):
    """Four members of six rows with noise of 0.01, one of them wrong, and 30 of a single row, which say nothing."""
    random = np.random.default_rng(3)
    several = [(f"m{i}", [*(10 * i + 0.01 * random.normal(size=5)), 10 * i + 0.5]) for i in range(4)]
    single = [(f"s{i}", [float(i)]) for i in range(30)]
    text = MEMBERS.format(noise=":sigma unknown", solve=f"(solve :robust {robust})")
    found = mbm.loads(text).solve(data={"t": rows(*several, *single)})
    residuals = np.concatenate([np.array(v[:5]) - np.mean(v[:5]) for _, v in several])
    spread = np.sqrt(residuals @ residuals / 16)  # 20 good rows, four means
    # 0.4: of 16 degrees of freedom the spread is told to a sixth, a robust one to less
    assert found["h"].sigma[0] == pytest.approx(spread / np.sqrt(5), rel=0.4)


def test_a_measured_value_that_rows_share_connects_their_unknowns():
    """Lines of three bundles; the first two share the stations, whose places have errors, the third has its own."""
    text = """(problem p (data m external :key j) (data t external :with (m j)) (unknowns (a :per t.k :init 1))
      (observe t (= y (* (a k) m.x)) :errors ((m.x 0.1)) :sigma 0.1))"""
    table = {"j": [0.0, 1, 1, 2, 3, 4], "k": [0.0, 0, 1, 1, 2, 2], "y": [1.0, 2, 3, 4, 5, 6]}
    data = {"m": {"j": np.arange(5.0), "x": np.arange(1.0, 6.0)}, "t": {c: np.array(v) for c, v in table.items()}}
    parts = parts_of(mbm.loads(text).compile(data=data)._assembled()[0])
    assert [part.columns.tolist() for part in parts] == [[0, 1], [2]]
    assert [part.rows.tolist() for part in parts] == [[0, 1, 2, 3], [4, 5]]
