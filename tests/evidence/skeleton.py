"""The stick figure of the reference: as a problem file, as a NumPy chain, and its data as tables."""

from __future__ import annotations

import csv

import numpy as np

from tests.evidence.material import shared, shared_json

TEXT = """
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

(problem skeleton-near
  (constants (k0 800) (k1 800))
  (data joints (csv "joints.csv"))
  (data dofs (csv "dofs.csv") :key dof :columns ((near near :unit deg)))
  (unknowns
    (phi angle :init 5deg) (theta angle :init -7deg) (psi angle :init -150deg)
    (xg :init 3.9m) (yg :init 0.1m) (zg :init -0.15m)
    (q angle :per dofs :init near))
  (observe image joints
    (= [X Y] (perse (trans [xg yg zg] (rotate [phi theta psi] (feature (human q) path)))))
    :sigma 0.5)
  (derive (joint-at (trans [xg yg zg] (rotate [phi theta psi] (feature (human q) path))) :over joints)))
"""
POSE = ("phi", "theta", "psi", "xg", "yg", "zg")
PATHS = {
    "pelvis": "pelvis/origin",
    "neck": "torso/neck/origin",
    "head": "torso/neck/head/origin",
    "lsh": "torso/larm/origin",
    "lel": "torso/larm/elbow/origin",
    "lwr": "torso/larm/elbow/wrist/origin",
    "rsh": "torso/rarm/origin",
    "rel": "torso/rarm/elbow/origin",
    "rwr": "torso/rarm/elbow/wrist/origin",
    "lhip": "lleg/origin",
    "lkn": "lleg/knee/origin",
    "lan": "lleg/knee/ankle/origin",
    "rhip": "rleg/origin",
    "rkn": "rleg/knee/origin",
    "ran": "rleg/knee/ankle/origin",
}
"""Joints of the reference → features of the model: the origin of a part is where its chain of transforms leads."""


def tables(near: dict[str, float]) -> dict[str, dict[str, list[object]]]:
    """The joints in the image, and the angles with their starts in degrees."""
    with shared("reference", "skeleton", "joints.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    joints = {
        "joint": [r["joint"] for r in rows],
        "path": [PATHS[r["joint"]] for r in rows],
        "X": [float(r["X"]) for r in rows],
        "Y": [float(r["Y"]) for r in rows],
    }
    angles = [n for n in shared_json("reference", "skeleton", "inputs.json")["unknowns"] if n not in POSE]
    return {"joints": joints, "dofs": {"dof": angles, "near": [float(np.rad2deg(near[a])) for a in angles]}}


def _about(axis: int, angle: float) -> np.ndarray:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i], matrix[i, j] = np.sin(angle), -np.sin(angle)
    return matrix


def _euler(phi: float, theta: float, psi: float) -> np.ndarray:
    return _about(2, psi) @ _about(1, theta) @ _about(0, phi)


def joints_at(x: dict[str, float]) -> dict[str, np.ndarray]:
    """The chain of the reference's README, multiplied out: positions of all joints in the viewpoint frame."""
    ex = np.array([1.0, 0.0, 0.0])
    turn = _euler(x["phi"], x["theta"], x["psi"])
    origin = np.array([x["xg"], x["yg"], x["zg"]])
    upper = turn @ _about(2, x["waist"])
    found = {"pelvis": origin, "neck": origin + upper @ [0, 0, 0.5]}
    head = upper @ _about(1, -np.pi / 2) @ _euler(0.0, x["neck_th"], x["neck_ps"])
    found["head"] = found["neck"] + 0.25 * head @ ex
    for side, sign in (("l", 1), ("r", -1)):
        shoulder = origin + upper @ [0, sign * 0.2, 0.46]
        arm = upper @ _about(2, sign * np.pi / 2) @ _euler(*(x[f"{side}sh_{a}"] for a in ("phi", "th", "ps")))
        elbow = shoulder + 0.3 * arm @ ex
        hip = origin + turn @ [0, sign * 0.1, 0]
        leg = turn @ _about(1, np.pi / 2) @ _euler(*(x[f"{side}hip_{a}"] for a in ("phi", "th", "ps")))
        knee = hip + 0.42 * leg @ ex
        found |= {f"{side}sh": shoulder, f"{side}el": elbow, f"{side}hip": hip, f"{side}kn": knee}
        found[f"{side}wr"] = elbow + 0.26 * arm @ _about(2, x[f"{side}elbow"]) @ ex
        found[f"{side}an"] = knee + 0.4 * leg @ _about(1, x[f"{side}knee"]) @ ex
    return found
