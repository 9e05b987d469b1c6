"""The search for feet as immutable states: steps of the inner problem, and where each component stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np

from mbm.equations.corrections.types import Conditions
from mbm.equations.metric import cost_at
from mbm.equations.types import Correctable, Equations, Floats, Indices, Mask
from mbm.values import dataclass, replace

LEVEL = 1.0 + 1e-6
"""A singular reduced Hessian counts as positive definite: at the centre of a circle every point of it is nearest."""

SOFTNESS = 1e-8
"""Weight of a condition against the corrections, where the curvature along the conditions is asked for."""


LEAST_DETERMINANT = 0.1


def step(slopes: Floats, curvature: Floats | None, noisy: Mask, values: Floats, at: Floats) -> tuple[Floats, Floats]:
    """The next corrections (R, q) and the multipliers (R, k); not finite where a system has no solution.

    ``slopes`` (R, k, q), ``curvature`` (R, q, q) or None for none, ``noisy`` (R, k), ``values`` (R, k), ``at`` (R, q).
    """
    if slopes.shape[1] > slopes.shape[2] and bool(noisy.all()):
        return _by_corrections(slopes, curvature, values, at)
    if curvature is None:
        return _by_equations(slopes, noisy, values, at)
    if slopes.shape[1] > 1 or slopes.shape[2] > 2:
        return _whole(slopes, curvature, noisy, values, at)
    determinant, target, multipliers = _written_out(slopes[:, 0], curvature, noisy[:, 0], values[:, 0], at)
    left = np.flatnonzero(~(np.abs(determinant) > LEAST_DETERMINANT))
    if len(left):
        target[left], multipliers[left] = _whole(slopes[left], curvature[left], noisy[left], values[left], at[left])
    return target, multipliers


def _written_out(
    slopes: Floats, curvature: Floats, noisy: Mask, values: Floats, at: Floats
) -> tuple[Floats, Floats, Floats]:
    """One equation in one or two corrections: the determinant (R,) of I + W, the corrections and the multipliers."""
    a, p, u = 1.0 + curvature[:, 0, 0], slopes[:, 0], at[:, 0]
    if at.shape[1] == 1:
        turned, kept = p / a, u - u / a  # (I + W)⁻¹ Bᵀ and (I + W)⁻¹ W u
        multipliers = (values + p * (kept - u)) / (p * turned + noisy)
        return a, (kept - turned * multipliers)[:, None], multipliers[:, None]
    b, c, q, v = curvature[:, 0, 1], 1.0 + curvature[:, 1, 1], slopes[:, 1], at[:, 1]
    determinant = a * c - b * b
    turns = ((c * p - b * q) / determinant, (a * q - b * p) / determinant)
    stays = (u - (c * u - b * v) / determinant, v - (a * v - b * u) / determinant)
    multipliers = (values + p * (stays[0] - u) + q * (stays[1] - v)) / (p * turns[0] + q * turns[1] + noisy)
    target = np.stack([stays[0] - turns[0] * multipliers, stays[1] - turns[1] * multipliers], axis=1)
    return determinant, target, multipliers[:, None]


def _by_equations(slopes: Floats, noisy: Mask, values: Floats, at: Floats) -> tuple[Floats, Floats]:
    """``S λ = h − B u`` with ``S = B Bᵀ + Σ``; ``u = −Bᵀ λ``."""
    misclosures = values - np.einsum("rkq,rq->rk", slopes, at)
    if slopes.shape[1] == 1:
        weight = np.einsum("rkq,rkq->rk", slopes, slopes) + noisy
        with np.errstate(all="ignore"):
            multipliers = misclosures / weight
    else:
        multipliers = solved(spread(slopes, noisy), misclosures)
    return -np.einsum("rkq,rk->rq", slopes, multipliers), multipliers


def spread(slopes: Floats, noisy: Mask) -> Floats:
    """Covariance S (R, k, k) of the linearised conditions."""
    result: Floats = slopes @ slopes.transpose(0, 2, 1)
    index = np.arange(slopes.shape[1])
    result[:, index, index] += noisy
    return result


def _by_corrections(slopes: Floats, curvature: Floats | None, values: Floats, at: Floats) -> tuple[Floats, Floats]:
    """More equations than corrections, all with noise of their own: the normal equations of the corrections."""
    normal = slopes.transpose(0, 2, 1) @ slopes
    index = np.arange(slopes.shape[2])
    normal[:, index, index] += 1.0
    if curvature is not None:
        normal = normal + curvature
    change = solved(normal, -(at + np.einsum("rkq,rk->rq", slopes, values)))
    return at + change, values + np.einsum("rkq,rq->rk", slopes, change)


def _whole(slopes: Floats, curvature: Floats, noisy: Mask, values: Floats, at: Floats) -> tuple[Floats, Floats]:
    rows, k, q = slopes.shape
    matrix = np.zeros((rows, q + k, q + k))
    matrix[:, :q, :q] = curvature
    index = np.arange(q)
    matrix[:, index, index] += 1.0
    matrix[:, :q, q:] = slopes.transpose(0, 2, 1)
    matrix[:, q:, :q] = slopes
    index = np.arange(q, q + k)
    matrix[:, index, index] = -1.0 * noisy
    found = solved(matrix, np.concatenate([-at, -values], axis=1))
    return at + found[:, :q], found[:, q:]


def curved_up(slopes: Floats, curvature: Floats, noisy: Mask, asked: Mask) -> Mask:
    """Whether the cost grows along the conditions (R,), of those ``asked``: a foot is a nearest point, not a farthest.

    That is the case for sure where the curvature is below 1, the foot nearer than the radius of curvature.
    """
    bent = np.einsum("rij,rij->r", curvature, curvature) >= 1.0
    result = np.asarray(~bent, dtype=bool)
    looked_at = np.flatnonzero(bent & asked)
    along = slopes[looked_at]
    held = along.transpose(0, 2, 1) @ (along / np.where(noisy[looked_at], 1.0, SOFTNESS)[:, :, None])
    result[looked_at] = _positive_definite(LEVEL * np.eye(slopes.shape[2]) + curvature[looked_at] + held)
    return result


def _positive_definite(matrices: Floats) -> Mask:
    """Which symmetric matrices (R, n, n) have positive pivots only: elimination, of all R together."""
    rest, found = matrices, np.ones(len(matrices), dtype=bool)
    while rest.shape[1]:
        pivot = rest[:, 0, 0]
        found &= pivot > 0.0
        column = rest[:, 1:, 0] / np.where(found, pivot, 1.0)[:, None]
        rest = rest[:, 1:, 1:] - column[:, :, None] * rest[:, 0, None, 1:]
    return found


def solved(matrices: Floats, right: Floats) -> Floats:
    """Solutions (R, n) of the systems (R, n, n); NaN for those that are singular or not finite."""
    try:
        return np.asarray(np.linalg.solve(matrices, right[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        half = len(matrices) // 2
        if not half:
            return np.full(right.shape, np.nan)
        return np.concatenate([solved(matrices[:half], right[:half]), solved(matrices[half:], right[half:])])


LAST = 1e-8
"""A Newton step shorter than this, beside 1 + |u| standard deviations, is the last: its square is below rounding."""

NOTHING = 1e-14
"""A step that is not worth an evaluation."""

SMALL = 1e-5
"""A step whose gain is near rounding: it is taken without a test."""

DECREASE = 1e-4
CLOSER = 0.25
STEEPER = 1.5
SHORTEST = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Search:
    """R components at ``corrections`` u (R, q) with own noises e (R, k), and the direction that each tries next.

    ``values`` h, ``slopes`` B and ``curvature`` W are those at u; ``move`` (R, q) and ``shift`` (R, k) the changes of u
    and e that are tried with the share ``length`` (R,), ``multipliers`` λ (R, k) those behind the move. ``newton`` says
    that the move uses the curvature. ``done`` components have arrived, ``lost`` ones gave up.
    """

    noisy: Mask
    corrections: Floats
    noises: Floats
    values: Floats
    slopes: Floats
    curvature: Floats
    multipliers: Floats
    penalty: Floats
    move: Floats
    shift: Floats
    length: Floats
    newton: Mask
    done: Mask
    lost: Mask

    def some(self, rows: Indices) -> Search:
        """The search of some components."""
        return replace(self, **{each.name: getattr(self, each.name)[rows] for each in fields(self)})

    def with_rows(self, chosen: Mask, other: Search) -> Search:
        """The search with the ``chosen`` components (R,) of another."""
        mixed = {}
        for each in fields(self):
            mine, theirs = getattr(self, each.name), getattr(other, each.name)
            mixed[each.name] = np.where(chosen.reshape(-1, *[1] * (mine.ndim - 1)), theirs, mine)
        return replace(self, **mixed)

    @property
    def gaps(self) -> Floats:
        """What the equations leave over, h − e (R, k)."""
        return self.values - self.noises


def begun(conditions: Conditions, start: Floats) -> Search:
    """The search at ``start`` (R, q); components without finite values there are lost."""
    rows, k = conditions.noisy.shape
    nothing = np.zeros((rows, k))
    local = conditions.at(start, nothing)
    finite = np.isfinite(local.values).all(axis=1) & np.isfinite(local.slopes).all(axis=(1, 2))
    search = Search(
        noisy=conditions.noisy,
        corrections=start,
        noises=nothing,
        values=local.values,
        slopes=local.slopes,
        curvature=np.zeros_like(local.curvature),
        multipliers=nothing,
        penalty=nothing,
        move=np.zeros_like(start),
        shift=nothing,
        length=np.ones(rows),
        newton=np.zeros(rows, dtype=bool),
        done=np.zeros(rows, dtype=bool),
        lost=np.asarray(~finite, dtype=bool),
    )
    return _aimed(search)


def _aimed(search: Search) -> Search:
    """With the next direction of every component that goes on: Newton's where it descends, else Gauss-Helmert's."""
    target, multipliers = step(search.slopes, search.curvature, search.noisy, search.values, search.corrections)
    usable = np.isfinite(target).all(axis=1) & np.isfinite(multipliers).all(axis=1)
    search = _directed(search, target, multipliers, np.ones(len(target), dtype=bool))
    usable &= (_promise(search) <= 0.0) | (_size(search.move) <= SMALL * (1.0 + _size(search.corrections)))
    if not bool((usable | search.done | search.lost).all()):
        search = _straight(search, ~usable)
    arrived = np.maximum(_size(search.move), _size(search.shift)) <= NOTHING * (1.0 + _size(search.corrections))
    stuck = ~np.isfinite(search.move).all(axis=1) | ~np.isfinite(search.multipliers).all(axis=1)
    return _halted(replace(search, done=search.done | (arrived & ~search.lost), lost=search.lost | stuck))


def _directed(search: Search, target: Floats, multipliers: Floats, newton: Mask) -> Search:
    return replace(
        search,
        move=target - search.corrections,
        shift=np.where(search.noisy, multipliers - search.noises, 0.0),
        multipliers=multipliers,
        penalty=np.maximum(search.penalty, STEEPER * np.abs(multipliers)),
        length=np.ones(len(target)),
        newton=newton,
    )


def _straight(search: Search, chosen: Mask) -> Search:
    """With Gauss-Helmert's direction for the ``chosen`` components."""
    target, multipliers = step(search.slopes, None, search.noisy, search.values, search.corrections)
    other = _directed(search, target, multipliers, np.zeros(len(target), dtype=bool))
    return search.with_rows(chosen & ~search.done & ~search.lost, other)


