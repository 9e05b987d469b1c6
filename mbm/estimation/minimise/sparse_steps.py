"""Steps of the sparse solver: by factors of the place before, by those of the place, or by Newton's method; limited."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from mbm.equations.types import Equations, Floats, Reason
from mbm.problem.types import Method
from mbm.solver.decisions import REACH
from mbm.solver.step_control import relative_offset
from mbm.sparse.normal import Normal
from mbm.sparse.place import RULES, BlockEquations, Place, length_of, limited, newton_step, normal_at
from mbm.sparse.rank import decided
from mbm.sparse.system import Factorised, Plan, factorised
from mbm.values import dataclass

DIAGONAL = (1e-6, 1e32)
"""Range of the metric's squares."""

CLOSE = 1e-2
"""At an offset below this the Jacobian hardly changes any more: the factors of the place before are tried again …"""

QUICK = 0.25
"""… and kept as long as each step brings the offset below this share."""

HIDDEN = 100.0
"""Pivots so many times as large as damping or rounding, or less, are not known to a per cent."""

BOX_ROUNDS = 20
"""Times that a step is solved for again because it would leave the box."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """What need not be computed again: ``normal`` of the place; ``factors``, those of the place if its ``normal`` is
    there, else of the place before; the ``step`` to try from the place, and the decrease that it promises; the
    ``whole`` one, undamped and not limited, likewise. ``examined``: whether damping hides a direction has been decided.
    """

    normal: Normal | None = None
    factors: Factorised | None = None
    step: tuple[Floats, float] | None = None
    whole: tuple[Floats, float] | None = None
    examined: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """An immutable value; ``reason`` is None while there is something left to do. ``growth`` is Nielsen's ν.

    Of a ``point`` that was accepted only the residuals are known at first (``place`` None), and the old Jacobian is
    given up before the new one is made. ``back`` is where to go on if a derivative there is not finite, or if the cost
    cannot judge the point and the offset there is no better; None once the point stands.

    ``rule`` says how steps are limited: by ``damping``, or to a ``radius``; then ``length`` is that of the last step,
    and ``limited`` whether it was. ``slow``: Gauss-Newton's steps converge so slowly that Newton's pay. ``before`` is
    the offset that a whole step led from to the point (infinite: it was not whole), ``trials`` counts those from there.
    ``least`` is the damping that is as good as none. ``weak``: some direction is known so weakly that even that hides
    it, and the triangle of the Jacobian is asked for undamped steps (None: nothing has looked so yet).
    """

    equations: BlockEquations
    plan: Plan
    place: Place | None
    known: Known
    point: Floats
    residuals: Floats
    tolerance: float
    rule: Method
    least: float
    damping: float
    growth: float
    radius: float
    length: float
    limited: bool
    slow: bool
    weak: bool | None
    offset: float
    before: float
    trials: int
    back: State | None
    iterations: int
    evaluations: int
    reason: Reason | None
    bad_row: int | None


def recalled(equations: BlockEquations, state: State, here: Place) -> State:
    """The state with a step by what is known already, else without factors of another place."""
    known = state.known
    if known.step is not None:
        return state
    if known.whole is not None:
        return _within(state, here, known.whole)
    if known.normal is not None or known.factors is None:
        return state
    if state.offset <= CLOSE and not state.slow and (equations.linear or not state.weak):
        step = _along(known.factors, here)
        promise = 0.0 if step is None else _promise(state.plan, here, step)
        if step is not None and promise > 0.0 and offset_at(equations, here, promise) <= QUICK * state.offset:
            return _within(state, here, (step, promise))
    return replace(state, known=Known())


def proposed(equations: BlockEquations, state: State, here: Place) -> State:
    """The state with a step over the padded columns; without one where the equations cannot be factorised."""
    if state.known.step is not None:
        return state
    normal = normal_at(state.plan, here) if state.known.normal is None else state.known.normal
    step, factors = _solved(state, here, normal)
    state = replace(state, known=Known(normal=normal, factors=factors))
    if state.weak and state.damping <= state.least and (factors is None or _lost(state, here, factors)):
        exact = _exact(state, here, affine=equations.linear)
        state = replace(state, weak=equations.linear or exact is not None, known=replace(state.known, examined=True))
        step = step if exact is None else exact
    if step is None:
        return state
    found = (step, _promise(state.plan, here, step))
    if factors is not None and state.slow:
        state, found = _newton(equations, state, here, factors, found)
    return _within(state, here, found)


def _newton(
    equations: BlockEquations, state: State, here: Place, factors: Factorised, found: tuple[Floats, float]
) -> tuple[State, tuple[Floats, float]]:
    """Newton's step in place of the one ``found``, with a radius for it; not where it leaves the box."""
    step, promise = newton_step(equations, state.plan, here, factors)
    low, high = (-inf, inf) if here.gaps is None else here.gaps
    if not (promise > 0.0 and bool((np.isfinite(step) & (step >= low) & (step <= high)).all())):
        return state, found
    length = length_of(step, np.clip(here.squares, *DIAGONAL))
    return replace(state, radius=max(state.radius, min(length, REACH * state.radius))), (step, promise)


