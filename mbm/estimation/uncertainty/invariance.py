"""Movements that no sum of squares notices, although the residuals do: a drive turned about the only anchor there is.

Where noise is stated along the axes of a world that may be turned, residuals turn with it: none keeps its value, the
sum of their squares does. The Jacobian then sees the movement by the residuals, and a standard deviation made of
it says how large these are. The cost has no curvature there: the derivative of its gradient, taken along with
the covariance, has an eigenvalue of zero, where that of ``JᵀJ`` is 1 in all directions. It is found by Lanczos'
method from differences of the gradient (Golub and Van Loan 2013, section 10.1), and is believed where the cost is the
same some way off as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Minimum, Observability
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.estimation.uncertainty.freedom import free_combinations, touched_by
from mbm.values import dataclass

SEEN = 10.0
"""Condition below which nothing is looked for: residuals are that much smaller than what moves, in any drive."""

TURNS = 0.2
"""Of a free movement one standard deviation turns the residuals, whose length is √cost, by 1/√cost rad, and moves some
unknown by that share of its size. If all are known five times better, nothing is looked for."""

SPACED = 1e-5
"""Share of its size by which a number goes either way for a difference of the gradient: truncated and rounded alike."""

ROUNDED_AWAY = 1e-9
"""Share of its error below which a number is 0 but for rounding."""

MOST_STEPS = 40
"""Lanczos' steps; the zero stands apart from the others, and some ten find it."""

FLAT, CERTAIN = 1e-2, 1e-7
"""Curvature, as a share of that of ``JᵀJ``, that may be none where the minimum is known to rounding of the cost; and
how well its direction is known at the end."""

BENDS, HIDDEN = 0.1, 0.01
"""Curvature that is not that of a free direction; and what the first step has of one at least, of an even share."""

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
    """At a minimum ``image``, J, of steps (n,), its transpose ``back``, and (JᵀJ)⁺, which is ``solve``; and of points
    half of the gradient of the cost (n,). The unknowns have the ``size`` (n,) and
    standard deviations ``sigma`` (n,); None: these are not known yet.
    """

    image: Callable[[Floats], Floats]
    back: Callable[[Floats], Floats]
    solve: Callable[[Floats], Floats]
    gradient: Callable[[Floats], Floats]
    size: Floats
    sigma: Floats | None = None


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
    if equations.linear or held or bool(observed.fixed.any()) or not observed.condition > SEEN:
        return observed, point
    if equations.likely or equations.implicit is not None or not minimum.reason.converged or not minimum.cost > 0.0:
        return observed, point
    metric = _dense(equations, minimum, observed) if minimum.blocks is None else _sparse(equations, minimum, observed)
    if metric.sigma is not None and not (metric.sigma / metric.size).max() * np.sqrt(minimum.cost) > TURNS:
        return observed, point
    found: list[Floats] = []
    while len(found) < MOST:
        flat = _flattest(equations, metric, found, point)
        if flat is not None and abs(flat.share) > CERTAIN:
            nearer = equations.retract(point, flat.newton)
            flat, point = _flattest(equations, metric, found, nearer), nearer
        if flat is None or not _stays(equations, minimum, metric, flat.direction, settings):
            break
        found.append(flat.direction)
    if not found:
        return observed, minimum.point
    return _freed(equations, minimum, observed, np.stack(found, axis=1)), point


def _dense(equations: Assembled, minimum: Minimum, observed: Observability) -> _Metric:
    strengths = observed.singular_values[: observed.row_space.shape[1]]
    factor = observed.row_space / strengths / observed.scale[:, None]

    def gradient(point: Floats) -> Floats:
        residuals, slopes = equations.linearised(point)
        return np.asarray(residuals @ slopes)

    sigma = np.sqrt(np.einsum("ij,ij->i", factor, factor))
    return _Metric(
        size=_sizes(equations, minimum.point, sigma),
        sigma=sigma,
        image=lambda step: np.asarray(minimum.jacobian @ step),
        back=lambda right: np.asarray(right @ minimum.jacobian),
        solve=lambda right: np.asarray(factor @ (right @ factor)),
        gradient=gradient,
    )


