"""Solves made together say what solves made one by one say: documents, tables, CSV, for any number of threads."""

from __future__ import annotations

import copy
import io

import numpy as np
import pytest

import mbm
from mbm.compiler import SolveSettings
from mbm.kernels.native.engine import available
from mbm.report.blocks import ManyReports
from mbm.report.exports import write_solves
from mbm.report.solve_columns import solve_columns
from mbm.solution.interruption import Interruption

pytestmark = pytest.mark.skipif(not available(), reason="without machine code solves are made one by one")

RANGES = """
(problem tags
  (data receivers external :key receiver)
  (data ranges external :with (receivers receiver))
  (unknowns (p (vector 3) :init [1.75m 1.75m 1m]) {more})
  (observe ranges {when} (= range (distance p [receivers.x receivers.y receivers.z])) :sigma {sigma})
  (derive (height (- {top} (p 3)) :unit cm) (far (distance p [0m 0m 0m])))
  (for-each epoch))
"""
CURVE = """
(problem curves
  (data d external)
  (unknowns (a {a}) (turn (rotation 3) :init [0.2 0.1 -0.3]) (t angle :init 0.3))
  (observe d (= [u v w] (+ (rotate turn [x y 1]) [a a 0])) :sigma 0.01)
  (observe d (= c (cos (+ t x))) :sigma 0.02)
  (for-each g k))
"""


def epochs(count=40, outliers=False, seed=5):
    """Ranges to eight receivers from places in a room; some epochs have fewer."""
    generator = np.random.default_rng(seed)
    at = np.column_stack([generator.uniform(0, 4, 8), generator.uniform(0, 4, 8), generator.uniform(2, 3, 8)])
    rows = [(e, r) for e in range(count) for r in range(8) if not (e % 7 == 3 and r > 4)]
    places = generator.uniform([0.5, 0.5, 0.3], [3, 3, 1.5], (count, 3))
    epoch, receiver = (np.array(column) for column in zip(*rows, strict=True))
    ranges = np.linalg.norm(places[epoch] - at[receiver], axis=1) + 0.01 * generator.standard_normal(len(rows))
    if outliers:
        ranges[::37] += 0.5
    mixed = generator.permutation(len(rows))
    return {
        "receivers": {"receiver": np.arange(8), "x": at[:, 0], "y": at[:, 1], "z": at[:, 2]},
        "ranges": {"epoch": epoch[mixed], "receiver": receiver[mixed], "range": ranges[mixed]},
    }


def turned_points(seed=2):
    """Points that are turned and shifted, in twelve groups under two keys, one of them a text."""
    from scipy.spatial.transform import Rotation

    generator = np.random.default_rng(seed)
    parts = []
    for g in range(6):
        for k in ("left", "right"):
            turn = Rotation.from_rotvec([0.25, 0.05 + 0.02 * g, -0.3]).as_matrix()
            xy = generator.uniform(-1, 1, (9, 2))
            uvw = np.column_stack([xy, np.ones(9)]) @ turn.T + [0.3, 0.3, 0.0]
            uvw += 0.01 * generator.standard_normal(uvw.shape)
            c = np.cos(0.4 + xy[:, 0]) + 0.02 * generator.standard_normal(9)
            parts += [(float(g), k, *xy[i], *uvw[i], c[i]) for i in range(9)]
    names = ("g", "k", "x", "y", "u", "v", "w", "c")
    return {"d": {name: [part[i] for part in parts] for i, name in enumerate(names)}}