def _within(state: State, here: Place, whole: tuple[Floats, float]) -> State:
    """The state with the ``whole`` step and what it promises, limited to the radius where that is the rule."""
    if state.rule not in RULES:
        return replace(state, known=replace(state.known, step=whole))
    squares = np.clip(here.squares, *DIAGONAL)
    step = limited(state.rule, state.plan, here, whole[0], squares, state.radius)
    shorter = step is not whole[0]
    promise = _promise(state.plan, here, step) if shorter else whole[1]
    known = replace(state.known, step=(step, promise), whole=whole)
    return replace(state, known=known, length=length_of(step, squares), limited=shorter)


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
        factors = factorised(state.plan, normal, np.where(still, 1.0, state.damping * np.clip(here.squares, *DIAGONAL)))
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
        normal = state.plan.accumulate(here.values, np.where(still, 0.0, 1.0))
        step = np.where(still, step, 0.0)
        gradient = here.gradient + state.plan.gradient(here.values, state.plan.image(here.values, step))
    return step, None


def unexamined(state: State, here: Place) -> bool:
    """Whether the undamped step may lack a direction, and nothing has looked whether it does."""
    known = state.known
    if known.examined or known.normal is None or known.factors is None or state.damping > state.least:
        return False
    return _lost(state, here, known.factors)


def _lost(state: State, here: Place, factors: Factorised) -> bool:
    """Whether damping or rounding hides what the normal equations know of some direction."""
    layout = state.plan.structure
    squares = np.where(layout.dead | here.held, 1.0, np.clip(here.squares, *DIAGONAL))
    rounding = float(np.finfo(float).eps) * layout.count**0.5
    return bool(factors.least_pivot(squares) <= HIDDEN * max(state.damping, rounding))


def _exact(state: State, here: Place, *, affine: bool) -> Floats | None:
    """The undamped step of least norm by the triangle of the Jacobian.

    None where the normal equations do as well, or bounds are in the way.
    """
    layout = state.plan.structure
    found = decided(state.plan, here.values, layout.dead | here.held, affine=affine)
    if not found.triangular:
        return None
    whole = layout.padded(found.inverse.solve(-here.gradient[layout.free][:, None])[:, 0])
    low, high = (-inf, inf) if here.gaps is None else here.gaps
    return whole if bool((np.isfinite(whole) & (whole >= low) & (whole <= high)).all()) else None


def _promise(found: Plan, here: Place, step: Floats) -> float:
    """The decrease of the cost if the residuals were linear."""
    image = found.image(here.values, step)
    return -float(2.0 * (here.gradient @ step) + image @ image)


def offset_at(equations: Equations, here: Place, promise: float) -> float:
    """The relative offset of a place from where the promised decrease leads."""
    moving = equations.dimension - int(here.held.sum())
    return relative_offset(promise, max(here.cost - promise, 0.0), moving, equations.count - moving)