def _halted(search: Search) -> Search:
    """Components that have stopped stay where they are."""
    going = ~(search.done | search.lost)
    if bool(going.all()):
        return search
    keep = going[:, None]
    multipliers = np.where(np.isfinite(search.multipliers), search.multipliers, 0.0)
    return replace(
        search,
        move=np.where(keep, search.move, 0.0),
        shift=np.where(keep, search.shift, 0.0),
        multipliers=np.where(keep, search.multipliers, multipliers),
    )


def swept(conditions: Conditions, search: Search) -> Search:
    """One evaluation: components whose trial point is good move there and aim again, others shorten their step."""
    share = search.length[:, None]
    trial = search.corrections + share * search.move
    noises = search.noises + share * search.shift
    local = conditions.at(trial, search.multipliers)
    there = replace(
        search,
        corrections=trial,
        noises=noises,
        values=local.values,
        slopes=local.slopes,
        curvature=local.curvature,
    )
    stopped = search.done | search.lost
    better = _acceptable(search, there) & ~stopped
    failed = ~(better | stopped)
    if not bool(better.any()):
        return _again(search, failed)
    settled = better & search.newton & (search.length == 1.0)
    settled &= np.maximum(_size(search.move), _size(search.shift)) <= LAST * (1.0 + _size(search.corrections))
    aimed = _aimed(replace(there, done=search.done | settled))
    return aimed if not bool(failed.any()) else aimed.with_rows(failed, _again(search, failed))


