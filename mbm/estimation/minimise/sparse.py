"""Marquardt's method on block-sparse normal equations, and others that differ in how they limit steps.

Damping as Nielsen (1999) adapts it, less where the linear model holds, with the diagonal of ``JᵀJ`` as the metric,
clamped as Ceres does. Points without a finite residual or Jacobian are refused, the cost never grows by more than its
rounding, and the iteration ends where the dense solvers end: at a relative offset below the tolerance (Bates and Watts
1981), or at rounding. The dogleg and Gauss-Newton limit undamped steps to a trust radius (Moré 1978): `limited`.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite
from typing import Any

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import first_bad
from mbm.equations.pushing import pushed
from mbm.equations.types import Equations, Floats, Minimum, Reason
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from mbm.solver.decisions import LEAST_GAIN_RATIO, OFFSET_DECREASE, REACH, SLOW_OFFSET, UNDECIDED
from mbm.solver.step_control import damping_factor, radius_after, relative_offset, remaining
from mbm.sparse.deferred import DeferredMatrix
from mbm.sparse.equations import blocked
from mbm.sparse.limited import RULES, length_of, limited
from mbm.sparse.newton import newton_step
from mbm.sparse.normal import Normal
from mbm.sparse.place import BlockEquations, Place, counted_as, first_bad_slope, inside, moved, normal_at, place_at
from mbm.sparse.system import BlockJacobian, Factorised, Plan, factorised, plan
from mbm.values import dataclass

FIRST = 1e-4
"""Damping of the first step, relative to the diagonal."""

GOOD = 0.75
"""Gain ratio above which the linear model holds, so that …"""

RELIEF = 0.1
"""… damping shrinks faster than Nielsen's rule has it: the far ends of long chains of poses are damped long before
anything else is."""

LEAST = 1e-10
"""Damping that is as good as none, and keeps singular equations solvable."""

MOST = 1e16
"""Damping at which no step is left."""

DIAGONAL = (1e-6, 1e32)
"""Range of the metric's squares."""

CLOSE = 1e-2
"""At an offset below this the Jacobian hardly changes any more: the factors of the place before are tried again …"""

QUICK = 0.25
"""… and kept as long as each step brings the offset below this share."""

TRIALS = 60
"""Trial points in one iteration."""

MANY = 15.0
"""Steps from which on one of Newton's is worth the derivatives at as many points that it takes."""

