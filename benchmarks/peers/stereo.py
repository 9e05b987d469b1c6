"""A pair of cameras by OpenCV: each calibrated alone, then both together, as one process."""

from __future__ import annotations

import cv2
import numpy as np

from benchmarks.peers import main

EXACT = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-12)
SINGLE = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3
BOTH = SINGLE | cv2.CALIB_USE_INTRINSIC_GUESS


def answer(arrays: dict[str, np.ndarray]) -> dict[str, object]:
    """Board (n, 3), images of left and right (photos, n, 2), size → sum of squares, baseline, cameras (2, 6)."""
    points = [arrays["board"].astype(np.float32)] * len(arrays["left"])
    sides = [[view.astype(np.float32)[:, None] for view in arrays[side]] for side in ("left", "right")]
    size = tuple(int(v) for v in arrays["size"])
    found = [cv2.calibrateCamera(points, side, size, None, None, flags=SINGLE)[1:3] for side in sides]
    (left, bent), (right, curved) = found
    rms, left, bent, right, curved, _, shift, *_ = cv2.stereoCalibrate(
        points, *sides, left, bent, right, curved, size, flags=BOTH, criteria=EXACT
    )
    cameras = [[k[0, 0], k[1, 1], k[0, 2], k[1, 2], *d.ravel()[:2]] for k, d in ((left, bent), (right, curved))]
    rows = 2 * len(points) * len(points[0])
    return {"squares": rms**2 * rows, "baseline": float(np.linalg.norm(shift)), "cameras": cameras}


if __name__ == "__main__":
    main(answer)
