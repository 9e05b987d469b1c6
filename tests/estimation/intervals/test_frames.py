"""Sequences by interval methods, frame by frame: beside closed forms, linear programmes, and true paths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

import mbm
from mbm.estimation.intervals.building import network
from mbm.estimation.intervals.contraction import FIXED, contracted
from mbm.estimation.intervals.frames import framed

WALK = """
(problem walk
  (data d external)
  (states :over k (x :in (-100 100)))
  (dynamics (= (next x) (+ x (* 2 (dt))) :bound (* {b} (dt))))
  (observe d (= y x) :bound 0.5)
  (derive (twice (* 2 x)) (whole (- (last d x) (first d x))))
  (solve :method (interval{options})))"""
ROUNDED = 1e-12
"""What is rounded outwards over the steps."""


def walk(k, y, b=0.3, options=""):
    return mbm.loads(WALK.format(b=b, options=options)).solve(data={"d": {"k": k, "y": y}})


def test_a_walk_has_the_bounds_that_all_rows_together_leave():
    k = np.array([0.0, 1.0, 2.0, 4.0, 5.0])
    y = 2 * k + np.array([0.3, -0.2, 0.4, 0.0, -0.3])
    found = walk(k, y)
    apart = k[:, None] - k  # closed form: each row reaches every step, widened by the noise between
    low = (y + 2 * apart - 0.5 - 0.3 * np.abs(apart)).max(axis=1)
    high = (y + 2 * apart + 0.5 + 0.3 * np.abs(apart)).min(axis=1)
    np.testing.assert_allclose(found["x"].bounds, np.stack([low, high], axis=1), rtol=0, atol=ROUNDED)
    assert (found["x"].bounds[:, 0] <= low).all()
    assert (found["x"].bounds[:, 1] >= high).all()
    np.testing.assert_allclose(found["twice"].bounds, 2 * found["x"].bounds, rtol=0, atol=ROUNDED)


def test_steps_without_rows_are_predicted_and_rows_beyond_reach_leave_nothing():
    text = WALK.format(b=0.3, options="").replace("(data d external)", "(data d external) (data f external)")
    found = mbm.loads(text).solve(data={"d": {"k": [0, 3], "y": [0.0, 6.0]}, "f": {"k": [0, 1, 2, 3, 4]}})
    assert found["x"].bounds[4].tolist() == pytest.approx([7.2, 8.8], abs=ROUNDED)
    assert found["x"].bounds[1].tolist() == pytest.approx([1.2, 2.8], abs=ROUNDED)
    empty = walk([0, 1, 2], [0.0, 9.0, 4.0])
    assert empty.solves[0].status == "infeasible"
    twice = walk([0, 1, 1], [0.0, 2.2, 1.6])  # several rows of a step all hold
    assert twice["x"].bounds[1].tolist() == pytest.approx([1.7, 2.1], abs=ROUNDED)


def test_forward_takes_transitions_and_constraints_alone():
    text = WALK.format(b=0.3, options=" :contract forward")
    text = text.replace("(observe", "(constraints (<= 0 x 1 :at first))\n  (observe")
    found = mbm.loads(text).solve(data={"d": {"k": [0, 1, 2], "y": [0.5, 2.5, 4.5]}})
    assert found["x"].bounds.tolist() == [pytest.approx(pair, abs=ROUNDED) for pair in ([0, 1], [1.7, 3.3], [3.4, 5.6])]


CART = """
(problem cart
  (data d external)
  (states :over k (x :in (-1000 1000)) (v :in (-50 50)) (c :in (-5 5)))
  (unknowns (b :in (-0.2 0.2)))
  (dynamics
    (= (next x) (+ x (* v (dt))) :sigma 0)
    (= (next v) (+ v c) :bound 0.2)
    (static c))
  (observe d (= y (+ x b)) :bound 0.5)
  (solve :method (interval)))"""


def cart():
    g = np.random.default_rng(2)
    x, v, y = 0.0, 1.0, []
    for _ in range(8):
        y.append(x + 0.1 + g.uniform(-0.5, 0.5))
        x, v = x + v, v + 0.05 + g.uniform(-0.2, 0.2)
    return {"d": {"k": np.arange(8.0), "y": np.array(y)}}


def hull(tables):
    """The least and greatest value of [x… v… c b] by linear programmes."""
    y, n = tables["d"]["y"], len(tables["d"]["y"])
    rows, limits, equal = [], [], []
    unit = np.eye(2 * n + 2)
    x, v, c, b = unit[:n], unit[n : 2 * n], unit[2 * n], unit[2 * n + 1]
    for k in range(n):
        for sign in (1, -1):
            rows.append(sign * (x[k] + b))
            limits.append(0.5 + sign * y[k])
            if k:
                rows.append(sign * (v[k] - v[k - 1] - c))
                limits.append(0.2)
        if k:
            equal.append(x[k] - x[k - 1] - v[k - 1])
    box = [(-1000, 1000)] * n + [(-50, 50)] * n + [(-5, 5), (-0.2, 0.2)]
    ends = [
        [s * linprog(s * row, rows, limits, equal, np.zeros(len(equal)), bounds=box).fun for s in (1, -1)]
        for row in unit
    ]
    return np.array(ends)


def test_bounds_contain_the_hull_and_are_the_fixed_point_of_all_demands():
    tables = cart()
    problem = mbm.loads(CART)
    found = problem.solve(data=tables)
    exact = hull(tables)
    mine = np.vstack([found["x"].bounds, found["v"].bounds, found["c"].bounds[:1], found["b"].bounds[None]])
    slack = 1e-9  # of the linear programmes
    assert (mine[:, 0] <= exact[:, 0] + slack).all()
    assert (mine[:, 1] >= exact[:, 1] - slack).all()
    assert np.ptp(found["c"].bounds, axis=0).tolist() == [0.0, 0.0]
    elaborated = problem.compile(data=tables)._for(None).elaborated
    whole = network(elaborated.problem, elaborated.tables, {})
    every = contracted(whole, whole.low[None], whole.high[None], shrink=FIXED)
    frames = framed(whole, lambda: False).boxes
    # contractions in any order end at one fixed point; sweeps and passes stop a little before it
    np.testing.assert_allclose(frames.low, every.low, rtol=0, atol=1e-6)
    np.testing.assert_allclose(frames.high, every.high, rtol=0, atol=1e-6)


DRIVE = """
(problem drive
  (data m external :key station) (data r external :with (m station)) (data o external)
  (states :over k (x :in (-50 50)) (y :in (-50 50)) (a angle))
  (dynamics
    (= (next x) (+ x (* s (cos a))) :bound 0.05)
    (= (next y) (+ y (* s (sin a))) :bound 0.05)
    (= (next a) (+ a w) :bound 0.02))
  (observe r (= d (distance [x y] [m.x m.y])) :bound 0.3)
  (solve :method (interval)))"""


def test_a_true_drive_lies_within_the_bounds():
    g = np.random.default_rng(5)
    path, s, w = [np.array([1.0, 2.0, 0.3])], g.uniform(0.5, 1.5, 15), g.uniform(-0.3, 0.3, 15)
    for k in range(14):
        a = path[-1][2]
        step = np.array([s[k + 1] * np.cos(a), s[k + 1] * np.sin(a), w[k + 1]])
        path.append(path[-1] + step + g.uniform(-1, 1, 3) * [0.05, 0.05, 0.02])
    path = np.array(path)
    stations = np.array([[-10.0, 0.0], [15.0, -5.0], [0.0, 20.0]])
    k, station = np.repeat(np.arange(15), 3), np.tile(np.arange(3), 15)
    d = np.linalg.norm(path[k, :2] - stations[station], axis=1) + g.uniform(-0.3, 0.3, 45)
    found = mbm.loads(DRIVE).solve(
        data={
            "m": {"station": [0, 1, 2], "x": stations[:, 0], "y": stations[:, 1]},
            "r": {"k": k, "station": station, "d": d},
            "o": {"k": np.arange(15), "s": s, "w": w},
        }
    )
    for name, true in zip("xy", path.T, strict=False):
        bounds = found[name].bounds
        assert (bounds[:, 0] <= true).all()
        assert (bounds[:, 1] >= true).all()
        assert (bounds[:, 1] - bounds[:, 0]).max() < 3.0


def test_what_is_not_bounded_is_refused_with_the_reason():
    text = WALK.format(b=0.3, options="")
    rows = {"d": {"k": [0, 1], "y": [0.0, 2.0]}}
    for old, new, said in (
        (":bound (* 0.3 (dt))", ":sigma 0.3", "the standard deviation of the transition of `x`"),
        ("(= (next x) (+ x (* 2 (dt))) :bound (* 0.3 (dt)))", "(random-walk x :sigma 1)", "of the transition of `x`"),
        (":in (-100 100)", ":init 0 :sigma 3", "standard deviation"),
        ("(interval)", "(interval :contract hull)", "`:contract hull` with states"),
    ):
        with pytest.raises(mbm.MbmError, match="not-for-intervals") as caught:
            mbm.loads(text.replace(old, new)).solve(data=rows)
        assert said in str(caught.value)
