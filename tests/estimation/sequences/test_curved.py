"""Curved rows and transitions, against SciPy's least squares; and states that are poses, against mbm's batch solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import mbm
from mbm.estimation.sequences.types import Prior, Rules
from tests.estimation.sequences.chains import chained

STEPS = 15
ANCHORS = np.array([[0.0, 0.0], [9.0, 1.0], [3.0, 8.0]])
CAR = """
(problem car (data z external)
  (unknowns (bias :init 0) (x :init 1) (y :init 2) (h :init 0.3))
  (observe z (= r (+ bias (distance [x y] [ax ay]))) :sigma 0.1 {loss})
  (for-each k))
"""
CAR_MOVES = """
(problem moves (data u external)
  (unknowns (bias :init 0) (x :init 1) (y :init 2) (h :init 0.3) (x2 :init 1) (y2 :init 2) (h2 :init 0.3))
  (observe u (= x2 (+ x (* v (cos (+ h (/ w 2)))))) (= y2 (+ y (* v (sin (+ h (/ w 2)))))) (= h2 (+ h w)) :sigma 1)
  (for-each k))
"""
"""A car that is driven: its own noise is in speed and turn."""

SPREAD = np.array([[0.05, 0.0], [0.02, 0.01], [0.0, 0.04]])
MEAN = np.array([0.2, 1.0, 2.0, 0.3])
COVARIANCE = np.diag([0.3, 0.5, 0.5, 0.1]) ** 2


def drive(state, control, noise):
    x, y, h = state
    v, w = control
    return np.array([x + v * np.cos(h + w / 2), y + v * np.sin(h + w / 2), h + w]) - SPREAD @ noise


def car(seed=3, loss=""):
    """The sequence, its ranges (step, anchor, range) and controls."""
    generator = np.random.default_rng(seed)
    controls = np.column_stack([np.full(STEPS - 1, 0.8), 0.25 * np.sin(np.arange(STEPS - 1))])
    states = [np.array([1.2, 1.7, 0.35])]
    for control in controls:
        states.append(drive(states[-1], control, generator.standard_normal(2)))
    rows = [(k, a) for k in range(STEPS) for a in range(3) if (k + a) % 3 and k != 6]
    k, a = np.array(rows).T
    r = np.linalg.norm(np.array(states)[k, :2] - ANCHORS[a], axis=1) + 0.1 + 0.1 * generator.standard_normal(len(k))
    # step 6 has no row that counts: its prediction
    z = {"k": np.append(k, 6), "ax": np.append(ANCHORS[a, 0], 0), "ay": np.append(ANCHORS[a, 1], 0)}
    z["r"] = np.append(r, 0.0)
    text = CAR.format(loss=loss).replace(":sigma 0.1", ":sigma 0.1 :when (> r 0)")
    moves = {"k": np.arange(STEPS - 1), "v": controls[:, 0], "w": controls[:, 1]}
    spreads = np.tile(SPREAD, (STEPS - 1, 1, 1))
    return chained((text, {"z": z}), (CAR_MOVES, {"u": moves}), spreads, still=1), (k, a, r), controls


def residuals_of(rows, controls, last):
    """Whitened residuals of the bias, the first state, and the noises up to a step, in units of their deviations."""
    k, a, r = rows
    used = k <= last

    def states(theta):
        found = [MEAN[1:] + np.sqrt(np.diag(COVARIANCE))[1:] * theta[1:4]]
        for noise, control in zip(theta[4:].reshape(-1, 2), controls[:last], strict=True):
            found.append(drive(found[-1], control, noise))
        return np.array(found)

    def residuals(theta):
        at = states(theta)[k[used], :2]
        bias = MEAN[0] + 0.3 * theta[0]
        return np.concatenate([theta, (np.linalg.norm(at - ANCHORS[a[used]], axis=1) + bias - r[used]) / 0.1])

    return residuals, states


def best(rows, controls, last):
    """The least-squares solution of all steps: states, their covariances, and the cost."""
    residuals, states = residuals_of(rows, controls, last)
    found = least_squares(residuals, np.zeros(4 + 2 * last), xtol=1e-15, ftol=1e-15, gtol=1e-14, jac="3-point")
    spread = np.linalg.inv(found.jac.T @ found.jac)

    def every(theta):
        moving = states(theta)
        return np.column_stack([np.full(len(moving), MEAN[0] + 0.3 * theta[0]), moving])

    steps = 1e-6 * np.eye(len(found.x))
    slopes = np.stack([(every(found.x + s) - every(found.x - s)) / 2e-6 for s in steps], axis=-1)
    return every(found.x), slopes @ spread @ slopes.transpose(0, 2, 1), 2 * found.cost


def test_a_smoother_of_curved_equations_is_the_batch_solution():
    sequence, rows, controls = car()
    prior = Prior.of(point=MEAN, covariance=COVARIANCE, unknown=np.zeros(4, bool))
    found = sequence.walk(prior, Rules(iterations=100, smooth=True))
    states, covariances, cost = best(rows, controls, STEPS - 1)
    assert found.settled
    assert found.cost == pytest.approx(cost, rel=1e-12)
    np.testing.assert_allclose(found.points, states, rtol=0, atol=1e-8)
    # SciPy's and the test's derivatives are differences: six digits
    np.testing.assert_allclose(found.covariances, covariances, rtol=0, atol=1e-6)


def test_a_fixed_lag_of_all_steps_is_the_smoother():
    sequence, _, _ = car()
    prior = Prior.of(point=MEAN, covariance=COVARIANCE, unknown=np.zeros(4, bool))
    whole = sequence.walk(prior, Rules(iterations=100, smooth=True))
    lagged = sequence.walk(prior, Rules(iterations=100, smooth=True, lag=STEPS - 1))
    np.testing.assert_allclose(lagged.points, whole.points, rtol=0, atol=1e-9)
    np.testing.assert_allclose(lagged.covariances, whole.covariances, rtol=0, atol=1e-10)


def test_an_iterated_update_is_the_least_squares_solution_of_its_step():
    """Of the first step, whose prior is stated, it is that of SciPy; an update that is linearised once is not."""
    sequence, rows, controls = car()
    prior = Prior.of(point=MEAN, covariance=COVARIANCE, unknown=np.zeros(4, bool))
    iterated = sequence.walk(prior, Rules(iterations=100))
    once = sequence.walk(prior, Rules())
    states, covariances, cost = best(rows, controls, 0)
    np.testing.assert_allclose(iterated.points[0], states[0], rtol=0, atol=1e-8)
    np.testing.assert_allclose(iterated.covariances[0], covariances[0], rtol=0, atol=1e-7)
    assert iterated.costs[0] == pytest.approx(cost, rel=1e-10)
    assert np.abs(once.points[0] - states[0]).max() > 1e-4


def test_an_update_linearised_once_is_the_extended_kalman_filter():
    sequence, rows, controls = car()
    prior = Prior.of(point=MEAN, covariance=COVARIANCE, unknown=np.zeros(4, bool))
    found = sequence.walk(prior, Rules())
    k, a, r = rows
    mean, covariance = MEAN.copy(), COVARIANCE.copy()
    for step in range(STEPS):
        if step:
            v, w = controls[step - 1]
            F = np.eye(4)
            F[1:3, 3] = [-v * np.sin(mean[3] + w / 2), v * np.cos(mean[3] + w / 2)]
            mean = np.append(mean[0], drive(mean[1:], controls[step - 1], np.zeros(2)))
            covariance = F @ covariance @ F.T
            covariance[1:, 1:] += SPREAD @ SPREAD.T
        mine = k == step
        away = mean[1:3] - ANCHORS[a[mine]]
        length = np.linalg.norm(away, axis=1)
        H = np.column_stack([np.ones(mine.sum()), away / length[:, None], np.zeros(mine.sum())])
        S = H @ covariance @ H.T + 0.01 * np.eye(mine.sum())
        gain = covariance @ H.T @ np.linalg.inv(S)
        mean = mean + gain @ (r[mine] - mean[0] - length)
        covariance = covariance - gain @ S @ gain.T
        np.testing.assert_allclose(found.points[step], mean, rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.covariances[step], covariance, rtol=0, atol=1e-12)


def test_a_loss_weighs_rows_in_an_iterated_update():
    """One range of the first step is 5 m too long; the least-squares problem with Huber's loss is SciPy's."""
    sequence, (k, a, r), controls = car(loss=":loss (huber 1.5)")
    prior = Prior.of(point=MEAN, covariance=COVARIANCE, unknown=np.zeros(4, bool))
    found = sequence.walk(prior, Rules(iterations=100))
    plain, _ = residuals_of((k, a, r), controls, 0)

    def rooted(theta):
        whole = plain(theta)
        z = np.abs(whole[4:])
        return np.concatenate([whole[:4], np.where(z <= 1.5, z, np.sqrt(np.maximum(3 * z - 2.25, 0)))])

    known = least_squares(rooted, np.zeros(4), xtol=1e-15, ftol=1e-15, gtol=1e-14)
    assert found.costs[0] == pytest.approx(2 * known.cost, rel=1e-9)


POSES = """
(problem poses (data z external)
  (unknowns (T (pose 3) :init (pose3 (euler 0.1 0.2 0.3) [1 2 3])))
  (observe z (= [u v w] (transform T [px py pz])) :sigma 0.2)
  (for-each k))
