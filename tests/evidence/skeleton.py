"""The stick figure of 25 degrees of freedom: its problem file, a NumPy chain, and what is known of its solutions.

The known values were computed apart from mbm, in NumPy and SciPy: the torso by least squares from 80 starts, every limb
by the two roots of a ray and a sphere. They are good to 1e-8.
"""

from __future__ import annotations

import shutil
from itertools import product
from pathlib import Path

import numpy as np

from tests.evidence.material import EXAMPLES, PROBLEMS, read_table

POSE = ("phi", "theta", "psi", "xg", "yg", "zg")
TRUTH = {
    "phi": np.deg2rad(8.0),
    "theta": np.deg2rad(-10.0),
    "psi": np.deg2rad(-155.0),
    "xg": 4.0,
    "yg": 0.15,
    "zg": -0.2,
    "waist": np.deg2rad(30.0),
    "neck_th": -0.7657305978687663,
    "neck_ps": 0.2073307314954107,
    "lsh_phi": 0.10851858697054095,
    "lsh_th": 0.5348206074525921,
    "lsh_ps": 0.1391655028827239,
    "lelbow": 1.2959841692455052,
    "rsh_phi": 1.2696250930143989,
    "rsh_th": 0.41281407403513093,
    "rsh_ps": 0.1753358227180717,
    "relbow": 1.3512480226939125,
    "lhip_phi": -0.8376825751507538,
    "lhip_th": -1.300718995192849,
    "lhip_ps": 0.23718363734596726,
    "lknee": 0.7020933904256819,
    "rhip_phi": -0.18591345038440676,
    "rhip_th": -0.7663759851546068,
    "rhip_ps": -0.7419920013957773,
    "rknee": 2.3709184901642146,
}
"""Angles in rad and places in m from which the image was made, with noise of half a pixel."""
COSTS = (4.123572676846824, 12.327752423884812, 25.625261210348523)
"""Of the three minima of the torso; each carries up to 512 postures of limbs that fit exactly."""
TORSO = {
    "phi": (0.12613899331603573, 0.0089014503498),
    "theta": (-0.18347854195922864, 0.0118071547937),
    "psi": (-2.6413832029219924, 0.0395141691412),
    "xg": (3.983788366788512, 0.0180024966759),
    "yg": (0.14975604410313337, 0.0017152359146),
    "zg": (-0.1997947882840564, 0.0011259485953),
    "waist": (0.4877876211116563, 0.0402144982690),
}
"""The best minimum: estimates and standard deviations."""
LIMBS = {
    "neck_th": -0.7403697391778638,
    "neck_ps": 0.23319128936187136,
    "lsh_th": 0.5359738076444805,
    "lsh_ps": 0.08509588760689532,
    "rsh_phi": 1.2798624364763995,
    "rsh_th": 0.41093260499633194,
    "rsh_ps": 0.14643576737967157,
    "relbow": 1.3051982679933718,
    "lhip_th": -1.3174351822038235,
    "lhip_ps": -0.017188039989941666,
    "rhip_phi": -0.13676262440854758,
    "rhip_th": -0.7069926997231193,
    "rhip_ps": -0.7845489507878723,
    "rknee": 2.3844036085833147,
}
LEFT_ARM = ((-1.1413855130385742, 2.3276580482096474), (0.07833288858234609, 1.3158253360698002))
LEFT_LEG = ((-0.5262860095370413, 0.7012697169655647), (0.3845830583526626, 1.8687868336215687))
"""Twist of the limb and bend of its joint: two ways each to bend the left arm and the left leg within their limits."""


def postures() -> list[dict[str, float]]:
    """The four solutions of the best cost that keep within the limits of the joints."""
    torso = {name: value for name, (value, _) in TORSO.items()}
    return [
        {**torso, **LIMBS, "lsh_phi": arm[0], "lelbow": arm[1], "lhip_phi": leg[0], "lknee": leg[1]}
        for arm, leg in product(LEFT_ARM, LEFT_LEG)
    ]


def write_example(folder: Path, starts: int = 500) -> Path:
    """The example of the language with its data, with so many random starts in place of its 500."""
    text = (EXAMPLES / "skeleton.mbm").read_text("utf-8")
    if "(random 500 :seed 7)" not in text:
        message = "the example says something else"
        raise ValueError(message)
    for name in ("skeleton_joints.csv", "skeleton_dofs.csv"):
        shutil.copy(PROBLEMS / "skeleton" / name, folder)
    path = folder / "skeleton.mbm"
    path.write_text(text.replace("(random 500", f"(random {starts}"), "utf-8")
    return path


def seen() -> dict[str, tuple[float, float]]:
    """Where the joints are in the image, in px, in the order of the data."""
    table = read_table(PROBLEMS / "skeleton" / "skeleton_joints.csv")
    return {j: (float(x), float(y)) for j, x, y in zip(table["joint"], table["X"], table["Y"], strict=True)}


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
