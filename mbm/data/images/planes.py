"""A board's plane and the image of it: homographies, and what they do to steps on the board."""

from __future__ import annotations

import numpy as np

from mbm.data.images import opencv
from mbm.data.images.fitting import Floats
from mbm.values import dataclass

FEWEST = 4
"""Points that determine a homography."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """The homography (3, 3) from places on a board to the image."""

    matrix: Floats

    def points(self, places: Floats) -> Floats:
        """Places (n, 2) in the image."""
        seen = places @ self.matrix[:, :2].T + self.matrix[:, 2]
        return np.asarray(seen[:, :2] / seen[:, 2:])

    def steps(self, places: Floats) -> tuple[Floats, Floats]:
        """The derivatives (n, 2) of the points by x and by y of places (n, 2): pixels for a unit of length."""
        seen = places @ self.matrix[:, :2].T + self.matrix[:, 2]
        points = seen[:, :2] / seen[:, 2:]
        along, down = ((self.matrix[:2, i] - points * self.matrix[2, i]) / seen[:, 2:] for i in (0, 1))
        return np.asarray(along), np.asarray(down)

    def misfit(self, places: Floats, points: Floats) -> float:
        """Root mean square of how far points (n, 2) are from places (n, 2) in the image, in px."""
        return float(np.sqrt(np.mean(np.sum((self.points(places) - points) ** 2, axis=1))))


def plane_of(places: Floats, points: Floats) -> Plane | None:
    """The homography from places (n, 2) to points (n, 2); None if they do not determine it."""
    if len(places) < FEWEST or np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-9 * np.ptp(places)) < 2:
        return None
    matrix = opencv.homography(places, points)
    return None if matrix is None else Plane(matrix=matrix)


def clear(along: Floats, down: Floats) -> Floats:
    """The distance (n,) from a point to the nearer edge at the end of steps (n, 2) that cross: a parallelogram's."""
    across = np.abs(along[:, 0] * down[:, 1] - along[:, 1] * down[:, 0])
    return np.asarray(across / np.maximum(np.linalg.norm(along, axis=1), np.linalg.norm(down, axis=1)))
