"""Made-up measurements with seeded noise, and the problems that they belong to, for the benchmarks."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

RANGE = """
(problem range-rows
  (data ranges external)
  (unknowns (p (vector 3) :init [1.75m 1.75m 1m]))
  (observe ranges (= range (distance p [rx ry rz])) :sigma 10mm))
"""
REPROJECTION = """
(problem reprojection-rows
  (data marks external)
  (unknowns (f :init 790) (g :init 790) (c (vector 2) :init [310 250]) (k (vector 2) :init [0 0])
            (a (vector 3) :init [0 0 0]) (t (vector 3) :init [0m 0m 0m]))
  (camera cam :model pinhole :focal (f g) :center ((c 1) (c 2)) :distortion ((k 1) (k 2) 0 0 0) :axes opencv)
  (observe marks
    (= [u v] (project cam (trans t (rotate [(a 1) (a 2) (a 3)] [x y z]))))
    :sigma 0.5))
"""
EPOCHS = """
(problem epochs
  (data receivers external :key receiver)
  (data ranges external :with (receivers receiver))
  (unknowns (p (vector 3) :init [1.75m 1.75m 1m]))
  (observe ranges (= range (distance p [receivers.x receivers.y receivers.z])) :sigma 10mm)
  (for-each epoch))
"""
BOARDS = """
(problem boards
  (data photos (csv "photos.csv") :key photo)
  (data corners (csv "corners.csv"))
  (camera cam :focal (fx fy) :center (cx cy) :distortion (k1 k2 p1 p2 k3))
  (unknowns
    (fx :init 600) (fy :init 600) (cx :init 320) (cy :init 240)
    (k1 :init 0) (k2 :init 0) (p1 :init 0) (p2 :init 0) (k3 :init 0)
    (r (vector 3) :per photos :init [rx ry rz])
    (t (vector 3) :per photos :init [tx ty tz] :unit m))
  (observe corners
    (= [u v] (project cam (trans (t photo) (rotate (axis-angle (r photo)) [x y 0]))))
    :sigma unknown))
"""
Columns = dict[str, np.ndarray]


def ceiling() -> np.ndarray:
    """48 receivers (48, 3) at a height of 2.7 m, metres."""
    numbers = np.arange(48)
    return np.column_stack([1 + 0.3 * (numbers // 8), 0.7 + 0.3 * (numbers % 8), np.full(48, 2.7)])


def range_rows(count: int) -> Columns:
    """Ranges from one place to the receivers, again and again; 10 mm of noise."""
    generator = np.random.default_rng(1)
    at = ceiling()[np.arange(count) % 48]
    measured = np.linalg.norm(at - [1.7, 1.6, 0.8], axis=1) + 0.01 * generator.standard_normal(count)
    return {"rx": at[:, 0], "ry": at[:, 1], "rz": at[:, 2], "range": measured}


def reprojection_rows(count: int) -> Columns:
    """Known points in a distorting camera; half a pixel of noise."""
    generator = np.random.default_rng(3)
    points = generator.uniform([-2, -2, 4], [2, 2, 8], (count, 3))
    phi, theta, psi = 0.05, -0.03, 0.1
    rx = np.array([[1, 0, 0], [0, np.cos(phi), -np.sin(phi)], [0, np.sin(phi), np.cos(phi)]])
    ry = np.array([[np.cos(theta), 0, np.sin(theta)], [0, 1, 0], [-np.sin(theta), 0, np.cos(theta)]])
    rz = np.array([[np.cos(psi), -np.sin(psi), 0], [np.sin(psi), np.cos(psi), 0], [0, 0, 1]])
    x, y, z = (points @ (rz @ ry @ rx).T + [0.1, -0.2, 0.3]).T
    square = (x / z) ** 2 + (y / z) ** 2
    bent = 1 - 0.1 * square + 0.02 * square**2
    u = 800 * x / z * bent + 320 + 0.5 * generator.standard_normal(count)
    v = 805 * y / z * bent + 240 + 0.5 * generator.standard_normal(count)
    return {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2], "u": u, "v": v}


def epoch_tables(epochs: int) -> dict[str, Columns]:
    """``epochs`` places in a room, each with 48 ranges; 10 mm of noise."""
    generator = np.random.default_rng(2)
    at = ceiling()
    places = generator.uniform([0.5, 0.5, 0.3], [3, 3, 1.5], (epochs, 3))
    distances = np.linalg.norm(places[:, None] - at[None], axis=2) + 0.01 * generator.standard_normal((epochs, 48))
    numbers = np.arange(48)
    receivers = {"receiver": numbers, "x": at[:, 0], "y": at[:, 1], "z": at[:, 2]}
    ranges = {
        "epoch": np.repeat(np.arange(epochs), 48),
        "receiver": np.tile(numbers, epochs),
        "range": distances.ravel(),
    }
    return {"receivers": receivers, "ranges": ranges}


def board_photographs(photographs: int = 13) -> dict[str, str]:
    """CSV texts: rough poses of a board (rad, m), and the images of its 54 corners with 0.2 pixels of noise."""
    generator = np.random.default_rng(3)
    corners = 0.03 * np.stack(np.meshgrid(np.arange(9), np.arange(6), [0]), axis=-1).reshape(-1, 3)
    photos, images = ["photo,rx,ry,rz,tx,ty,tz"], ["photo,x,y,u,v"]
    for photo in range(1, photographs + 1):
        turned = generator.normal(0, 0.3, 3)
        moved = np.array([-0.12, -0.08, 0.45]) + generator.normal(0, 0.03, 3)
        rough = np.r_[turned + generator.normal(0, 0.05, 3), moved + generator.normal(0, 0.01, 3)]
        photos.append(",".join([str(photo), *(f"{value:.3f}" for value in rough)]))
        x, y, z = (Rotation.from_rotvec(turned).apply(corners) + moved).T
        x, y = x / z, y / z
        square = x * x + y * y
        bent = 1 - 0.27 * square + 0.05 * square**2 + 0.02 * square**3
        u = 536.0 * (x * bent + 0.002 * x * y - 0.0005 * (square + 2 * x * x)) + 342.0
        v = 536.5 * (y * bent + 0.001 * (square + 2 * y * y) - 0.001 * x * y) + 235.0
        noisy = np.column_stack([u, v]) + generator.normal(0, 0.2, (len(u), 2))
        images += [
            f"{photo},{corner[0]:g},{corner[1]:g},{image[0]:.4f},{image[1]:.4f}"
            for corner, image in zip(corners, noisy, strict=True)
        ]
    return {"photos": "\n".join([*photos, ""]), "corners": "\n".join([*images, ""])}
