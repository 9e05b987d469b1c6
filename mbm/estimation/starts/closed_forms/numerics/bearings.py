"""Bearings of many points of known position → the poses that see them so (object space error, as in SQPnP).

Bearings of three points give the poses that see them so (P3P), by the solver's own text; they find poses where some
bearings are wrong.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.native.code import AnyCode
from mbm.estimation.starts.closed_forms.numerics.planes import agreeing, contaminated, samples_of
from mbm.rotations import cross_matrix, exponential, nearest

SAME_ORIGIN = 1e6
"""Parts of the extent of origins and points within which origins are one."""


def poses_of_most(
    code: AnyCode, points: Floats, bearings: Floats, weights: Floats, origins: Floats | None
) -> tuple[Floats, Floats]:
    """`poses_from_bearings` of the bearings (n, 3) that agree; of all, if none stands far out.

    Of samples of three from one origin, the pose with the least median of squares tells which do.
    """
    R, t = poses_from_bearings(points, bearings, weights, origins)
    eyes = np.zeros_like(points) if origins is None else origins
    if len(R) and not contaminated(_misfits(R[:1], t[:1], points, bearings, weights, eyes)[0]):
        return R, t
    size = max(float(np.ptp(points, axis=0).max()), float(np.abs(eyes).max()), 1e-300)
    _, which, counts = np.unique(np.round(eyes / size * SAME_ORIGIN), axis=0, return_inverse=True, return_counts=True)
    own = np.flatnonzero(which.ravel() == np.argmax(counts))
    samples = own[samples_of(len(own), 3)]
    if len(own) <= 3:
        return R, t
    turns, shifts = poses_from_three(code, points[samples], bearings[samples])
    shifts += eyes[samples[:, :1]]
    known = np.isfinite(shifts).all(axis=-1)
    if not bool(known.any()):
        return R, t
    kept = agreeing(_misfits(turns[known], shifts[known], points, bearings, weights, eyes))
    return poses_from_bearings(points[kept], bearings[kept], weights[kept], eyes[kept])


def _misfits(R: Floats, t: Floats, points: Floats, bearings: Floats, weights: Floats, eyes: Floats) -> Floats:
    """Weighted squared distances (k, n) between unit bearings and those of k poses."""
    seen = np.einsum("kij,nj->kni", R, points) + t[:, None] - eyes
    with np.errstate(all="ignore"):
        seen /= np.linalg.norm(seen, axis=2, keepdims=True)
        found = weights * np.square(seen - bearings).sum(axis=2)
    return np.where(np.isfinite(found), found, np.inf)


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


ITERATIONS = 12
"""Steps of Gauss–Newton on the rotation from each candidate; it converges quadratically from most."""

SAME_PLACE = 1e-14
"""Spread of points, beside their size, up to which rounding alone tells them apart."""

SAME_ANGLE = 1e-3
"""Rotations nearer than this, in rad, count as one solution."""


def poses_from_bearings(
    points: Floats, bearings: Floats, weights: Floats | None = None, origins: Floats | None = None
) -> tuple[Floats, Floats]:
    """The poses (k, 3, 3), (k, 3) that see ``points`` (n, 3) along unit ``bearings`` (n, 3), best first; k = 0 … 2.

    Bearings begin at ``origins`` (n, 3), those of several eyes in one body, or all at 0.

    Minimises ``Σ w |(1 − d dᵀ)(R x + t − c)|²``: the translation is eliminated, what remains is a quadratic form in the
    nine elements of R and 1 (Terzakis and Lourakis, ECCV 2020). Rotations nearest to its smallest eigenvectors and to
    its minimum, and the 24 of the cube, start Gauss–Newton, all at once; solutions with points behind the eye are left
    out. Planar and general points alike; a second solution is given where one is there, as with planes seen from afar.
    n ≥ 3.
    """
    centre = points.mean(axis=0)
    spread = np.sqrt(np.square(points - centre).sum(axis=1).mean())
    if not spread > SAME_PLACE * np.abs(points).max():
        return np.empty((0, 3, 3)), np.empty((0, 3))
    local = (points - centre) / spread
    eyes = np.zeros_like(points) if origins is None else origins / spread
    w = np.ones(len(points)) if weights is None else weights / weights.max()
    Q = w[:, None, None] * (np.eye(3) - bearings[:, :, None] * bearings[:, None, :])
    total = Q.sum(axis=0)
    if np.linalg.cond(total) > 1e12:
        return np.empty((0, 3, 3)), np.empty((0, 3))
    turned = np.einsum("ij,nk->nijk", np.eye(3), local).reshape(-1, 3, 9)  # R x = A r, r row by row
    lifted = np.concatenate([turned, -eyes[:, :, None]], axis=2)  # R x − c = A (r, 1)
    elimination = -np.linalg.solve(total, np.einsum("nij,njk->ik", Q, lifted))
    moved = lifted + elimination
    values, vectors = np.linalg.eigh(np.einsum("nij,nik,nkl->jl", moved, Q, moved))
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    basis = np.linalg.svd(root[:, :9])[2][:-5:-1]
    least = np.linalg.lstsq(root[:, :9], -root[:, 9], rcond=None)[0]
    nearby = np.concatenate([basis, -basis, least[None]]) if eyes.any() else np.concatenate([basis, -basis])
    R = _descended(np.concatenate([nearest(nearby.reshape(-1, 3, 3)), some_rotations()]), root)
    lifts = _lifted(R)
    cost = np.square(lifts @ root.T).sum(axis=1)
    t = lifts @ elimination.T
    seen = np.einsum("kij,nj->kni", R, local) + t[:, None, :] - eyes
    in_front = ((seen * bearings).sum(axis=2) > 0).mean(axis=1)
    kept = _distinct(R, cost, in_front)
    shift = spread * t[kept] - np.einsum("kij,j->ki", R[kept], centre)
    return np.asarray(R[kept]), np.asarray(shift)


def _lifted(R: Floats) -> Floats:
    """The elements of rotations and 1, (k, 10)."""
    return np.concatenate([R.reshape(-1, 9), np.ones((len(R), 1))], axis=1)


def some_rotations() -> Floats:
    """The 24 rotations of a cube, tilted so that none is a critical point by symmetry."""
    axes = [np.eye(3)[list(p)] for p in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2))]
    signs = [np.diag([a, b, c]) for a in (1.0, -1.0) for b in (1.0, -1.0) for c in (1.0, -1.0)]
    every = np.stack([s @ a for s in signs for a in axes])
    return np.asarray(every[np.linalg.det(every) > 0] @ exponential(np.array([0.1, 0.2, 0.3])))


def _descended(R: Floats, root: Floats) -> Floats:
    """Gauss–Newton with a little damping on ``|root · (r(R), 1)|²`` from each of ``R`` (k, 3, 3)."""
    generators = cross_matrix(np.eye(3))
    damping = np.full(len(R), 1e-3)
    values = _lifted(R) @ root.T
    cost = np.square(values).sum(axis=1)
    for _ in range(ITERATIONS):
        J = np.einsum("ij,kaj->kia", root[:, :9], np.einsum("kij,ajl->kail", R, generators).reshape(-1, 3, 9))
        normal = np.einsum("kia,kib->kab", J, J)
        scale = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        damped = normal + np.eye(3) * (damping[:, None, None] * scale + 1e-300)
        step = -np.linalg.solve(damped, np.einsum("kia,ki->ka", J, values)[:, :, None])[:, :, 0]
        trial = R @ exponential(step)
        trial_values = _lifted(trial) @ root.T
        trial_cost = np.square(trial_values).sum(axis=1)
        better = trial_cost < cost
        R = np.where(better[:, None, None], trial, R)
        values = np.where(better[:, None], trial_values, values)
        cost = np.where(better, trial_cost, cost)
        damping = np.where(better, damping * 0.01, np.maximum(damping, 1e-6) * 10)
    return R


def _distinct(R: Floats, cost: Floats, in_front: Floats) -> list[int]:
    """The best solution and the next best one that differs from it; those with most points in front only."""
    most = in_front.max(initial=0.0)
    if most <= 0.5:
        return []
    order = [int(i) for i in np.argsort(cost, kind="stable") if in_front[i] >= most - 1e-9]
    kept = order[:1]
    for i in order[1:]:
        difference = np.trace(R[kept[0]].T @ R[i])
        if (difference - 1) / 2 < np.cos(SAME_ANGLE) and _is_minimum_of_its_own(cost[i], cost[kept[0]]):
            kept.append(i)
            break
    return kept


def _is_minimum_of_its_own(cost: float, best: float) -> bool:
    """Whether a second solution fits nearly as well: candidates that got stuck on the way do not."""
    return cost <= 100 * best + 1e-2


def plane_poses_from_bearings(points: Floats, bearings: Floats) -> tuple[Floats, Floats]:
    """Poses of the plane R (…, 2, 2, 2), t (…, 2, 2) that see points (…, n, 2) along unit bearings (…, n, 2); n ≥ 3.

    Minimises ``Σ (n · (R x + t))²`` with n across the bearing: a quadratic form in (cos, sin) once t is eliminated.
    The solution with more points in front comes first, the other one is NaN unless as many are in front there.
    """
    across = np.stack([-bearings[..., 1], bearings[..., 0]], axis=-1)
    x, y = points[..., 0], points[..., 1]
    n0, n1 = across[..., 0], across[..., 1]
    turning = np.stack([n0 * x + n1 * y, n1 * x - n0 * y], axis=-1)  # n · R x = turning · (cos, sin)
    normal = np.einsum("...ni,...nj->...ij", across, across)
    usable = np.linalg.cond(np.where(np.isfinite(normal), normal, 0.0)) < 1e12
    normal = np.where(usable[..., None, None], normal, np.eye(2))
    elimination = -np.linalg.solve(normal, np.einsum("...ni,...nj->...ij", across, turning))
    moved = turning + across @ elimination
    form = np.einsum("...ni,...nj->...ij", moved, moved)
    smallest = np.linalg.eigh(np.nan_to_num(form))[1][..., 0]
    found = np.stack([smallest, -smallest], axis=-2)
    R = np.stack(
        [np.stack([found[..., 0], -found[..., 1]], axis=-1), np.stack([found[..., 1], found[..., 0]], axis=-1)], axis=-2
    )
    t = np.einsum("...ij,...kj->...ki", elimination, found)
    seen = np.einsum("...kij,...nj->...kni", R, points) + t[..., None, :]
    in_front = (np.einsum("...kni,...ni->...kn", seen, bearings) > 0).sum(axis=-1)
    best = in_front == in_front.max(axis=-1, keepdims=True)
    return np.where((best & usable[..., None])[..., None, None], R, np.nan), t
