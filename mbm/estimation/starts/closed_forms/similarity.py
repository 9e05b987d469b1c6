"""Point pairs: rotation, rigid motion or similarity between two sets of points (Umeyama 1991), in plane and space."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.frames import Frame, frames_of, some_rotation
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints, moved_points
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Plan, Situation
from mbm.rotations import nearest
from mbm.values import dataclass

RANK_TOLERANCE = 1e-10
"""Second singular value of the correlation beside the first, below which points of space lie on a line."""


def aligned(
    source: Floats, target: Floats, weights: Floats | None = None, *, scale: bool
) -> tuple[Floats, Floats, Floats]:
    """``c, R, t`` that minimise ``Σ w |y − (c R x + t)|²`` over ``x`` in ``source``, ``y`` in ``target``.

    ``source`` and ``target`` have shape (…, n, d) with d = 2 or 3, ``weights`` (…, n); c (…), R (…, d, d), t (…, d).
    R is a rotation also where the points are mirrored (Umeyama's determinant rule). NaN where the rotation is not
    determined: equal points, or points of space on one line.
    """
    w = np.ones(source.shape[:-1]) if weights is None else weights
    w = w / w.sum(axis=-1, keepdims=True)
    mean_source = np.einsum("...n,...nd->...d", w, source)
    mean_target = np.einsum("...n,...nd->...d", w, target)
    x, y = source - mean_source[..., None, :], target - mean_target[..., None, :]
    correlation = np.einsum("...n,...ni,...nj->...ij", w, y, x)
    R = nearest(correlation)
    values = np.linalg.svd(np.nan_to_num(correlation), compute_uv=False)
    decisive = values[..., -2]
    spread = np.sqrt(np.einsum("...n,...nd,...nd->...", w, x, x) * np.einsum("...n,...nd,...nd->...", w, y, y))
    with np.errstate(invalid="ignore", divide="ignore"):
        determined = (decisive > RANK_TOLERANCE * spread) & (spread > 0)
        if scale:
            c = np.einsum("...ij,...ij->...", R, correlation) / np.einsum("...n,...nd,...nd->...", w, x, x)
            determined &= c > 0
        else:
            c = np.ones(source.shape[:-2])
    c = np.where(determined, c, np.nan)
    R = np.where(determined[..., None, None], R, np.nan)
    t = mean_target - c[..., None] * np.einsum("...ij,...j->...i", R, mean_source)
    return c, R, t


def turned(source: Floats, target: Floats, weights: Floats | None = None) -> Floats:
    """R (…, d, d) that minimises ``Σ w |y − R x|²`` over directions or vectors x, y (…, n, d) (Wahba's problem).

    NaN where the rotation is not determined: in space, all vectors along one line.
    """
    w = np.ones(source.shape[:-1]) if weights is None else weights
    correlation = np.einsum("...n,...ni,...nj->...ij", w, target, source)
    values = np.linalg.svd(np.nan_to_num(correlation), compute_uv=False)
    decisive = values[..., 1] if source.shape[-1] == 3 else values[..., 0]
    determined = (decisive > RANK_TOLERANCE * values[..., 0]) & (values[..., 0] > 0)
    return np.where(determined[..., None, None], nearest(correlation), np.nan)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pairs:
    """The motion takes ``source`` (n, d) to ``target`` (n, d); ``inverse``: the other way round."""

    frame: Frame
    inverse: bool
    source: Floats
    target: Floats
    weight: Floats


@dataclass(frozen=True, slots=True)
class Similarity:
    """Umeyama's closed form, weighted, with the determinant rule."""

    name: str = "umeyama"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows whose residual is affine in the place of a moved point: with it, the point and its target are known."""
        del situation
        frame = next(frames_of(candidate), None)
        if frame is None:
            return None
        rows = candidate.rows(frame.dimension)
        if not len(rows):
            return None
        pairs = _moved_pairs(candidate, rows) if frame.moves else _turned_pairs(rows, frame)
        if pairs is None:
            return None
        minimal = frame.dimension if frame.moves else frame.dimension - 1
        return Plan(form=self, candidate=candidate, rows=rows, minimal=minimal, data=pairs)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution for each subset."""
        pairs: Pairs = plan.data
        source, target = pairs.source[subsets], pairs.target[subsets]
        if pairs.inverse:
            source, target = target, source
        weight = pairs.weight[subsets]
        if pairs.frame.moves:
            c, R, t = aligned(source, target, weight, scale=pairs.frame.scales)
        else:
            R = turned(source, target, weight)
            c, t = np.ones(len(R)), np.zeros((len(R), pairs.frame.dimension))
        return pairs.frame.numbers(c, R, t)[:, None, :]


def _moved_pairs(candidate: Candidate, rows: Rows) -> Pairs | None:
    found = moved_points(candidate, rows)
    targets = None if found is None else targets_of(found)
    if found is None or targets is None:
        return None
    return Pairs(
        frame=found.frame,
        inverse=found.inverse,
        source=found.points,
        target=targets[0],
        weight=rows.weight * targets[1],
    )


def targets_of(moved: MovedPoints) -> tuple[Floats, Floats] | None:
    """Where rows that are affine in the place of their point want it (n, d), and how steeply, squared (n,)."""
    d = moved.frame.dimension
    size = 1.0 + float(np.abs(moved.points).max())
    slopes = moved.slopes(np.zeros(d))
    if not np.isfinite(slopes).all():
        return None
    for place in (np.full(d, size), size * np.arange(1.0, d + 1)):
        if not np.allclose(moved.slopes(place), slopes, rtol=AGREEMENT, atol=AGREEMENT * float(np.abs(slopes).max())):
            return None
    if bool((np.abs(np.linalg.det(slopes)) <= 1e-9 * np.abs(slopes).max(axis=(1, 2)) ** d).any()):
        return None
    target = np.asarray(-np.linalg.solve(slopes, moved.values(np.zeros(d))[..., None])[..., 0])
    return target, np.asarray(np.square(slopes).mean(axis=(1, 2)) * d)


def _turned_pairs(rows: Rows, frame: Frame) -> Pairs | None:
    """Rows ``R u − y`` (or ``Rᵀ u − y``): half turns about all axes add up to nothing, which leaves y."""
    d = frame.dimension
    halves = [np.diag(np.array(s)) for s in ((1.0, 1, 1), (1.0, -1, -1), (-1.0, 1, -1), (-1.0, -1, 1))]
    if d == 2:
        halves = [np.eye(2), -np.eye(2)]
    values = [rows.values(frame.numbers(np.ones(()), R, np.zeros(d))) for R in halves]
    target = np.asarray(-np.mean(values, axis=0))
    source = values[0] + target
    generator = np.random.default_rng(0)
    R = some_rotation(d, generator)
    direct = rows.values(frame.numbers(np.ones(()), R, np.zeros(d)))
    tolerance = AGREEMENT * (np.abs(source).max(axis=1) + np.abs(target).max(axis=1))
    for inverse in (False, True):
        expected = source @ (R if inverse else R.T) - target
        if bool((np.abs(direct - expected).max(axis=1) <= tolerance).all()):
            return Pairs(frame=frame, inverse=inverse, source=source, target=target, weight=rows.weight)
    return None


SIMILARITY = Similarity()
