"""What is said of a fault of one solve of several, and of results that cannot give what is asked."""

from __future__ import annotations

import pickle

import pytest

import mbm

DANGLING = """(problem dangling
  (data r (table (k t y) (1 0 1.0) (1 1 2.0) (2 0 1.5) (2 2 2.5)))
  (data s (table (k t z) (1 0 1.1) (1 1 2.1) (2 1 1.4) (2 2 2.6)))
  (unknowns (a :per r.t :init 0))
  (observe r (= y (a t)) :sigma 0.1)
  (observe s (= z (a t)) :sigma 0.1)
  (for-each k))"""

WALK = """(problem walk
  (data r (table (t y) (0 1.5) (1 2.5) (2 2.7)))
  (states :over t (x :init 0 :sigma 3))
  (dynamics (random-walk x :sigma 0.5))
  (observe r (= y x) :sigma 0.1) (solve :method {}))"""


def test_a_fault_of_one_solve_has_its_place_and_mend():
    result = mbm.loads(DANGLING).solve()
    (diagnostic,) = result.document()["solves"][1]["diagnostics"]
    assert (diagnostic["row"], diagnostic["column_name"]) == (3, "t")
    assert diagnostic["hint"] == "correct the cell, or add the row"
    text = " ".join(str(result).split())
    assert "error[dangling-key]: 1 is no key of the family `a`, <text>:3 (column t): correct the cell, or add" in text


@pytest.mark.parametrize(("written", "said"), [("ekf", "ekf"), ("(smoother :lag 1)", "smoother"), ("batch", "batch")])
def test_the_options_have_the_estimator_of_states(written, said):
    assert mbm.loads(WALK.format(written)).solve().document()["options"]["method"] == said


def test_a_pickled_result_says_why_it_writes_no_files(tmp_path):
    result = pickle.loads(pickle.dumps(mbm.loads(WALK.format("batch")).solve()))  # noqa: S301
    with pytest.raises(mbm.MbmError, match="a result that was pickled has none"):
        result.write("ply", tmp_path / "out")
