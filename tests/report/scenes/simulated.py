"""A scene of two cameras and five images, simulated with OpenCV, and problems that say it in several ways."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

import mbm

SIZES = {"left": (640, 480), "right": (800, 600)}
CAMERAS = {
    "left": (np.array([[500.0, 0, 320], [0, 510.0, 240], [0, 0, 1]]), np.array([-0.2, 0.05, 1e-3, -2e-3, 0.01])),
    "right": (np.array([[700.0, 0, 400], [0, 690.0, 300], [0, 0, 1]]), np.array([0.1, -0.03, 0.0, 1e-3, 0.0])),
}
RIG = (np.array([0.02, -0.15, 0.01]), np.array([-0.12, 0.01, 0.02]))
"""Rotation vector and translation from the frame of the body to that of the right camera."""


@dataclass(frozen=True)
class World:
    """Points (n, 3), the pose (rvec, tvec) of each photo from the world to the body, and what was seen (by name)."""

    points: np.ndarray
    poses: dict[str, tuple[np.ndarray, np.ndarray]]
    seen: dict[str, list]


def world(rig: bool = False) -> World:
    generator = np.random.default_rng(3)
    points = generator.uniform([-1, -0.8, 3], [1, 0.8, 5], size=(12, 3))
    poses = {
        f"photo{i}": (generator.normal(scale=0.15, size=3), generator.normal(scale=0.2, size=3)) for i in range(1, 6)
    }
    seen: dict[str, list] = {name: [] for name in ("photo", "camera", "point", "u", "v")}
    for number, (photo, pose) in enumerate(poses.items()):
        for camera in CAMERAS if rig else [("left", "right")[number % 2]]:
            for i, uv in enumerate(images(camera, camera_pose(camera, pose, rig), points)):
                for name, value in zip(seen, (photo, camera, i + 1.0, *uv), strict=True):
                    seen[name].append(value)
    return World(points, poses, seen)


def camera_pose(camera: str, pose: tuple[np.ndarray, np.ndarray], rig: bool) -> tuple[np.ndarray, np.ndarray]:
    """From the world to the camera."""
    if not rig or camera == "left":
        return pose
    rvec, tvec = cv2.composeRT(*pose, *RIG)[:2]
    return rvec.ravel(), tvec.ravel()


def images(camera: str, pose: tuple[np.ndarray, np.ndarray], points: np.ndarray) -> np.ndarray:
    """By OpenCV's own formula: pixel centres at whole numbers."""
    return cv2.projectPoints(points, *pose, *CAMERAS[camera])[0].reshape(-1, 2)


def quaternion(rvec: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(rvec)
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * rvec / angle)])


def rotation(rvec: np.ndarray) -> np.ndarray:
    return cv2.Rodrigues(rvec)[0]


TEXT = """
(problem scene
  (data cams external :key camera)
  (data photos external :key photo)
  (data marks external :key point)
  (data seen external)
  (camera cam :per cams :focal (fx fy) :center (cx cy) :distortion (k1 k2 p1 p2 k3))
  (unknowns
    (T (pose 3) :per photos :init {init})
    (X (vector 3) :per marks :init [x y z] :fixed {known} :unit m))
  (observe seen (= [u v] (project (cam camera) {point})) :sigma 1px))
"""
SAID = {
    "inward": ("(pose3 (quaternion qw qx qy qz) [tx ty tz])", "(transform (T photo) (X point))"),
    "outward": (
        "(inverse (pose3 (quaternion qw qx qy qz) [tx ty tz]))",
        "(transform (inverse (T photo)) (X point))",
    ),
    "rig": (
        "(pose3 (quaternion qw qx qy qz) [tx ty tz])",
        "(transform (compose (pose3 (quaternion bw bx by bz) [btx bty btz]) (T photo)) (X point))",
    ),
}


def solved(said: str, made: World) -> object:
    """The scene solved, beginning a little off; three points hold it where it is."""
    init, point = SAID[said]
    tables = tables_of(made)
    if said == "rig":
        body = {"left": (np.array([1.0, 0, 0, 0]), np.zeros(3)), "right": (quaternion(RIG[0]), RIG[1])}
        for k, name in enumerate(("bw", "bx", "by", "bz", "btx", "bty", "btz")):
            tables["seen"] = {**tables["seen"], name: [np.concatenate(body[c])[k] for c in made.seen["camera"]]}
    return mbm.loads(TEXT.format(init=init, point=point, known="(< point 6)")).solve(data=tables)


def tables_of(made: World) -> dict[str, dict]:
    """The tables of the problem: starts are a little off."""
    return {"seen": made.seen, "cams": _cameras(), "photos": _photos(made), "marks": _marks(made)}


def _cameras() -> dict[str, list]:
    columns: dict[str, list] = {"camera": list(CAMERAS)}
    rows = [[k[0, 0], k[1, 1], k[0, 2], k[1, 2], *d, *SIZES[name]] for name, (k, d) in CAMERAS.items()]
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "width", "height")
    return columns | {name: [row[i] for row in rows] for i, name in enumerate(names)}


def _photos(made: World) -> dict[str, list]:
    rows = [np.concatenate([quaternion(r + 0.01), t + 0.02]) for r, t in made.poses.values()]
    names = ("qw", "qx", "qy", "qz", "tx", "ty", "tz")
    return {"photo": list(made.poses)} | {name: [row[i] for row in rows] for i, name in enumerate(names)}


def _marks(made: World) -> dict[str, list]:
    moved = made.points + 0.03 * (np.arange(12) >= 5)[:, None]
    return {"point": np.arange(1.0, 13.0)} | {name: moved[:, i] for i, name in enumerate("xyz")}