def _sparse(equations: Assembled, minimum: Minimum, observed: Observability) -> _Metric:
    # Here and below: loaded by sparse problems only, so that the others start at once.
    from mbm.sparse.equations import blocked
    from mbm.sparse.inverse import inverse_of
    from mbm.sparse.system import blocks_of

    blocks, own, inverse = blocks_of(minimum), blocked(equations), inverse_of(observed.inverse)
    plan, layout = blocks.plan, blocks.plan.structure

    def gradient(point: Floats) -> Floats:
        values = own.block_jacobian(point, plan.arithmetic)
        return np.asarray(plan.gradient(values, own.residuals(point))[layout.free])

    def back(right: Floats) -> Floats:
        whole = right if layout.rows is None else np.zeros(layout.count)
        if layout.rows is not None:
            whole[layout.rows] = right
        return np.asarray(plan.gradient(blocks.values, whole)[layout.free])

    alike = np.abs(inverse.solve(back(np.cos(np.arange(equations.count)))[:, None])[:, 0])
    return _Metric(
        size=_sizes(equations, minimum.point, alike),
        back=back,
        image=lambda step: plan.image(blocks.values, layout.padded(step)),
        solve=lambda right: inverse.solve(right[:, None])[:, 0],
        gradient=gradient,
    )


def _sizes(equations: Assembled, point: Floats, errors: Floats) -> Floats:
    """The largest number of the unknown that a coordinate (n,) belongs to; 1 for what turns, and where all are 0.

    Numbers that are nothing beside their ``errors`` (n,) are 0 but for rounding: these are their sizes.
    """
    layout = equations.layout
    found = np.ones(len(layout.number))
    for entry in layout.entries:
        found[entry.coordinates] = float(np.abs(point[entry.range]).max(initial=0.0)) or 1.0
    found[(layout.number < 0) | layout.angle] = 1.0
    own = found[equations.free]
    return np.where(own > ROUNDED_AWAY * errors, own, errors)


@np.errstate(all="ignore")
def _flattest(equations: Assembled, metric: _Metric, known: list[Floats], point: Floats) -> _Flat | None:
    """Along what the cost has no curvature at a point, beside directions that are ``known``; None: along nothing."""
    steps, images = list(known), [metric.image(each) for each in known]
    first = len(steps)
    diagonal: list[float] = []
    beside: list[float] = []
    size = equations.dimension - first
    step = metric.solve(metric.back(np.cos(np.arange(equations.count))))
    for _ in range(min(MOST_STEPS, size)):
        step, length = _apart(metric, step, steps, images)
        if not np.isfinite(length) or not length > 0.0:
            return None
        if len(steps) > first:
            beside.append(length)
        steps.append(step / length)
        images.append(metric.image(steps[-1]))
        part = SPACED / float(np.abs(steps[-1] / metric.size).max())
        ends = [metric.gradient(equations.retract(point, side * part * steps[-1])) for side in (1.0, -1.0)]
        step = metric.solve((ends[0] - ends[1]) / (2.0 * part))
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
    return _Flat(direction=basis @ axes[:, 0], share=float(shares[0]), newton=basis @ (along - newton) - further)


def _apart(metric: _Metric, step: Floats, steps: list[Floats], images: list[Floats]) -> tuple[Floats, float]:
    """What a step (n,) has beside others, and its length in standard deviations."""
    for _ in range(2):
        image = metric.image(step)
        for each, seen in zip(steps, images, strict=True):
            step = step - each * float(seen @ image)
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


def _freed(equations: Assembled, minimum: Minimum, observed: Observability, directions: Floats) -> Observability:
    """``observed`` with the ``directions`` (n, k) free."""
    scale, point = observed.scale, equations.coordinates(minimum.point)
    lost = np.linalg.qr(scale[:, None] * directions)[0]
    count = lost.shape[1]
    freed = replace(
        observed,
        rank=observed.rank - count,
        null_space=np.hstack([observed.null_space, lost]),
        combinations=(*observed.combinations, *free_combinations(lost, scale, point)),
        estimable=observed.estimable & ~touched_by(lost),
        unnoticed=count,
    )
    if observed.inverse is not None:
        from mbm.sparse.inverse import constrained_inverse, inverse_of

        held = constrained_inverse(inverse_of(observed.inverse), (scale[:, None] * lost).T, np.ones(count, dtype=bool))
        return replace(freed, inverse=held.inverse)
    kept = np.linalg.qr(observed.row_space.T @ lost, mode="complete")[0][:, count:]
    basis = observed.row_space @ kept
    _, strengths, right = np.linalg.svd(minimum.jacobian / scale @ basis, full_matrices=False)
    condition = float(strengths[0] / strengths[-1]) if len(strengths) else 1.0
    return replace(freed, row_space=basis @ right.T, singular_values=strengths, condition=condition)
