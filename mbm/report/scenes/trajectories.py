"""Trajectories of TUM's and KITTI's benchmarks: poses of the body in the world, one a line."""

from __future__ import annotations

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.problem.types import BlockRole, Problem, UnknownKind
from mbm.report.scenes import faults
from mbm.report.scenes.types import Files, Trajectory, numbers, words
from mbm.report.scenes.views import views
from mbm.rotations import from_euler, inverse_motion, matrix_of_quaternion, quaternion_of_matrix, unit
from mbm.text.types import MbmError

TUM, KITTI = "tum", "kitti"
_SPACE = 7
"""Numbers of a pose of space."""


def trajectories(problem: Problem, solution: Solution, form: str) -> list[Trajectory]:
    """The families of poses, in the order of their keys where these are numbers; those of the plane lie at z = 0.

    A pose that leads from the world to a camera, as equations with `project` tell, is turned round.

    Raises:
        MbmError: format-needs: there is no family of poses.

    """
    inward = _inward(problem, solution, form)
    found = []
    for entry in solution.layout.entries:
        if entry.keys is None or entry.unknown.kind is not UnknownKind.POSE:
            continue
        values = solution.numbers[entry.range].reshape(entry.members, -1)
        if values.shape[1] == _SPACE:
            rotations, translations = matrix_of_quaternion(unit(values[:, :4])), values[:, 4:]
        else:
            angles = np.column_stack([np.zeros((len(values), 2)), values[:, 0]])
            rotations, translations = from_euler(angles), np.column_stack([values[:, 1:], np.zeros(len(values))])
        if entry.unknown.name in inward:
            rotations, translations = inverse_motion(rotations, translations)
        keys = entry.keys
        if all(isinstance(key, float) for key in keys):
            order = np.argsort(np.array(keys, dtype=np.float64), kind="stable")
            keys = tuple(keys[i] for i in order.tolist())
            rotations, translations = rotations[order], translations[order]
        found.append(Trajectory(name=entry.unknown.name, keys=keys, rotations=rotations, translations=translations))
    if not found:
        raise MbmError(faults.format_needs(form, "a family of poses: `(NAME (pose 3) :per TABLE)` among the unknowns"))
    return found


def _inward(problem: Problem, solution: Solution, form: str) -> set[str]:
    """The poses that lead from the world to a camera."""
    projects = any(
        equation.projection is not None
        for block in problem.blocks
        if block.role is BlockRole.OBSERVATION
        for case in block.cases
        for equation in case.equations
    )
    return {view.pose for view in views(problem, solution, form) if not view.outward} if projects else set()


def tum(problem: Problem, solution: Solution) -> Files:
    """``t x y z qx qy qz qw``: the keys are the times.

    Raises:
        MbmError: format-needs: no family of poses, or keys that are no times.

    """
    found: Files = {}
    every = trajectories(problem, solution, TUM)
    for each, name in zip(every, words([each.name for each in every]), strict=True):
        if not all(isinstance(key, float) for key in each.keys):
            raise MbmError(faults.format_needs(TUM, f"times as keys of `{each.name}`: its keys are texts"))
        quaternions = np.roll(quaternion_of_matrix(each.rotations), -1, axis=1)
        times = np.array(each.keys, dtype=np.float64)
        rows = np.column_stack([times, each.translations, quaternions])
        found[f"{name}.tum"] = "".join(f"{numbers(row)}\n" for row in rows).encode()
    return found


def kitti(problem: Problem, solution: Solution) -> Files:
    """The upper 3×4 of each matrix, row by row.

    Raises:
        MbmError: format-needs: no family of poses.

    """
    found: Files = {}
    every = trajectories(problem, solution, KITTI)
    for each, name in zip(every, words([each.name for each in every]), strict=True):
        rows = np.concatenate([each.rotations, each.translations[:, :, None]], axis=2).reshape(-1, 12)
        found[f"{name}.txt"] = "".join(f"{numbers(row)}\n" for row in rows).encode()
    return found
