"""Tables sampled within a key of for-each, or a lap of a window, whose times start anew."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.problem.test_sampling import TRACK, data

RUNS = """
(problem runs
  (data track external) (data seen external)
  (unknowns (offset :init 0.1) (gain :init 1))
  (observe seen (= [u v] (* gain (sample track [x y] (+ t offset){order}))) :sigma 0.01{when})
  {more})
"""
EARLY = " :when (> (sample track x t) -0.5)"


def _runs():
    """Two drives whose clocks start anew, the second twice as fast; the rows of ``seen`` stand the other way round."""
    times = np.arange(0.2, 9, 0.3)
    drives = {1.0: data(times, offset=0.37), 2.0: data(times, offset=0.21, gain=0.8, seed=1)}
    drives[2.0]["track"] = {**drives[2.0]["track"], "x": 2 * TRACK[:, 0]}
    drives[2.0]["seen"] = {**drives[2.0]["seen"], "u": 2 * drives[2.0]["seen"]["u"]}
    order = {"track": [1.0, 2.0], "seen": [2.0, 1.0]}
    together = {
        table: {
            "run": np.concatenate([np.full(len(drives[run][table]["t"]), run) for run in order[table]]),
            **{c: np.concatenate([drives[run][table][c] for run in order[table]]) for c in drives[1.0][table]},
        }
        for table in order
    }
    return drives, together


@pytest.mark.parametrize("more", ["(for-each run)", "(window run :length 1 :step 1)"])
@pytest.mark.parametrize(("order", "when"), [("", ""), ("", EARLY), (" :order 3", "")])
def test_each_run_is_sampled_within_itself(order, when, more):
    drives, together = _runs()
    found = mbm.loads(RUNS.format(order=order, when=when, more=more)).solve(data=together)
    alone = mbm.loads(RUNS.format(order=order, when=when, more=""))
    assert [each.key["run"] for each in found.solves] == [1.0, 2.0]
    for each in found.solves:
        own = alone.solve(data=drives[each.key["run"]])
        assert each.dof == own.dof
        for name in ("offset", "gain"):
            # the same equations and start, in the same order
            assert float(each[name].value) == pytest.approx(float(own[name].value), rel=1e-12)
            assert float(each[name].sigma) == pytest.approx(float(own[name].sigma), rel=1e-12)


def test_a_window_over_two_runs_samples_each_within_itself():
    """Each row has the line of its own run between two of that run: nothing lies between rows of two."""
    t = np.tile(np.arange(4.0), 2)
    run = np.repeat([1.0, 2.0], 4)
    seen = np.array([0.5, 1.5, 2.5])
    tables = {
        "track": {"run": run, "t": t + 0.25 * run, "x": 10 * run + t},
        "seen": {"run": np.repeat([2.0, 1.0], 3), "t": np.tile(seen, 2), "u": np.zeros(6)},
    }
    tables["seen"]["u"] = 10 * tables["seen"]["run"] + tables["seen"]["t"] - 0.25 * tables["seen"]["run"] + 0.5
    text = """(problem p (data track external) (data seen external) (unknowns (s :init 0) (d :init 0.0))
      (observe seen (= u (+ s (sample track x (+ t d)))) :sigma 0.1) (observe d (= 0 d) :sigma 0.01)
      (window run :length 2 :step 1))"""
    last = mbm.loads(text).solve(data=tables).solves[-1]
    # all six lie between rows of their own run, one on its first
    assert last.dof == 6 + 1 - 2
    assert float(last["s"].value) == pytest.approx(0.5, abs=1e-9)
    assert last.cost == pytest.approx(0, abs=1e-15)


def test_rows_of_all_runs_are_sampled_in_each_where_their_table_has_none():
    t = np.tile(np.arange(3.0), 2)
    tables = {
        "track": {"run": np.repeat([1.0, 2.0], 3), "t": t, "x": np.concatenate([t[:3], 5 + t[:3]])},
        "seen": {"t": np.array([0.5, 1.5]), "u": np.array([10.5, 11.5])},
    }
    text = """(problem p (data track external) (data seen external) (unknowns (s))
      (observe seen (= u (+ s (sample track x t))) :sigma 0.1) (for-each run))"""
    found = mbm.loads(text).solve(data=tables)
    assert [float(each["s"].value) for each in found.solves] == pytest.approx([10.0, 5.0], rel=1e-12)