BOX_ROUNDS = 20
"""Times that a step is solved for again because it would leave the box."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """What need not be computed again: ``normal`` of the place; ``factors``, those of the place if its ``normal`` is
    there, else of the place before; the ``step`` from the place, and the decrease that it promises; the ``whole`` one,
    undamped and not limited, likewise.
    """

    normal: Normal | None = None
    factors: Factorised | None = None
    step: tuple[Floats, float] | None = None
    whole: tuple[Floats, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """An immutable value; ``reason`` is None while there is something left to do. ``growth`` is Nielsen's ν.

    ``rule`` says how steps are limited: by ``damping``, or to a ``radius``; then ``length`` is that of the last step,
    and ``limited`` whether it was. ``slow``: Gauss-Newton's steps converge so slowly that Newton's pay.
    """

    equations: BlockEquations
    plan: Plan
    place: Place | None
    known: Known
    point: Floats
    residuals: Floats
    tolerance: float
    rule: Method
    damping: float
    growth: float
    radius: float
    length: float
    limited: bool
    slow: bool
    offset: float
    iterations: int
    evaluations: int
    reason: Reason | None
    bad_row: int | None


@np.errstate(all="ignore")
def sparse_minimum(equations: Equations, start: Floats, settings: Settings, made: Plan | None = None) -> Minimum:
    """The minimum that a start (N,) leads to; its Jacobian (m, n) becomes a SciPy CSR array when it is looked at.

    Equations are assembled ones, which are taken apart into blocks, or know their blocks, for which a plan may be
    ``made`` already. Threads share heavy work; the answers do not depend on their number.
    """
    own = _blocks(equations)
    if own is None:
        message = "equations without blocks"
        raise TypeError(message)
    state = _begun(own, start, settings, made)
    while state.reason is None and state.iterations < settings.max_iterations and state.place is not None:
        if settings.stopped():
            return _answer(state, Reason.INTERRUPTED)
        here = state.place
        exact = here.cost <= here.rounding
        state = replace(state, reason=Reason.EXACT_FIT, offset=0.0) if exact else _stepped(own, state, here)
    return _answer(state, state.reason or Reason.MAX_ITERATIONS)


def _blocks(equations: Equations) -> BlockEquations | None:
    if isinstance(equations, BlockEquations):
        return equations
    return blocked(equations) if isinstance(equations, Assembled) else None


def _begun(equations: BlockEquations, start: Floats, settings: Settings, made: Plan | None) -> State:
    found = plan(equations.structure(), equations.backend, settings.workers) if made is None else made
    rule = Method.DOGLEG if settings.method in (Method.AUTO, Method.DIRECT_SEARCH) else settings.method
    point = inside(equations, start)
    residuals = equations.residuals(point)
    row, reason, place = first_bad(residuals), Reason.NOT_FINITE_AT_START, None
    if row is None and not isfinite(float(residuals @ residuals)):
        row = int(np.argmax(np.abs(residuals)))
    if row is None:
        values = equations.block_jacobian(point, found.arithmetic)
        place, reason = place_at(equations, found, point, residuals, values), Reason.JACOBIAN_NOT_FINITE_AT_START
        row = None if place is not None else first_bad_slope(found.structure, values)
    return State(
        equations=equations,
        plan=found,
        place=place,
        known=Known(),
        point=point,
        residuals=residuals,
        tolerance=settings.tolerance,
        rule=rule,
        damping=LEAST if equations.linear or rule in RULES else FIRST,
        growth=2.0,
        radius=inf,
        length=inf,
        limited=False,
        slow=False,
        offset=inf,
        iterations=0,
        evaluations=1,
        reason=None if place is not None else reason,
        bad_row=None if row is None else counted_as(equations, found.structure, row),
    )


def _stepped(equations: BlockEquations, state: State, here: Place) -> State:
    last = state
    for _ in range(TRIALS):
        state, found = _next(state, here)
        if found is None:
            state = _shortened(state)
            continue
        step, promise = found
        if promise <= 0.0 and state.damping < MOST and bool(step.any()):
            state = _shortened(state)
            continue
        point = moved(equations, here, state.plan, step)
        offset = _offset(equations, here, promise if state.known.whole is None else state.known.whole[1])
        if offset <= state.tolerance and (state.damping > LEAST or state.known.normal is None):
            state = replace(state, damping=LEAST, known=Known(normal=state.known.normal))
            continue
        if not state.slow and _creeps(last, offset):
            state = replace(state, slow=True, known=Known(normal=state.known.normal))
            continue
        state = replace(state, offset=offset)
        if offset > CLOSE:  # these factors are of no use elsewhere, and make room for the next Jacobian
            state = replace(state, known=replace(state.known, factors=None))
        if offset <= state.tolerance:
            return _ended(state, Reason.SMALL_OFFSET)
        undecided = promise <= UNDECIDED * here.rounding
        residuals = equations.residuals(point)
        cost = float(residuals @ residuals)
        state = replace(state, evaluations=state.evaluations + 1)
        share = (here.cost - cost) / promise if isfinite(cost) else -inf
        good = here.cost - cost >= -here.rounding if undecided else share > LEAST_GAIN_RATIO
        there = None
        if good:
            values = equations.block_jacobian(point, state.plan.arithmetic)
            there = place_at(equations, state.plan, point, residuals, values)
        if there is not None:
            moved_on = _accepted(state, there, 1.0 if undecided else share)
            if not undecided:
                return moved_on
            better = _better(equations, moved_on, there)
            return _ended(state, Reason.ROUNDING) if better is None else better
        if undecided and isfinite(cost):
            return _ended(state, Reason.ROUNDING)
        if state.damping >= MOST:
            return _ended(state, Reason.FLAT if isfinite(cost) else Reason.NO_FINITE_STEP)
        state = _shortened(state)
    return _ended(state, Reason.FLAT)


def _answer(state: State, reason: Reason) -> Minimum:
    layout, place, residuals = state.plan.structure, state.place, state.residuals
    free = layout.free
    sides = np.zeros(len(free), dtype=np.int8)
    if place is not None and place.held.any():
        slopes = state.plan.gradient(place.values, place.residuals)[free]
        sides[place.held[free]] = np.where(slopes[place.held[free]] > 0.0, -1, 1)
        lengths = np.sqrt(place.squares[free])
        sides = pushed(sides, slopes, lengths, state.equations.coordinates(place.point), place.cost)
    if layout.rows is not None:
        residuals = residuals[layout.rows]
    values = layout.zeros() if place is None else place.values
    jacobian: Any = DeferredMatrix((len(residuals), len(free)), lambda: layout.estimated(values))
    return Minimum(
        point=state.point,
        residuals=residuals,
        jacobian=jacobian,
        blocks=BlockJacobian(plan=state.plan, values=values),
        cost=float(residuals @ residuals),
        reason=reason,
        iterations=state.iterations,
        evaluations=state.evaluations,
        offset=state.offset,
        at_bound=sides,
        bad_row=state.bad_row,
    )


def _next(state: State, here: Place) -> tuple[State, tuple[Floats, float] | None]:
    """The step from a place over the padded columns, what it promises, and the state that knows how it was found.

    None: the equations cannot be factorised with this damping.
    """
    known = state.known
    if known.step is not None:
        return replace(state, known=replace(known, step=None)), known.step
    if known.whole is not None:
        return _within(state, here, known.whole)
    if known.normal is None and known.factors is not None and state.offset <= CLOSE and not state.slow:
        step = _along(known.factors, here)
        promise = 0.0 if step is None else _promise(state.plan, here, step)
        if step is not None and promise > 0.0 and _offset(state.equations, here, promise) <= QUICK * state.offset:
            return (state, (step, promise)) if state.rule not in RULES else _within(state, here, (step, promise))
    normal = normal_at(state.plan, here) if known.normal is None else known.normal
    step, factors = _solved(state, here, normal)
    found = None if step is None else (step, _promise(state.plan, here, step))
    state = replace(state, known=Known(normal=normal, factors=factors))
    if found is not None and factors is not None and state.slow:
        state, found = _newton(state, here, factors, found)
    return (state, found) if found is None or state.rule not in RULES else _within(state, here, found)


def _newton(
    state: State, here: Place, factors: Factorised, found: tuple[Floats, float]
) -> tuple[State, tuple[Floats, float]]:
    """Newton's step in place of the one ``found``, with a radius for it; not where it leaves the box."""
    step, promise = newton_step(state.equations, state.plan, here, factors)
    low, high = (-inf, inf) if here.gaps is None else here.gaps
    if not (promise > 0.0 and bool((np.isfinite(step) & (step >= low) & (step <= high)).all())):
        return state, found
    length = length_of(step, np.clip(here.squares, *DIAGONAL))
    return replace(state, radius=max(state.radius, min(length, REACH * state.radius))), (step, promise)


