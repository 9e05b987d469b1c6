"""Two unknown poses with known motions between them: hand and eye, robot and world; and where nothing is between.

Products of two unknown motions with known ones between them → the two (robot–world and hand–eye calibration).
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.chains import FRAME, REST, SAME_MOTION, put_pose
from mbm.estimation.starts.closed_forms.products import Products, products_of
from mbm.estimation.starts.closed_forms.rows import Rows, finite
from mbm.estimation.starts.closed_forms.types import Candidate, Plan, Situation
from mbm.rotations import exponential, inverse_motion, nearest
from mbm.values import dataclass


@dataclass(frozen=True, slots=True)
class HandEye:
    """Shah (2013): both rotations from the singular vectors of a bilinear form, then both translations."""

    name: str = "hand-eye"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Products ``P A Q`` of two unknown poses, or their inverses, with motions A that differ."""
        del situation
        found = products_of(candidate)
        if found is None or len(found.links) != 2 or not len(_varied(found)):
            return None
        return _plan(self, candidate, found)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution (T, 1, K·s) for each subset of the products; NaN for members that no pair determines."""
        return np.stack([_solved(plan, subset) for subset in subsets])[:, None, :]


@dataclass(frozen=True, slots=True)
class Datum:
    """Poses of which products alone are known: one of them is where all begins.

    What is known of the others follows from it, step by step.
    """

    name: str = "datum"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Products of unknown poses with one motion between each two, and no member of their families known."""
        known = [bool(np.isfinite(situation.numbers[entry.range]).any()) for entry in candidate.entries]
        found = None if any(known) else products_of(candidate)
        if found is None or any(_differ(found, k) for k in range(len(found.turns))):
            return None
        return _plan(self, candidate, found)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """No motion for the first member of the smallest family (T, 1, K·s), NaN for all others."""
        found: Products = plan.data
        link = min(found.links, key=lambda each: each.entry.members)
        places = plan.candidate.places
        result = np.full(places.shape, np.nan)
        put_pose(result, places, link.places(int(link.member.min())), REST)
        return np.tile(result.ravel(), (len(subsets), 1))[:, None, :]


def _plan(form: HandEye | Datum, candidate: Candidate, found: Products) -> Plan:
    rows = Rows.without_numbers(found.turns.shape[1], 6)
    return Plan(form=form, candidate=candidate, rows=rows, minimal=3, data=found)


def _differ(found: Products, k: int) -> bool:
    """Whether what is between a link and the next is not the same in all products."""
    turn, shift = np.ptp(found.turns[k], axis=0).max(), np.ptp(found.shifts[k], axis=0).max()
    return bool(turn > SAME_MOTION or shift > SAME_MOTION * (1.0 + np.abs(found.shifts[k]).max()))


def _varied(found: Products) -> list[Indices]:
    """The products of each two members that have three at least, most first."""
    members = np.stack([link.member for link in found.links])
    _, which = np.unique(members, axis=1, return_inverse=True)
    pairs = [np.flatnonzero(which.ravel() == k) for k in range(int(which.max()) + 1)]
    return sorted((pair for pair in pairs if len(pair) >= 3), key=len, reverse=True)


def _solved(plan: Plan, subset: Indices) -> Floats:
    found: Products = plan.data
    places = plan.candidate.places
    result = np.full(places.shape, np.nan)
    known = finite(found.R, (1, 2)) & np.isin(np.arange(len(found.R)), subset)
    for pair in _varied(found):
        mine = pair[known[pair]]
        both = outer_and_inner((found.turns[0, mine], found.shifts[0, mine]), (found.R[mine], found.t[mine]))
        if both is None:
            continue
        for link, (R, t) in zip(found.links, both, strict=True):
            if link.inverse:
                R, t = inverse_motion(R, t)
            put_pose(result, places, link.places(int(link.member[mine[0]])), FRAME.numbers(np.ones(()), R, t))
        break  # the other members follow from these
    return result.ravel()


HAND_EYE = HandEye()
DATUM = Datum()


APART = 1e-5
"""Relative gap of the largest singular values, below which the rotations are taken to turn about one axis."""


def outer_and_inner(
    between: tuple[Floats, Floats], products: tuple[Floats, Floats]
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]] | None:
    """X and Z, each R (3, 3) and t (3,), with ``M = X A Z`` for motions A and M, each R (n, 3, 3) and t (n, 3).

    The rotations maximise ``Σ tr(Mᵀ X A Z)``, a bilinear form in X and Z: its largest singular vectors (Shah, ASME J.
    Mechanisms and Robotics 5 (3), 2013); the translations then solve linear equations. Of several ways that fit, as
    where the motions A turn about one axis, it is one. None if nothing tells how X is turned.
    """
    (A, a), (M, m) = between, products
    if len(A) < 3:
        return None
    form = np.einsum("nil,njk->ijlk", M, A).reshape(9, 9)  # X_ij A_jk Z_kl M_il
    U, values, _ = np.linalg.svd(form)
    if values[0] - values[1] > APART * values[0]:
        turned = U[:, 0].reshape(3, 3)
        X = nearest(turned if np.linalg.det(turned) > 0 else -turned)
    else:
        one = _about_one_axis(between, products)
        if one is None:
            return None
        X = one
    Z = nearest(np.einsum("nji,kj,nkl->il", A, X, M))
    matrix = np.concatenate([np.tile(np.eye(3), (len(A), 1, 1)), X @ A], axis=2).reshape(-1, 6)
    shifts = np.linalg.lstsq(matrix, (m - a @ X.T).ravel(), rcond=None)[0]
    return (X, shifts[:3]), (Z, shifts[3:])


def _about_one_axis(between: tuple[Floats, Floats], products: tuple[Floats, Floats]) -> Floats | None:
    """X of the same where the motions A turn about one axis e, or none: a turntable, a stage.

    It takes the axes of the turns between motions A to those between motions M, or where nothing turns, ways to ways.
    The turn b about e is left free; where motions shift, too, cos b and sin b enter linearly.
    """
    (A, a), (M, m) = between, products
    S = A @ A[0].T
    ours, theirs = _axes(S), _axes(M @ M[0].T)
    if not np.abs(ours).max() > SAME_MOTION:
        ours, theirs = a - a[0], m - m[0]
    if not np.abs(ours).max() > 0.0:
        return None
    X = nearest(theirs.T @ ours)
    e = np.linalg.svd(ours)[2][0]
    ahead = np.outer(a @ e, e)
    ways = np.stack([a - ahead, np.cross(e, a)], axis=2)
    matrix = np.concatenate([S, np.tile(np.eye(3), (len(A), 1, 1)), ways], axis=2).reshape(-1, 8)
    cosine, sine = np.linalg.lstsq(matrix, (m @ X - ahead).ravel(), rcond=None)[0][6:]
    return X @ exponential(np.arctan2(sine, cosine) * e)


def _axes(R: Floats) -> Floats:
    """The axes (n, 3) of rotations (n, 3, 3), of length 2 sin of the angle."""
    return np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