"""
POSE_MOVES = """
(problem moves (data s external)
  (unknowns (T (pose 3) :init (pose3 (euler 0.1 0.2 0.3) [1 2 3]))
            (T2 (pose 3) :init (pose3 (euler 0.1 0.2 0.3) [1 2 3])))
  (observe s (= T2 (compose T (pose3 (euler 0.1 -0.2 0.3) [0.5 0.1 0]))) :sigma 1)
  (for-each k))
"""
POSE_BATCH = """
(problem batch (data z external) (data s external) (data steps external :key k)
  (unknowns (T (pose 3) :per steps :init (pose3 (euler 0.1 0.2 0.3) [1 2 3])))
  (observe first (= (pose3 (euler 0.1 0.2 0.3) [1 2 3]) (T 0)) :sigma [0.3 0.2 0.4 0.5 0.6 0.7])
  (observe z (= [u v w] (transform (T k) [px py pz])) :sigma 0.2)
  (observe s (= (T next) (compose (T k) (pose3 (euler 0.1 -0.2 0.3) [0.5 0.1 0]))) :sigma [.1 .2 .3 .2 .3 .4]))
"""
DEVIATIONS = np.array([0.3, 0.2, 0.4, 0.5, 0.6, 0.7])
POSE_NOISE = np.diag([0.1, 0.2, 0.3, 0.2, 0.3, 0.4])


def poses(steps, seed=5):
    """Points that are seen from poses, one or two at each step: a pose is determined by its neighbours only."""
    generator = np.random.default_rng(seed)
    turn = Rotation.from_euler("ZYX", [0.3, 0.2, 0.1])
    place = np.array([1.0, 2.0, 3.0])
    rows = []
    for k in range(steps):
        for _ in range(1 + k % 2):
            point = generator.uniform(-2, 2, 3)
            rows.append((k, *point, *(turn.apply(point) + place + 0.2 * generator.standard_normal(3))))
        place = place + turn.apply([0.5, 0.1, 0.0]) + 0.2 * generator.standard_normal(3)
        turn = turn * Rotation.from_euler("ZYX", [0.3, -0.2, 0.1])
        turn = turn * Rotation.from_rotvec(generator.standard_normal(3) * [0.1, 0.2, 0.3])
    return dict(zip(("k", "px", "py", "pz", "u", "v", "w"), np.array(rows).T, strict=True))


def test_a_smoother_of_poses_is_the_batch_solution():
    """Covariances in the frame of each step, as all results have them."""
    steps = 8
    z = poses(steps)
    moves = {"k": np.arange(steps - 1), "next": np.arange(1, steps)}
    spreads = np.tile(POSE_NOISE, (steps - 1, 1, 1))
    sequence = chained((POSES, {"z": z}), (POSE_MOVES, {"s": moves}), spreads, still=0)
    start = sequence.seen.equations.layout.start
    # differences of poses are stated in the frame of the measured one, coordinates of translations in that of the world
    axes = np.eye(6)
    axes[3:, 3:] = Rotation.from_euler("ZYX", [0.3, 0.2, 0.1]).as_matrix()
    prior = Prior.of(point=start, covariance=axes @ np.diag(DEVIATIONS**2) @ axes.T, unknown=np.zeros(6, bool))
    found = sequence.walk(prior, Rules(iterations=100, smooth=True))
    batch = mbm.loads(POSE_BATCH).solve(data={"z": z, "s": moves, "steps": {"k": np.arange(steps)}})
    assert found.settled
    assert found.cost == pytest.approx(batch.solves[0].cost, rel=1e-10)
    for k in range(steps):
        place, sigma = batch["T"].value[k], batch["T"].sigma[k]
        q = found.points[k][:4]
        np.testing.assert_allclose(np.sign(q @ place[:4]) * q, place[:4], rtol=0, atol=1e-8)
        np.testing.assert_allclose(found.points[k][4:], place[4:], rtol=0, atol=1e-8)
        np.testing.assert_allclose(np.sqrt(np.diag(found.covariances[k])), sigma, rtol=1e-7)


def test_a_smoother_whose_path_gets_stuck_ends_as_batch_does():
    """One range to one beacon at each step: the filter's path ends on the wrong side of it."""
    t = 0.1 * np.arange(250)
    places = 5.0 * np.column_stack([np.sin(t / 10), np.cos(t / 13)])
    noise = 0.1 * np.random.default_rng(0).normal(size=250)
    text = """(problem around (data seen external) (states :over t (p (vector 2) :init [0 5] :sigma 1))
      (dynamics (constant-velocity p :acceleration 0.5 :velocity 0 :velocity-sigma 1))
      (observe seen (= r (distance p [10 10])) :sigma 0.1) (solve :method smoother))"""
    data = {"seen": {"t": t, "r": np.linalg.norm(places - 10.0, axis=1) + noise}}
    found = mbm.loads(text).solve(data=data)
    assert found.solves[0].status == "converged"
    # 250 rows, and as many priors and noises as numbers: the sum of squares is χ² distributed
    assert chi2.ppf(1e-3, 250) < found.solves[0].cost < chi2.ppf(1 - 1e-3, 250)


