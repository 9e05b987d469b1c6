"""Alignment of associated positions by evo: Umeyama's closed form through its API, and its command as a process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from evo.core import geometry, sync, trajectory
from evo.tools import file_interface

from benchmarks.peers import fastest, main

RUNS = 5


def answer(arrays: dict[str, np.ndarray], reference: str, estimate: str, tolerance: str) -> dict[str, object]:
    """Two trajectory files and the tolerance of their association, s → scale, turn, shift, rms, seconds."""
    truth, found = (file_interface.read_tum_trajectory_file(name) for name in (reference, estimate))
    truth, found = sync.associate_trajectories(truth, found, max_diff=float(tolerance))
    pairs = truth.num_poses
    target, source = truth.positions_xyz, found.positions_xyz
    turn, shift, scale = geometry.umeyama_alignment(source.T, target.T, with_scale=True)
    errors = target - (scale * source @ turn.T + shift)
    command = [str(Path(sys.executable).with_name("evo_ape")), "tum", reference, estimate]
    command += ["--align", "--correct_scale", "--t_max_diff", tolerance]
    fitted = trajectory.PoseTrajectory3D(
        positions_xyz=source, orientations_quat_wxyz=found.orientations_quat_wxyz, timestamps=found.timestamps
    )
    return {
        "pairs": pairs,
        "scale": float(scale),
        "turn": turn.tolist(),
        "shift": shift.tolist(),
        "cost": float(np.square(errors).sum()),
        "closed form": fastest(lambda: geometry.umeyama_alignment(source.T, target.T, with_scale=True), 20),
        "align": fastest(lambda: fitted.align(truth, correct_scale=True), 5),
        "command": fastest(lambda: subprocess.run(command, check=True, capture_output=True), RUNS),
    }


if __name__ == "__main__":
    main(answer)
