"""Six photographs of forty points by one camera, as a COLMAP model: seeded, and the bundle adjustment by SciPy."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from problems.reference.cameras import exponential, pinhole
from problems.reference.least_squares import PROBLEMS, Array, derivative, write_expected

FOLDER = PROBLEMS / "bundle" / "model"
CAMERA = np.array([900.0, 900.0, 512.0, 384.0])
IMAGES, POINTS = 6, 40
NOISE = 0.5
ROUGH_TURN, ROUGH_SHIFT, ROUGH_POINT = 0.01, 0.05, 0.08
"""How far the model that is to be adjusted lies from the truth: rad, m, m."""


def scene() -> tuple[Array, Array]:
    """Rotation vectors and translations of the photographs (n, 6), world to camera, and the points (m, 3)."""
    random = np.random.default_rng(1958)
    points = random.uniform((-1.5, -1.0, -0.8), (1.5, 1.0, 0.8), (POINTS, 3))
    poses = []
    for angle in np.linspace(-0.7, 0.7, IMAGES):
        vector = np.array([0.05 * np.sin(5 * angle), angle, 0.03])
        poses.append([*vector, 0.2 * np.sin(3 * angle), 0.1 * angle, 5.0 + 0.3 * np.cos(4 * angle)])
    return np.array(poses), points


def seen(poses: Array, points: Array) -> Array:
    """Image points in px (n, m, 2), (0, 0) in the middle of the first pixel."""
    return np.array([pinhole(CAMERA, points @ exponential(p[:3]).T + p[3:]) for p in poses])


def quaternion(vector: Array) -> Array:
    """(w, x, y, z) of a rotation vector."""
    angle = np.linalg.norm(vector)
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) / angle * vector])


def model() -> dict[str, str]:
    """The files of the model, by name: COLMAP counts pixels from the corner of the first, half a pixel further."""
    random = np.random.default_rng(1964)
    poses, points = scene()
    image = seen(poses, points) + random.normal(0, NOISE, (IMAGES, POINTS, 2)) + 0.5
    inside = (image > 0).all(axis=2) & (image < (1024, 768)).all(axis=2)
    poses = poses + random.normal(0, 1, poses.shape) * ([ROUGH_TURN] * 3 + [ROUGH_SHIFT] * 3)
    points = points + random.normal(0, ROUGH_POINT, points.shape)
    cameras = f"1 PINHOLE 1024 768 {' '.join(f'{v:g}' for v in (*CAMERA[:2], *(CAMERA[2:] + 0.5)))}\n"
    lines, tracks = [], [[] for _ in points]
    for i, (pose, row) in enumerate(zip(poses, image, strict=True)):
        numbers = " ".join(f"{v:.6f}" for v in (*quaternion(pose[:3]), *pose[3:]))
        lines.append(f"{i + 1} {numbers} 1 view{i + 1}.jpg")
        spots = []
        for j in np.flatnonzero(inside[i]):
            tracks[j].append(f"{i + 1} {len(spots)}")
            spots.append(f"{row[j, 0]:.3f} {row[j, 1]:.3f} {j + 1}")
        lines.append(" ".join(spots))
    marks = [
        f"{j + 1} {' '.join(f'{v:.4f}' for v in point)} 128 128 128 1.0 {' '.join(tracks[j])}"
        for j, point in enumerate(points)
    ]
    return {"cameras.txt": cameras, "images.txt": "\n".join(lines) + "\n", "points3D.txt": "\n".join(marks) + "\n"}


def main() -> None:
    """Write data and expected answer."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in model().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    lines = (FOLDER / "images.txt").read_text(encoding="utf-8").splitlines()
    rows = [
        (i, int(mark) - 1, float(u) - 0.5, float(v) - 0.5)
        for i, line in enumerate(lines[1::2])
        for u, v, mark in np.array(line.split()).reshape(-1, 3)
    ]
    which = np.array([r[:2] for r in rows])
    measured = np.array([r[2:] for r in rows])

    def residuals(x: Array) -> Array:
        poses, points = x[: 6 * IMAGES].reshape(-1, 6), x[6 * IMAGES :].reshape(-1, 3)
        return ((seen(poses, points)[which[:, 0], which[:, 1]] - measured) / NOISE).ravel()

    poses, points = scene()
    start = np.concatenate([poses.ravel(), points.ravel()])
    found = least_squares(residuals, start, jac=lambda x: derivative(residuals, x), method="lm", xtol=1e-12, ftol=1e-12)
    x = found.x
    for _ in range(3):
        x = x - np.linalg.lstsq(derivative(residuals, x), residuals(x), rcond=1e-10)[0]
    jacobian, left = derivative(residuals, x), residuals(x)

    def ratio(x: Array) -> Array:
        place = x[6 * IMAGES :].reshape(-1, 3)
        away = [np.sqrt(np.sum((place[a] - place[b]) ** 2)) for a, b in ((0, 1), (2, 3))]
        return np.array([away[0] / away[1]])

    gradient = derivative(ratio, x)[0]
    sigma = float(np.sqrt(gradient @ np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-10) @ gradient))
    solve = {
        "dof": len(left) - len(x) + 7,
        "cost": float(left @ left),
        "estimates": {},
        "derived": {"ratio": {"value": float(ratio(x)[0]), "sigma": sigma}},
    }
    write_expected("bundle", {"bundle": {"solves": [solve]}})


if __name__ == "__main__":
    main()