def _creeps(last: State, offset: float) -> bool:
    """Whether steps near the minimum need many more at the rate of the last one, which was whole."""
    whole = last.damping <= LEAST and not last.limited
    slow = SLOW_OFFSET * last.offset < offset <= CLOSE
    return whole and slow and remaining(offset, last.offset, last.tolerance) > MANY


def _within(state: State, here: Place, whole: tuple[Floats, float]) -> tuple[State, tuple[Floats, float]]:
    """The ``whole`` step and what it promises, limited to the radius, and the state that knows both."""
    squares = np.clip(here.squares, *DIAGONAL)
    step = limited(state.rule, state.plan, here, whole[0], squares, state.radius)
    shorter = step is not whole[0]
    promise = _promise(state.plan, here, step) if shorter else whole[1]
    known = replace(state.known, whole=whole)
    return replace(state, known=known, length=length_of(step, squares), limited=shorter), (step, promise)


def _along(factors: Factorised, here: Place) -> Floats | None:
    """The step by factors of another place; None with bounds, or if it is not finite."""
    if here.gaps is not None or here.held.any():
        return None
    step = factors.solve(-here.gradient[:, None])[:, 0]
    return step if bool(np.isfinite(step).all()) else None


def _solved(state: State, here: Place, normal: Normal) -> tuple[Floats | None, Factorised | None]:
    """The damped step over the padded columns, with the factors; None where the equations cannot be factorised.

    With bounds: what would leave the box is put on its bound, and the rest solved again, without factors that stay.
    """
    layout = state.plan.structure
    gradient, still = here.gradient, layout.dead | here.held
    step = np.zeros(layout.columns)
    for solves in range(BOX_ROUNDS):
        added = state.damping * np.clip(here.squares, *DIAGONAL)
        added[still] = 1.0
        factors = factorised(state.plan, normal, added)
        if factors is None:
            return None, None
        found = factors.solve(-np.where(still, 0.0, gradient)[:, None])[:, 0]
        step = np.where(still, step, found)
        if not bool(np.isfinite(step).all()):
            return None, None
        if here.gaps is None:
            return step, factors
        crossing = ((step < here.gaps[0]) | (step > here.gaps[1])) & ~still
        step = np.clip(step, *here.gaps)
        if not crossing.any():
            return step, factors if solves == 0 else None
        still = still | crossing
        normal = state.plan.accumulate(layout.weighted(here.values, np.where(still, 0.0, 1.0)))
        step = np.where(still, step, 0.0)
        gradient = here.gradient + state.plan.gradient(here.values, state.plan.image(here.values, step))
    return step, None