FAR_ATTITUDE = """(problem attitude
  (constants (a 0) (b 0) (c 0))
  (data seen (table (t ax ay az mx my mz) (0 -0.26 -0.23 -0.94 0.72 -0.11 0.68)))
  (states :over t (R (rotation 3) :init (axis-angle [a b c]) :sigma 1))
  (dynamics (static R))
  (observe a seen (= [ax ay az] (rotate (inverse R) [0 0 -1])) :sigma 0.02)
  (observe m seen (= [mx my mz] (rotate (inverse R) [0.6 0 0.8])) :sigma 0.03)
  (solve :method iterated-ekf))"""


@pytest.mark.parametrize(
    "first", [(2.0, -2.0, 0.0), (-1.5, 0.4, -2.5), (2.9, 0.3, 0.2), (0.1, -0.2, 2.8), (1.0, 1.0, -1.0)]
)
def test_no_turns_are_counted_that_change_nothing(first):
    """By SciPy, from several starts: the rotation vector from the first state is at most π long."""
    seen, along = np.array([-0.26, -0.23, -0.94, 0.72, -0.11, 0.68]), Rotation.from_rotvec(first)

    def residuals(vector, base):
        here = base * Rotation.from_rotvec(vector)
        rows = np.concatenate([here.inv().apply([0, 0, -1]), here.inv().apply([0.6, 0, 0.8])]) - seen
        return np.concatenate([(along.inv() * here).as_rotvec(), rows / np.repeat([0.02, 0.03], 3)])

    starts = Rotation.random(6, random_state=1)
    expected = min(2.0 * least_squares(residuals, np.zeros(3), args=(start,)).cost for start in starts)
    problem = mbm.loads(FAR_ATTITUDE)
    solve = problem.solve(constants=dict(zip("abc", first, strict=True))).first
    assert solve.status == "converged"
    assert solve.cost == pytest.approx(expected, rel=1e-6)
