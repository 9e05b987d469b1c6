"""Solves that have no rows of some table, and rows in any order, say together what they say one by one."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.kernels.native.engine import available
from mbm.report.blocks import ManyReports
from mbm.report.solve_document import solve_document
from tests.estimation.many.test_families import one_by_one
from tests.estimation.many.test_together import numbers_apart

pytestmark = pytest.mark.skipif(not available(), reason="without machine code solves are made one by one")

LINES = """
(problem lines
  (data d external)
  (data q external)
  (unknowns (a :init 0.5) (v :init 0.1) {more})
  (observe d (= y (+ a (* v x))) :sigma 0.1)
  (observe q (= z (+ a (exp (* v x)) {besides})) :sigma 0.1 {loss})
  {clauses}
  (for-each epoch))
"""
WINDOWS = """
(problem windows
  (data d external)
  (unknowns (v :init 0) (b :init 0))
  (observe d (= y (+ (* v x) b)) :sigma 0.1)
  (constraints (<= (* v x) 1.15 :over d :name cap))
  (window t :length 3 :step 1 :min-rows 6))
"""
OFFSETS = {"more": "(b :per q.group :init 0)", "besides": "(b group)"}
KINDS = {
    "nothing more": {},
    "a loss": {"loss": ":loss huber"},
    "limits": {"clauses": "(constraints (<= (* v x) 0.55 :over q :name cap))"},
    "means known beforehand": {"clauses": "(constraints (normal (* v x) 0.2 0.3 :over q))"},
    "means of other numbers": {"clauses": "(constraints (normal v 0.3 0.2 :over q))"},
    "members": OFFSETS,
    "members with limits": OFFSETS | {"clauses": "(constraints (<= (b q.group) 0.02 :over q :name cap))"},
    "members known beforehand": OFFSETS | {"more": "(b :per q.group :init 0 :sigma 0.1)"},
    "consensus": {"clauses": "(solve :robust lmeds)"},
}


def lines(absent, seed=0):
    """30 epochs of points on a line, and of a curve but in the epochs ``absent``."""
    generator = np.random.default_rng(seed)
    points, curve = [], []
    for epoch in range(30):
        x = generator.uniform(0, 4, 6)
        points += [(epoch, u, w) for u, w in zip(x, 1 + 0.3 * x + 0.1 * generator.standard_normal(6), strict=True)]
        if epoch not in absent:
            x = generator.uniform(0, 2, 4)
            z = 1 + np.exp(0.3 * x) + 0.1 * generator.standard_normal(4)
            curve += [(epoch, u, w, "gh"[int(generator.integers(2))]) for u, w in zip(x, z, strict=True)]
    return {
        "d": {name: [row[i] for row in points] for i, name in enumerate(("epoch", "x", "y"))},
        "q": {name: [row[i] for row in curve] for i, name in enumerate(("epoch", "x", "z", "group"))},
    }


def without_messages(document):
    """Linear equations among others are solved by several steps, not by one, to the same end."""
    for solve in document["solves"]:
        del solve["message"]
    return document


@pytest.mark.parametrize("absent", [range(2, 30, 3), range(0, 30, 3), range(30)], ids=["not first", "first", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_solves_without_rows_of_a_table_are_told_from_those_with(kind, absent):
    """The first solve of a block has such rows, or none, or no solve has: nothing that others say follows from that."""
    problem = mbm.loads(LINES.format(**{"more": "", "besides": 0, "loss": "", "clauses": ""} | KINDS[kind]))
    data = lines(absent)
    solved = problem.solve(data=data)
    assert isinstance(solved.result.solves, ManyReports)
    made, plain = without_messages(solved.document()), without_messages(one_by_one(problem, data).document())
    # as `numbers_apart` argues
    assert list(numbers_apart(plain, made)) == []


@pytest.mark.parametrize("kind", ["nothing more", "limits", "members with limits"])
def test_reports_say_what_documents_say(kind):
    problem = mbm.loads(LINES.format(**{"more": "", "besides": 0, "loss": "", "clauses": ""} | KINDS[kind]))
    solved = problem.solve(data=lines(range(0, 30, 3)))
    assert [solve_document(solve) for solve in solved.result.solves] == solved.document()["solves"]


def test_limits_hold_by_their_own_rows_in_windows_of_rows_in_any_order():
    """With noise that is stated far too small, so that each solve is looked at by itself."""
    generator = np.random.default_rng(3)
    t = generator.permutation(np.arange(120) / 4)
    x = generator.uniform(0, 4, len(t))
    y = 0.3 * x + 0.9 * generator.standard_normal(len(t))
    problem, data = mbm.loads(WINDOWS), {"d": {"t": t, "x": x, "y": y}}
    made = problem.solve(data=data)
    assert isinstance(made.result.solves, ManyReports)
    assert list(numbers_apart(one_by_one(problem, data).document(), made.document())) == []
    held = [solve for solve in made.solves if any(limit.active for limit in solve.constraints)]
    assert held
    for solve in held:
        slope = solve.estimates[0]
        mine = (t > solve.key["t"] - 3) & (t <= solve.key["t"])
        # the slope is what the farthest point allows, to a few roundings
        assert slope.value == pytest.approx(1.15 / x[mine].max(), rel=1e-12)
        assert slope.sigma == pytest.approx(0, abs=1e-12)
