"""Losses where the data leave no residual: the stated noise is all that is known of the spread."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

LINE = """
(problem line
  (data d (table (x y) (0 1.1) (1 2.9)))
  (unknowns (a :init 1) (b :init 0))
  (observe d (= y (+ (* a x) b)) :sigma 0.2 {loss}))
"""


@pytest.mark.parametrize("backend", ["auto", "numpy", "casadi"])
@pytest.mark.parametrize("loss", ["", ":loss huber", ":loss cauchy", ":loss soft-l1"])
def test_two_points_give_a_line_with_the_uncertainty_of_the_points(loss, backend):
    result = mbm.loads(LINE.format(loss=loss)).solve(backend=backend)
    # a = y2 - y1, b = y1
    np.testing.assert_allclose([result["a"].value, result["b"].value], [1.8, 1.1], rtol=1e-9)
    # the loss counts residuals of zero in full, so that the covariance is that of least squares
    np.testing.assert_allclose([result["a"].sigma, result["b"].sigma], [0.2 * np.sqrt(2), 0.2], rtol=1e-6)


RANGES = """
(problem rob
  (data ranges external)
  (unknowns (p (vector 3) :unit m))
  (observe ranges (= range (distance p [x y z])) :sigma 5mm)
  (solve :robust gnc))
"""


@pytest.mark.parametrize("backend", ["auto", "casadi"])
def test_graduated_non_convexity_tries_both_sides_of_the_stations(backend):
    """Stations nearly in a plane: from the mirror image that the closed form also gives, too few agree."""
    stations = np.array([[x, y, 2.5 + 0.05 * ((x + y) % 2)] for x in (0, 1, 2, 3) for y in (0, 1)], dtype=float)
    truth = np.array([1.2, 0.6, 0.7])
    measured = np.linalg.norm(stations - truth, axis=1)
    measured[3] += 0.5
    table = {"x": stations[:, 0], "y": stations[:, 1], "z": stations[:, 2], "range": measured}
    result = mbm.loads(RANGES).solve(data={"ranges": table}, backend=backend)
    # without noise the good ranges agree exactly
    np.testing.assert_allclose(result["p"].value, truth, atol=1e-7)


FEW = """
(problem few
  (data d (table (e x y z r) {rows}))
  (unknowns (p (vector 3)))
  (observe d (= r (distance p [x y z])) :sigma 0.02 {loss}) (for-each e))
"""
FULL = "(2 0 0 0.5 5) (2 10 0 0.5 8) (2 0 10 0 7.2) (2 10 10 0.5 9.2) (2 5 5 4 3.1)"


@pytest.mark.parametrize("backend", ["auto", "numpy"])
@pytest.mark.parametrize("loss", [":loss tukey", ":loss geman-mcclure", ":loss cauchy"])
def test_too_few_ranges_leave_a_place_on_their_circle_undetermined(loss, backend):
    """Two ranges fix a circle: x from their difference, x² + y² + z'² = r²; no start, beside a full solve."""
    text = FEW.format(rows=f"(1 0 0 0.5 5) (1 10 0 0.5 8) {FULL}", loss=loss)
    few = mbm.loads(text).solve(backend=backend).solves[0]
    assert few.status == "unobservable"
    x, y, z = few.estimates[0].value
    # the squares differ by 20 x - 100; the fit stops where its steps are small against sigma
    np.testing.assert_allclose([x, np.sqrt(x * x + y * y + (z - 0.5) ** 2)], [3.05, 5.0], rtol=1e-6)


@pytest.mark.parametrize("backend", ["auto", "numpy"])
def test_ranges_from_one_station_leave_a_place_on_a_sphere_undetermined(backend):
    """The one that is off is left aside: the radius is the mean of the others, two of each length."""
    lengths = (4.80, 4.80, 4.81, 4.81, 9.9, 4.82, 4.82)
    rows = " ".join(f"(1 1 2 3 {length})" for length in lengths)
    text = FEW.format(rows=f"{rows} {FULL}", loss=":loss tukey")
    few = mbm.loads(text).solve(backend=backend).solves[0]
    assert few.status == "unobservable"
    # the good ranges lie symmetrically about 4.81, where any even loss has its minimum
    assert np.linalg.norm(few.estimates[0].value - [1.0, 2.0, 3.0]) == pytest.approx(4.81, abs=1e-3)


