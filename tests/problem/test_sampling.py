"""Tables sampled at times that hold unknowns: clock offsets, rows that come and go, derivatives, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, Slerp

import mbm

TRACK_TIMES = np.arange(0, 20, 0.5)
TRACK = np.column_stack([np.cos(TRACK_TIMES / 2), np.sin(TRACK_TIMES / 3)])
SIGMA = 0.01
CLOCK = """
(problem clock
  (data track external)
  (data seen external)
  (unknowns (offset :init {init}) (gain :init 1))
  (observe seen (= [u v] (* gain (sample track [x y] (+ t offset)))) :sigma 0.01)
  {more})
"""


def on_track(times):
    return np.column_stack([np.interp(times, TRACK_TIMES, column) for column in TRACK.T])


def data(times, offset=0.37, gain=1.2, seed=0):
    """Positions of the track seen by a clock that is ``offset`` behind, 1 cm of noise."""
    seen = gain * on_track(times + offset) + np.random.default_rng(seed).normal(0, SIGMA, (len(times), 2))
    return {
        "track": {"t": TRACK_TIMES, "x": TRACK[:, 0], "y": TRACK[:, 1]},
        "seen": {"t": times, "u": seen[:, 0], "v": seen[:, 1]},
    }


def reference(given, rows, start=(0.3, 1.1), track=on_track):
    """Least squares over the rows, by SciPy with differences."""
    times = given["seen"]["t"][rows]
    seen = np.column_stack([given["seen"]["u"], given["seen"]["v"]])[rows]

    def residuals(p):
        return ((p[1] * track(times + p[0]) - seen) / SIGMA).ravel()

    found = least_squares(residuals, start, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    return found.x, np.sqrt(np.diag(covariance)), 2 * found.cost


def test_a_clock_offset_is_estimated_with_its_uncertainty():
    given = data(np.arange(0.2, 19, 0.3))
    solved = mbm.loads(CLOCK.format(init=0, more="")).solve(data=given)
    wanted, sigma, cost = reference(given, slice(None))
    found = [float(solved[name].value) for name in ("offset", "gain")]
    # SciPy stops where its differences end: 1e-8 of a sigma of 2e-3.
    np.testing.assert_allclose(found, wanted, atol=1e-8)
    np.testing.assert_allclose([float(solved[n].sigma) for n in ("offset", "gain")], sigma, rtol=1e-5)
    assert solved.first.cost == pytest.approx(cost, rel=1e-10)
    assert solved.status == "ok"


def beyond(times):
    """The track with its last straight line going on."""
    slope = (TRACK[-1] - TRACK[-2]) / 0.5
    late = np.maximum(times - TRACK_TIMES[-1], 0)[:, None] * slope
    return on_track(times) + late


def test_rows_that_the_estimate_puts_outside_are_used_and_told():
    times = np.arange(0.4, 19.5, 0.3)
    given = data(times)
    solved = mbm.loads(CLOCK.format(init=0, more="")).solve(data=given)
    outside = times + float(solved["offset"].value) > TRACK_TIMES[-1]
    assert outside.any()  # at the start, with no offset, all rows were inside
    wanted, _, cost = reference(given, slice(None), track=beyond)
    assert float(solved["offset"].value) == pytest.approx(wanted[0], abs=1e-8)
    assert solved.first.cost == pytest.approx(cost, rel=1e-10)
    assert solved.first.dof == 2 * len(times) - 2
    (told,) = [d for d in solved.first.diagnostics if d.code.name == "sampled-rows-moved"]
    rows = np.flatnonzero(outside) + 1
    assert f"row {rows[0]} lies beyond" in told.message
    assert len(rows) == 1


def test_rows_that_the_start_puts_outside_are_unused_and_told():
    times = np.arange(0.2, 19, 0.3)
    given = data(times)
    solved = mbm.loads(CLOCK.format(init=1.2, more="")).solve(data=given)
    inside = times + 1.2 <= TRACK_TIMES[-1]
    wanted, _, _ = reference(given, inside)
    assert float(solved["offset"].value) == pytest.approx(wanted[0], abs=1e-8)
    assert solved.first.dof == 2 * inside.sum() - 2
    (told,) = [d for d in solved.first.diagnostics if d.code.name == "sampled-rows-moved"]
    assert "lie within the sampled table at the estimates" in told.message
    again = mbm.loads(CLOCK.format(init=float(solved["offset"].value), more="")).solve(data=given)
    assert not [d for d in again.first.diagnostics if d.code.name == "sampled-rows-moved"]


def test_derivatives_are_those_of_differences():
    compiled = mbm.loads(CLOCK.format(init=0.123, more="")).compile(data=data(np.arange(0.2, 18, 0.3)))
    point = np.array([0.0123, -0.04])
    differences = [
        (compiled.residuals(point + step) - compiled.residuals(point - step)) / 2e-6 for step in 1e-6 * np.eye(2)
    ]
    # Straight lines: central differences are exact to rounding where no node is crossed within 1e-6.
    np.testing.assert_allclose(compiled.jacobian(point), np.array(differences).T, atol=1e-5)


def test_an_offset_alone_is_no_linear_problem():
    """Between two nodes it is: a solver that believed it would stop after one step."""
    text = """
    (problem p (data track external) (data seen external) (unknowns (offset :init 0))
      (observe seen (= u (sample track x (+ t offset))) :sigma 0.01))
    """
    given = data(np.arange(3, 17, 0.3), offset=1.7, gain=1)
    solved = mbm.loads(text).solve(data=given)
    assert abs(float(solved["offset"].value) - 1.7) < 4 * float(solved["offset"].sigma)


def test_many_starts_sample_each_at_their_own_times():
    text = """
    (problem p (data track external) (data seen external) (unknowns (offset :in (-3 3)))
      (observe seen (= [u v] (sample track [x y] (+ t offset))) :sigma 0.01) (solve :starts (random 40)))
    """
    given = data(np.arange(4, 16, 0.3), offset=2.2, gain=1)
    solved = mbm.loads(text).solve(data=given)
    assert abs(float(solved["offset"].value) - 2.2) < 4 * float(solved["offset"].sigma)


def test_quantities_beyond_the_table_have_no_value():
    more = "(derive (early (sample track x 1.25)) (late (sample track x (+ 19.4 offset))))"
    solved = mbm.loads(CLOCK.format(init=0, more=more)).solve(data=data(np.arange(0.2, 18, 0.3)))
    assert float(solved["early"].value) == pytest.approx(float(on_track(np.array([1.25]))[0, 0]), abs=1e-15)
    assert np.isnan(float(solved["late"].value))


def test_the_column_of_times_may_be_named_and_angles_go_the_shorter_way():
    text = """
    (problem p
      (data compass (table (stamp heading) (0s 350deg) (2s 30deg) (1s 10deg)))
      (data seen (table (when) (0.5s) (1.5s)))
      (unknowns (a :init 0))
      (observe seen (= (cos (sample compass (angle heading) when :by stamp)) a) :sigma 1))
    """
    wanted = np.cos(np.deg2rad([0, 20])).mean()
    assert float(mbm.loads(text).solve()["a"].value) == pytest.approx(wanted, rel=1e-12)


def test_noise_may_be_sampled():
    text = """
    (problem p
      (data quality (table (t s) (0 1) (10 3)))
      (data seen (table (t y) (0 4) (5 7)))
      (unknowns (a :init 0))
      (observe seen (= y a) :sigma (sample quality s t)))
    """
    # Sigmas 1 and 2: weights 1 and 1/4.
    assert float(mbm.loads(text).solve()["a"].value) == pytest.approx((4 + 7 / 4) / (1 + 1 / 4), rel=1e-12)


def test_unknowns_may_stand_in_what_is_sampled():
    text = """
    (problem p
      (data lamp (table (t on) (0 0) (1 1) (2 0)))
      (data seen (table (t y) (0.25 1.5) (0.5 2) (1.5 2) (1.75 1.5)))
      (unknowns (dark :init 0) (bright :init 1))
      (observe seen (= y (sample lamp (+ dark (* on bright)) t)) :sigma 1))
    """
    solved = mbm.loads(text).solve()
    assert [float(solved[n].value) for n in ("dark", "bright")] == pytest.approx([1, 2], abs=1e-12)


TABLES = '(data a (table (t x name) (1 2 "u") (2 3 "v"))) (data b (table (t y k) (1 4 1))) (data c (table (z) (1)))'


@pytest.mark.parametrize(
    ("form", "code", "words"),
    [
        ("(sample a x)", "bad-form", "a table, a form and a time"),
        ("(sample d x t)", "unknown-table", "`d`"),
        ("(sample c z t)", "unknown-column", "`t`"),
        ("(sample a x t :by s)", "unknown-column", "`s`"),
        ("(sample a x t :by name)", "bad-time", "holds the text `u`"),
        ("(sample b y t)", "bad-time", "one row only"),
        ("(sample a name t)", "wrong-kind", "the text column `name`"),
        ("(sample a (sample a x t) t)", "bad-form", "inside `sample`"),
        ("(sample a x (sample a x t))", "bad-form", "inside `sample`"),
        ("(sample a (m t) t)", "bad-form", "picked by a column that is sampled"),
        ("(sample a (lambda (u) u) t)", "wrong-kind", "a number, a vector, a rotation or a pose"),
        ("(sample a x t :order 2)", "bad-form", "1 or 3"),
        ("(sample a x t :order 3)", "bad-form", "3 rows of `a`, which has 2"),
    ],
)
def test_what_cannot_be_sampled(faults, form, code, words):
    text = f"(problem p {TABLES} (unknowns (m :per a.t :init 0)) (observe a (= (m t) 1)) (observe b (= {form} (m k))))"
    found = faults(text)
    assert found[0].code.name == code
    assert words in found[0].message


def test_times_that_clash_with_the_table_are_told(faults):
    text = "(problem p (data a (table (t x) (1s 2) (2s 3))) (unknowns (o :init 0m)) (observe (= 1 (sample a x o))))"
    assert [f.code.name for f in faults(text)] == ["unit-clash"]


NODES = np.array([0.0, 0.4, 1.5, 2.1, 3.0, 3.2, 4.6])
INSIDE = np.array([0.0, 0.1, 0.4, 0.9, 2.0, 2.1, 3.05, 3.9, 4.6])


def sampled(form, columns, times=INSIDE):
    """A form of the columns at times, as a quantity derived for each of them."""
    problem = mbm.loads(f"""
        (problem p (data track external) (data seen external) (unknowns (a :init 0))
          (observe seen (= when a)) (derive (f {form} :over seen)))""")
    given = {"track": {"when": NODES, **columns}, "seen": {"when": times}}
    return problem.solve(data=given)["f"].value


def test_a_cubic_has_the_slopes_of_parabolas():
    y = np.sin(NODES) + 0.3 * NODES
    slopes = np.gradient(y, NODES, edge_order=2)
    wanted = CubicHermiteSpline(NODES, y, slopes)(INSIDE)
    np.testing.assert_allclose(sampled("(sample track y when :order 3)", {"y": y}), wanted, rtol=1e-12)
    both = sampled("(sample track [y (* 2 y)] when :order 3)", {"y": y})
    np.testing.assert_allclose(both, np.column_stack([wanted, 2 * wanted]), rtol=1e-12)


def test_the_column_of_times_is_the_one_called_as_in_the_time():
    columns = {"y": NODES**2, "t": NODES + 100}
    np.testing.assert_allclose(
        sampled("(sample track y when)", columns), np.interp(INSIDE, NODES, NODES**2), rtol=1e-13
    )
    shifted = sampled("(sample track y (+ when 100) :by t)", columns)
    np.testing.assert_allclose(shifted, np.interp(INSIDE, NODES, NODES**2), rtol=1e-11)


def quaternions(seed=5):
    turns = Rotation.from_rotvec(np.random.default_rng(seed).normal(0, 1, (len(NODES), 3)))
    return turns, dict(zip(("qx", "qy", "qz", "qw"), turns.as_quat().T, strict=True))


@pytest.mark.parametrize("order", [1, 3])
def test_rotations_stay_on_the_great_circle(order):
    turns, columns = quaternions()
    found = sampled(f"(sample track (quaternion qw qx qy qz) when :order {order})", columns)
    wanted = Slerp(NODES, turns)(INSIDE)
    apart = Rotation.from_quat(np.roll(found, -1, axis=1)) * wanted.inv()
    assert apart.magnitude().max() < 1e-12


def test_rotations_of_the_plane_go_the_shorter_way():
    angles = np.array([3.0, -3.1, 3.1, 2.0, -1.0, 0.5, 0.6])
    found = sampled("(heading (sample track (pose2 0 0 yaw) when))", {"yaw": angles})
    wanted = np.interp(INSIDE, NODES, np.unwrap(angles))
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * wanted), atol=1e-12)


@pytest.mark.parametrize("order", [1, 3])
def test_poses_turn_and_move(order):
    turns, columns = quaternions()
    where = np.random.default_rng(6).normal(size=(len(NODES), 3))
    columns |= dict(zip("xyz", where.T, strict=True))
    found = sampled(f"(sample track (pose3 (quaternion qw qx qy qz) [x y z]) when :order {order})", columns)
    apart = Rotation.from_quat(np.roll(found[:, :4], -1, axis=1)) * Slerp(NODES, turns)(INSIDE).inv()
    assert apart.magnitude().max() < 1e-12
    cubic = CubicHermiteSpline(NODES, where, np.gradient(where, NODES, axis=0, edge_order=2))(INSIDE)
    straight = np.column_stack([np.interp(INSIDE, NODES, c) for c in where.T])
    np.testing.assert_allclose(found[:, 4:], cubic if order == 3 else straight, atol=1e-12)


DRIFT = """
(problem drift
  (data track external)
  (data seen external)
  (unknowns (offset :init 0) (drift :init 0))
  (observe seen (= [u v] (sample track [x y] (+ (* t (+ 1 drift)) offset) :order {order})) :sigma 0.01))
