"""A figure's fifteen joints measured in space: seeded positions, and the posture within its limits by SciPy."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from problems.reference.cameras import Poses, exponential
from problems.reference.least_squares import Array, derivative, fit, table, write_expected, write_table

SIGMA = 0.008
POSE = np.array([[0.1, -0.2, 0.6, 1.2, -0.4, 0.95]])
"""Rotation vector and translation (m) of the pelvis."""
LIMITS = {
    "waist": (-45, 45, 45), "neck_th": (-60, 60, -30), "neck_ps": (-60, 60, 15),
    "lsh_phi": (-90, 90, 20), "lsh_th": (-90, 90, 30), "lsh_ps": (-90, 90, 10), "lelbow": (0, 150, 80),
    "rsh_phi": (-90, 90, 60), "rsh_th": (-90, 90, 25), "rsh_ps": (-90, 90, 5), "relbow": (0, 150, 70),
    "lhip_phi": (-60, 60, -40), "lhip_th": (-85, 45, -85), "lhip_ps": (-45, 45, 15), "lknee": (0, 150, 95),
    "rhip_phi": (-60, 60, 5), "rhip_th": (-85, 45, -40), "rhip_ps": (-45, 45, -30), "rknee": (0, 150, 60),
}  # fmt: skip
"""Limits and truth of each joint angle in degrees: the waist and a hip stand at their limits."""
PATHS = {
    "pelvis": "pelvis/origin", "neck": "torso/neck/origin", "head": "torso/neck/head/origin",
    "lsh": "torso/larm/bone/origin", "lel": "torso/larm/elbow/origin", "lwr": "torso/larm/elbow/wrist/origin",
    "rsh": "torso/rarm/bone/origin", "rel": "torso/rarm/elbow/origin", "rwr": "torso/rarm/elbow/wrist/origin",
    "lhip": "lleg/bone/origin", "lkn": "lleg/knee/origin", "lan": "lleg/knee/ankle/origin",
    "rhip": "rleg/bone/origin", "rkn": "rleg/knee/origin", "ran": "rleg/knee/ankle/origin",
}  # fmt: skip
X = np.array([1.0, 0.0, 0.0])


def about(axis: int, angle: Array) -> Array:
    """The rotation (3, 3) about a coordinate axis."""
    return exponential(angle * np.eye(3)[axis])


def turned(phi: Array, theta: Array, psi: Array) -> Array:
    """Rz(psi) Ry(theta) Rx(phi)."""
    return about(2, psi) @ about(1, theta) @ about(0, phi)


def joints(angles: dict[str, Array], turn: Array, shift: Array) -> Array:
    """The joints (15, 3) in the order of `PATHS`, angles in rad."""
    half = np.pi / 2
    torso = turn @ about(2, angles["waist"])
    neck = shift + torso @ np.array([0, 0, 0.5])
    found = [shift, neck, neck + 0.25 * torso @ about(1, -half) @ turned(0, angles["neck_th"], angles["neck_ps"]) @ X]
    for side, sign in (("l", 1), ("r", -1)):
        shoulder = shift + torso @ np.array([0, 0.2 * sign, 0.46])
        upper = torso @ about(2, half * sign) @ turned(*(angles[f"{side}sh_{a}"] for a in ("phi", "th", "ps")))
        elbow = shoulder + 0.3 * upper @ X
        found += [shoulder, elbow, elbow + 0.26 * upper @ about(2, angles[f"{side}elbow"]) @ X]
    for side, sign in (("l", 1), ("r", -1)):
        hip = shift + turn @ np.array([0, 0.1 * sign, 0])
        thigh = turn @ about(1, half) @ turned(*(angles[f"{side}hip_{a}"] for a in ("phi", "th", "ps")))
        knee = hip + 0.42 * thigh @ X
        found += [hip, knee, knee + 0.4 * thigh @ about(1, angles[f"{side}knee"]) @ X]
    return np.array(found)


def measure() -> None:
    """Write limits and positions."""
    random = np.random.default_rng(1992)
    write_table("posture", "angles.csv", ("dof", "lo", "hi"), [(n, lo, hi) for n, (lo, hi, _) in LIMITS.items()])
    turn, shift = Poses(POSE).moved(np.zeros(6))[0]
    seen = joints({n: np.deg2rad(v) for n, (_, _, v) in LIMITS.items()}, turn, shift)
    seen = seen + random.normal(0, SIGMA, seen.shape)
    rows = [(n, p, *(f"{v:.4f}" for v in s)) for (n, p), s in zip(PATHS.items(), seen, strict=True)]
    write_table("posture", "joints.csv", ("joint", "path", "x", "y", "z"), rows)


def main() -> None:
    """Write data and expected answer."""
    measure()
    seen = np.array([[float(r[c]) for c in "xyz"] for r in table("posture", "joints.csv")])
    low, high, truth = np.deg2rad(np.array(list(LIMITS.values()), dtype=float)).T
    pose = Poses(POSE)

    def residuals(x: Array) -> Array:
        angles = dict(zip(LIMITS, x[6:], strict=True))
        return ((joints(angles, *pose.moved(x[:6])[0]) - seen) / SIGMA).ravel()

    rough = least_squares(
        residuals,
        [*np.zeros(6), *np.clip(truth, low + 0.01, high - 0.01)],
        jac=lambda x: derivative(residuals, x),
        bounds=([*np.full(6, -np.inf), *low], [*np.full(6, np.inf), *high]),
        xtol=1e-12,
    )
    limit = np.where(np.abs(rough.x[6:] - low) < 1e-6, low, np.where(np.abs(rough.x[6:] - high) < 1e-6, high, np.nan))
    free = np.concatenate([np.ones(6, dtype=bool), np.isnan(limit)])

    def whole(x: Array) -> Array:
        full = np.zeros(25, dtype=x.dtype)
        full[free] = x
        full[~free] = limit[~free[6:]]
        return full

    found = fit(lambda x: residuals(whole(x)), rough.x[free].tolist())
    pose.settle(whole(found.x)[:6])
    estimates = {"T": {"value": pose.values()[0]}, "q": {"value": np.rad2deg(whole(found.x)[6:]).tolist()}}
    solve = {"dof": found.dof, "cost": found.cost, "estimates": estimates}
    write_expected("posture", {"posture": {"solves": [solve]}})


if __name__ == "__main__":
    main()
