"""A stream that is fed step by step says what the solve of all rows says of each step."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import mbm
from mbm.problem.sequence.types import RATE
from tests.emit.sequences import ARM, CART, DRIVE, FRAMES, STATIONS, STEPS, noisy, table


def fed(compiled, tables, by=None):
    """All answers of a stream that is fed the rows of all tables."""
    stream = compiled.stream()
    found = []
    for key in np.unique(np.concatenate([np.asarray(each["k"]) for each in tables.values()])):
        rows = {}
        for name, columns in tables.items():
            mine = np.flatnonzero(np.asarray(columns["k"]) == key)
            rows[name] = {c: [v[i] for i in mine] for c, v in columns.items()}
        found.append(stream.step(rows if by is None else by(rows, key)))
    found += stream.finish()
    return [each for each in found if each is not None]


def same(result, answers, names, last=()):
    """The estimates of the steps are those of the whole problem, to rounding."""
    assert [each.key for each in answers] == list(result[names[0]].keys)
    for name in names:
        for part in ("value", "sigma"):
            whole = getattr(result[name], part)
            np.testing.assert_allclose([getattr(each[name], part) for each in answers], whole, rtol=1e-12, atol=1e-12)
    for name in last:
        for part in ("value", "sigma"):
            whole = getattr(result[name], part)
            np.testing.assert_allclose(getattr(answers[-1][name], part), whole, rtol=1e-12, atol=1e-12)


METHODS = ("ekf", "iterated-ekf", "truncated-ekf", "(smoother :lag 3)", "(smoother :lag 1)", "(smoother :lag 20)")


@pytest.mark.parametrize("sigma", ["0.1", "s"])
@pytest.mark.parametrize("method", METHODS)
def test_steps_are_those_of_the_whole_problem(method, sigma):
    rest = "(constraints (<= x 1.1) (>= b -1)) " if method == "truncated-ekf" else ""
    tables = {"frames": FRAMES, "z": table(y=noisy, s=lambda k, g: 0.1 + 0.02 * k)}
    compiled = mbm.loads(CART.format(method=method, sigma=sigma, rest=rest)).compile(data=tables)
    result = compiled.solve()
    answers = fed(compiled, tables)
    same(result, answers, ["x", f"x{RATE}"], ["b"])
    if "smoother" not in method:
        assert sum(each.cost for each in answers) == pytest.approx(result.solves[0].cost, rel=1e-12)


@pytest.mark.parametrize("method", ["iterated-ekf", "(smoother :lag 2)"])
def test_rows_of_any_kind(method):
    rows = table(y=noisy, w=lambda k, g: g.random(len(k)))
    count = len(rows["k"])
    rows |= {"at": ["ab"[i % 2] for i in range(count)], "kind": ["near" if i % 3 else "far" for i in range(count)]}
    rows["y"][4] = -9.0
    tables = {"frames": FRAMES | {"go": np.cos(FRAMES["k"])}, "z": rows}
    compiled = mbm.loads(STATIONS.format(method=method, rest="")).compile(data=tables)
    answers = fed(compiled, tables)
    same(compiled.solve(), answers, ["x", "s"], ["lift"])
    assert answers[0].names == ('lift["a"]', 'lift["b"]', "s", "x")


@pytest.mark.parametrize("method", ["ekf", "(smoother :lag 2)"])
def test_poses_and_columns_of_transitions(method):
    k = FRAMES["k"]
    generator = np.random.default_rng(3)
    wheels = {"k": k, "forward": 1 + 0.02 * generator.standard_normal(STEPS), "turn": 0.1 + 0.0 * k}
    ranges = {
        "k": k,
        "px": 5.0 * (k % 2),
        "py": 4.0 + 0.0 * k,
        "d": 4 + 0.1 * k + 0.1 * generator.standard_normal(STEPS),
    }
    tables = {"wheels": wheels, "ranges": ranges}
    compiled = mbm.loads(DRIVE.format(method=method, rest="")).compile(data=tables)
    answers = fed(compiled, tables)
    result = compiled.solve()
    same(result, answers, ["at"])
    assert answers[0].names == ("at.rot[1]", "at.trans[1]", "at.trans[2]")
    whole = result.covariance
    last = [whole.names.index(f"at@8{name.removeprefix('at')}") for name in answers[-1].names]
    np.testing.assert_allclose(answers[-1].covariance, whole.matrix[np.ix_(last, last)], rtol=1e-12, atol=1e-15)


def test_hypotheses():
    a = np.deg2rad([10, 4, -2, -9, -15, -20, -24, -28, -30])
    tables = {"frames": FRAMES, "seen": {"k": FRAMES["k"], "x": np.cos(a)}}
    compiled = mbm.loads(ARM).compile(data=tables)
    answers = fed(compiled, tables)
    result = compiled.solve()
    same(result, answers, ["a"], ["l"])
    assert [each.hypotheses for each in answers] == list(result.solves[0].record.followed)
    assert max(each.hypotheses for each in answers) > 1


@pytest.mark.parametrize("method", ["ekf", "(smoother :lag 3)"])
def test_a_step_may_have_more_rows_than_any_before(method):
    generator = np.random.default_rng(5)
    k = np.repeat(np.arange(STEPS, dtype=float), [1, 1, 2, 1, 40, 1, 200, 1, 3])
    tables = {"frames": FRAMES, "z": {"k": k, "y": np.sin(0.4 * k) + 0.1 * generator.standard_normal(len(k))}}
    problem = mbm.loads(CART.format(method=method, sigma=0.1, rest=""))
    few = {"frames": FRAMES, "z": {"k": [0.0], "y": [0.0]}}
    same(problem.solve(data=tables), fed(problem.compile(data=few), tables), ["x", f"x{RATE}"], ["b"])


def test_a_step_is_named_by_its_rows_or_beside_them():
    tables = {"frames": FRAMES, "z": table(y=noisy)}
    compiled = mbm.loads(CART.format(method="ekf", sigma=0.1, rest="")).compile(data=tables)
    stream = compiled.stream()
    found = []
    for key in FRAMES["k"]:
        y = tables["z"]["y"][tables["z"]["k"] == key]
        rows = {} if not len(y) else {"z": {"y": y[0] if len(y) == 1 else y}}
        found.append(stream.step(rows, at=key))
    same(compiled.solve(), found, ["x"], ["b"])
    assert stream.finish() == []


def test_units_of_columns():
    text = """
    (problem ms (data z external :columns ((k ms :unit ms) (y mm :unit mm)))
      (states :over k (x :init 0m :sigma 1m :unit cm)) (dynamics (random-walk x :sigma 3m))
      (observe z (= y x) :sigma 5mm) (solve :method ekf))"""
    rows = {"ms": [0.1, 0.3, 0.7], "mm": [3.0, 5.0, 2.0]}
    compiled = mbm.loads(text).compile(data={"z": rows})
    result, stream = compiled.solve(), compiled.stream()
    found = [stream.step({"z": {"ms": t, "mm": y}}) for t, y in zip(*rows.values(), strict=True)]
    same(result, found, ["x"])
    assert found[0]["x"].unit == "cm"
    np.testing.assert_allclose(found[1].covariance, [[found[1]["x"].sigma ** 2]], rtol=1e-14)


WRONG = {
    "over": ({"z": {"k": 1.0, "y": 0.0}}, None, "wrong-step", "does not follow"),
    "several": ({"z": {"k": [3.0, 4.0], "y": [0.0, 0.0]}}, None, "wrong-step", "one and the same `k`"),
    "none": ({"z": {"y": 0.0}}, None, "wrong-step", "no step is named"),
    "no rows": ({}, None, "wrong-step", "no step is named"),
    "other step": ({"z": {"k": 3.0, "y": 0.0}}, 4.0, "wrong-step", "one and the same `k`"),
    "no step": ({"z": {"k": np.nan, "y": 0.0}}, None, "wrong-step", "k"),
    "unknown": ({"zz": {"k": 3.0, "y": 0.0}}, None, "wrong-step", "`zz` is no table with steps"),
    "lacking": ({"z": {"k": 3.0}}, None, "wrong-step", "lack `y`"),
    "text": ({"z": {"k": 3.0, "y": "a"}}, None, "wrong-step", "holds texts"),
    "gap": ({"z": {"k": 3.0, "y": np.nan}}, None, "not-finite", "y"),
    "lengths": ({"z": {"k": [3.0, 3.0], "y": [0.0]}}, None, "unequal-lengths", "y"),
    "kind": (3, None, "wrong-argument", "tables"),
    "list": ({"z": [1.0]}, None, "not-a-table", "float"),
    "nested": ({"z": {"k": 3.0, "y": [[0.0]]}}, None, "bad-cell", "y"),
    "text at": ({}, "x", "wrong-argument", "`at` is 'x'; a finite number"),
    "number as text": ({}, "3", "wrong-argument", "`at` is '3'; a finite number"),
    "infinite at": ({}, np.inf, "wrong-argument", "a finite number"),
    "text step": ({"z": {"k": "a", "y": 0.0}}, None, "wrong-step", "k"),
}


@pytest.mark.parametrize("rows", WRONG.values(), ids=WRONG)
def test_rows_that_are_none_leave_the_stream_as_it_was(rows):
    tables, at, code, words = rows
    compiled = mbm.loads(CART.format(method="ekf", sigma=0.1, rest="")).compile(
        data={"frames": FRAMES, "z": table(y=noisy)}
    )
    one, other = compiled.stream(), compiled.stream()
    for stream in (one, other):
        stream.step({"z": {"k": 2.0, "y": 0.3}})
    with pytest.raises(mbm.MbmError, match=code) as caught:
        one.step(tables, at=at)
    assert words in str(caught.value)
    last = [stream.step({"z": {"k": 5.0, "y": 0.4}})["x"] for stream in (one, other)]
    assert last[0].value == last[1].value
    assert last[0].sigma == last[1].sigma


REFUSED = {
    "no states": (
        "(problem p (data d (table (y) (1))) (unknowns (a :init 0)) (observe d (= y a) :sigma 1))",
        "without `states`",
    ),
    "for-each": (CART.format(method="ekf", sigma=0.1, rest="(for-each k)"), "`for-each`"),
    "other rows": (CART.format(method="ekf", sigma="(first z s)", rest=""), "looks at rows of other steps"),
    "row": (CART.format(method="ekf", sigma="(* 0.1 row)", rest=""), "looks at rows of other steps"),
    "counts": (
        CART.format(method="batch", sigma="0.1 :distribution (student 3)", rest=""),
        "`:distribution student` of `z` does not go with a stream",
    ),
    "all at once": (
        CART.format(method="batch", sigma="0.1 :correlation (ar1 0.5)", rest=""),
        "a stream takes one step after the other",
    ),
    "lag": (CART.format(method="(smoother :lag 1000000000)", sigma=0.1, rest=""), "too-much-memory"),
}


@pytest.mark.parametrize("text", REFUSED.values(), ids=REFUSED)
def test_what_has_no_stream_is_refused(text):
    stated, words = text
    tables = {"frames": FRAMES, "z": table(y=noisy, s=lambda k, g: 0.1 + 0.02 * k)}
    compiled = mbm.loads(stated).compile(data=tables if "external" in stated else None)
    with pytest.raises(mbm.MbmError) as caught:
        compiled.stream()
    assert words in str(caught.value)


def test_a_row_of_a_kind_that_was_not_compiled():
    text = """
    (problem kinds (data z external)
      (states :over k (x :init 0 :sigma 1)) (dynamics (random-walk x :sigma 1))
      (observe z (= y (if (= kind "near") x (if (= kind "far") (* 2 x) (* 3 x)))) :sigma 1) (solve :method ekf))"""
    data = {"z": {"k": [0.0, 1.0], "y": [0.0, 1.0], "kind": ["near", "far"]}}
    stream = mbm.loads(text).compile(data=data).stream()
    stream.step({"z": {"k": 0.0, "y": 0.0, "kind": "far"}})
    with pytest.raises(mbm.MbmError, match="no-equation-for-row"):
        stream.step({"z": {"k": 1.0, "y": 0.0, "kind": "other"}})


def test_a_stream_ends_where_nothing_is_finite():
    text = """
    (problem roots (data z external)
      (states :over k (x :init 1 :sigma 0.1)) (dynamics (= (next x) (sqrt (- x 1)) :sigma 0.1))
      (observe z (= y x) :sigma 0.1) (solve :method ekf))"""
    stream = mbm.loads(text).compile(data={"z": {"k": [0.0, 1.0], "y": [0.0, 1.0]}}).stream()
    stream.step({"z": {"k": 0.0, "y": 0.0}})
    for _ in range(2):
        with pytest.raises(mbm.MbmError, match="stream-stopped: the stream has ended at `k` = 1,"):
            stream.step({"z": {"k": 1.0, "y": 0.0}})
    assert stream.finish() == []


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_stream_is_not_copied(copied):
    """A copy that took steps would change this one."""
    compiled = mbm.loads(
        """(problem walk (data d (table (t y) (1 2))) (states :over d.t (x :init 0 :sigma 10))
          (dynamics (= (next x) x :sigma 0.1)) (observe d (= y x) :sigma 0.1) (solve :method ekf))"""
    ).compile()
    with pytest.raises(TypeError, match="a stream is neither pickled nor copied"):
        copied(compiled.stream())


def test_an_unknown_that_is_none():
    compiled = mbm.loads(CART.format(method="ekf", sigma=0.1, rest="")).compile(
        data={"frames": FRAMES, "z": table(y=noisy)}
    )
    with pytest.raises(KeyError, match=r"there are b, x, x\.rate"):
        compiled.stream().step(at=0.0)["y"]


ODOMETRY = """
(problem odometry
  (data o external) (data z external)
  (states :over k (at (pose 2) :init (pose2 0 0 0) :sigma 0.1))
  (dynamics (= (next at) (compose at (pose2 ahead 0 turn)) :sigma {sigma}))
  (observe z (= y (translation at)) :sigma 0.3)
  (solve :method {method}))