def _again(search: Search, failed: Mask) -> Search:
    """Components whose trial ``failed``: from Newton's direction to Gauss-Helmert's, from that to half of it."""
    length = np.where(failed, np.where(search.newton, 1.0, 0.5 * search.length), search.length)
    turned = failed & search.newton
    other = replace(search, length=length, lost=search.lost | (failed & (length < SHORTEST)))
    return _halted(_straight(other, turned) if bool(turned.any()) else other)


def _acceptable(search: Search, there: Search) -> Mask:
    """Whether each trial point is better: nearer to a foot, or by the merit."""
    finite = np.isfinite(there.values).all(axis=1) & np.isfinite(there.slopes).all(axis=(1, 2))
    full = search.length == 1.0
    good = full & (_size(search.move) <= SMALL * (1.0 + _size(search.corrections)))
    good |= full & (_remainder(there) <= CLOSER * _remainder(search))
    if not bool(good.all()):
        rounding = 1e-15 * (1.0 + np.abs(_merit(search)))
        good |= _merit(there) <= _merit(search) + DECREASE * search.length * _promise(search) + rounding
    return np.asarray(good & finite, dtype=bool)


def _merit(search: Search) -> Floats:
    squares = np.square(search.corrections).sum(axis=1) + np.square(search.noises).sum(axis=1)
    return np.asarray(0.5 * squares + (search.penalty * np.abs(search.gaps)).sum(axis=1))


