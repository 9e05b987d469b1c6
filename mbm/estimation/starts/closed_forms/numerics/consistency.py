"""Loops that agree with one another and with the chain of poses that they close (Mangelson et al. 2018, PCM).

The chain puts all poses, and tells how far any two of them may have drifted apart. Two loops make a cycle with the
parts of the chain between their ends: where it does not close within its noise, one of the two is wrong. Wrong ones
agree with others by chance alone: of the graph of loops that agree, a clique is kept that is nearly its largest.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.closed_forms.numerics.chordal import Motions
from mbm.rotations import cross_matrix, quaternion_of_matrix, vector_of_quaternion
from mbm.values import dataclass

MOST_LOOPS = 1000
"""Loops that are compared two by two: these take about a second."""

OPEN = 1 / 2000
"""Share of true cycles whose squared misfit, a χ², is taken not to close: of a thousand loops about none. More are left
out where chains have drifted so far that their covariances are those of other places."""

RIVALS = 4
"""Loops that do not close, but agree with one another, and are no chance: of 200 drawn at random no more than three."""

STRAIGHT = 1e-4
"""Half an angle below which a screw is its chord: rounding is all that is left of the difference."""


def agreeing_loops(motions: Motions, shifts: Floats, chain: Indices) -> Mask | None:
    """Which of the motions (m,) with ``shifts`` (m, d) are the chain or loops that agree; None: there are too many.

    ``chain`` are those that join poses 0 … to the next ones, in this order. Where one is missing, loops across the gap
    are compared with such as join the same pieces. A step of the chain that is wrong is left out: loops that span it do
    not close with the chain, and agree with one another.
    """
    cycles = _cycles(motions, shifts, chain)
    agree = cycles.agreeing(cycles.closed)
    while agree is not None:
        step = cycles.wrong_step(agree)
        rest = chain if step is None else np.delete(chain, step)
        without = _cycles(motions, shifts, rest) if len(rest) < len(chain) and len(rest) else None
        more = None if without is None else without.agreeing(without.closed)
        if without is None or more is None or len(more) <= len(agree):
            break
        cycles, agree, chain = without, more, rest
    if agree is None:
        return None
    found = np.zeros(len(motions.first), dtype=bool)
    found[chain] = True
    found[agree] = True
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Cycles:
    """The ``loops`` (k,) among motions, which join poses ``low`` and ``high`` (k,), and the cycles they make.

    ``R`` (k, 3, 3) and ``t`` (k, 3) are the motions that are left of the cycles with the chain, ``own`` (k, 6, 6) their
    covariances by the loops alone; ``closed`` (k,): these close, or the chain does not join the poses. ``steps`` are
    the first poses of the chain's; ``piece`` and ``drift``: as `_chained` has them.
    """

    loops: Indices
    low: Indices
    high: Indices
    R: Floats
    t: Floats
    own: Floats
    closed: Mask
    limit: float
    steps: Indices
    piece: Indices
    drift: Floats

    def agreeing(self, among: Mask) -> Indices | None:
        """The motions that are loops ``among`` (k,) the others and agree with one another; None: there are too many."""
        keep = np.flatnonzero(among)
        if len(keep) > MOST_LOOPS:
            return None
        i, j, R, t, own = self.low[keep], self.high[keep], self.R[keep], self.t[keep], self.own[keep]
        piece, drift = self.piece, self.drift
        agree = np.zeros((len(keep), len(keep)), dtype=bool)
        there = _adjoint(R, t)
        for k in range(len(keep)):
            turn = R[k] @ _transposed(R)
            spread = _between(drift, i, i[k]) + _seen(there[k], _between(drift, j, j[k])) + own + own[k]
            agree[k] = _squares(turn, t[k] - _applied(turn, t), spread) <= self.limit
            agree[k] |= (piece[i] != piece[i[k]]) | (piece[j] != piece[j[k]])
        return self.loops[keep[_clique(agree & agree.T)]]

    def wrong_step(self, agree: Indices) -> int | None:
        """Which of the ``steps`` all loops span that do not close and agree with one another, and fewest others do."""
        found = self.agreeing(~self.closed)
        if found is None or len(found) < RIVALS:
            return None
        rivals = np.isin(self.loops, found)
        spanned = (self.steps >= self.low[rivals].max()) & (self.steps < self.high[rivals].min())
        others = np.isin(self.loops, agree)
        through = (self.low[others, None] <= self.steps) & (self.steps < self.high[others, None])
        return int(np.argmin(np.where(spanned, through.sum(axis=0), len(agree) + 1))) if spanned.any() else None


def _cycles(motions: Motions, shifts: Floats, chain: Indices) -> _Cycles:
    from scipy.special import chdtri

    R, t, variances = _ahead(motions, shifts)
    low, high = np.minimum(motions.first, motions.second), np.maximum(motions.first, motions.second)
    steps = low[chain]
    turned, moved, piece, drift = _chained(R[chain], t[chain], variances[chain], steps, int(high.max()) + 1)
    loops = np.setdiff1d(np.arange(len(R)), chain)
    i, j = low[loops], high[loops]
    R, t = turned[i] @ R[loops], _applied(turned[i], t[loops]) + moved[i]
    own = _seen(_adjoint(R, t), variances[loops][:, :, None] * np.eye(6))
    R = R @ _transposed(turned[j])
    t = t - _applied(R, moved[j])
    limit = float(chdtri(3 * shifts.shape[1] - 3, OPEN))
    closed = (_squares(R, t, _between(drift, i, j) + own) <= limit) | (piece[i] != piece[j])
    return _Cycles(
        loops=loops, low=i, high=j, R=R, t=t, own=own, closed=closed, limit=limit, steps=steps, piece=piece, drift=drift
    )  # fmt: skip


def _ahead(motions: Motions, shifts: Floats) -> tuple[Floats, Floats, Floats]:
    """Turns (m, 3, 3), shifts (m, 3) from the earlier pose to the later one and the variances (m, 6) of both.

    Those of the plane keep its third axis.
    """
    count, size = shifts.shape
    R, t = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    R[:, :size, :size], t[:, :size] = motions.turns, shifts
    back = motions.first > motions.second
    R[back] = _transposed(R[back])
    t[back] = -_applied(R[back], t[back])
    return R, t, np.repeat(1.0 / motions.stiffness, 3, axis=1)


def _chained(
    R: Floats, t: Floats, variances: Floats, low: Indices, count: int
) -> tuple[Floats, Floats, Indices, Floats]:
    """Turns (K, 3, 3), shifts (K, 3) of the poses, the pieces (K,) that they belong to, and how far they drift there.

    That is the covariance (K, 6, 6) of a motion in the frame of the first pose of a piece, which is the origin.
    """
    turned, moved = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    for k, before in enumerate(low.tolist()):
        turned[before + 1], moved[before + 1] = turned[before] @ R[k], turned[before] @ t[k] + moved[before]
    drift = np.zeros((count, 6, 6))
    drift[low + 1] = _seen(_adjoint(turned[low + 1], moved[low + 1]), variances[:, :, None] * np.eye(6))
    begins = np.ones(count, dtype=np.int64)
    begins[low + 1] = 0
    return turned, moved, np.cumsum(begins), np.cumsum(drift, axis=0)


def _between(drift: Floats, one: Indices, other: Indices) -> Floats:
    return np.asarray(drift[np.maximum(one, other)] - drift[np.minimum(one, other)])


def _transposed(R: Floats) -> Floats:
    return np.swapaxes(R, -1, -2)


def _applied(R: Floats, v: Floats) -> Floats:
    return np.asarray((R @ v[..., None])[..., 0])


def _adjoint(R: Floats, t: Floats) -> Floats:
    """What a screw (6,), turn first, becomes in the frame that motions (n) lead to."""
    found = np.zeros((len(R), 6, 6))
    found[:, :3, :3] = found[:, 3:, 3:] = R
    found[:, 3:, :3] = cross_matrix(t) @ R
    return found


def _seen(adjoint: Floats, spread: Floats) -> Floats:
    return np.asarray(adjoint @ spread @ _transposed(adjoint))


def _squares(R: Floats, t: Floats, spread: Floats) -> Floats:
    """The squared lengths (n,) of the screws that motions are, in standard deviations."""
    turn = vector_of_quaternion(quaternion_of_matrix(R))
    half = np.maximum(0.5 * np.linalg.norm(turn, axis=1), STRAIGHT)
    across = np.cross(turn, t)
    shift = t - 0.5 * across + ((1.0 - half / np.tan(half)) / (4.0 * half**2))[:, None] * np.cross(turn, across)
    screw = np.hstack([turn, shift])
    weighed = np.linalg.solve(spread, screw[:, :, None])[:, :, 0]
    return np.asarray((screw * weighed).sum(axis=1))


def _clique(agree: Mask) -> Indices:
    """Members all of which agree: who agrees with the fewest others is left out, until all do."""
    left = np.arange(len(agree))
    while len(left):
        counts = agree[np.ix_(left, left)].sum(axis=1)
        worst = int(np.argmin(counts))
        if counts[worst] == len(left):
            break
        left = np.delete(left, worst)
    return left
