"""Marquardt's method for many points at once: every operation is one NumPy call over all trials that still move.

The workhorse of multi-start search and of consensus trials, to moderate accuracy: normal equations with unit diagonal,
the damping of Nielsen (1999), hard bounds by an active set. The last digits, and the reasons for stopping, are the
business of the solvers for one point. A trial never ends worse than it began, and no trial influences another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from mbm.solution.types import Floats, Indices, Mask
from mbm.target.decisions import (
    FIRST_DAMPING,
    HOPELESS_DAMPING,
    LEAST_GAIN_RATIO,
    MEMORY,
    POSITIVE_KEPT,
    REGULARISATION,
    REVISIONS,
)
from mbm.values import dataclass


class Stack(Protocol):
    """Least squares equations at many points at once; one *trial* is one start, or one subset of the equations.

    ``points`` (T, N) are as in ``Equations``, one row each; ``which`` (T,) says to which trial each of them belongs,
    for stacks in which every trial has equations of its own. A step has ``dimension`` n coordinates.
    """

    @property
    def dimension(self) -> int:
        """n, the coordinates of a step."""
        ...

    @property
    def count(self) -> int:
        """m, the scalar residuals of a trial."""
        ...

    @property
    def lower(self) -> Floats:
        """Hard lower bounds, shape (n,), -inf where there is none."""
        ...

    @property
    def upper(self) -> Floats:
        """Hard upper bounds, shape (n,), +inf where there is none."""
        ...

    @property
    def positive(self) -> Mask:
        """Coordinates that must stay strictly above zero, shape (n,)."""
        ...

    def linearised(self, points: Floats, which: Indices) -> tuple[Floats, Floats]:
        """Whitened residuals (T, m) and their derivatives (T, m, n); NaN or inf where a model has no value."""
        ...

    def coordinates(self, points: Floats) -> Floats:
        """The numbers that steps add to, shape (T, n), 0 for the coordinates of rotations and directions."""
        ...

    def moved(self, points: Floats, steps: Floats) -> Floats:
        """The points after the steps (T, n), with coordinates that rounding took out of the bounds put back."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batched:
    """Where the trials ended: ``points`` (T, N), ``cost`` (T,) = Σ r², inf where a start has no finite value.

    ``settled`` (T,): the next step promises next to nothing; the others ran out of ``iterations`` (T,) or of finite
    points. ``evaluations`` (T,) of the equations were made on the way.
    """

    points: Floats
    cost: Floats
    settled: Mask
    iterations: Indices
    evaluations: Indices


