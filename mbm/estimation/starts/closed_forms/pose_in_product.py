"""One unknown pose of a product whose others are known: the product of each photograph, divided, and an average."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.chains import FRAME, Lines, is_pose, put_pose, rows_of_products, without_poses
from mbm.estimation.starts.closed_forms.products import products_in
from mbm.estimation.starts.closed_forms.rows import Rows, finite
from mbm.estimation.starts.closed_forms.types import Candidate, Plan, Situation
from mbm.rotations import nearest
from mbm.values import dataclass

NEAR = 3.0
"""Distance from the middle one, in medians of all, up to which poses are averaged."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Factors:
    """What each of n products says of the pose: R (n, 3, 3) and t (n, 3) of the member whose numbers begin at (n,)."""

    first: Indices
    R: Floats
    t: Floats


@dataclass(frozen=True, slots=True)
class PoseInProduct:
    """The composed pose is measured as if it were free; what is known of it is then taken off."""

    name: str = "pose-in-product"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that see a product of poses, all but one of which closed forms have found."""
        entry = candidate.entries[0]
        if len(candidate.entries) != 1 or candidate.paired or not is_pose(entry):
            return None
        number = candidate.support.entries[0]
        free = situation.with_numbers(without_poses(situation))
        parts = []
        for poses, lines in _lines(situation, free, number).items():
            found = products_in(free, lines, poses)
            if found is None:
                continue
            k = next(i for i, link in enumerate(found.links) if link.entry is entry)
            R, t = found.factor(k, situation.numbers)
            first = entry.offset + found.links[k].member * entry.unknown.size
            known = finite(R, (1, 2)) & np.isin(first, candidate.places)
            parts.append((first[known], R[known], t[known]))
        if not sum(len(first) for first, _, _ in parts):
            return None
        first, R, t = (np.concatenate(each) for each in zip(*parts, strict=True))
        rows = Rows.without_numbers(len(first), 6)
        return Plan(form=self, candidate=candidate, rows=rows, minimal=1, data=Factors(first=first, R=R, t=t))

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution (T, 1, K·7) for each subset of the products; NaN for members that are in none."""
        return np.stack([_solved(plan, subset) for subset in subsets])[:, None, :]


def _lines(situation: Situation, free: Situation, number: int) -> dict[tuple[int, ...], Lines]:
    """Rows that miss the pose and nothing else, by the two or more poses that they missed to begin with."""
    span = situation.layout.entries[number].range
    found: dict[tuple[int, ...], Lines] = {}
    for group in situation.mentioning[number]:
        others = (group.index < span.start) | (group.index >= span.stop)
        mine = np.flatnonzero(~(np.isnan(situation.numbers)[group.index] & others).any(axis=1))
        for poses, rows in rows_of_products(free, group, mine):
            if len(poses) > 1 and number in poses:
                found[poses] = (*found.get(poses, ()), (group, rows))
    return found


def _solved(plan: Plan, subset: Indices) -> Floats:
    factors: Factors = plan.data
    places = plan.candidate.places
    result = np.full(places.shape, np.nan)
    for first in np.unique(factors.first[subset]).tolist():
        mine = subset[factors.first[subset] == first]
        R, t = _average(factors.R[mine], factors.t[mine])
        put_pose(result, places, np.arange(first, first + 7), FRAME.numbers(np.ones(()), R, t))
    return result.ravel()


def _average(R: Floats, t: Floats) -> tuple[Floats, Floats]:
    """The mean of the motions (n, 3, 3), (n, 3) that lie near the one which is the least far from half of them."""
    turned = np.linalg.norm(R[:, None] - R[None], axis=(2, 3))
    shifted = np.linalg.norm(t[:, None] - t[None], axis=2)
    apart = turned + shifted / max(float(np.median(np.linalg.norm(t, axis=1))), 1e-300)
    middle = int(np.argmin(np.median(apart, axis=1)))
    kept = apart[middle] <= NEAR * np.median(apart[middle])
    return nearest(R[kept].mean(axis=0)), np.asarray(t[kept].mean(axis=0))


POSE_IN_PRODUCT = PoseInProduct()
