"""The articulated figure of 19 joint angles against its kinematic chain, multiplied out with NumPy."""

from __future__ import annotations

import numpy as np
import pytest

FIGURE = """
(defmodel arm (phi th ps bend)
  (rotate (phi th ps)
    (bone (cylinder 3cm 30cm))
    (elbow (trans (30cm 0 0) (rotate (0 0 bend)
      (bone (cylinder 3cm 26cm))
      (wrist (trans (26cm 0 0) (sphere 4cm))))))))

(defmodel leg-chain (phi th ps bend)
  (rotate (phi th ps)
    (bone (cylinder 5cm 42cm))
    (knee (trans (42cm 0 0) (rotate (0 bend 0)
      (bone (cylinder 4cm 40cm))
      (ankle (trans (40cm 0 0) (sphere 4cm))))))))

(defmodel human (q)
  (pelvis (sphere 5cm))
  (torso (rotate (0 0 (q "waist"))
    (spine (cylinder 8cm 50cm))
    (neck (trans (0 0 50cm) (rotate (0 -90deg 0) (rotate (0 (q "neck_th") (q "neck_ps"))
      (throat (cylinder 4cm 25cm))
      (head (trans (25cm 0 0) (sphere 10cm)))))))
    (larm (trans (0 20cm 46cm)    (rotate (0 0 90deg)  (arm (q "lsh_phi") (q "lsh_th") (q "lsh_ps") (q "lelbow")))))
    (rarm (trans (0 -20cm 46cm)   (rotate (0 0 -90deg) (arm (q "rsh_phi") (q "rsh_th") (q "rsh_ps") (q "relbow")))))))
  (lleg (trans (0 10cm 0)  (rotate (0 90deg 0) (leg-chain (q "lhip_phi") (q "lhip_th") (q "lhip_ps") (q "lknee")))))
  (rleg (trans (0 -10cm 0) (rotate (0 90deg 0) (leg-chain (q "rhip_phi") (q "rhip_th") (q "rhip_ps") (q "rknee"))))))
"""
ANGLES = (
    "waist",
    "neck_th",
    "neck_ps",
    *(f"{side}sh_{angle}" for side in "lr" for angle in ("phi", "th", "ps")),
    *(f"{side}hip_{angle}" for side in "lr" for angle in ("phi", "th", "ps")),
    *(f"{side}{joint}" for side in "lr" for joint in ("elbow", "knee")),
)


def _about(axis: int, angle: float) -> np.ndarray:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i] = np.sin(angle)
    matrix[i, j] = -np.sin(angle)
    return matrix


def _euler(phi: float, theta: float, psi: float) -> np.ndarray:
    return _about(2, psi) @ _about(1, theta) @ _about(0, phi)


def _joints(q: dict[str, float]) -> dict[str, np.ndarray]:
    """The chain of the reference solution, in the pelvis frame."""
    ex = np.array([1.0, 0, 0])
    waist = _about(2, q["waist"])
    found = {"pelvis": np.zeros(3), "torso": np.zeros(3), "torso/neck": waist @ [0, 0, 0.50]}
    nod = waist @ _about(1, -np.pi / 2) @ _euler(0, q["neck_th"], q["neck_ps"])
    found["torso/neck/head"] = found["torso/neck"] + 0.25 * nod @ ex
    for side, sign in (("l", 1), ("r", -1)):
        shoulder = waist @ [0, sign * 0.20, 0.46]
        turn = waist @ _about(2, sign * np.pi / 2) @ _euler(*(q[f"{side}sh_{a}"] for a in ("phi", "th", "ps")))
        elbow = shoulder + 0.30 * turn @ ex
        arm = f"torso/{side}arm"
        found[arm], found[f"{arm}/elbow"] = shoulder, elbow
        found[f"{arm}/elbow/wrist"] = elbow + 0.26 * turn @ _about(2, q[f"{side}elbow"]) @ ex
        hip = np.array([0, sign * 0.10, 0])
        turn = _about(1, np.pi / 2) @ _euler(*(q[f"{side}hip_{a}"] for a in ("phi", "th", "ps")))
        knee = hip + 0.42 * turn @ ex
        found[f"{side}leg"], found[f"{side}leg/knee"] = hip, knee
        found[f"{side}leg/knee/ankle"] = knee + 0.40 * turn @ _about(1, q[f"{side}knee"]) @ ex
    return found


@pytest.mark.parametrize("seed", range(3))
def test_every_joint(opened, family, seed):
    angles = dict(zip(ANGLES, np.random.default_rng(seed).uniform(-np.pi, np.pi, len(ANGLES)), strict=True))
    figure = opened(FIGURE, q=family("q", ANGLES))
    at = {("q", name): value for name, value in angles.items()}
    for path, expected in _joints(angles).items():
        found = figure.numbers(f'(feature (human q) "{path}/origin")', at)
        np.testing.assert_allclose(found, expected, atol=1e-14, err_msg=path)  # sums of products of doubles near 1


def test_parts_through_model_calls_by_name(opened, family):
    figure = opened(FIGURE, q=family("q", ANGLES))
    at = {("q", name): 0.3 for name in ANGLES}
    by_name = figure.numbers("(origin (human q) torso larm elbow wrist)", at)
    np.testing.assert_array_equal(
        by_name, figure.numbers("(feature (human q) '(torso (larm (elbow (wrist (origin))))))", at)
    )


def test_the_form_of_a_joint_names_the_members_of_the_family(opened, family):
    figure = opened(FIGURE, q=family("q", ANGLES))
    at = {("q", name): 0.3 for name in ANGLES}
    quoted = figure.numbers("(get-vertex-from-model '(human q) '(torso (rarm (elbow (origin)))))", at)
    np.testing.assert_allclose(quoted, figure.numbers("(origin (human q) torso rarm elbow)", at), atol=1e-15)
