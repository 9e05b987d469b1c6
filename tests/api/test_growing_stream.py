"""The stream of a smoother, or of `batch`: after each step what all rows so far say, at a cost that does not grow."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.estimation.sequences.kalman import jointly

WALK = """
(problem walk (data z external) (data w external)
  {unknowns} (states :over k (x :init 0 :sigma 10))
  (dynamics (random-walk x :sigma 1)) (observe z (= y {seen}) :sigma 0.5) {rest} (solve :method {method}))"""

DRIVE = """
(problem drive (data o external) (data p external)
  (states :over k (T (pose 2) :init (pose2 0 0 0) :sigma [0.1 0.5 0.5]))
  (dynamics (= (next T) (compose T (pose2 dx dy da)) :sigma [0.01 0.05 0.02]))
  (observe p (= [px py] (translation T)) :sigma 0.5)
  (solve :method {method}))"""

STEPS = 240


def rows_until(tables, last):
    """The rows of all steps up to one."""
    return {
        name: {column: np.asarray(cells)[np.asarray(each["k"]) <= last] for column, cells in each.items()}
        for name, each in tables.items()
    }


def rows_of(tables, key):
    """The rows of one step."""
    return {
        name: {column: np.asarray(cells)[np.asarray(each["k"]) == key] for column, cells in each.items()}
        for name, each in tables.items()
    }


def drive():
    """Motions and positions with their noise; positions are lacking for 60 steps."""
    generator = np.random.default_rng(7)
    turns = 0.05 * np.sin(np.arange(STEPS) / 40)
    heading = np.concatenate([[0.0], np.cumsum(turns[1:])])
    way = np.column_stack([np.cos(heading[:-1]), np.sin(heading[:-1])])
    places = np.vstack([[0.0, 0.0], np.cumsum(way, axis=0)]) + 0.5 * generator.standard_normal((STEPS, 2))
    k = np.arange(STEPS, dtype=float)
    seen = (k < 120) | (k >= 180)
    noise = generator.standard_normal((3, STEPS)) * np.array([[0.01], [0.05], [0.02]])
    return {
        "o": {"k": k, "da": turns + noise[0], "dx": 1.0 + noise[1], "dy": noise[2]},
        "p": {"k": k[seen], "px": places[seen, 0], "py": places[seen, 1]},
    }


def compiled_walk(method, text=WALK):
    """With a row of each table, of which none counts."""
    problem = mbm.loads(text.format(unknowns="", seen="x", rest="", method=method))
    return problem.compile(data={"z": {"k": [0.0], "y": [0.0]}, "w": {"k": [0.0], "u": [0.0]}})


@pytest.mark.parametrize("method", ["smoother", "batch"])
def test_steps_of_a_linear_problem_are_those_of_dense_least_squares(method):
    generator = np.random.default_rng(1)
    k = np.sort(generator.choice(np.arange(150.0), 100, replace=False))
    y = np.cumsum(generator.standard_normal(100)) + 0.5 * generator.standard_normal(100)
    stream = compiled_walk(method).stream()
    for step, (key, value) in enumerate(zip(k, y, strict=True)):
        answer = stream.step({"z": {"k": key, "y": value}})
        if step % 33 in (0, 32):
            moves = [(np.eye(1), np.array([[dt]])) for dt in np.diff(k[: step + 1])]
            each = [(np.ones((1, 1)), y[i : i + 1], 0.25 * np.eye(1)) for i in range(step + 1)]
            means, covariances, _ = jointly(np.zeros(1), np.array([[100.0]]), moves, each)
            assert answer["x"].value == pytest.approx(means[-1, 0], abs=1e-9)
            assert answer["x"].sigma == pytest.approx(np.sqrt(covariances[-1, 0, 0]), rel=1e-9)
            shown = stream.last(20)
            assert [each.key for each in shown] == list(k[max(0, step - 19) : step + 1])
            # Steps before those that are shown may be a thousandth of a standard deviation from where they would be.
            np.testing.assert_allclose([each["x"].value for each in shown], means[-20:, 0], rtol=0, atol=1e-3)
            np.testing.assert_allclose([each["x"].sigma ** 2 for each in shown], covariances[-20:, 0, 0], rtol=1e-9)
    whole = stream.finish()
    np.testing.assert_allclose([each["x"].value for each in whole], means[:, 0], rtol=0, atol=1e-9)


def test_steps_of_poses_are_those_of_all_rows_so_far():
    tables = drive()
    compiled = mbm.loads(DRIVE.format(method="batch")).compile(data=rows_until(tables, 1))
    whole = mbm.loads(DRIVE.format(method="smoother"))
    stream = compiled.stream()
    for key in range(STEPS):
        answer = stream.step(rows_of(tables, key), at=key)
        if key in (1, 40, 119, 150, 180, 181, STEPS - 1):
            result = whole.solve(data=rows_until(tables, key))
            value, sigma = result["T"].value[-1], result["T"].sigma[-1].max()
            np.testing.assert_allclose(answer["T"].value, value, rtol=0, atol=1e-3 * sigma)
            np.testing.assert_allclose(answer["T"].sigma, result["T"].sigma[-1], rtol=1e-3)
            shown = np.array([each["T"].value for each in stream.last(60)])
            np.testing.assert_allclose(shown, result["T"].value[-60:], rtol=0, atol=3e-3 * sigma)
    whole = stream.finish()
    assert len(whole) == STEPS
    np.testing.assert_allclose([each["T"].value for each in whole], result["T"].value, rtol=0, atol=1e-6)
    np.testing.assert_allclose([each["T"].sigma for each in whole], result["T"].sigma, rtol=1e-6)


def test_the_work_of_a_step_does_not_grow_but_where_a_late_row_reaches_far_back():
    tables = drive()
    stream = mbm.loads(DRIVE.format(method="smoother")).compile(data=rows_until(tables, 1)).stream()
    work = []
    for key in range(STEPS):
        before = stream._stepper._memory._get("evaluations")
        stream.step(rows_of(tables, key), at=key)
        work.append(stream._stepper._memory._get("evaluations") - before)
    early, late = np.mean(work[60:120]), np.mean(work[-40:])
    assert late < 1.5 * early
    assert np.mean(work[140:180]) < 10  # without positions a motion says nothing of the steps before
    assert work[180] > 60  # the first position after these says something of all of them


def test_an_unknown_that_is_determined_late():
    generator = np.random.default_rng(2)
    k = np.arange(90.0)
    y = 3.0 + np.cumsum(generator.standard_normal(90))
    late = k[70:]
    tables = {"z": {"k": k, "y": y}, "w": {"k": late, "u": y[70:] - 3.0 + 0.3 * generator.standard_normal(20)}}
    rest = "(observe w (= u x) :sigma 0.3)"
    text = WALK.replace(":sigma 10", "")
    problem = mbm.loads(text.format(unknowns="(unknowns (b :init 0))", seen="(+ x b)", rest=rest, method="smoother"))
    stream = problem.compile(data=rows_until(tables, 0)).stream()
    for key in k:
        answer = stream.step(rows_of(tables, key))
        if key in (0.0, 69.0, 70.0, 89.0):
            result = problem.solve(data=rows_until(tables, key))
            for each in (answer["b"].sigma, answer["x"].sigma, result["b"].sigma):
                assert np.isnan(each) == (key < 70)
            if key < 70:
                continue
            assert answer["b"].value == pytest.approx(float(result["b"].value), abs=1e-8)
            assert answer["x"].value == pytest.approx(result["x"].value[-1], abs=1e-8)
            assert answer["x"].sigma == pytest.approx(result["x"].sigma[-1], rel=1e-8)


def test_wrong_rows_are_left_out_and_more_rows_than_before_taken():
    generator = np.random.default_rng(3)
    k = np.repeat(np.arange(130.0), np.where(np.arange(130) == 100, 30, 1))
    y = np.sin(k / 9) + 0.5 * generator.standard_normal(len(k))
    y[[20, 50, 51]] = 40.0
    tables = {"z": {"k": k, "y": y}, "w": {"k": [0.0], "u": [0.0]}}
    lossy = WALK.replace(":sigma 0.5)", ":sigma 0.5 :loss (tukey))")
    problem = mbm.loads(lossy.format(unknowns="", seen="x", rest="", method="smoother"))
    stream = problem.compile(data=rows_until(tables, 0)).stream()
    for key in np.unique(k):
        stream.step({"z": rows_of(tables, key)["z"]})
    result = problem.solve(data=tables)
    whole = stream.finish()
    np.testing.assert_allclose([each["x"].value for each in whole], result["x"].value, rtol=0, atol=1e-5)
    assert abs(result["x"].value).max() < 3


def test_what_is_limited_in_all_steps_has_no_stream_and_filters_give_a_step_once():
    for method in ("batch", "smoother", "smoother :constraints truncate"):
        text = WALK.replace(":init 0 :sigma 10", ":init 0 :sigma 10 :in (-1 1)")
        compiled = compiled_walk(method, text)
        with pytest.raises(mbm.MbmError, match="bounds, as `x` has"):
            compiled.stream()
    with pytest.raises(mbm.MbmError, match="gives each step once"):
        compiled_walk("ekf").stream().last(1)