CONSENSUS = RANGES.format(more="", when="", sigma="10mm", top="2.7m").replace(
    "(for-each epoch)", "(for-each epoch) (solve :robust lmeds)"
)
LOSS = RANGES.format(more="", when="", sigma="10mm :loss huber", top="2.7m")
PROBLEMS = {
    "ranges": (RANGES.format(more="", when="", sigma="10mm", top="2.7m"), epochs()),
    "unknown noise": (RANGES.format(more="", when="", sigma="unknown", top="2.7m"), epochs()),
    "fixed": (RANGES.format(more="(b :init 2.7m :fixed true)", when="", sigma="10mm", top="b"), epochs()),
    "filtered": (RANGES.format(more="", when=":when (< receiver 7)", sigma="10mm", top="2.7m"), epochs()),
    "prior": (RANGES.format(more="(h :init 0.9m :sigma 3cm)", when="", sigma="10mm", top="h"), epochs()),
    "gross errors": (RANGES.format(more="", when="", sigma="10mm", top="2.7m"), epochs(outliers=True)),
    "a loss": (LOSS, epochs(outliers=True)),
    "a loss that is wide": (LOSS.replace("huber", "(huber 5)"), epochs()),
    "a loss of vectors": (
        "(problem turned (data d external) (unknowns (a :init 0) (turn (rotation 3) :init [0.2 0.1 -0.3]))"
        " (observe d (= [u v w] (+ (rotate turn [x y 1]) [a a 0])) :sigma 0.004 :loss soft-l1) (for-each g k))",
        turned_points(),
    ),
    "consensus": (CONSENSUS, epochs(outliers=True)),
    "consensus without a start": (CONSENSUS.replace(":init [1.75m 1.75m 1m]", ":unit m"), epochs(outliers=True)),
    "too few": (RANGES.format(more="", when=":when (< receiver 3)", sigma="10mm", top="2.7m"), epochs()),
    "rotations": (CURVE.format(a=":init 0"), turned_points()),
    "scattered": (
        "(problem lines (data d external) (unknowns (a :init 0) (b :init 0))"
        " (observe d (= c (+ a (* b x))) :sigma unknown) (derive (twice (* 2 a))) (for-each g k))",
        turned_points(),
    ),
    "bounds": (CURVE.format(a=":init 0 :in (-1 0.3)"), turned_points()),
    "linear": (
        "(problem lines (data d external) (unknowns (a :init 0) (b :init 0))"
        " (observe d (= c (+ a (* b x))) :sigma (+ 0.01 (abs y))) (for-each g k))",
        turned_points(),
    ),
}

MADE_TOGETHER = [
    *("ranges", "unknown noise", "filtered", "fixed", "rotations", "scattered", "linear", "consensus"),
    *("a loss", "a loss that is wide", "a loss of vectors"),
]


def numbers_apart(first, second, path=""):
    """Where two documents differ: texts anywhere, numbers by more than roundings in another order make of them."""
    if isinstance(first, dict) and isinstance(second, dict):
        if first.keys() != second.keys():
            yield path, sorted(first), sorted(second)
            return
        for name in first:
            if name not in ("seconds", "backend", "iterations", "evaluations"):
                yield from numbers_apart(first[name], second[name], f"{path}/{name}")
    elif isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        for i, (one, other) in enumerate(zip(first, second, strict=True)):
            yield from numbers_apart(one, other, f"{path}/{i}")
    elif isinstance(first, float) and isinstance(second, float):
        # Both paths end where the next step is below 1e-10 standard deviations, which here are 1e-3 to 1e-2; costs and
        # covariances follow from there to second and to first order.
        if abs(first - second) > 1e-9 * max(abs(first), abs(second)) + 1e-11:
            yield path, first, second
    elif first != second:
        yield path, first, second


@pytest.mark.parametrize("name", PROBLEMS)
def test_documents_agree_with_those_of_solves_one_by_one(name):
    text, data = PROBLEMS[name]
    problem = mbm.loads(text)
    made = problem.solve(data=data)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("mbm.solution.many.solve.FEW", 1_000)
        # the subsets of consensus are drawn alike in native code only
        plain = problem.solve(data=data, backend="auto" if ":robust" in text else "numpy")
    assert not isinstance(plain.result.solves, ManyReports)
    assert list(numbers_apart(plain.document(), made.document())) == []


@pytest.mark.parametrize("name", MADE_TOGETHER)
def test_these_are_made_together(name):
    """And not by the way that takes over where something is unusual."""
    text, data = PROBLEMS[name]
    solves = mbm.loads(text).solve(data=data).result.solves
    assert isinstance(solves, ManyReports)
    assert sum(block.block.columns.clean.sum() for block in solves.blocks) > len(solves) / 2