"""


def curve(times):
    return np.column_stack([4 * np.cos(times / 2), 3 * np.sin(times / 3)])


@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize("seed", range(6))
def test_offset_and_drift_of_a_clock_converge_from_nothing(order, seed):
    random = np.random.default_rng(seed)
    offset, drift = random.uniform(-1.5, 1.5), random.uniform(-0.01, 0.01)
    nodes, times = np.arange(-5, 65, 0.1), np.sort(random.uniform(0, 55, 150))
    track = curve(nodes)
    seen = curve(times * (1 + drift) + offset) + random.normal(0, 0.01, (len(times), 2))
    given = {
        "track": {"t": nodes, "x": track[:, 0], "y": track[:, 1]},
        "seen": {"t": times, "u": seen[:, 0], "v": seen[:, 1]},
    }
    solved = mbm.loads(DRIFT.format(order=order)).solve(data=given)
    assert solved.status == "ok"
    for name, truth in (("offset", offset), ("drift", drift)):
        # Four standard deviations: 1 in 10,000.
        assert abs(float(solved[name].value) - truth) < 4 * float(solved[name].sigma)
    assert 1e-4 < solved.first.chi2_p < 1 - 1e-4


def test_a_clock_offset_between_poses_is_found_by_their_rotations_too():
    random = np.random.default_rng(11)
    nodes = np.arange(0, 30, 0.2)
    turns = Rotation.from_rotvec(np.column_stack([np.sin(nodes), 0.5 * np.cos(nodes / 2), nodes / 5]))
    times = np.arange(1, 28, 0.37)
    seen = Slerp(nodes, turns)(times + 0.123) * Rotation.from_rotvec(random.normal(0, 1e-3, (len(times), 3)))
    names = ("qx", "qy", "qz", "qw")
    given = {
        "track": {"t": nodes, **dict(zip(names, turns.as_quat().T, strict=True))},
        "seen": {"t": times, **dict(zip(names, seen.as_quat().T, strict=True))},
    }
    solved = mbm.loads("""
        (problem p (data track external) (data seen external) (unknowns (o :init 0))
          (observe seen (= (quaternion qw qx qy qz) (sample track (quaternion qw qx qy qz) (+ t o))) :sigma 1e-3))
        """).solve(data=given)
    assert solved.status == "ok"
    assert abs(float(solved["o"].value) - 0.123) < 4 * float(solved["o"].sigma)


EACH = """(problem p (data A external) (data B external) (unknowns (s :in (-0.5 0.5)) (m :init 1))
  (observe B (= u (+ m (sample A x (+ t s) :order {order}))) :sigma 0.1) {more})"""


def by_key():
    """Two keys whose times begin anew, the second one with more rows."""
    rng = np.random.default_rng(2)
    tables = []
    for k, rows in ((1, 6), (2, 9)):
        t = np.arange(float(rows))
        at = np.linspace(0.7, rows - 1.8, 7)
        seen = (at + 0.2) ** 2 * k + 0.5 * k + rng.normal(0, 0.1, 7)
        tables.append(({"k": t * 0 + k, "t": t, "x": k * t**2}, {"k": at * 0 + k, "t": at, "u": seen}))
    return tables


def together(parts):
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@pytest.mark.parametrize("order", [1, 3])
def test_times_begin_anew_with_each_key(order):
    tables = by_key()
    first, second = (together(each) for each in zip(*tables, strict=True))
    found = mbm.loads(EACH.format(order=order, more="(for-each k)")).solve(data={"A": first, "B": second}).solves
    for (a, b), each in zip(tables, found, strict=True):
        alone = mbm.loads(EACH.format(order=order, more="")).solve(data={"A": a, "B": b})
        for name in ("s", "m"):
            # the same minimum, from two starts
            assert float(each[name].value) == pytest.approx(float(alone[name].value), abs=1e-6 * alone[name].sigma)
            assert float(each[name].sigma) == pytest.approx(float(alone[name].sigma), rel=1e-5)


def test_what_is_wrong_with_the_times_of_one_key():
    problem = mbm.loads(EACH.format(order=1, more="(for-each k)"))
    first, second = (together(each) for each in zip(*by_key(), strict=True))
    wrong = {**first, "t": np.where((first["k"] == 2) & (first["t"] == 3), 4.0, first["t"])}
    with pytest.raises(mbm.MbmError) as caught:
        problem.solve(data={"A": wrong, "B": second})
    (fault,) = caught.value.diagnostics
    assert (fault.code.name, fault.place.row) == ("bad-time", 11)
    few = {name: values[(first["k"] == 1) | (first["t"] == 0)] for name, values in first.items()}
    solves = problem.solve(data={"A": few, "B": second}).solves
    assert [each.status.value for each in solves] == ["converged", "not-converged"]
    assert [d.code.name for d in solves[1].diagnostics] == ["bad-time"]