def _promise(search: Search) -> Floats:
    """Slope of the merit along the direction."""
    change = (search.corrections * search.move).sum(axis=1) + (search.noises * search.shift).sum(axis=1)
    return np.asarray(change - (search.penalty * np.abs(search.gaps)).sum(axis=1))


def _remainder(search: Search) -> Floats:
    """Squared size of what keeps a point from being a foot: the conditions, and the gradient beside them."""
    gradient = search.corrections + np.einsum("rkq,rk->rq", search.slopes, search.multipliers)
    own = np.where(search.noisy, search.noises - search.multipliers, 0.0)
    return np.asarray(np.square(gradient).sum(axis=1) + np.square(own).sum(axis=1) + np.square(search.gaps).sum(axis=1))


def _size(vectors: Floats) -> Floats:
    return np.asarray(np.abs(vectors).max(axis=1, initial=0.0))


FAR = 5.0
"""Root mean square residual, in standard deviations, from which a start is far: corrections that large bend the way to
the minimum more than the unknowns do."""

Minimise = Callable[[Equations, Floats], Floats]
"""From equations and a start to the point of a rough minimum."""


def approached(equations: Correctable, start: Floats, rough: Minimise) -> Floats:
    """The start (N,), or where ``rough`` leads from it with exact columns if that fits better."""
    compared = equations.roughly_corrected()
    cost = cost_at(compared, start)
    if cost <= FAR**2 * compared.count:
        return start
    other = rough(equations.uncorrected(), start)
    return other if cost_at(compared, other) < cost else start