@pytest.mark.parametrize("name", ["ranges", "gross errors", "rotations", "consensus"])
def test_columns_say_what_the_reports_say(name):
    text, data = PROBLEMS[name]
    result = mbm.loads(text).solve(data=data).result
    columns, plain = solve_columns(result.solves), solve_columns(tuple(result.solves))
    assert [dict(key) for key in columns.keys] == [dict(key) for key in plain.keys]
    assert columns.statuses == plain.statuses
    assert columns.fits == plain.fits
    assert [s.name for s in columns.scalars] == [s.name for s in plain.scalars]
    for one, other in zip(columns.scalars, plain.scalars, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        np.testing.assert_array_equal(one.sigmas, other.sigmas)


def test_any_number_of_workers_gives_the_same_document(monkeypatch):
    """With so few rows in a slice that there are several."""
    monkeypatch.setattr("mbm.solution.many.solve.ROWS_AT_ONCE", 60)
    text, data = PROBLEMS["gross errors"]
    compiled = mbm.loads(text).compile(data=data)
    documents = []
    for workers in (1, 2, 5, None):
        document = copy.deepcopy(compiled.solve(workers=workers).document())
        for solve in document["solves"]:
            solve.pop("seconds")
        documents.append(document)
    assert all(document == documents[0] for document in documents)


def test_slices_do_not_change_the_answers(monkeypatch):
    text, data = PROBLEMS["ranges"]
    compiled = mbm.loads(text).compile(data=data)
    one = compiled.solve().table()
    monkeypatch.setattr("mbm.solution.many.solve.ROWS_AT_ONCE", 30)
    several = compiled.solve()
    assert len(several.result.solves.blocks) > 5
    table = several.table()
    for name in one:
        assert list(one[name]) == list(table[name])


def test_solves_are_a_sequence_of_reports():
    text, data = PROBLEMS["ranges"]
    solves = mbm.loads(text).solve(data=data).solves
    assert len(solves) == 40
    assert solves[-1].key == solves[39].key
    assert [s.key for s in solves[3:5]] == [solves[3].key, solves[4].key]
    with pytest.raises(IndexError):
        solves[40]
    rows = solves[2].rows()
    assert sum(row.residual**2 for row in rows) == pytest.approx(solves[2].cost, rel=1e-9)  # summed in another order


def test_csv_has_a_row_for_each_solve_in_the_order_of_the_keys():
    text, data = PROBLEMS["too few"]
    result = mbm.loads(text).solve(data=data).result
    stream = io.StringIO()
    write_solves(result, stream)
    lines = stream.getvalue().splitlines()
    order = dict.fromkeys(data["ranges"]["epoch"].tolist())
    assert [line.split(",")[0] for line in lines[1:]] == [str(epoch) for epoch in order]


class After(Interruption):
    """Requested once it has been asked so many times."""

    def __init__(self, count):
        super().__init__()
        self._left = count

    @property
    def requested(self):
        self._left -= 1
        return self._left < 0


def test_an_interrupted_run_keeps_the_solves_that_were_made(monkeypatch):
    monkeypatch.setattr("mbm.solution.many.solve.ROWS_AT_ONCE", 60)
    text, data = PROBLEMS["ranges"]
    compiled = mbm.loads(text).compile(data=data)
    whole = compiled.result(SolveSettings())
    part = compiled.result(SolveSettings(interruption=After(2)))
    assert not part.complete
    assert 0 < len(part.solves) < len(whole.solves)
    for i in range(len(part.solves)):
        np.testing.assert_array_equal(part.solves[i].estimates[0].value, whole.solves[i].estimates[0].value)


def test_a_row_that_spoils_its_solve_leaves_the_others():
    text, data = copy.deepcopy(PROBLEMS["ranges"])
    text = text.replace(":sigma 10mm", ":sigma s")
    data["ranges"]["s"] = np.full(len(data["ranges"]["range"]), 0.01)
    data["ranges"]["s"][5] = -1.0
    statuses = [s.status.label for s in mbm.loads(text).solve(data=data).solves]
    assert statuses.count("not-converged") == 1
    assert statuses.count("converged") == 39
