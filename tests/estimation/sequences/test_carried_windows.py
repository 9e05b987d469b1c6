"""Windows of a sequence with `:carry`: what leaves a window is the prior of the next."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

import mbm
from tests.estimation.sequences.kalman import jointly

WALK = """
(problem walk (data z external) (data w external) (unknowns (b :init 0 :sigma 2))
  (states :over k (x :init 0 {sigma})) (dynamics (random-walk x :sigma 1))
  (observe z (= y (+ x b)) :sigma 0.5) (observe w (= u x) :sigma 1) {rest}
  (window k :length 8 :step 3 :carry true) (solve :method {method}))"""


def walk(steps=40, run=0):
    """Rows of a walk in irregular steps."""
    generator = np.random.default_rng(run)
    k = np.cumsum(generator.choice([0.5, 1.0, 1.5], steps))
    x = np.cumsum(generator.standard_normal(steps))
    some = np.arange(steps) % 3 == 0
    return {
        "z": {"k": k, "y": x + 3.0 + 0.5 * generator.standard_normal(steps)},
        "w": {"k": k[some], "u": x[some] + generator.standard_normal(some.sum())},
    }


def least_squares(tables, end, sigma=10.0):
    """State and offset (T, 2) at all steps up to an end, and their covariances, by dense least squares."""
    k = tables["z"]["k"][tables["z"]["k"] <= end]
    moves = [(np.eye(2), np.diag([dt, 0.0])) for dt in np.diff(k)]
    rows = []
    for key in k:
        y, u = (tables[name][column][tables[name]["k"] == key] for name, column in (("z", "y"), ("w", "u")))
        H = np.vstack([np.ones((len(y), 2)), np.tile([[1.0, 0.0]], (len(u), 1))])
        rows.append((H, np.concatenate([y, u]), np.diag([0.25] * len(y) + [1.0] * len(u))))
    return jointly(np.zeros(2), np.diag([sigma**2, 4.0]), moves, rows)[:2]


@pytest.mark.parametrize("method", ["smoother", "batch"])
def test_windows_of_a_linear_problem_say_what_all_rows_so_far_say(method):
    tables = walk()
    result = mbm.loads(WALK.format(method=method, sigma=":sigma 10", rest="")).solve(data=tables)
    assert len(result.solves) > 10
    for solve in result.solves:
        means, covariances = least_squares(tables, solve.key["k"])
        count = len(solve["x"].keys)
        sigmas = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        np.testing.assert_allclose(solve["x"].value, means[-count:, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(solve["x"].sigma, sigmas[-count:, 0], rtol=1e-9)
        assert float(solve["b"].value) == pytest.approx(means[-1, 1], abs=1e-9)
        assert float(solve["b"].sigma) == pytest.approx(sigmas[-1, 1], rel=1e-9)
    end = solve.key["k"]
    assert solve.dof == sum(((each["k"] > end - 8) & (each["k"] <= end)).sum() for each in tables.values())


@pytest.mark.parametrize("method", ["smoother", "batch"])
def test_what_is_certain_at_the_first_step_is_so_at_no_later_one(method):
    tables = walk()
    result = mbm.loads(WALK.format(method=method, sigma=":sigma 0", rest="")).solve(data=tables)
    for solve in result.solves:
        means, covariances = least_squares(tables, solve.key["k"], sigma=1e-5)
        count = len(solve["x"].keys)
        np.testing.assert_allclose(solve["x"].value, means[-count:, 0], rtol=0, atol=1e-6)
        np.testing.assert_allclose(solve["x"].sigma, np.sqrt(covariances[-count:, 0, 0]), atol=2e-5)


def test_a_window_of_one_step_is_not_certain_either():
    text = """(problem p (data z external) (states :over k (x :init 0 :sigma 0)) (dynamics (random-walk x :sigma 1))
      (observe z (= y x) :sigma 1) (window k :length 2.2 :step 1.5 :carry true) (solve :method smoother))"""
    data = {"z": {"k": np.array([0.0, 1.0, 3.1]), "y": np.array([0.3, 1.0, 9.0])}}
    last = mbm.loads(text).solve(data=data).solves[-1]
    # From x(0) = 0 the step to k = 1 has the variance 1, and so has its row.
    np.testing.assert_allclose(last["x"].value, [0.5], atol=1e-12)
    np.testing.assert_allclose(last["x"].sigma, [np.sqrt(0.5)], atol=1e-12)


def test_what_no_row_has_determined_when_it_leaves_is_still_open():
    """Without a prior of x the first rows tell the sum of x and b alone: later ones of x tell both."""
    tables = walk()
    late = tables["w"]["k"] > 20
    tables["w"] = {name: column[late] for name, column in tables["w"].items()}
    text = WALK.format(method="smoother", sigma="", rest="").replace(":init 0 :sigma 2", ":init 0")
    result = mbm.loads(text).solve(data=tables)
    assert np.isnan(result.solves[4]["b"].sigma)
    assert np.isfinite(result.solves[-1]["b"].sigma)
    last = result.solves[-1]
    # The last window may end before the last row.
    count = int((tables["z"]["k"] <= last.key["k"]).sum())
    early = {name: {c: v[each["k"] <= last.key["k"]] for c, v in each.items()} for name, each in tables.items()}
    whole = mbm.loads(text.replace("(window k :length 8 :step 3 :carry true)", "")).solve(data=early)
    assert len(whole["x"].value) == count
    np.testing.assert_allclose(last["x"].value, whole["x"].value[-len(last["x"].value) :], rtol=0, atol=1e-8)
    assert float(last["b"].sigma) == pytest.approx(float(whole["b"].sigma), rel=1e-8)


def test_each_key_begins_anew():
    one, two = walk(run=1), walk(run=2)
    both = {
        name: {
            "run": np.repeat([1.0, 2.0], [len(one[name]["k"]), len(two[name]["k"])]),
            **{column: np.concatenate([one[name][column], two[name][column]]) for column in one[name]},
        }
        for name in one
    }
    keyed = mbm.loads(WALK.format(method="smoother", sigma=":sigma 10", rest="(for-each run)")).solve(data=both)
    alone = mbm.loads(WALK.format(method="smoother", sigma=":sigma 10", rest="")).solve(data=two)
    own = [solve for solve in keyed.solves if solve.key["run"] == 2]
    assert len(own) == len(alone.solves)
    for found, expected in zip(own, alone.solves, strict=True):
        np.testing.assert_allclose(found["x"].value, expected["x"].value, rtol=0, atol=1e-12)


DRIVE = """
(problem drive (data o external) (data r external)
  (unknowns (off :init 0 :sigma 0.5))
  (states :over k (T (pose 2) :init (pose2 0 0 0) :sigma [0.2 0.3 0.3]))
  (dynamics (= (next T) (compose T (pose2 dx 0 da)) :sigma [0.03 0.05 0.03]))
  (observe r (= d (+ off (distance (translation T) [bx by]))) :sigma 0.1)
  (window k :length 5 :step 2 {carry}) (solve :method smoother))"""
BEACONS = np.array([[8.0, -2.0], [-3.0, 9.0], [2.0, 25.0], [-15.0, 12.0]])


def drive(steps):
    """True poses (turn, x, y) and offset, drawn from what the problem says, and rows: in a circle between beacons."""
    generator = np.random.default_rng(4)
    pose = np.array([0.2, 0.3, 0.3]) * generator.standard_normal(3)
    off, poses, ranges = 0.5 * generator.standard_normal(), [], []
    for k in range(steps):
        if k:
            c, s = np.cos(pose[0]), np.sin(pose[0])
            pose = pose + np.array([0.1, c, s])
            noise = np.array([0.03, 0.05, 0.03]) * generator.standard_normal(3)
            c, s = np.cos(pose[0]), np.sin(pose[0])
            pose = pose + np.array([noise[0], c * noise[1] - s * noise[2], s * noise[1] + c * noise[2]])
        poses.append(pose)
        for beacon in BEACONS[[k % 4, (k + 1) % 4]]:
            measured = off + np.hypot(*(pose[1:] - beacon)) + 0.1 * generator.standard_normal()
            ranges += [[k, *beacon, measured]]
    k = np.arange(steps, dtype=float)
    tables = {
        "o": {"k": k, "dx": np.ones(steps), "da": np.full(steps, 0.1)},
        "r": dict(zip(("k", "bx", "by", "d"), np.array(ranges).T, strict=True)),
    }
    return np.array(poses), off, tables


def test_windows_of_a_drive_are_consistent():
    """Mean squared normalised errors of the newest pose within the 95 % bounds of χ², of 200 windows."""
    poses, off, tables = drive(400)
    result = mbm.loads(DRIVE.format(carry=":carry true")).solve(data=tables)
    assert len(result.solves) == 200
    nees, shares = [], []
    for solve in result.solves:
        at = int(solve["T"].keys[-1])
        value = solve["T"].value[-1]
        error = value - poses[at]
        error[0] = np.angle(np.exp(1j * error[0]))
        names = [f"T@{at}.rot[1]", f"T@{at}.trans[1]", f"T@{at}.trans[2]"]
        places = [solve.covariance.names.index(name) for name in names]
        nees.append(error @ np.linalg.solve(solve.covariance.matrix[np.ix_(places, places)], error))
        shares.append((float(solve["off"].value) - off) / float(solve["off"].sigma))
    low, high = chi2.ppf([0.025, 0.975], 3 * 200) / 200
    assert low < np.mean(nees) < high
    assert np.max(np.abs(shares)) < 3.5
    assert result.solves[-1]["off"].sigma < 0.05


def test_windows_with_few_rows_carry_what_they_have():
    tables = walk()
    text = WALK.format(method="smoother", sigma=":sigma 10", rest="")
    few = mbm.loads(text.replace(":step 3", ":step 3 :min-rows 11")).solve(data=tables).solves
    skipped = [str(solve.status) == "skipped" for solve in few]
    assert skipped[0] and not all(skipped)
    for solve in (solve for solve, left in zip(few, skipped, strict=True) if not left):
        means, covariances = least_squares(tables, solve.key["k"])
        np.testing.assert_allclose(solve["x"].value[-1], means[-1, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(solve["x"].sigma[-1], np.sqrt(covariances[-1, 0, 0]), rtol=1e-9)


def test_a_gap_begins_anew_with_a_warning():
    """Behind the gap each window says what all rows behind it say."""
    tables = walk()
    early, late = (
        {name: {c: v[keep(each["k"])] for c, v in each.items()} for name, each in tables.items()}
        for keep in (lambda k: k < 12, lambda k: k > 25)
    )
    both = {name: {c: np.concatenate([v, late[name][c]]) for c, v in each.items()} for name, each in early.items()}
    solves = mbm.loads(WALK.format(method="smoother", sigma=":sigma 10", rest="")).solve(data=both).solves
    behind = [solve for solve in solves if solve.key["k"] >= late["z"]["k"][0]]
    for solve in behind:
        means, covariances = least_squares(late, solve.key["k"])
        np.testing.assert_allclose(solve["x"].value[-1], means[-1, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(solve["x"].sigma[-1], np.sqrt(covariances[-1, 0, 0]), rtol=1e-9)
    warned = [any(each.code.name == "begun-anew" for each in solve.diagnostics) for solve in solves]
    first = len(solves) - len(behind)
    assert not any(warned[:first])
    assert warned[first]
    assert not warned[-1]


REFUSED = {
    "filter": (WALK.format(method="ekf", sigma=":sigma 10", rest=""), "is for `:method ekf`"),
    "lag": (WALK.format(method="(smoother :lag 2)", sigma=":sigma 10", rest=""), "is for `:method smoother`"),
    "limits": (
        WALK.format(method="smoother", sigma=":sigma 10 :in (-99 99)", rest=""),
        "has bounds, as `x` has",
    ),
    "distribution": (
        WALK.format(method="batch", sigma=":sigma 10", rest="").replace("0.5)", "0.5 :distribution (student 3))"),
        "`:distribution student` of `z` does not go with `:carry`",
    ),
    "correlation": (
        WALK.format(method="batch", sigma=":sigma 10", rest="").replace("0.5)", "0.5 :correlation (ar1 0.5))"),
        "`:carry` takes one step after the other, and `:correlation` of `z` joins their rows",
    ),
    "no states": (
        "(problem p (data z external) (unknowns (a :init 0)) (observe z (= y a) :sigma 1)"
        " (window k :length 2 :step 1 :carry true))",
        "has no `states`",
    ),
    "no truth": (WALK.format(method="smoother", sigma=":sigma 10", rest="").replace("true", "3"), "true or false"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_carried_is_refused(case):
    text, words = REFUSED[case]
    tables = walk(12) if "data w" in text else {"z": walk(12)["z"]}
    said = ""
    try:
        result = mbm.loads(text).solve(data=tables)
        said = " ".join(str(each) for solve in result.solves for each in solve.diagnostics)
    except mbm.MbmError as error:
        said = str(error)
    assert words in said


FAMILIES = """
(problem families (data z external) (data q external)
  (unknowns (b :per q.j :init 0 {prior}))
  (states :over k (x :init 0 :sigma 1)) (dynamics (random-walk x :sigma 0.3))
  (observe z (= y x) :sigma 0.1) (observe q (= u (+ (b j) x)) :sigma 0.2)
  (window k :length 3 :step 1 :carry true) (solve :method {method}))"""
SIGHTINGS = np.array([[0, 1, 0.1], [1, 2, 0.2], [2, 1, 0.7], [3, 3, 4.0], [4, 2, 1.0], [5, 3, 4.4], [6, 4, 9.0]])


def family_by_least_squares(y, end, sigma):
    """Means and deviations of the members by key, and of the last x, by all rows up to an end."""
    seen = SIGHTINGS[SIGHTINGS[:, 0] <= end]
    keys, steps = list(dict.fromkeys(seen[:, 1])), end + 1
    rows = [(np.eye(steps)[0], 0.0, 1.0)]
    rows += [(np.eye(steps)[k] - np.eye(steps)[k - 1], 0.0, 0.3) for k in range(1, steps)]
    rows += [(np.eye(steps)[k], y[k], 0.1) for k in range(steps)]
    wide = [(np.concatenate([h, np.zeros(len(keys))]) / s, v / s) for h, v, s in rows]
    for k, j, u in seen:
        h = np.zeros(steps + len(keys))
        h[[int(k), steps + keys.index(j)]] = 1.0
        wide.append((h / 0.2, u / 0.2))
    wide += [(np.eye(steps + len(keys))[steps + at] / sigma, 0.0) for at in range(len(keys))]
    H, v = np.array([h for h, _ in wide]), np.array([v for _, v in wide])
    covariance = np.linalg.inv(H.T @ H)
    mean, deviation = covariance @ H.T @ v, np.sqrt(np.diag(covariance))
    members = {key: (mean[steps + at], deviation[steps + at]) for at, key in enumerate(keys)}
    return members, (mean[steps - 1], deviation[steps - 1])


@pytest.mark.parametrize("method", ["smoother", "batch"])
@pytest.mark.parametrize(("prior", "sigma"), [("", np.inf), (":sigma 1", 1.0)])
def test_members_of_families_are_carried_by_their_keys(method, prior, sigma):
    """The keys stand in another order in the fourth window; the first one leaves with the sixth, new ones come."""
    y = np.array([0.0, 0.3, 0.5, 0.9, 1.1, 1.0, 1.4])
    tables = {"z": {"k": np.arange(7.0), "y": y}, "q": dict(zip("kju", SIGHTINGS.T, strict=True))}
    result = mbm.loads(FAMILIES.format(method=method, prior=prior)).solve(data=tables)
    assert len(result.solves) == 7
    for solve in result.solves:
        members, last = family_by_least_squares(y, int(solve.key["k"]), sigma)
        for key, value, deviation in zip(solve["b"].keys, solve["b"].value, solve["b"].sigma, strict=True):
            assert (float(value), float(deviation)) == pytest.approx(members[key], abs=1e-9)
        assert (float(solve["x"].value[-1]), float(solve["x"].sigma[-1])) == pytest.approx(last, abs=1e-9)