def _promise(found: Plan, here: Place, step: Floats) -> float:
    """The decrease of the cost if the residuals were linear."""
    image = found.image(here.values, step)
    return -float(2.0 * (here.gradient @ step) + image @ image)


def _offset(equations: Equations, here: Place, promise: float) -> float:
    moving = equations.dimension - int(here.held.sum())
    return relative_offset(promise, max(here.cost - promise, 0.0), moving, equations.count - moving)


def _better(equations: BlockEquations, state: State, there: Place) -> State | None:
    """The state at a point that the cost cannot judge, with the step from it, if the offset is clearly smaller."""
    found, onward = _next(state, there)
    if onward is None or not _offset(equations, there, onward[1]) <= OFFSET_DECREASE * state.offset:
        return None
    return replace(found, known=replace(found.known, step=onward))


def _shortened(state: State) -> State:
    """More damping, or a shorter radius; but factors of another place are given up first."""
    if state.known.normal is None and state.known.factors is not None:
        return replace(state, known=Known())
    if state.rule in RULES and state.known.whole is not None:
        return replace(state, radius=0.5 * min(state.radius, state.length), known=replace(state.known, step=None))
    return replace(
        state,
        damping=min(state.damping * state.growth, MOST),
        growth=2.0 * state.growth,
        known=replace(state.known, factors=None, step=None),
    )


def _accepted(state: State, there: Place, share: float) -> State:
    damping = max(state.damping * (RELIEF if share > GOOD else damping_factor(share)), LEAST)
    return replace(
        state,
        place=there,
        known=Known(factors=state.known.factors),
        point=there.point,
        residuals=there.residuals,
        damping=damping,
        growth=2.0,
        radius=radius_after(share, state.radius, state.length, int(not state.limited)),
        iterations=state.iterations + 1,
    )


def _ended(state: State, reason: Reason) -> State:
    return replace(state, reason=reason, iterations=state.iterations + 1)