AGREEING = """
(problem few
  (data d (table (k x y) (1 0 1.0) (1 1 2.1) (1 2 9.0) (2 0 0) (2 1 1.1) (2 2 1.9) (2 3 3.05) (2 4 3.9) (2 5 40)))
  (unknowns (a) (b))
  (observe d (= y (+ a (* b x))) :sigma 0.1 :loss {loss} {options}))
"""


@pytest.mark.parametrize("backend", ["auto", "numpy", "casadi"])
@pytest.mark.parametrize("options", [") (for-each k", ":when (= k 1)"])
@pytest.mark.parametrize("loss", ["tukey", "geman-mcclure", "cauchy"])
def test_rows_that_alone_keep_weight_have_the_noise_that_is_stated(loss, options, backend):
    """Of three points a line through two is left: the third counts next to nothing, and the fit shows no residual."""
    solve = mbm.loads(AGREEING.format(loss=loss, options=options)).solve(backend=backend).solves[0]
    said = [d.message for d in solve.diagnostics if d.code.name == "ambiguous-consensus"]
    assert 1 <= len(said) == len(set(said)) <= 2  # that other rows fit as well, and which row could change places
    residuals = np.array([1.0, 2.1, 9.0]) - solve.estimates[0].value - solve.estimates[1].value * np.arange(3)
    kept = np.abs(residuals) < 1.0
    assert kept.sum() == 2
    design = np.column_stack([np.ones(3), np.arange(3)])[kept]
    expected = 0.1 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    # the third keeps a weight of (2.385 · 0.1/5.8)² = 0.0017 under Cauchy's loss, the least among those of its pairs
    np.testing.assert_allclose([float(e.sigma) for e in solve.estimates], expected, rtol=0.02)


def test_a_loss_on_equations_that_hold_no_unknown() -> None:
    """Half of one equation, for no unknown, is that equation: not the mean of nothing, of which NumPy warns."""
    problem = mbm.loads("""(problem p (data d (table (y) (1) (2) (4))) (unknowns (a :init 1))
      (observe d (= y a) :sigma 1)
      (observe (if (> a 9) (= 1 7) (= 3 7)) :sigma (unknown 2) :loss cauchy))""")
    for backend in ("numpy", "native"):
        assert problem.solve(backend=backend)["a"].value == pytest.approx(7 / 3, rel=1e-6)


@pytest.mark.parametrize("noise", [":sigma 0.1 :loss huber", ":sigma 0.1 :loss cauchy", ":loss huber"])
@pytest.mark.parametrize("places", [(0.0, 1.7), (0.0, 0.0, 0.0, 0.0, 0.0, 1.7)], ids=["two rows", "one apart"])
def test_what_one_row_alone_determines_it_contradicts_nobody_about(noise, places):
    """The slope of a line by readings in two places: the fit goes through a single one there, whatever it is."""
    problem = mbm.loads(f"(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b t))) {noise}))")
    for seed in range(4):
        y = np.random.default_rng(seed).normal(1.0, 0.1, len(places))
        found = problem.solve(data={"d": {"t": places, "y": y}})
        assert "bad-leverage" not in [each.code.name for each in found.diagnostics]


@pytest.mark.parametrize("far", [1e2, 1e9, 1e12])
@pytest.mark.parametrize("error", [0.0, -1.0])
def test_a_row_far_out_is_told_from_a_wrong_one_far_out(far, error):
    """The line 1 + 2t by 8 readings, continued to ``far`` as it is, or with 0 there: 100 deviations off, or more."""
    t = np.append(np.arange(8.0), far)
    noise = 0.1 * np.random.default_rng(1).normal(size=8)
    y = np.append(1 + 2 * t[:8] + noise, (1 + 2 * far) * (1.0 + error))
    text = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b t))) :sigma 0.1 :loss huber))"
    found = mbm.loads(text).solve(data={"d": {"t": t, "y": y}})
    assert ("bad-leverage" in [each.code.name for each in found.diagnostics]) == (error != 0.0)
