"""Bearings of three points of known position → the poses that see them so (P3P), by the solver's own text."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.native.code import AnyCode

PRODUCTS = 1e3
"""Of one set, with which `SolverCode.expect` weighs it."""


def poses_from_three(code: AnyCode, points: Floats, bearings: Floats) -> tuple[Floats, Floats]:
    """All ``R, t`` with ``R x + t = s d``, s > 0, for three points x and unit bearings d of each of T sets.

    ``points`` and ``bearings`` have shape (T, 3, 3); R (T, 4, 3, 3) and t (T, 4, 3) hold up to four solutions, NaN
    beside them: `mbm.solver.minimal_pose`.
    """
    sets = len(points)
    found, counts, scratch = np.empty((sets, 4, 12)), np.zeros(sets, dtype=np.int64), np.empty(48)
    code.expect(PRODUCTS * sets)
    given = np.ascontiguousarray(points), np.ascontiguousarray(bearings)
    code.routine("poses_of_many", int, object, object, object, object, object)(sets, *given, found, counts, scratch)
    found[np.arange(4) >= counts[:, None]] = np.nan
    return found[..., :9].reshape(sets, 4, 3, 3), found[..., 9:]
