"""Poses from bearings of which some are wrong."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.native.code import AnyCode
from mbm.estimation.starts.closed_forms.numerics.bearings import poses_from_bearings
from mbm.estimation.starts.closed_forms.numerics.medians import agreeing, contaminated, samples_of
from mbm.estimation.starts.closed_forms.numerics.three_points import poses_from_three


def poses_of_most(code: AnyCode, points: Floats, bearings: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """`poses_from_bearings` of the bearings (n, 3) that agree; of all, if none stands far out.

    Of samples of three, the pose with the least median of squares tells which do.
    """
    R, t = poses_from_bearings(points, bearings, weights)
    if len(R) and not contaminated(_misfits(R[:1], t[:1], points, bearings, weights)[0]):
        return R, t
    samples = samples_of(len(points), 3)
    turns, shifts = poses_from_three(code, points[samples], bearings[samples])
    known = np.isfinite(shifts).all(axis=-1)
    if len(points) <= 3 or not bool(known.any()):
        return R, t
    kept = agreeing(_misfits(turns[known], shifts[known], points, bearings, weights))
    return poses_from_bearings(points[kept], bearings[kept], weights[kept])


def _misfits(R: Floats, t: Floats, points: Floats, bearings: Floats, weights: Floats) -> Floats:
    """Weighted squared distances (k, n) between unit bearings and those of k poses."""
    seen = np.einsum("kij,nj->kni", R, points) + t[:, None]
    with np.errstate(all="ignore"):
        seen /= np.linalg.norm(seen, axis=2, keepdims=True)
        found = weights * np.square(seen - bearings).sum(axis=2)
    return np.where(np.isfinite(found), found, np.inf)
