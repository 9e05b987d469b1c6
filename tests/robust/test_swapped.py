"""A false row in the place of a true one, under a loss that leaves rows out, at the same cost: said."""

from __future__ import annotations

import re

import numpy as np
import pytest

import mbm

TEXT = """
(problem chain
  (data places external :key id)
  (data steps external)
  (unknowns (x :per places :fixed (= id 0)))
  (observe steps (= d (- (x to) (x from))) :sigma 0.1 {how}))"""
ODOMETRY = """
(problem chain
  (data places external :key id)
  (data steps external)
  (unknowns (x :per places :fixed (= id 0)))
  (observe odometry steps (= d (- (x to) (x from))) :sigma 0.1 :when (= (- to from) 1))
  (observe loops steps (= d (- (x to) (x from))) :sigma 0.1 :loss tukey :when (> (- to from) 1)))"""
FALSE, TAIL = 40.0, 3


def chain(count, *, false=FALSE, closed=False, seed=0):
    """A chain of places a metre apart: loops join all but the last `TAIL`.

    The last row, from the first place to the last, is ``false`` by so much; ``closed``: a true row joins these as well.
    """
    g, inner = np.random.default_rng(seed), count - TAIL
    pairs = [(i, i + 1) for i in range(count - 1)] + [(i, i + 2) for i in range(inner - 2)]
    pairs += [(0, inner - 1), (1, inner - 1)] + [(2, count - 1)] * closed + [(0, count - 1)]
    first, last = np.array(pairs).T
    d = (last - first).astype(float) + 0.1 * g.normal(size=len(first))
    d[-1] += false
    return {"places": {"id": np.arange(float(count))}, "steps": {"from": first, "to": last, "d": d}}


def said(text, count, **how):
    """What is said of it, and the estimates."""
    found = mbm.loads(text).solve(data=chain(count, **how))
    return messages(found.first), found["x"].value


def messages(solve):
    """What is said of which rows are wrong."""
    return [
        each.message
        for each in solve.diagnostics
        if each.code.name == "ambiguous-consensus" and "left out" in each.message
    ]


@pytest.mark.parametrize("loss", ["tukey", "cauchy", "geman-mcclure"])
@pytest.mark.parametrize("count", [12, 80])
def test_any_of_the_rows_that_hold_the_end_of_a_chain_may_be_the_false_one(count, loss):
    """One of them is left out, the others are named: of many unknowns, too, which sparse matrices solve."""
    (message,), _ = said(TEXT.format(how=f":loss {loss}"), count)
    rows = sorted(int(each) for each in re.findall(r"\d+", message))
    last = (count - 1) + (count - TAIL - 2) + 2 + 1
    assert rows == [*range(count - TAIL, count), last]


@pytest.mark.parametrize("count", [12, 80])
def test_nothing_is_said_where_the_others_tell(count):
    """Another true row to the end outvotes the false one; odometry without a loss is never left out."""
    loss = TEXT.format(how=":loss tukey")
    for told, x in (said(loss, count, closed=True), said(ODOMETRY, count), said(loss, count, false=0.0)):
        assert told == []
        assert abs(x[-1] - (count - 1)) < 1.0  # a step scatters by 0.1


def test_solves_side_by_side_say_the_same():
    tables = [chain(12, false=each)["steps"] for each in (0.0, FALSE, 0.0)]
    steps = {name: np.concatenate([each[name] for each in tables]) for name in tables[0]}
    steps["run"] = np.repeat([1, 2, 3], len(tables[0]["d"]))
    text = TEXT.format(how=":loss tukey").rstrip()[:-1] + " (for-each run))"
    found = mbm.loads(text).solve(data={"places": chain(12)["places"], "steps": steps})
    assert [len(messages(each)) for each in found.solves] == [0, 1, 0]


@pytest.mark.parametrize("rule", ["ransac", "msac", "lmeds"])
def test_consensus_says_the_same(rule):
    """It leaves rows out altogether; another true row to the end outvotes the false one."""
    text = TEXT.format(how="").rstrip()[:-1] + f" (solve :robust {rule}))"
    (message,), _ = said(text, 12)
    assert sorted(int(each) for each in re.findall(r"\d+", message)) == [9, 10, 11, len(chain(12)["steps"]["d"])]
    assert said(text, 12, closed=True)[0] == []


@pytest.mark.parametrize("how", [" :loss tukey))", ") (solve :robust ransac))"])
def test_any_step_between_two_ends_of_loops_may_be_the_false_one(how):
    """Two rows from each end of the chain to each other end contradict the three steps between: not which of these."""
    pairs = [(i, i + 1) for i in range(9)] + [(0, 2), (1, 3), (0, 3), (6, 8), (7, 9), (6, 9)] + [(0, 9), (2, 7), (3, 6)]
    first, last = np.array(pairs).T
    d = (last - first).astype(float) + 0.1 * np.random.default_rng(1).normal(size=len(first))
    d[4] += 30.0  # from 4 to 5
    data = {"places": {"id": np.arange(10.0)}, "steps": {"from": first, "to": last, "d": d}}
    (message,) = messages(mbm.loads(TEXT.format(how="")[:-3] + how).solve(data=data).first)
    assert sorted(int(each) for each in re.findall(r"\d+", message)) == [4, 5, 6]


def test_a_row_of_great_influence_that_others_still_check_is_not_alone():
    """The leverage of the third row is 0.72, also where consensus counts rows with 0.72 of their information."""
    text = """(problem line (data d (table (x y)
        (1.6698 1.4399) (2.1656 1.6311) (0.4505 0.9935) (1.6278 1.4056) (0.0012 1.2759) (2.9775 1.9974)))
      (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.1) (solve :robust lmeds))"""
    (solve,) = mbm.loads(text).solve().solves
    assert np.flatnonzero(solve.residuals("d")["outlier"]).tolist() == [4]
    assert "ambiguous-consensus" not in [each.code.name for each in solve.diagnostics]
