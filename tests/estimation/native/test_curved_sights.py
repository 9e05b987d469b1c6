"""Consensus on images through a lens that distorts: lines of sight are found from near ones, in machine code."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.kernels.native.engine import available

POINTS = np.random.default_rng(5).uniform(-1.0, 1.0, (16, 3))
TURN, SHIFT = Rotation.from_euler("xyz", [0.2, -0.3, 0.5]), np.array([0.1, -0.2, 3.5])
WRONG = (2, 7, 11)

CAMERA = "(camera cam :model pinhole :focal (f f) :center (320 240) :distortion (k1 k2 0.001 -0.002 0))"
MOVED = {
    "pose": ("(T (pose 3))", "(transform T [x y z])"),
    "inverse": ("(T (pose 3))", "(transform (inverse T) [x y z])"),
    "rotation vector": ("(w (vector 3)) (t (vector 3))", "(+ t (rotate (axis-angle w) [x y z]))"),
}
"""How the points are moved before the camera; the numbers are those of this motion, or of the one back."""


def problem(how: str, solve: str = "(solve :robust lmeds)") -> mbm.Problem:
    unknowns, moved = MOVED[how]
    return mbm.loads(f"""
    (problem seen (data d external) (constants (f 800) (k1 -0.3) (k2 0.1)) {CAMERA}
      (unknowns {unknowns}) (observe d (= [u v] (project cam {moved})) :sigma 0.5) {solve})""")


def images(noise: float, seed: int, wrong: tuple[int, ...] = WRONG) -> dict[str, np.ndarray]:
    """By the formula of Brown and Conrady, as OpenCV states it."""
    random = np.random.default_rng(seed)
    x, y, z = (TURN.apply(POINTS) + SHIFT).T
    a, b = x / z, y / z
    square = a * a + b * b
    radial = 1.0 - 0.3 * square + 0.1 * square**2
    p1, p2 = 0.001, -0.002
    u = a * radial + 2 * p1 * a * b + p2 * (square + 2 * a * a)
    v = b * radial + p1 * (square + 2 * b * b) + 2 * p2 * a * b
    image = 800.0 * np.column_stack([u, v]) + [320.0, 240.0] + noise * random.standard_normal((len(POINTS), 2))
    image[list(wrong)] += random.uniform(40.0, 90.0, (len(wrong), 2))
    return dict(zip("xyzuv", [*POINTS.T, *image.T], strict=True))


def motion(result: mbm.Solved | object, how: str) -> tuple[np.ndarray, np.ndarray]:
    """The rotation and the shift that an answer says the points make."""
    if how == "rotation vector":
        return Rotation.from_rotvec(result["w"].value).as_matrix(), result["t"].value
    w, x, y, z, *t = result["T"].value
    R = Rotation.from_quat([x, y, z, w]).as_matrix()
    return (R, np.array(t)) if how == "pose" else (R.T, -R.T @ np.array(t))


@pytest.mark.parametrize("how", MOVED)
def test_the_pose_is_found_among_outliers(how: str) -> None:
    found = problem(how).solve(data={"d": images(0.0, 1)})
    R, t = motion(found, how)
    # Without noise the fit is exact: rounding of numbers up to 600 pixels times a condition of some ten.
    np.testing.assert_allclose(R, TURN.as_matrix(), rtol=0, atol=1e-10)
    np.testing.assert_allclose(t, SHIFT, rtol=0, atol=1e-10)
    assert found.first.residual_summaries["d"].outliers == tuple(row + 1 for row in WRONG)


@pytest.mark.parametrize("how", MOVED)
def test_estimators_give_the_answers_of_whole_solves_in_machine_code(how: str) -> None:
    compiled = problem(how).compile(data={"d": images(0.5, 0)})
    estimator = compiled.estimator("u", "v")
    assert estimator.fast is available()
    for seed in range(1, 6):
        data = images(0.5, seed)
        found, whole = estimator(data["u"], data["v"]), compiled.solve(data={"d": data})
        assert found.clean is estimator.fast
        assert found.cost == pytest.approx(whole.first.cost, rel=1e-9)
        # Both end within 1e-10 standard deviations of one minimum.
        np.testing.assert_allclose(found.covariance, whole.covariance.matrix, rtol=1e-6, atol=1e-14)


def test_many_solves_are_those_made_alone() -> None:
    text = problem("pose", "(solve :robust lmeds) (for-each run)")
    sets = [images(0.5, seed, WRONG if seed % 2 else ()) for seed in range(12)]
    table = {name: np.concatenate([each[name] for each in sets]) for name in "xyzuv"}
    many = text.solve(data={"d": {**table, "run": np.repeat(np.arange(12.0), len(POINTS))}})
    alone = problem("pose")
    for run, (each, solved) in enumerate(zip(sets, many.solves, strict=True)):
        one = alone.solve(data={"d": each}).first
        assert solved.cost == pytest.approx(one.cost, rel=1e-8)
        outliers = tuple(row - len(POINTS) * run for row in solved.residual_summaries["d"].outliers)
        assert outliers == one.residual_summaries["d"].outliers
