"""Movements that no sum of squares notices, although the residuals do: a drive turned about the only anchor there is.

Where noise is stated along the axes of a world that may be turned, residuals turn with it: none keeps its value, the
sum of their squares does. The Jacobian then sees the movement by the residuals, and a standard deviation made of
it says how large these are. The cost has no curvature there: the derivative of its gradient, taken along with
the covariance, has an eigenvalue of zero, where that of ``JᵀJ`` is 1 in all directions. It is found by Lanczos'
method from differences of the gradient (Golub and Van Loan 2013, section 10.1), and is believed where the cost is the
same some way off as well.

What data say by themselves turns with nothing: differences from them keep their values, or tell of the movement.

Where all places lie on one ray from the anchor, distances do not notice either if they are shifted across it: the
Jacobian has no derivative there, but the cost has a curvature. What is free is the turn, of which the shift is a part.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.turning import may_turn
from mbm.equations.types import Floats, Mask, Minimum, Observability
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.estimation.uncertainty.freedom import free_combinations, sizes, touched_by
from mbm.solver.decisions import decided_rank
from mbm.values import dataclass

SEEN = 10.0
"""Condition below which nothing is looked for: residuals are that much smaller than what moves, in any drive."""

TURNS = 0.2
"""Of a free movement one standard deviation turns the residuals, whose length is √cost, by 1/√cost rad, and moves some
unknown by that share of its size. If all are known five times better, nothing is looked for."""

SPACED = 1e-5
"""Share of its size by which a number goes either way for a difference of the gradient: truncated and rounded alike."""

HARDLY = 1e-4
"""Singular value, as a share of the largest, below which a descent may have left what is none; by the curvature of the
cost is then seen how well the movement is known."""

NO_BEND = 1e-6
"""Curvature, as a share of that along well determined unknowns, that is none."""

MOST_STEPS = 40
"""Lanczos' steps; the zero stands apart from the others, and some ten find it."""

FLAT, CERTAIN = 1e-2, 1e-7
"""Curvature, as a share of that of ``JᵀJ``, that may be none where the minimum is known to rounding of the cost; and
how well its direction is known at the end."""

NEARER = 3
"""Newton's steps at most from where a descent has ended to where the curvature is known so well."""

BENDS, HIDDEN = 0.1, 0.01
"""Curvature that is not that of a free direction; and what the first step has of one at least, of an even share."""

KEPT = 1e-3
"""Share of the change of all residuals that those from data may have, by which a free movement changes none."""

AWAY, FARTHEST = 0.1, 0.003
"""Standard deviations after which the cost has to be the same still; or this share of the unknowns' size."""

STAYED = 0.01
"""Share of that way that is left where the cost is least again: a descent slides along a valley, and ends in it."""

NONE_OF_IT = 1e-3
"""Share of what the Jacobian lets the cost grow by that is none …"""

ROUNDED = 1e-12
"""… and of the cost itself."""

DECISIVE = 10.0
"""Times that rounding of the cost by which it would have to grow, were the direction none: else nothing is shown."""

