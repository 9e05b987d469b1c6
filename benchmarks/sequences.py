"""A drive of 100,000 frames by filters and smoothers: mbm beside filterpy, a loop in NumPy, and gtsam, in one run.

Each frame has the way since the last one (forward, sideways, turn) and a position to half a metre. Peers that are not
installed (``pip install filterpy gtsam``) are left out. Seconds are the least of the runs; gtsam is called from Python.

    python -m benchmarks.sequences [--frames 100000] [--runs 2]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

import mbm
from benchmarks.machine import machine

TEXT = """
(problem drive
  (data o external) (data p external)
  (states :over k (T (pose 2) :init (pose2 0 0 0) :sigma [0.1 0.5 0.5]))
  (dynamics (= (next T) (compose T (pose2 dx dy da)) :sigma [0.01 0.05 0.02]))
  (observe p (= [px py] (translation T)) :sigma 0.5)
  (solve :method {method}))
"""
FIRST, MOVED, SEEN = np.array([0.1, 0.5, 0.5]), np.array([0.01, 0.05, 0.02]), 0.5
"""Standard deviations: of the first pose and of a motion (turn, x, y), and of a coordinate."""
LAG = 10


def drive(frames: int) -> tuple[Any, Any, Any]:
    """True poses (n, 3) as turn, x, y; motions (n, 3) as measured, the first of no use; positions (n, 2)."""
    random = np.random.default_rng(7)
    turns = 0.05 * np.sin(np.arange(frames) / 40) + 0.02 * random.normal(size=frames)
    heading = np.concatenate([[0.0], np.cumsum(turns[1:])])
    places = np.zeros((frames, 2))
    places[1:] = np.cumsum(np.column_stack([np.cos(heading[:-1]), np.sin(heading[:-1])]), axis=0)
    true = np.column_stack([heading, places])
    motions = np.column_stack([turns, np.ones(frames), np.zeros(frames)]) + MOVED * random.normal(size=(frames, 3))
    return true, motions, places + SEEN * random.normal(size=(frames, 2))


def by_mbm(method: str, motions: Any, seen: Any) -> Callable[[], Any]:
    """A whole solve."""
    k = np.arange(len(seen))
    data = {
        "o": {"k": k, "da": motions[:, 0], "dx": motions[:, 1], "dy": motions[:, 2]},
        "p": {"k": k, "px": seen[:, 0], "py": seen[:, 1]},
    }
    compiled = mbm.loads(TEXT.format(method=method)).compile(data=data)
    return lambda: compiled.solve()["T"].value[:, -2:]


def by_stream(motions: Any, seen: Any, *, method: str) -> Callable[[], Any]:
    """A filter or smoother that is fed step by step, from Python."""
    few = {"o": {"k": [0, 1], "da": [0.0, 0.0], "dx": [0.0, 1.0], "dy": [0.0, 0.0]}}
    compiled = mbm.loads(TEXT.format(method=method)).compile(
        data=few | {"p": {"k": [0, 1], "px": [0.0, 1.0], "py": [0.0, 0.0]}}
    )

    def run() -> Any:
        stream = compiled.stream()
        found = []
        for k, (way, at) in enumerate(zip(motions.tolist(), seen.tolist(), strict=True)):
            rows = {"o": {"k": k, "da": way[0], "dx": way[1], "dy": way[2]}, "p": {"k": k, "px": at[0], "py": at[1]}}
            found.append(stream.step(rows))
        found += stream.finish()[: len(found) if None in found else 0]
        return np.array([each["T"].value[-2:] for each in found if each is not None])

    return run


def moved(state: Any, way: Any) -> tuple[Any, Any, Any]:
    """The state ahead, and its slopes by the state and by the noise of the motion."""
    c, s = np.cos(state[0]), np.sin(state[0])
    ahead = state + np.array([way[0], c * way[1] - s * way[2], s * way[1] + c * way[2]])
    F = np.array([[1.0, 0, 0], [-s * way[1] - c * way[2], 1, 0], [c * way[1] - s * way[2], 0, 1]])
    c, s = np.cos(ahead[0]), np.sin(ahead[0])
    return ahead, F, np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])


def by_numpy(motions: Any, seen: Any) -> Callable[[], Any]:
    """An extended Kalman filter as a loop."""
    H, R = np.eye(3)[1:], SEEN**2 * np.eye(2)

    def run() -> Any:
        state, P, found = np.zeros(3), np.diag(FIRST**2), []
        for k in range(len(seen)):
            if k:
                state, F, G = moved(state, motions[k])
                P = F @ P @ F.T + (G * MOVED**2) @ G.T
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            state = state + K @ (seen[k] - state[1:])
            P = P - K @ H @ P
            found.append(state[1:])
        return np.array(found)

    return run


def by_filterpy(motions: Any, seen: Any) -> Callable[[], Any]:
    """The same by filterpy."""
    from filterpy.kalman import ExtendedKalmanFilter

    H, R = np.eye(3)[1:], SEEN**2 * np.eye(2)

    def run() -> Any:
        filter_ = ExtendedKalmanFilter(dim_x=3, dim_z=2)
        filter_.x, filter_.P, found = np.zeros(3), np.diag(FIRST**2), []
        for k in range(len(seen)):
            if k:
                filter_.x, F, G = moved(filter_.x, motions[k])
                filter_.P = F @ filter_.P @ F.T + (G * MOVED**2) @ G.T
            filter_.update(seen[k], lambda _: H, lambda x: x[1:], R=R)
            found.append(filter_.x[1:].copy())
        return np.array(found)

    return run


def by_gtsam(motions: Any, seen: Any, *, lag: int | None) -> Callable[[], Any]:
    """Incremental smoothing (iSAM2) of all poses, or of the last ``lag``; each frame gives the newest."""
    import gtsam

    first = gtsam.noiseModel.Diagonal.Sigmas(FIRST[[1, 2, 0]])
    way = gtsam.noiseModel.Diagonal.Sigmas(MOVED[[1, 2, 0]])
    place = gtsam.noiseModel.Isotropic.Sigma(2, SEEN)

    def run() -> Any:
        solver = gtsam.ISAM2() if lag is None else gtsam.IncrementalFixedLagSmoother(float(lag))
        found, pose = [], gtsam.Pose2()
        for k in range(len(seen)):
            graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            if k:
                motion = gtsam.Pose2(motions[k, 1], motions[k, 2], motions[k, 0])
                pose = pose.compose(motion)
                graph.add(gtsam.BetweenFactorPose2(k - 1, k, motion, way))
            else:
                graph.add(gtsam.PriorFactorPose2(0, pose, first))
            graph.add(gtsam.PoseTranslationPrior2D(k, seen[k], place))
            values.insert(k, pose)
            if lag is None:
                solver.update(graph, values)
                pose = solver.calculateEstimatePose2(k)
            else:
                times = gtsam.FixedLagSmootherKeyTimestampMap()
                times.insert((k, float(k)))
                solver.update(graph, values, times)
                pose = solver.calculateEstimatePose2(k)
            found.append([pose.x(), pose.y()])
        return np.array(found)

    return run


def line(name: str, make: Callable[..., Callable[[], Any]], frames: int, runs: int, **options: Any) -> None:
    """Microseconds a frame for a tenth of the frames and for all: the same where time is linear."""
    each = []
    for count in (frames // 10, frames):
        true, motions, seen = drive(count)
        try:
            run = make(motions, seen, **options)
        except ImportError as error:
            print(f"{name}: {error}")
            return
        least = np.inf
        for _ in range(runs):
            began = perf_counter()
            places = run()
            least = min(least, perf_counter() - began)
        each.append(least / count * 1e6)
    error = float(np.sqrt(np.square(places - true[:, 1:]).sum(axis=1).mean()))
    print(
        f"{name}: {each[0]:.1f} µs a frame of {frames // 10:,}, {each[1]:.1f} of {frames:,}; rms {error:.4f} m",
        flush=True,
    )


def main() -> None:
    """A line for each estimator."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=100_000)
    parser.add_argument("--runs", type=int, default=2)
    asked = parser.parse_args()
    print(machine())
    for method in ("ekf", "iterated-ekf", f"(smoother :lag {LAG})", "smoother"):
        line(f"mbm {method}", lambda m, s, method=method: by_mbm(method, m, s), asked.frames, asked.runs)
    for method in ("ekf", f"(smoother :lag {LAG})", "smoother"):
        line(f"mbm stream, {method}", by_stream, asked.frames, asked.runs, method=method)
    line("NumPy loop", by_numpy, asked.frames, asked.runs)
    line("filterpy", by_filterpy, asked.frames, asked.runs)
    line(f"gtsam fixed lag {LAG}", by_gtsam, asked.frames, 1, lag=LAG)
    line("gtsam iSAM2", by_gtsam, asked.frames, 1, lag=None)


if __name__ == "__main__":
    main()
