"""``batch``: all steps at once, against smoothers, dense least squares and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import mbm
from tests.estimation.sequences.smoothing import constant_velocity, smoothed

CLOSE = 2e-6
"""In standard deviations: what is exact has 1e-4 of the noise beside it. The square of that is the difference, times
that of how many times larger than the standard deviations this noise is, after seconds without a measurement."""


def walk(dynamics, rest="", sigma="0.3"):
    return (
        f"(problem walk (data gps external) (states :over t (p :init 0.5 :sigma 10)) (dynamics {dynamics})"
        f" (observe gps (= x p) :sigma {sigma}) {rest})"
    )


def track(n, seed, step=lambda rng, n: np.ones(n - 1)):
    rng = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(step(rng, n))])
    speed = np.cumsum(rng.normal(0, 0.5, n))
    return times, np.cumsum(speed) + rng.normal(0, 0.3, n)


def irregular(rng, n):
    return rng.uniform(0.2, 3.0, n - 1)


@pytest.mark.parametrize("n", [2, 7, 60, 400])
def test_constant_velocity_is_the_smoother(n):
    times, x = track(n, n, irregular)
    text = walk("(constant-velocity p :acceleration 0.5 :velocity 1 :velocity-sigma 5)")
    result = mbm.loads(text).solve(data={"gps": {"t": times, "x": x}})
    moves = [constant_velocity(dt, 0.5) for dt in np.diff(times)]
    rows = [[(np.array([1.0, 0.0]), z, 0.3)] for z in x]
    means, covariances, cost = smoothed(moves, rows, np.array([0.5, 1.0]), np.diag([100.0, 25.0]))
    sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    for i, name in enumerate(("p", "p.rate")):
        assert np.asarray(result[name].keys) == pytest.approx(times)
        assert np.abs((result[name].value - means[:, i]) / sigma[:, i]).max() < CLOSE
        assert result[name].sigma == pytest.approx(sigma[:, i], rel=CLOSE)
    assert result.solves[0].cost == pytest.approx(cost, rel=CLOSE)
    assert result.solves[0].dof == n
    distance = np.diff(times) * (result["p.rate"].value[1:] + result["p.rate"].value[:-1]) / 2
    assert np.abs(np.diff(result["p"].value) - distance).max() < CLOSE


def test_covariances_between_steps_are_named():
    times, x = track(5, 3)
    result = mbm.loads(walk("(random-walk p :sigma 0.7)")).solve(data={"gps": {"t": times, "x": x}})
    found = result.covariance
    assert list(found.names) == ["p@0", "p@1", "p@2", "p@3", "p@4"]
    A = np.zeros((10, 5))
    A[:5] = np.eye(5) / 0.3
    A[5, 0] = 1 / 10
    for k in range(4):
        A[6 + k, k : k + 2] = [-1 / 0.7, 1 / 0.7]
    b = np.concatenate([x / 0.3, [0.5 / 10], np.zeros(4)])
    assert found.matrix == pytest.approx(np.linalg.inv(A.T @ A), rel=1e-10)
    assert result["p"].value == pytest.approx(np.linalg.lstsq(A, b)[0], rel=1e-10)


def test_out_of_order_twice_and_without_rows():
    """Rows of a step form one update, in whatever order they stand; a step without rows is a prediction."""
    table = {"t": [3.0, 0.0, 1.0, 1.0, 6.0], "x": [2.0, 0.1, 0.9, 1.2, 5.0]}
    rest = "(data clock (table (t) (2) (4)))"
    result = mbm.loads(walk("(constant-velocity p :acceleration 0.5 :velocity-sigma 5)", rest)).solve(
        data={"gps": table}
    )
    times = np.array([0.0, 1, 2, 3, 4, 6])
    assert np.asarray(result["p"].keys) == pytest.approx(times)
    measured = {0: [0.1], 1: [0.9, 1.2], 3: [2.0], 5: [5.0]}
    rows = [[(np.array([1.0, 0.0]), z, 0.3) for z in measured.get(k, [])] for k in range(6)]
    moves = [constant_velocity(dt, 0.5) for dt in np.diff(times)]
    means, covariances, _ = smoothed(moves, rows, np.array([0.5, 0.0]), np.diag([100.0, 25.0]))
    assert result["p"].value == pytest.approx(means[:, 0], rel=CLOSE)
    assert result["p"].sigma == pytest.approx(np.sqrt(covariances[:, 0, 0]), rel=CLOSE)


def test_a_missing_cell_is_an_error_or_left_out():
    table = {"t": [0.0, 1.0, 2.0, 3.0], "x": [0.1, np.nan, 2.1, 2.9]}
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(walk("(random-walk p :sigma 1)")).solve(data={"gps": table})
    assert caught.value.diagnostics[0].code.name == "not-finite-cell"
    text = walk("(random-walk p :sigma 1)").replace(":sigma 0.3", ":sigma 0.3 :when (finite x)")
    result = mbm.loads(text).solve(data={"gps": table})
    rows = [[(np.ones(1), z, 0.3)] if np.isfinite(z) else [] for z in table["x"]]
    means, covariances, _ = smoothed([(np.eye(1), np.eye(1))] * 3, rows, np.array([0.5]), np.array([[100.0]]))
    assert result["p"].value == pytest.approx(means[:, 0], rel=1e-9)
    assert result["p"].sigma == pytest.approx(np.sqrt(covariances[:, 0, 0]), rel=1e-9)


def test_static_states_and_plain_unknowns_are_constant():
    times, x = track(12, 5)
    rest = "(data ref (table (y) (0.4))) (observe ref (= y b) :sigma 0.1)"
    plain = walk("(random-walk p :sigma 1)", f"(unknowns (b :init 0 :sigma 2)) {rest}")
    still = walk("(random-walk p :sigma 1) (static b)", rest.replace("= y b", "= y (first gps b)"))
    still = still.replace(":sigma 10)", ":sigma 10) (b :init 0 :sigma 2)")
    plain, still = (text.replace("(= x p)", "(= x (+ p b))") for text in (plain, still))
    data = {"gps": {"t": times, "x": x}}
    one, other = mbm.loads(still).solve(data=data), mbm.loads(plain).solve(data=data)
    assert one["p"].value == pytest.approx(other["p"].value, rel=1e-9)
    assert one["b"].value == pytest.approx(np.full(12, other["b"].value), rel=1e-9)
    assert one["b"].sigma == pytest.approx(np.full(12, other["b"].sigma), rel=1e-9)
    assert one.solves[0].dof == other.solves[0].dof == 13


def test_odometry_in_the_plane_is_least_squares():
    """Poses with noise in the frame of the step reached, against SciPy on the same residuals."""
    rng = np.random.default_rng(7)
    n, noise, beacon = 15, np.array([0.02, 0.1, 0.05]), np.array([[0.0, 5.0], [8.0, -3.0]])
    turn, move = rng.normal(0.1, 0.05, n), rng.normal(1.0, 0.1, n)
    theta, place = np.cumsum(turn), np.zeros((n, 2))
    for k in range(1, n):
        place[k] = place[k - 1] + move[k] * np.array([np.cos(theta[k - 1]), np.sin(theta[k - 1])])
    ranges = np.linalg.norm(place[:, None] - beacon, axis=2) + rng.normal(0, 0.05, (n, 2))
    text = """(problem drive (data odo external) (data range external)
      (states :over k (T (pose 2) :init (pose2 0 0 0.1) :sigma 0.5))
      (dynamics (= (next T) (compose T (pose2 (* (dt) d) 0 a)) :sigma [0.02 0.1 0.05]))
      (observe range (= r (distance (translation T) [bx by])) :sigma 0.05))"""
    k = np.arange(n)
    seen = {"bx": np.tile(beacon[:, 0], n), "by": np.tile(beacon[:, 1], n)}
    both = {"k": np.repeat(k, 2), "r": ranges.ravel(), **seen}
    result = mbm.loads(text).solve(data={"odo": {"k": k, "a": turn, "d": move}, "range": both})

    def residuals(v):
        a, p = v[:n], v[n:].reshape(n, 2)
        found = [(a[0] - 0.1) / 0.5]
        found += list(Rotation.from_euler("z", -0.1).as_matrix()[:2, :2] @ p[0] / 0.5)
        for i in range(1, n):
            step = np.array([np.cos(a[i - 1]), np.sin(a[i - 1])]) * move[i]
            back = Rotation.from_euler("z", -a[i]).as_matrix()[:2, :2]
            found.append((a[i - 1] + turn[i] - a[i]) / noise[0])
            found += list(back @ (p[i - 1] + step - p[i]) / noise[1:])
        found += list((np.linalg.norm(p[:, None] - beacon, axis=2) - ranges).ravel() / 0.05)
        return np.array(found)

    there = least_squares(residuals, np.concatenate([theta, place.ravel()]), xtol=1e-15, ftol=1e-15, gtol=1e-12)
    assert 2 * there.cost == pytest.approx(result.solves[0].cost, rel=1e-8)
    assert result["T"].value[:, 1:] == pytest.approx(there.x[n:].reshape(n, 2), abs=1e-6)
    covariance = np.linalg.inv(there.jac.T @ there.jac)
    sigma = np.sqrt(np.diag(covariance))
    shown = np.asarray(result["T"].sigma)
    assert shown[:, 0] == pytest.approx(sigma[:n], rel=1e-5)
    assert shown[:, 1:] == pytest.approx(sigma[n:].reshape(n, 2), rel=1e-5)


def test_a_rotation_goes_on_by_its_rate():
    """Constant turn rate about a fixed axis, seen exactly: the rate is the rotation vector per unit of time."""
    axis, n = np.array([0.2, -0.4, 0.3]), 6
    times = np.array([0.0, 1.0, 1.5, 3.0, 3.5, 5.0])
    quaternions = Rotation.from_rotvec(times[:, None] * axis).as_quat()
    table = {"t": times} | {name: quaternions[:, i] for i, name in enumerate(("qx", "qy", "qz", "qw"))}
    text = """(problem spin (data imu external)
      (states :over t (R (rotation 3) :init (quaternion 1 0 0 0)))
      (dynamics (constant-velocity R :acceleration 0.1))
      (observe imu (= (quaternion qw qx qy qz) R) :sigma 0.01))"""
    result = mbm.loads(text).solve(data={"imu": table})
    assert result["R.rate"].value == pytest.approx(np.tile(axis, (n, 1)), abs=1e-6)
    assert result.solves[0].cost == pytest.approx(0, abs=1e-8)


def test_a_covariance_may_be_singular():
    """A vector with the noise of constant velocity written out, and a first covariance of rank one."""
    times, x = track(9, 11, irregular)
    text = """(problem walk (data gps external)
      (states :over t (s (vector 2) :init [0 1] :covariance [[4 2] [2 1]]))
      (dynamics (= (next s) [(+ (s 1) (* (dt) (s 2))) (s 2)]
        :covariance (let ((a (/ (* (dt) (dt)) 2)) (b (dt))) (* 0.25 [[(* a a) (* a b)] [(* a b) (* b b)]]))))
      (observe gps (= x (s 1)) :sigma 0.3))"""
    result = mbm.loads(text).solve(data={"gps": {"t": times, "x": x}})
    moves = [constant_velocity(dt, 0.5) for dt in np.diff(times)]
    rows = [[(np.array([1.0, 0.0]), z, 0.3)] for z in x]
    means, covariances, cost = smoothed(moves, rows, np.array([0.0, 1.0]), np.array([[4.0, 2.0], [2.0, 1.0]]))
    assert result["s"].value == pytest.approx(means, rel=1e-6, abs=1e-6)
    sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    assert result["s"].sigma == pytest.approx(sigma, rel=1e-6)
    assert result.solves[0].cost == pytest.approx(cost, rel=1e-6)


def test_without_noise_the_start_decides():
    """A thrown ball: every step follows from the first, of which the place is certain."""
    times = np.array([0.0, 0.1, 0.2, 0.35, 0.5])
    z = np.array([0.02, 1.46, 2.79, 4.66, 6.27])
    text = """(problem ball (data cam external)
      (states :over t (s (vector 2) :init [0 15] :sigma [0 5]))
      (dynamics (= (next s) (let ((h (dt))) [(+ (s 1) (* h (s 2)) (* -4.905 h h)) (- (s 2) (* 9.81 h))]) :sigma 0))
      (observe cam (= z (s 1)) :sigma 0.03))"""
    result = mbm.loads(text).solve(data={"cam": {"t": times, "z": z}})
    A = np.concatenate([times / 0.03, [1 / 5]])
    b = np.concatenate([(z + 4.905 * times**2) / 0.03, [15 / 5]])
    speed = (A @ b) / (A @ A)
    assert result["s"].value[:, 1] == pytest.approx(speed - 9.81 * times, rel=1e-9)
    assert result["s"].value[:, 0] == pytest.approx(speed * times - 4.905 * times**2, abs=1e-9)
    assert result["s"].sigma[:, 1] == pytest.approx(np.full(5, (A @ A) ** -0.5), rel=1e-7)
    assert result["s"].sigma[0, 0] == 0
    assert result.solves[0].dof == 5


def test_constraints_hold_at_every_step():
    times, x = np.arange(6.0), np.array([0.0, 1.4, 0.8, 1.5, 0.7, 0.2])
    result = mbm.loads(walk("(random-walk p :sigma 1)", "(constraints (<= p 1))")).solve(
        data={"gps": {"t": times, "x": x}}
    )

    def residuals(v):
        return np.concatenate([(x - v) / 0.3, np.diff(v), [(v[0] - 0.5) / 10]])

    there = least_squares(residuals, np.full(6, 0.5), bounds=(-np.inf, 1.0), xtol=1e-15, ftol=1e-15, gtol=1e-14)
    assert result["p"].value == pytest.approx(there.x, abs=1e-6)
    (found,) = result.solves[0].constraints
    assert list(found.active_rows) == [2, 4]


def test_the_noise_of_transitions_may_be_unknown():
    """``:sigma unknown``: the factor that the residuals of the transitions themselves give."""
    rng = np.random.default_rng(3)
    p = np.cumsum(rng.normal(0, 2.0, 200))
    text = """(problem walk (data gps external) (states :over t (p :init 0 :sigma 10))
      (dynamics (= (next p) p :sigma unknown)) (observe gps (= x p) :sigma 0.1))"""
    result = mbm.loads(text).solve(data={"gps": {"t": np.arange(200.0), "x": p + rng.normal(0, 0.1, 200)}})
    scatter = np.diff(result["p"].value).std()
    assert scatter == pytest.approx(2.0, rel=0.15)


RUNS = """(problem runs (data gps external) (data odo external)
  (states :over t (p :init 0 :sigma 10)) (dynamics (= (next p) (+ p v) :sigma 0.2))
  (observe gps (= x p) :sigma 0.3) {rest})"""


def runs(seed=1):
    rng = np.random.default_rng(seed)
    gps, odo = ({"run": [], "t": [], name: []} for name in "xv")
    for run, times in ((1, [0, 1, 2]), (2, [0, 1, 4, 5]), (3, [7])):
        for t in times:
            for table, name in ((gps, "x"), (odo, "v")):
                table["run"].append(run)
                table["t"].append(float(t))
                table[name].append(rng.normal(t, 0.3))
    return {"gps": gps, "odo": odo}


def of_run(data, run):
    keep = {name: np.asarray(table["run"]) == run for name, table in data.items()}
    return {name: {c: np.asarray(v)[keep[name]] for c, v in table.items()} for name, table in data.items()}


def test_each_key_is_a_sequence_of_its_own():
    data = runs()
    together = mbm.loads(RUNS.format(rest="(for-each run)")).solve(data=data)
    assert [solve.key["run"] for solve in together.solves] == [1, 2, 3]
    for solve in together.solves:
        alone = mbm.loads(RUNS.format(rest="")).solve(data=of_run(data, solve.key["run"]))
        (estimate,) = solve.estimates
        assert list(estimate.keys) == list(alone["p"].keys)
        assert estimate.value == pytest.approx(alone["p"].value, rel=1e-12)
        assert estimate.sigma == pytest.approx(alone["p"].sigma, rel=1e-12)


def test_each_window_is_a_sequence_of_its_own():
    data = of_run(runs(), 2)
    slid = mbm.loads(RUNS.format(rest="(window t :length 2.5 :step 1)")).solve(data=data)
    assert [list(solve.estimates[0].keys) for solve in slid.solves] == [[0], [0, 1], [0, 1], [1], [4], [4, 5]]


def test_a_key_that_lacks_a_row_fails_alone():
    data = runs()
    data["odo"] = {name: cells[:-3] for name, cells in data["odo"].items()}  # of run 2, steps 4 and 5; run 3
    together = mbm.loads(RUNS.format(rest="(for-each run)")).solve(data=data)
    assert [solve.status for solve in together.solves] == ["converged", "not-converged", "converged"]
    assert [d.code.name for d in together.solves[1].diagnostics] == ["unmatched-step"]


@pytest.mark.parametrize("rest", ["", "(for-each run)"])
def test_the_row_of_the_first_step_is_not_used(rest):
    data = of_run(runs(), 2)
    data["odo"]["v"][0] = np.nan
    found = mbm.loads(RUNS.format(rest=rest)).solve(data=data)
    assert found.solves[0].status == "converged"
    data["odo"]["v"][2] = np.nan
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(RUNS.format(rest=rest)).solve(data=data)
    assert caught.value.diagnostics[0].code.name == "not-finite-cell"


def test_other_data_make_other_steps():
    """One compiled problem: steps and transitions are those of the data at hand."""
    compiled = mbm.loads(RUNS.format(rest="")).compile(data=of_run(runs(1), 1))
    for seed, run in ((2, 2), (3, 1)):
        data = of_run(runs(seed), run)
        fresh = mbm.loads(RUNS.format(rest="")).solve(data=data)
        again = compiled.solve(data=data)
        assert list(again["p"].keys) == list(fresh["p"].keys)
        assert again["p"].value == pytest.approx(fresh["p"].value, rel=1e-12)


def test_a_start_is_found_step_by_step():
    """A wheel that turns unseen between sights of its mark: a start at rest fits the first sight alone."""
    rng = np.random.default_rng(2)
    t = np.arange(80.0)
    angle = 0.3 + 0.9 * t + np.cumsum(np.cumsum(rng.normal(0, 0.005, 80)))
    text = """(problem wheel (data seen external)
      (states :over t (a :init 0 :sigma 1))
      (dynamics (constant-velocity a :acceleration 0.01 :velocity 0 :velocity-sigma 1))
      (observe seen (= [u v] [(cos a) (sin a)]) :sigma 0.02))"""
    noise = rng.normal(0, 0.02, (2, 80))
    data = {"seen": {"t": t, "u": np.cos(angle) + noise[0], "v": np.sin(angle) + noise[1]}}
    result = mbm.loads(text).solve(data=data)
    assert result.solves[0].chi2_p > 1e-3
    assert np.abs((result["a"].value - angle) / result["a"].sigma).max() < 5


@pytest.mark.slow
def test_batch_begins_where_a_smoother_ends():
    """A drive among four beacons, of whose ranges a fifth is too long by 10 m on the average: it begins at rest."""
    rng = np.random.default_rng(0)
    t = 0.5 * np.arange(250)
    places, rate = np.zeros((250, 2)), np.zeros(2)
    for k in range(1, 250):
        pushed = 0.25 * rng.normal(size=2)
        places[k] = places[k - 1] + 0.5 * rate + 0.125 * pushed
        rate = rate + 0.5 * pushed
    beacons = 30.0 * np.array([[1, 1], [-1, 1], [1, -1], [-1, -1]])
    step, which = np.repeat(np.arange(250), 4), np.tile(np.arange(4), 250)
    ranges = np.linalg.norm(places[step] - beacons[which], axis=1) + 0.1 * rng.normal(size=1000)
    wrong = rng.random(1000) < 0.2
    ranges[wrong] += rng.exponential(10.0, size=wrong.sum())
    text = """(problem drive (data seen external) (states :over t (p (vector 2) :init [0 0] :sigma 1))
      (dynamics (constant-velocity p :acceleration 0.5 :velocity 0 :velocity-sigma 1))
      (observe seen (= r (distance p [bx by])) :sigma 0.1 :loss tukey))"""
    data = {"seen": {"t": t[step], "bx": beacons[which, 0], "by": beacons[which, 1], "r": ranges}}
    result = mbm.loads(text).solve(data=data)
    assert np.abs((result["p"].value - places) / result["p"].sigma).max() < 5


BEFORE = """
(problem before (data z (table (t y dy) (0 0.0 0) (1 0.3 0.5) (2 0.5 0.5) (3 0.9 0.5)))
  (states :over t (s :init 0 :sigma 1)) (dynamics (random-walk s :sigma 0.3))
  (observe z (= y s) :sigma 0.1) (observe rel z (= dy (- s (previous s))) :sigma 0.2)
  (derive (up (- s (previous s)) :over z)) (solve :method {}))"""


def test_a_state_in_previous_is_that_of_the_row_before():
    """As dense least squares has it: the differences are measured, too."""
    result = mbm.loads(BEFORE.format("batch")).solve()
    eye = np.eye(4)
    differences = eye[1:] - eye[:-1]
    H = np.vstack([eye[:1], differences / 0.3, eye / 0.1, differences / 0.2])
    v = np.concatenate([[0.0], np.zeros(3), np.array([0.0, 0.3, 0.5, 0.9]) / 0.1, np.full(3, 0.5 / 0.2)])
    expected = np.linalg.lstsq(H, v, rcond=None)[0]
    np.testing.assert_allclose(result["s"].value, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result["s"].sigma, np.sqrt(np.diag(np.linalg.inv(H.T @ H))), rtol=1e-9)
    np.testing.assert_allclose(result["up"].value[1:], np.diff(expected), rtol=0, atol=1e-9)
    assert np.isnan(result["up"].value[0])


@pytest.mark.parametrize("method", ["ekf", "smoother"])
def test_filters_refuse_the_state_of_the_row_before(method):
    with pytest.raises(mbm.MbmError, match="states of several steps"):
        mbm.loads(BEFORE.format(method)).solve()
