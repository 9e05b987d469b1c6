"""The search for feet as immutable states: where each component stands, and its next direction.

A better start for equations with errors in measured columns: the fit that takes the columns as exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np

from mbm.equations.corrections.steps import step
from mbm.equations.corrections.types import Conditions
from mbm.equations.metric import cost_at
from mbm.equations.types import Correctable, Equations, Floats, Indices, Mask
from mbm.values import dataclass, replace

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