@np.errstate(all="ignore")
def minimise_all(
    stack: Stack,
    starts: Floats,
    *,
    iterations: int,
    tolerance: float = 1e-7,
    stopped: Callable[[], bool] = lambda: False,
) -> Batched:
    """The minima that the starts (T, N) lead to, each in at most so many steps; in chunks that fit the memory.

    A trial has settled when no column of the Jacobian makes an angle with the residuals whose cosine is above
    ``tolerance``, when the hardly damped step promises less than ``tolerance²`` of the cost, or when the cost is below
    ``tolerance²`` for each residual: zero, in standard deviations. ``stopped`` ends all of them where they are; chunks
    that were not begun then cost inf.
    """
    chunk = max(1, MEMORY // max(1, stack.count * stack.dimension))
    parts: list[Batched] = []
    for first in range(0, max(len(starts), 1), chunk):
        if parts and stopped():
            parts.append(_idle(starts[first:]))
            break
        state = _State(stack, starts[first : first + chunk], first, tolerance)
        for _ in range(iterations):
            if not state.moving.size or stopped():
                break
            state.advance()
        parts.append(state.answer())
    return joined(parts)


def _idle(starts: Floats) -> Batched:
    """Trials that were not begun."""
    none = np.zeros(len(starts), dtype=np.int64)
    return Batched(
        points=np.array(starts, dtype=np.float64),
        cost=np.full(len(starts), np.inf),
        settled=none > 0,
        iterations=none,
        evaluations=none,
    )


def joined(parts: Sequence[Batched]) -> Batched:
    """Trials one after the other; at least one part."""
    return Batched(
        points=np.concatenate([p.points for p in parts]),
        cost=np.concatenate([p.cost for p in parts]),
        settled=np.concatenate([p.settled for p in parts]),
        iterations=np.concatenate([p.iterations for p in parts]),
        evaluations=np.concatenate([p.evaluations for p in parts]),
    )


class _State:
    """All trials; those that still move are advanced together, and put back where they ended."""

    def __init__(self, stack: Stack, starts: Floats, first: int, tolerance: float) -> None:
        self._stack = stack
        self._tolerance = tolerance
        self._first = first
        count = len(starts)
        self._points = np.array(starts, dtype=np.float64)
        self._cost = np.full(count, np.inf)
        self._settled = np.zeros(count, dtype=bool)
        self._iterations = np.zeros(count, dtype=np.int64)
        residuals, jacobian = stack.linearised(self._points, first + np.arange(count))
        cost = np.square(residuals).sum(axis=1)
        finite = np.isfinite(cost) & np.isfinite(jacobian).all(axis=(1, 2))
        self.moving = np.flatnonzero(finite)
        self._cost[self.moving] = cost[finite]
        self._now = _Moving(
            points=self._points[finite],
            cost=cost[finite],
            residuals=residuals[finite],
            jacobian=jacobian[finite],
            damping=np.full(len(self.moving), FIRST_DAMPING),
            growth=np.full(len(self.moving), 2.0),
            scale=np.zeros((len(self.moving), stack.dimension)),
        )

    def answer(self) -> Batched:
        """Where the trials are."""
        self._points[self.moving], self._cost[self.moving] = self._now.points, self._now.cost
        return Batched(
            points=self._points,
            cost=self._cost,
            settled=self._settled,
            iterations=self._iterations,
            evaluations=self._iterations + 1,
        )

    def advance(self) -> None:
        """One step of every trial that still moves."""
        now, stack = self._now, self._stack
        transposed = now.jacobian.transpose(0, 2, 1)
        gradient = (transposed @ now.residuals[:, :, None])[:, :, 0]
        normal = transposed @ now.jacobian
        np.maximum(now.scale, np.sqrt(np.einsum("tii->ti", normal)), out=now.scale)
        scale = np.where(now.scale > 0.0, now.scale, 1.0)
        normal /= scale[:, :, None]
        normal /= scale[:, None, :]
        step, slope = _bounded_step(normal, gradient / scale, now.damping, scale, _gaps(stack, now.points))
        promise = _promise(now.jacobian, now.residuals, step)
        small = self._tolerance * self._tolerance
        done = (now.damping <= FIRST_DAMPING) & (promise >= 0.0) & (promise <= small * now.cost)
        done |= (slope * slope <= small * now.cost) | (now.cost <= small * now.residuals.shape[1])
        trial = stack.moved(now.points, step)
        residuals, jacobian = stack.linearised(trial, self._first + self.moving)
        lower = np.square(residuals).sum(axis=1)
        share = np.where(promise > 0.0, (now.cost - lower) / promise, -1.0)
        good = (share > LEAST_GAIN_RATIO) & np.isfinite(lower) & np.isfinite(jacobian.sum(axis=(1, 2)))
        now.take(good, trial, lower, residuals, jacobian)
        now.adapt(good, share)
        self._iterations[self.moving] += 1
        self._settled[self.moving] = done
        self._leave(done | (now.damping > HOPELESS_DAMPING))

    def _leave(self, ended: Mask) -> None:
        """Put those that ended back in their places; the others go on."""
        if not ended.any():
            return
        places = self.moving[ended]
        self._points[places], self._cost[places] = self._now.points[ended], self._now.cost[ended]
        self.moving = self.moving[~ended]
        self._now = self._now.only(~ended)


@dataclass(slots=True, kw_only=True, eq=False)
class _Moving:
    """The trials that still move, one line each; ``scale`` (T, n) is the largest norm that each column has had."""

    points: Floats
    cost: Floats
    residuals: Floats
    jacobian: Floats
    damping: Floats
    growth: Floats
    scale: Floats

    def take(self, good: Mask, points: Floats, cost: Floats, residuals: Floats, jacobian: Floats) -> None:
        """The trial points that are ``good`` take the places of those they were tried from."""
        if good.all():
            self.points, self.cost, self.residuals, self.jacobian = points, cost, residuals, jacobian
            return
        self.points[good], self.cost[good] = points[good], cost[good]
        self.residuals[good], self.jacobian[good] = residuals[good], jacobian[good]

    def adapt(self, good: Mask, share: Floats) -> None:
        """Nielsen's damping: less after steps that kept their promise, ever faster more after those that did not."""
        factor = np.maximum(1.0 / 3.0, 1.0 - (2.0 * np.minimum(share, 1.0) - 1.0) ** 3)
        self.damping *= np.where(good, factor, self.growth)
        self.growth = np.where(good, 2.0, 2.0 * self.growth)

    def only(self, kept: Mask) -> _Moving:
        """Some of them."""
        return _Moving(**{name: getattr(self, name)[kept] for name in self.__slots__})


def _gaps(stack: Stack, points: Floats) -> tuple[Floats, Floats] | None:
    """Largest movements down (≤ 0) and up (≥ 0) of each coordinate (T, n) in one step; None without any bounds."""
    lower, upper, positive = stack.lower, stack.upper, stack.positive
    if not (np.isfinite(lower).any() or np.isfinite(upper).any() or positive.any()):
        return None
    here = stack.coordinates(points)
    down = lower - here
    return np.where(positive, np.maximum(down, (POSITIVE_KEPT - 1.0) * here), down), upper - here


def _bounded_step(
    normal: Floats, gradient: Floats, damping: Floats, scale: Floats, limits: tuple[Floats, Floats] | None
) -> tuple[Floats, Floats]:
    """The damped step (T, n) inside the bounds, and the largest slope (T,) along a coordinate that is free to move.

    The normal equations (T, n, n) and the gradient (T, n) are in scaled coordinates, with a diagonal of at most 1.
    A coordinate at a bound that the gradient pushes against is held. Those that a step takes beyond a bound are put on
    it, and the step is computed anew for the others.
    """
    if limits is None:
        return _solved(normal, gradient, damping, None) / scale, np.abs(gradient).max(axis=1, initial=0.0)
    down, up = limits[0] * scale, limits[1] * scale
    held = ((down >= 0.0) & (gradient >= 0.0)) | ((up <= 0.0) & (gradient <= 0.0))
    slope = np.abs(np.where(held, 0.0, gradient)).max(axis=1, initial=0.0)
    step = np.zeros_like(gradient)
    for revision in range(REVISIONS + 1):
        rest = gradient + (normal @ np.where(held, step, 0.0)[:, :, None])[:, :, 0]
        found = np.where(held, step, _solved(normal, rest, damping, held))
        beyond = ~held & ((found < down) | (found > up))
        step = np.where(held, step, np.clip(found, down, up))
        if revision == REVISIONS or not beyond.any():
            break
        held = held | beyond
    return step / scale, slope


def _solved(normal: Floats, gradient: Floats, damping: Floats, held: Mask | None) -> Floats:
    """``-(normal + damping)⁻¹ gradient`` for each trial, with the coordinates that are ``held`` left out."""
    matrix = normal.copy()
    n = matrix.shape[1]
    if held is not None and held.any():
        matrix[held[:, :, None] | held[:, None, :]] = 0.0
        gradient = np.where(held, 0.0, gradient)
        damping = np.where(held, 1.0, damping[:, None])
    else:
        damping = damping[:, None]
    places = np.arange(n)
    matrix[:, places, places] += damping + REGULARISATION
    # A column that has been exactly zero so far has a zero on the diagonal too: only the damping keeps it regular.
    return np.asarray(np.linalg.solve(matrix, -gradient[:, :, None])[:, :, 0], dtype=np.float64)


def _promise(jacobian: Floats, residuals: Floats, step: Floats) -> Floats:
    """The decrease of Σ r² that the linear model promises for each step, shape (T,)."""
    image = (jacobian @ step[:, :, None])[:, :, 0]
    decrease: Floats = -(image * (image + 2.0 * residuals)).sum(axis=1)
    return decrease
