"""Pose from points by OpenCV and PoseLib: a consensus of minimal solutions, refined on the rows that agree."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np

from benchmarks.peers import main

LIMIT = 3.0
"""Pixels within which a row agrees, three standard deviations."""
TRIALS = 1000
Pose = Callable[[np.ndarray, np.ndarray], np.ndarray | None]


def opencv(focal: float, centre: np.ndarray) -> Pose:
    import cv2

    camera = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])

    def pose(points: np.ndarray, image: np.ndarray) -> np.ndarray | None:
        found, turn, shift, inliers = cv2.solvePnPRansac(
            points, image, camera, None, iterationsCount=TRIALS, reprojectionError=LIMIT, flags=cv2.SOLVEPNP_P3P
        )
        if not found or inliers is None or len(inliers) < 4:
            return None
        chosen = inliers.ravel()
        turn, shift = cv2.solvePnPRefineLM(points[chosen], image[chosen], camera, None, turn, shift)
        return np.asarray(cv2.Rodrigues(turn)[0])

    return pose


def poselib(focal: float, centre: np.ndarray) -> Pose:
    import poselib as library

    camera = {"model": "SIMPLE_PINHOLE", "width": 640, "height": 480, "params": [focal, *centre]}
    options = {"max_reproj_error": LIMIT, "max_iterations": TRIALS}

    def pose(points: np.ndarray, image: np.ndarray) -> np.ndarray | None:
        found, _ = library.estimate_absolute_pose(image, points, camera, options, {})
        return np.asarray(found.R)

    return pose


def answer(arrays: dict[str, np.ndarray]) -> dict[str, dict[str, dict[str, list[float] | float]]]:
    """``KIND/points`` (s, n, 3), ``KIND/image``, ``KIND/R``, ``camera`` → errors in degrees and seconds a scene."""
    focal, *centre = arrays["camera"]
    found: dict[str, dict[str, dict[str, list[float] | float]]] = {}
    for name, make in (("OpenCV", opencv), ("PoseLib", poselib)):
        pose = make(focal, np.array(centre))
        found[name] = {}
        for kind in sorted({key.rsplit("/", 1)[0] for key in arrays if "/" in key}):
            scenes = zip(arrays[f"{kind}/points"], arrays[f"{kind}/image"], arrays[f"{kind}/R"], strict=True)
            errors, seconds = [], 0.0
            for points, image, truth in scenes:
                began = process_time()
                R = pose(np.ascontiguousarray(points), np.ascontiguousarray(image))
                seconds += process_time() - began
                cosine = -1.0 if R is None else (np.trace(R.T @ truth) - 1) / 2
                errors.append(float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))))
            found[name][kind] = {"errors": errors, "seconds": seconds / len(errors)}
    return found


if __name__ == "__main__":
    main(answer)