"""


@pytest.mark.parametrize("sigma", ["0.05", "s"])
@pytest.mark.parametrize("method", ["ekf", "(smoother :lag 2)"])
def test_transitions_with_other_numbers_at_each_step(method, sigma):
    """Where noise is the same, the numbers alone are put in the place of those before."""
    g = np.random.default_rng(3)
    k = np.array([0.0, 1, 2, 4, 5, 6, 7])
    o = {"k": k, "ahead": 1 + 0.1 * g.normal(size=7), "turn": 0.2 * g.normal(size=7), "s": 0.04 + 0.01 * np.cos(k)}
    text = ODOMETRY.format(method=method, sigma=sigma).replace("(= y (tr", "(= [y1 y2] (tr")
    tables = {"o": o, "z": {"k": k, "y1": k + 0.1 * g.normal(size=7), "y2": 0.1 * g.normal(size=7)}}
    compiled = mbm.loads(text).compile(data=tables)
    same(compiled.solve(), fed(compiled, tables), ["at"])


def test_a_step_names_what_it_estimates_and_a_smoother_has_no_cost_of_a_step():
    text = """(problem p (data seen (table (t x) (0 0) (1 0)))
      (states :over t (p :init 0 :sigma 1)) (unknowns (b :init 0 :sigma 1))
      (dynamics (random-walk p :sigma 0.1)) (observe seen (= x (+ p b)) :sigma 0.1) (solve :method {}))"""
    stream = mbm.loads(text.format("ekf")).compile().stream()
    answer = stream.step({"seen": {"t": 0, "x": 0.2}})
    assert sorted(answer) == ["b", "p"]
    assert "p" in answer
    assert "q" not in answer
    # (x − 0)²/S with S = 1 + 1 + 0.01
    assert answer.cost == pytest.approx(0.04 / 2.01, rel=1e-9)
    smoother = mbm.loads(text.format("(smoother :lag 1)")).compile().stream()
    assert smoother.step({"seen": {"t": 0, "x": 0.2}}) is None
    assert smoother.step({"seen": {"t": 1, "x": 0.2}}).cost is None
    smoother.finish()
    with pytest.raises(mbm.MbmError, match="`finish`"):
        smoother.step({"seen": {"t": 2, "x": 0.2}})
