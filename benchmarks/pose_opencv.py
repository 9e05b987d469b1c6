"""OpenCV's pose from points, for `benchmarks.pose`: scenes in, errors in degrees out. Needs nothing but OpenCV."""

from __future__ import annotations

import json
import sys

import cv2
import numpy as np


def main(path: str, focal: float, centre: tuple[float, float]) -> None:
    camera = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]])
    scenes = np.load(path)
    errors = []
    for points, image, truth in zip(scenes["points"], scenes["image"], scenes["R"], strict=True):
        found, turn, shift, inliers = cv2.solvePnPRansac(
            points, image, camera, None, iterationsCount=1000, reprojectionError=3.0, flags=cv2.SOLVEPNP_P3P
        )
        if not found or inliers is None or len(inliers) < 4:
            errors.append(180.0)
            continue
        chosen = inliers.ravel()
        turn, shift = cv2.solvePnPRefineLM(points[chosen], image[chosen], camera, None, turn, shift)
        R = cv2.Rodrigues(turn)[0]
        errors.append(float(np.degrees(np.arccos(np.clip((np.trace(R.T @ truth) - 1) / 2, -1, 1)))))
    print(json.dumps(errors))


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), (float(sys.argv[3]), float(sys.argv[4])))
