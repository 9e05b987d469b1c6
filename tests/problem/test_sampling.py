"""Tables sampled at times that hold unknowns: clock offsets, rows that come and go, derivatives, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

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


def reference(given, rows, start=(0.3, 1.1)):
    """Least squares over the rows, by SciPy with differences."""
    times = given["seen"]["t"][rows]
    seen = np.column_stack([given["seen"]["u"], given["seen"]["v"]])[rows]

    def residuals(p):
        return ((p[1] * on_track(times + p[0]) - seen) / SIGMA).ravel()

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


def test_rows_that_the_estimate_puts_outside_are_unused():
    times = np.arange(0.4, 19.5, 0.3)
    given = data(times)
    solved = mbm.loads(CLOCK.format(init=0, more="")).solve(data=given)
    inside = times + float(solved["offset"].value) <= TRACK_TIMES[-1]
    assert (~inside).any()  # at the start, with no offset, all rows were inside
    wanted, _, cost = reference(given, inside)
    assert float(solved["offset"].value) == pytest.approx(wanted[0], abs=1e-8)
    assert solved.first.cost == pytest.approx(cost, rel=1e-10)
    assert solved.first.dof == 2 * inside.sum() - 2


def test_rows_that_the_start_puts_outside_come_back():
    times = np.arange(0.2, 19, 0.3)
    given = data(times)
    solved = mbm.loads(CLOCK.format(init=1.2, more="")).solve(data=given)
    wanted, _, _ = reference(given, slice(None))
    assert float(solved["offset"].value) == pytest.approx(wanted[0], abs=1e-8)
    assert solved.first.dof == 2 * len(times) - 2


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
        ("(sample a (rot2 x) t)", "wrong-kind", "a number, a vector or a matrix"),
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
