"""Other minima next to one, behind a kink of the model, as parts of the region that the data do not exclude."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Minimum
from mbm.estimation.search.contours import TURN, steps_to
from mbm.estimation.search.search import Alternative
from mbm.estimation.search.twins import separation
from mbm.problem.manifold import Piece
from mbm.values import dataclass

OPEN = 1e14
"""Condition of normal equations from which something is not told."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beyond:
    """Minima (k,) next to one: the ``steps`` (k, n) to them, their standard deviations ``spreads`` (k, n).

    ``grown`` (k,) is how much more they cost, in variances of the noise; less as far as the region about them is
    larger, which is as probable as if it cost less (Laplace's approximation).
    """

    steps: Floats
    spreads: Floats
    grown: Floats

    def ends(self, reach: Floats | float) -> tuple[Floats, Floats]:
        """How far (n,) the regions in which the cost grows by reach² lie below and above; 0 where none does."""
        left = np.square(reach) - self.grown[:, None]
        room = np.sqrt(np.maximum(left, 0.0)) * self.spreads
        below, above = (np.where(left >= 0.0, room + sign * self.steps, 0.0) for sign in (-1.0, 1.0))
        return below.max(axis=0, initial=0.0), above.max(axis=0, initial=0.0)


def beyond(equations: Assembled, minimum: Minimum, others: Sequence[Alternative], variance: float) -> Beyond | None:
    """Those of the ``others`` from which no rotation differs by more than `TURN`; None: there are none."""
    layout = equations.layout
    turning = layout.angle[equations.free].copy()
    for curved in layout.curved:
        if curved.piece is Piece.QUATERNION:
            turning |= np.isin(equations.free, curved.coordinates)
    found = [each.minimum for each in others if each.minimum.blocks is None]
    points = np.array([each.point for each in found]).reshape(-1, len(minimum.point))
    near = (separation(equations, minimum.point, points)[:, turning] <= TURN).all(axis=1)
    if not turning.any() or not near.any():
        return None
    own = list(compress(found, near))
    normals = [each.jacobian.T @ each.jacobian for each in own]
    squares = np.array([np.diag(np.linalg.pinv(each, hermitian=True)) for each in normals])
    costs = (np.array([each.cost for each in own]) - minimum.cost) / variance
    wider = np.array([_log_size(each) for each in normals]) - _log_size(minimum.jacobian.T @ minimum.jacobian)
    wider = np.nan_to_num(wider)  # what is open has no volume to compare
    return Beyond(
        steps=steps_to(equations, minimum.point, points[near]),
        spreads=np.sqrt(variance * squares),
        grown=np.clip(costs - wider, 0.0, np.maximum(costs, 0.0)),
    )


def _log_size(normal: Floats) -> float:
    """The logarithm of the squared volume of the region that normal equations (n, n) leave; NaN where that is open."""
    scale = np.sqrt(np.diag(normal))
    if not scale.all():
        return np.nan
    scaled = normal / np.outer(scale, scale)
    sign, found = np.linalg.slogdet(scaled)
    closed = sign > 0.0 and np.linalg.cond(scaled) < OPEN
    return -float(found) - 2.0 * float(np.log(scale).sum()) if closed else np.nan
