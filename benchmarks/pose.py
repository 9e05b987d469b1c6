"""Pose from n image points with gross errors and no initial guess, beside OpenCV on the same scenes.

`python -m benchmarks.pose [scenes] [--alone]`: OpenCV is installed into an environment of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from time import perf_counter

import numpy as np

import mbm
from benchmarks.machine import machine, show

COUNTS = (6, 10, 20, 50)
SHARES = (0.0, 0.2, 0.4)
FOCAL, CENTRE, SIGMA = 800.0, (320.0, 240.0), 1.0
FAILED = 5.0
"""Degrees from which a rotation counts as a failure."""

PEER = Path(__file__).with_name("pose_opencv.py")
PROBLEM = """
(problem pose
  (data marks external)
  (camera cam :focal (800 800) :center (320 240))
  (unknowns (T (pose 3)))
  (observe marks (= [u v] (project cam (transform T [x y z]))) :sigma 1)
  (solve :robust (msac)))
"""


def scene(count: int, share: float, seed: int) -> dict[str, np.ndarray]:
    """Points in a cube of two metres, 4 to 8 m away, any attitude; wrong images are uniform over 640 × 480."""
    random = np.random.default_rng([seed, count, round(100 * share)])
    q = random.normal(size=4)
    w, x, y, z = q / np.linalg.norm(q)
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    t = np.array([*random.uniform(-0.5, 0.5, 2), random.uniform(4, 8)])
    points = random.uniform(-1, 1, size=(count, 3))
    seen = points @ R.T + t
    image = FOCAL * seen[:, :2] / seen[:, 2:] + CENTRE + SIGMA * random.normal(size=(count, 2))
    wrong = round(share * count)
    image[:wrong] = random.uniform((0, 0), (640, 480), size=(wrong, 2))
    return {"points": points, "image": image, "R": R, "t": t}


def degrees(found: np.ndarray, truth: np.ndarray) -> float:
    """The angle between two rotations."""
    return float(np.degrees(np.arccos(np.clip((np.trace(found.T @ truth) - 1) / 2, -1, 1))))


def ours(scenes: dict[str, list[dict[str, np.ndarray]]]) -> dict[str, tuple[list[float], float, list[float]]]:
    """Errors in degrees, milliseconds a scene, and squared errors in units of the stated covariance, by kind."""
    first = next(iter(scenes.values()))[0]
    compiled = mbm.loads(PROBLEM).compile(data={"marks": _table(first)})
    found = {}
    for kind, each in scenes.items():
        errors, scaled, began = [], [], perf_counter()
        for one in each:
            try:
                solved = compiled.solve(data={"marks": _table(one)})
            except mbm.MbmError:
                errors.append(180.0)
                continue
            pose = json.loads(solved.to_json())["solves"][0]["estimates"]["T"]["value"]
            R = np.array(pose["matrix"])
            errors.append(degrees(R, one["R"]))
            if errors[-1] < FAILED:
                turn = R.T @ one["R"]
                step = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
                step = np.append(step, one["t"] - np.array(pose["translation"]))
                scaled.append(float(step @ np.linalg.solve(np.asarray(solved.covariance.matrix), step)))
        found[kind] = (errors, 1e3 * (perf_counter() - began) / len(each), scaled)
    return found


def _table(one: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return dict(zip("xyzuv", (*one["points"].T, *one["image"].T), strict=True))


def peer(scenes: dict[str, list[dict[str, np.ndarray]]], folder: Path) -> dict[str, list[float]]:
    """OpenCV's errors: RANSAC with P3P, refined on its inliers."""
    environment = folder / "environment"
    venv.create(environment, with_pip=True)
    python = str(environment / "bin" / "python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", "opencv-python-headless"], check=True)
    found = {}
    for kind, each in scenes.items():
        table = folder / "scenes.npz"
        np.savez(table, **{name: np.stack([one[name] for one in each]) for name in ("points", "image", "R")})
        command = [python, str(PEER), str(table), str(FOCAL), *map(str, CENTRE)]
        found[kind] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return found


def summary(errors: list[float]) -> tuple[str, str]:
    """The mean of those that did not fail, and the share that did."""
    good = [e for e in errors if e < FAILED]
    return (f"{np.mean(good):.3f}°" if good else "–", f"{100 * (1 - len(good) / len(errors)):.1f} %")


def main() -> None:
    print(machine())
    count = next((int(a) for a in sys.argv[1:] if a.isdigit()), 100)
    scenes = {
        f"{n} points, {100 * share:.0f} %": [scene(n, share, seed) for seed in range(count)]
        for n in COUNTS
        for share in SHARES
    }
    mine = ours(scenes)
    with tempfile.TemporaryDirectory() as folder:
        others = {} if "--alone" in sys.argv else peer(scenes, Path(folder))
    lines = []
    for kind, (errors, milliseconds, scaled) in mine.items():
        other = summary(others[kind]) if others else ("–", "–")
        ratio = f"{np.mean(scaled) / 6:.2f}" if scaled else "–"
        lines.append([kind, *summary(errors), ratio, f"{milliseconds:.1f}", *other])
    show(["scene", "mbm", "failed", "error² / covariance", "ms", "OpenCV", "failed"], lines)


if __name__ == "__main__":
    main()
