"""Images of known points by a camera that does not divide by the depth: its pose, but for the depth."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints, moved_points
from mbm.estimation.starts.closed_forms.numerics.parallel import parallel_poses
from mbm.estimation.starts.closed_forms.numerics.space import DEEP
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Plan, Situation
from mbm.values import dataclass

SAME_SLOPE = 1e-9
"""Change of slopes from place to place, beside their size, that rounding makes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shadows:
    """Where rows see their points (n, 2): ``image = (axes p)[:2]`` of points p in the camera's frame."""

    moved: MovedPoints
    image: Floats
    axes: Floats


@dataclass(frozen=True, slots=True)
class PoseInParallel:
    """The nearest rotation to the linear map of points into the image; of plane points two of them."""

    name: str = "pose-in-parallel"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that are linear in the place of a moved point, alike in all of them, and do not tell its depth."""
        del situation
        moved = moved_points(candidate, candidate.rows(2))
        if moved is None or moved.frame.dimension != 3 or moved.frame.scales:
            return None
        slopes = moved.slopes(np.zeros(3))
        size = np.abs(slopes).max()
        alike = [slopes[:1], moved.slopes(np.array([0.4, -0.7, 1.3])), moved.slopes(np.array([-0.2, 0.5, 2.1]))]
        if not all(bool((np.abs(each - slopes) <= SAME_SLOPE * size).all()) for each in alike):
            return None
        turned, scales = np.linalg.qr(slopes[0].T)
        if not abs(np.linalg.det(scales)) > AGREEMENT * size**2:
            return None
        axes = np.vstack([turned.T, np.cross(turned[:, 0], turned[:, 1])])
        image = -np.linalg.solve(scales.T, moved.values(np.zeros(3)).T).T
        data = Shadows(moved=moved, image=image, axes=axes)
        return Plan(form=self, candidate=candidate, rows=moved.rows, minimal=3, data=data)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """Up to two poses for each subset."""
        seen: Shadows = plan.data
        found = np.full((len(subsets), 2, plan.candidate.places.shape[1]), np.nan)
        for k, mine in enumerate(subsets):
            R, t, _ = parallel_poses(seen.moved.points[mine], seen.image[mine], DEEP)
            found[k, : len(R)] = seen.moved.numbers(seen.axes.T @ R, t @ seen.axes)
        return found


POSE_IN_PARALLEL = PoseInParallel()
