"""Angles across ±π: in the data, in priors, in boxes, in derived quantities. The truth is on the unit circle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.noise.peer import linear, solved, table

DEGREE = math.pi / 180
# Directions around 180 degrees, on both sides of the cut.
DIRECTIONS = np.array([178.0, -179.0, 179.5, -177.5, 180.0]) * DEGREE
UNWRAPPED = np.where(DIRECTIONS < 0, DIRECTIONS + 2 * math.pi, DIRECTIONS)
DATA = table("t", w=DIRECTIONS, k=[1, 2, 3, 4, 5])


def close(found, expected, tolerance=1e-12):
    """The same direction."""
    assert abs(math.remainder(float(found) - expected, 2 * math.pi)) < tolerance
    assert -math.pi < float(found) <= math.pi


@pytest.mark.parametrize("start", [-179, 179, 90, -90])
def test_mean_direction_lies_where_the_data_are(start):
    result = solved(f"""(problem p {DATA} (unknowns (a angle :init {start}deg))
      (observe t (= w a) :sigma 2deg))""")
    close(result["a"].value, UNWRAPPED.mean())
    assert float(result["a"].sigma) == pytest.approx(2 * DEGREE / math.sqrt(5), rel=1e-12)
    rest = (UNWRAPPED - UNWRAPPED.mean()) / (2 * DEGREE)
    assert result.first.cost == pytest.approx(rest @ rest, rel=1e-9)


def test_measured_side_may_be_the_angle():
    """`(angle w)` makes an angle of a column; a real unknown is then compared along the circle."""
    result = solved(f"""(problem p {DATA} (unknowns (a :init 3.0))
      (observe t (= (angle w) a) :sigma 2deg))""")
    assert float(result["a"].value) == pytest.approx(UNWRAPPED.mean(), abs=1e-12)


def test_real_numbers_do_not_wrap():
    result = solved(f"(problem p {DATA} (unknowns (a :init 3.0)) (observe t (= w a) :sigma 2deg))")
    assert float(result["a"].value) == pytest.approx(DIRECTIONS.mean(), abs=1e-12)


def test_bare_forms_and_normals_wrap_too():
    bare = solved(f"(problem p {DATA} (unknowns (a angle :init 170deg)) (observe t (- a w) :sigma 2deg))")
    close(bare["a"].value, UNWRAPPED.mean())
    normal = solved(f"""(problem p {DATA} (unknowns (a angle :init 170deg))
      (constraints (normal a w 2deg :over t)))""")
    close(normal["a"].value, UNWRAPPED.mean())


@pytest.mark.parametrize(("init", "sigma"), [("179deg", "1deg"), ("-179deg", "3deg"), ("539deg", "1deg")])
def test_prior_across_the_cut(init, sigma):
    result = solved(f"""(problem p (unknowns (a angle :init {init} :sigma {sigma}))
      (observe (= -178deg a) :sigma 2deg))""")
    mean, spread = float(init[:-3]) * DEGREE, float(sigma[:-3]) * DEGREE
    other = mean + math.remainder(-178 * DEGREE - mean, 2 * math.pi)
    weights = np.array([1 / spread**2, 1 / (2 * DEGREE) ** 2])
    close(result["a"].value, weights @ [mean, other] / weights.sum())
    assert float(result["a"].sigma) == pytest.approx(1 / math.sqrt(weights.sum()), rel=1e-12)


@pytest.mark.parametrize(("measured", "expected"), [(-175, -175), (175, 175), (-160, -170), (160, 170), (180, 180)])
def test_box_across_the_cut(measured, expected):
    result = solved(f"""(problem p (unknowns (a angle :init 180deg :in (170deg 190deg)))
      (observe (= {measured}deg a) :sigma 1deg))""")
    close(result["a"].value, expected * DEGREE)
    assert result.status == "ok"
    held = measured != expected
    assert np.isnan(result["a"].sigma) == held


@pytest.mark.parametrize("start", [-175, 185, 545])
def test_start_is_taken_as_the_representative_inside_the_box(start):
    result = solved(f"""(problem p (unknowns (a angle :init {start}deg :in (170deg 190deg)))
      (observe (= 172deg a) :sigma 1deg))""")
    close(result["a"].value, 172 * DEGREE)


def test_fixed_angle_keeps_its_value():
    result = solved("""(problem p (unknowns (a angle :init 190deg :fixed true) (b angle :init 0))
      (observe (= -179deg (+ a b)) :sigma 1deg))""")
    close(result["b"].value, -9 * DEGREE)
    close(result["a"].value, -170 * DEGREE)


def test_bearings_to_a_point_behind():
    """A point at (-10, 0.1), bearings from places on both sides: linear least squares on the unwrapped angles."""
    places = np.array([[0.0, 0.3], [0.0, -0.4], [1.0, 0.05], [-1.0, 0.6], [2.0, -0.2]])
    truth = np.array([-10.0, 0.1])
    bearing = np.arctan2(truth[1] - places[:, 1], truth[0] - places[:, 0])
    assert (bearing > 3).any()
    assert (bearing < -3).any()
    result = solved(f"""(problem p {table("t", x=places[:, 0], y=places[:, 1], w=bearing)}
      (unknowns (p (vector 2) :init [-9 0]))
      (observe t (= w (atan2 (- (p 2) y) (- (p 1) x))) :sigma 1deg)
      (derive (far (atan2 (p 2) (p 1)) :unit deg)))""")
    # Exact data: rounding of angles near π, times distance over base line.
    np.testing.assert_allclose(result["p"].value, truth, atol=1e-9)
    away = truth - places
    square = (away**2).sum(axis=1)
    jacobian = np.column_stack([-away[:, 1] / square, away[:, 0] / square])
    fit = linear(jacobian, np.zeros(5), np.full(5, DEGREE))
    np.testing.assert_allclose(result.covariance.matrix, fit.covariance, rtol=1e-7)
    slope = np.array([-truth[1], truth[0]]) / (truth @ truth)
    assert float(result["far"].value) == pytest.approx(math.degrees(math.atan2(0.1, -10)), abs=1e-9)
    assert float(result["far"].sigma) == pytest.approx(
        math.degrees(math.sqrt(slope @ fit.covariance @ slope)), rel=1e-7
    )


def test_derived_angles_are_wrapped():
    result = solved("""(problem p (unknowns (a angle :init 170deg))
      (observe (= 170deg a) :sigma 1deg)
      (derive (sum (+ a 30deg)) (twice (* 2 a)) (gap (- a -170deg))))""")
    assert float(result["sum"].value) == pytest.approx(-160 * DEGREE, abs=1e-12)
    assert float(result["gap"].value) == pytest.approx(-20 * DEGREE, abs=1e-12)
    # A multiple of an angle is a number.
    assert float(result["twice"].value) == pytest.approx(340 * DEGREE, abs=1e-12)


def test_members_of_a_family_wrap_one_by_one():
    result = solved(f"""(problem p {DATA} (unknowns (a angle :per t.k :init 181deg :sigma 1000deg))
      (observe t (= w (a k)) :sigma 1deg))""")
    for found, expected in zip(result["a"].value, DIRECTIONS, strict=True):
        # The prior has a millionth of the weight.
        close(found, expected, 1e-6 * math.pi)