MOST = 7
"""Motions of a space with its size: no more directions are looked for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Metric:
    """At a minimum lengths of steps (n,), those of the ``image`` (k,): how much JᵀJ lets the cost grow by them, or its
    curvature along what J does not see. ``solve`` takes half of a gradient (n,) to the step that has it; of points
    half of the ``gradient`` of the cost (n,). ``start`` (n,) is a step of all kinds, ``seen`` (m,) what it does to the
    residuals. The unknowns have the ``size`` (n,) and standard deviations ``sigma`` (n,); None: not known yet. ``bent``
    (n, k) are the directions that the cost sees and J does not, orthonormal where scaled.
    """

    image: Callable[[Floats], Floats]
    solve: Callable[[Floats], Floats]
    gradient: Callable[[Floats], Floats]
    seen: Callable[[Floats], Floats]
    start: Floats
    size: Floats
    sigma: Floats | None = None
    bent: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Flat:
    """A ``direction`` (n,), one standard deviation long, along which the cost has so small a ``share`` of the curvature
    of ``JᵀJ``, and what leads nearer to the minimum, which is ``newton``'s step (n,).
    """

    direction: Floats
    share: float
    newton: Floats


def with_invariances(
    equations: Assembled, minimum: Minimum, observed: Observability, settings: Settings
) -> tuple[Observability, Floats]:
    """``observed``, in which directions along which the cost stays the same are free, and the point (N,) about which
    these are known: the minimum, or nearer to it than rounding of the cost lets a descent come.

    Nothing is looked for beside bounds and constraints that hold the estimates.
    """
    point = minimum.point
    held = minimum.constraints is not None and bool(minimum.constraints.forcing.any())
    seen = observed.rank == observed.dimension and not observed.condition > SEEN
    if equations.linear or held or bool(observed.fixed.any()) or seen or observed.rank == 0:
        return observed, point
    if equations.likely or equations.implicit is not None or not minimum.reason.converged or not minimum.cost > 0.0:
        return observed, point
    turning = may_turn(equations)
    if not bool(turning.any()):
        return observed, point
    metric = _dense(equations, minimum, observed) if minimum.blocks is None else _sparse(equations, minimum, observed)
    if metric.sigma is not None and not (metric.sigma / metric.size).max() * np.sqrt(minimum.cost) > TURNS:
        return observed, point
    found: list[Floats] = []
    while len(found) < MOST:
        flat = _flattest(equations, metric, found, point)
        for _ in range(NEARER):
            if flat is None or abs(flat.share) <= CERTAIN:
                break
            point = equations.retract(point, flat.newton)
            flat = _flattest(equations, metric, found, point)
        if flat is None or _told(metric, flat.direction, turning):
            break
        if not _stays(equations, minimum, metric, flat.direction, settings):
            break
        found.append(flat.direction)
    if not found:
        return observed, minimum.point
    return _freed(equations, minimum, observed, np.stack(found, axis=1), metric.bent), point


def curved_directions(equations: Assembled, minimum: Minimum, observed: Observability) -> Floats:
    """The free directions (n, k), scaled, that are free to first order only: the cost has a curvature along them.

    Of sparse problems, and beside limits, nobody looks.
    """
    held = minimum.constraints is not None and bool(minimum.constraints.forcing.any())
    null, straight = observed.null_space[:, len(observed.unused) :], equations.linear or observed.inverse is not None
    if straight or held or equations.likely or equations.implicit is not None or not minimum.reason.converged:
        return null[:, :0]
    size = sizes(equations.layout, equations.free, minimum.point, np.zeros(len(observed.scale)))

    def gradient(point: Floats) -> Floats:
        residuals, slopes = equations.linearised(point)
        return np.asarray(residuals @ slopes)

    return _bent(equations, minimum.point, gradient, null, observed.scale, size)[0]


def _told(metric: _Metric, direction: Floats, turning: Mask) -> bool:
    """Whether differences from data tell of a movement along the direction."""
    seen = metric.seen(direction)
    return not float(np.linalg.norm(seen[~turning])) < KEPT * float(np.linalg.norm(seen))


def _dense(equations: Assembled, minimum: Minimum, observed: Observability) -> _Metric:
    strengths = observed.singular_values[: observed.row_space.shape[1]]
    scale, axes = observed.scale, observed.row_space
    sigma = np.sqrt(np.square(axes / strengths / scale[:, None]).sum(axis=1))
    size = sizes(equations.layout, equations.free, minimum.point, sigma)

    def gradient(point: Floats) -> Floats:
        residuals, slopes = equations.linearised(point)
        return np.asarray(residuals @ slopes)

    unseen = _moving(observed)[:, : -int((strengths >= HARDLY * strengths[0]).sum())]
    bent, curvature = _bent(equations, minimum.point, gradient, unseen, scale, size)
    if len(curvature):
        axes, strengths, _ = _beside(minimum, observed, bent)
        axes, strengths = np.hstack([axes, bent]), np.concatenate([strengths, np.sqrt(curvature)])
    factor = axes / strengths / scale[:, None]
    return _Metric(
        size=size,
        sigma=sigma,
        image=lambda step: np.asarray(strengths * ((scale * step) @ axes)),
        solve=lambda right: np.asarray(factor @ (right @ factor)),
        gradient=gradient,
        seen=lambda step: np.asarray(minimum.jacobian @ step),
        start=factor @ np.cos(np.arange(len(strengths))),
        bent=bent,
    )


def _sparse(equations: Assembled, minimum: Minimum, observed: Observability) -> _Metric:
    # Here and below: loaded by sparse problems only, so that the others start at once.
    from mbm.sparse.equations import blocked
    from mbm.sparse.inverse import inverse_of
    from mbm.sparse.system import blocks_of

    blocks, own, inverse = blocks_of(minimum), blocked(equations), inverse_of(observed.inverse)
    plan, layout, scale = blocks.plan, blocks.plan.structure, observed.scale

    def gradient(point: Floats) -> Floats:
        values = own.block_jacobian(point, plan.arithmetic)
        return np.asarray(plan.gradient(values, own.residuals(point))[layout.free])

    def seen(step: Floats) -> Floats:
        every = plan.image(blocks.values, layout.padded(step))
        return every if layout.rows is None else every[layout.rows]

    random = np.zeros(layout.count)
    random[slice(None) if layout.rows is None else layout.rows] = np.cos(np.arange(equations.count))
    start = inverse.solve(plan.gradient(blocks.values, random)[layout.free][:, None])[:, 0]
    size = sizes(equations.layout, equations.free, minimum.point, np.abs(start))
    bent, curvature = _bent(equations, minimum.point, gradient, observed.null_space, scale, size)
    beside = bent / np.sqrt(curvature) / scale[:, None]
    return _Metric(
        size=size,
        image=lambda step: np.concatenate([seen(step), np.sqrt(curvature) * ((scale * step) @ bent)]),
        solve=lambda right: inverse.solve(right[:, None])[:, 0] + beside @ (right @ beside),
        gradient=gradient,
        seen=seen,
        start=start + beside.sum(axis=1),
        bent=bent,
    )


def _bent(
    equations: Assembled,
    point: Floats,
    gradient: Callable[[Floats], Floats],
    unseen: Floats,
    scale: Floats,
    size: Floats,
) -> tuple[Floats, Floats]:
    """The directions (n, k) among those that the Jacobian does not see (n, u), all scaled, along which the cost has a
    curvature, and that (k,); none where a descent would go on.
    """
    none = np.zeros((len(scale), 0)), np.zeros(0)
    if not 0 < unseen.shape[1] <= MOST:
        return none
    found = [_change(equations, gradient, point, each / scale, size) / scale for each in unseen.T]
    slopes = np.stack(found, axis=1)
    if not bool(np.isfinite(slopes).all()):
        return none
    _, sizes, right = np.linalg.svd(slopes, full_matrices=False)
    kept = right[sizes > NO_BEND].T
    inner = (unseen @ kept).T @ slopes @ kept
    curvature, axes = np.linalg.eigh((inner + inner.T) / 2.0)
    return (unseen @ kept @ axes, curvature) if bool((curvature > NO_BEND).all()) else none


@np.errstate(all="ignore")
def _change(
    equations: Assembled, gradient: Callable[[Floats], Floats], point: Floats, step: Floats, size: Floats
) -> Floats:
    """How half of the gradient changes along a step (n,), as much as it changes for all of that."""
    part = SPACED / float(np.abs(step / size).max())
    ends = [gradient(equations.retract(point, side * part * step)) for side in (1.0, -1.0)]
    return np.asarray((ends[0] - ends[1]) / (2.0 * part))


@np.errstate(all="ignore")
def _flattest(equations: Assembled, metric: _Metric, known: list[Floats], point: Floats) -> _Flat | None:
    """Along what the cost has no curvature at a point, beside directions that are ``known``; None: along nothing."""
    steps, images = list(known), [metric.image(each) for each in known]
    first = len(steps)
    diagonal: list[float] = []
    beside: list[float] = []
    size = equations.dimension - first
    step = metric.start
    for _ in range(min(MOST_STEPS, size)):
        step, length = _apart(metric, step, steps, images)
        if not np.isfinite(length) or not length > 0.0:
            return None
        if len(steps) > first:
            beside.append(length)
        steps.append(step / length)
        images.append(metric.image(steps[-1]))
        step = metric.solve(_change(equations, metric.gradient, point, steps[-1], metric.size))
        diagonal.append(float(metric.image(step) @ images[-1]))
        shares, axes = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
        left = _apart(metric, step, steps, images)[1] * abs(float(axes[-1, 0]))
        if not np.isfinite(left) or (shares[0] > BENDS and left < HIDDEN / np.sqrt(size)):
            return None
        if left < CERTAIN:
            break
    else:
        return None
    if not abs(shares[0]) < FLAT:
        return None
    basis, further = np.stack(steps[first:], axis=1), metric.solve(metric.gradient(point))
    along = np.array([float(each @ metric.image(further)) for each in images[first:]])
    newton = axes[:, 1:] @ ((along @ axes[:, 1:]) / shares[1:])
    direction = basis @ axes[:, 0]
    direction = direction / float(np.linalg.norm(metric.seen(direction)))
    return _Flat(direction=direction, share=float(shares[0]), newton=basis @ (along - newton) - further)


def _apart(metric: _Metric, step: Floats, steps: list[Floats], images: list[Floats]) -> tuple[Floats, float]:
    """What a step (n,) has beside others, and its length."""
    for _ in range(2):
        image = metric.image(step)
        for each, seen in zip(steps, images, strict=True):
            step = step - each * float(seen @ image) / float(seen @ seen)
    image = metric.image(step)
    return step, float(np.sqrt(image @ image))


def _stays(equations: Assembled, minimum: Minimum, metric: _Metric, direction: Floats, settings: Settings) -> bool:
    """Whether a minimum as deep lies along the direction, which the way back to this one would lead away from."""
    part = min(AWAY, FARTHEST / float(np.abs(direction / metric.size).max()))
    if not part**2 > DECISIVE * ROUNDED * minimum.cost:
        return False
    begun = equations.retract(minimum.point, part * direction)
    ended = minimise(equations, begun, settings)
    gone = float(np.linalg.norm(ended.point - minimum.point) / np.linalg.norm(begun - minimum.point))
    return gone > STAYED and abs(ended.cost - minimum.cost) < part**2 * NONE_OF_IT + ROUNDED * minimum.cost


def _moving(observed: Observability) -> Floats:
    """An orthonormal basis of all that the equations mention, scaled: what is free first, then what is known best."""
    return np.hstack([observed.null_space[:, len(observed.unused) :], observed.row_space[:, ::-1]])


def _beside(minimum: Minimum, observed: Observability, others: Floats) -> tuple[Floats, Floats, Floats]:
    """What the Jacobian sees beside ``others`` (n, k), orthonormal where scaled: directions, its singular values, and
    what it does not see.
    """
    every = _moving(observed)
    basis = every @ np.linalg.qr(every.T @ others, mode="complete")[0][:, others.shape[1] :]
    _, strengths, right = np.linalg.svd(minimum.jacobian / observed.scale @ basis)
    rank = decided_rank(len(strengths), strengths, 0)
    return basis @ right[:rank].T, strengths[:rank], basis @ right[rank:].T


def _freed(
    equations: Assembled, minimum: Minimum, observed: Observability, directions: Floats, bent: Floats
) -> Observability:
    """``observed`` with the ``directions`` (n, k) free, in place of as many of those that are ``bent``."""
    scale, point = observed.scale, equations.coordinates(minimum.point)
    lost = np.linalg.qr(scale[:, None] * directions)[0]
    count = lost.shape[1]
    null, inverse = observed.null_space[:, len(observed.unused) :], observed.inverse
    if inverse is None:
        axes, strengths, null = _beside(minimum, observed, lost)
        condition = float(strengths[0] / strengths[-1]) if len(strengths) else 1.0
        observed = replace(observed, row_space=axes, singular_values=strengths, condition=condition)
    elif bent.shape[1]:
        null = null @ np.linalg.qr(null.T @ bent, mode="complete")[0][:, bent.shape[1] :]
    else:
        from mbm.sparse.inverse import constrained_inverse, inverse_of

        slopes = (scale[:, None] * lost).T
        inverse = constrained_inverse(inverse_of(inverse), slopes, np.ones(count, dtype=bool)).inverse
    null, free = np.hstack([null, lost]), len(observed.unused)
    own = observed.null_space[:, :free] if observed.inverse is None else null[:, :0]
    combinations = observed.combinations if observed.inverse is not None else free_combinations(null, scale, point)
    return replace(
        observed,
        rank=observed.dimension - null.shape[1] - free,
        null_space=np.hstack([own, null]),
        combinations=combinations,
        estimable=(observed.estimable | touched_by(bent)) & ~touched_by(null),
        inverse=inverse,
        unnoticed=count,
    )
