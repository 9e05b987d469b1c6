"""Marquardt's method on block-sparse normal equations, and others that differ in how they limit steps.

Damping as Nielsen (1999) adapts it, less where the linear model holds, with the diagonal of ``JᵀJ`` as the metric,
clamped as Ceres does. Points without a finite residual or Jacobian are refused, the cost never grows by more than its
rounding, and the iteration ends where the dense solvers end: at a relative offset below the tolerance (Bates and Watts
1981), or at rounding. The dogleg and Gauss-Newton limit undamped steps to a trust radius (Moré 1978): `limited`.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import first_bad
from mbm.equations.types import Equations, Floats, Minimum, Reason
from mbm.equations.whitening import FLOOR
from mbm.estimation.minimise.sparse_steps import CLOSE, Known, State, offset_at, proposed, recalled, unexamined
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from mbm.solver.decisions import LEAST_GAIN_RATIO, OFFSET_DECREASE, SLOW_OFFSET, UNDECIDED
from mbm.solver.step_control import damping_factor, radius_after, remaining
from mbm.sparse.equations import blocked
from mbm.sparse.place import RULES, BlockEquations, Place, counted_as, first_bad_slope, inside, moved, place_at
from mbm.sparse.system import BlockJacobian, DeferredMatrix, Plan, plan

if TYPE_CHECKING:
    from numpy.typing import NDArray

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

TRIALS = 60
"""Trial points in one iteration."""

MANY = 15.0
"""Steps from which on one of Newton's is worth the derivatives at as many points that it takes."""


def least_damping(equations: BlockEquations) -> float:
    """`LEAST`, which is relative to the diagonal: less where that is of rows which weigh far more than others."""
    return LEAST * FLOOR**2 if equations.floored else LEAST


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
    while state.reason is None:
        # What is large lives as long as the state that holds it: each stage gives up what the next makes anew.
        here = state.place
        if here is None:
            state = _arrived(own, state)
        elif state.back is None and (reason := _limit(state, here, settings)) is not None:
            state = replace(state, reason=reason)
        else:
            state = recalled(own, state, here)
            state = proposed(own, state, here)
            state = _tried(own, state, here) if state.back is None else _confirmed(own, state, here)
    return _answer(_arrived(own, state) if state.place is None and state.bad_row is None else state)


def _blocks(equations: Equations) -> BlockEquations | None:
    if isinstance(equations, BlockEquations):
        return equations
    return blocked(equations) if isinstance(equations, Assembled) else None


def _begun(equations: BlockEquations, start: Floats, settings: Settings, made: Plan | None) -> State:
    found = plan(equations.structure(), equations.backend, settings.workers) if made is None else made
    rule = Method.DOGLEG if settings.method in (Method.AUTO, Method.DIRECT_SEARCH) else settings.method
    point = inside(equations, start)
    residuals = equations.residuals(point)
    row = first_bad(residuals)
    if row is None and not isfinite(float(residuals @ residuals)):
        row = int(np.argmax(np.abs(residuals)))
    return State(
        equations=equations,
        plan=found,
        place=None,
        known=Known(),
        point=point,
        residuals=residuals,
        tolerance=settings.tolerance,
        rule=rule,
        least=least_damping(equations),
        damping=least_damping(equations) if equations.linear or rule in RULES else FIRST,
        growth=2.0,
        radius=inf,
        length=inf,
        limited=False,
        slow=False,
        weak=True if equations.linear else None,
        offset=inf,
        before=inf,
        trials=0,
        back=None,
        iterations=0,
        evaluations=1,
        reason=None if row is None else Reason.NOT_FINITE_AT_START,
        bad_row=None if row is None else counted_as(equations, found.structure, row),
    )


def _limit(state: State, here: Place, settings: Settings) -> Reason | None:
    """Why there is nothing left to do, whatever the next step may be."""
    if settings.stopped():
        return Reason.INTERRUPTED
    if state.iterations >= settings.max_iterations:
        return Reason.MAX_ITERATIONS
    return Reason.EXACT_FIT if here.cost <= here.rounding else None


def _arrived(equations: BlockEquations, state: State) -> State:
    """The state with everything at its point, or the one to go back to; from the start there is none."""
    values = equations.block_jacobian(state.point, state.plan.arithmetic)
    place = place_at(equations, state.plan, state.point, state.residuals, values)
    if place is not None:
        doubtful = state.back is not None and state.back.reason is Reason.ROUNDING
        return replace(state, place=place, back=state.back if doubtful else None)
    row = counted_as(equations, state.plan.structure, first_bad_slope(state.plan.structure, values))
    return state.back or replace(state, reason=Reason.JACOBIAN_NOT_FINITE_AT_START, bad_row=row)


def _tried(equations: BlockEquations, state: State, here: Place) -> State:
    """The state after the step was tried: at the point where it leads, or where it was, with another step to find."""
    state = replace(state, trials=state.trials + 1)
    if state.trials > TRIALS:
        return _ended(state, Reason.FLAT)
    known = state.known
    if known.step is None:
        return _shortened(state)
    step, promise = known.step
    if promise <= 0.0 and state.damping < MOST and bool(step.any()):
        return _shortened(state)
    offset = offset_at(equations, here, promise if known.whole is None else known.whole[1])
    if offset <= state.tolerance and (state.damping > state.least or known.normal is None):
        return replace(state, damping=state.least, known=Known(normal=known.normal))
    stalling = state.weak is None and offset > SLOW_OFFSET * state.before
    if (stalling or (offset <= state.tolerance and not state.weak)) and unexamined(state, here):
        return replace(state, weak=True, known=Known(normal=known.normal))
    if not state.slow and _creeps(state, offset):
        return replace(state, slow=True, known=Known(normal=known.normal))
    state = replace(state, offset=offset)
    if offset <= state.tolerance:
        return _ended(state, Reason.SMALL_OFFSET)
    undecided = promise <= UNDECIDED * here.rounding
    point = moved(equations, here, state.plan, step)
    residuals = equations.residuals(point)
    cost = float(residuals @ residuals)
    state = replace(state, evaluations=state.evaluations + 1)
    share = (here.cost - cost) / promise if isfinite(cost) else -inf
    rejected = _rejected(state, finite=isfinite(cost), undecided=undecided)
    good = here.cost - cost >= -here.rounding if undecided else share > LEAST_GAIN_RATIO
    return _accepted(state, point, residuals, 1.0 if undecided else share, rejected) if good else rejected


def _rejected(state: State, *, finite: bool, undecided: bool) -> State:
    """The state if the point where the step leads is no good; ``finite`` says whether its cost is."""
    if undecided and finite:
        return _ended(state, Reason.ROUNDING)
    if state.damping >= MOST:
        return _ended(state, Reason.FLAT if finite else Reason.NO_FINITE_STEP)
    return _shortened(state)


def _confirmed(equations: BlockEquations, state: State, here: Place) -> State:
    """The state at a point that the cost cannot judge, if the offset there is clearly smaller; else the one before."""
    step = state.known.step
    better = step is not None and offset_at(equations, here, step[1]) <= OFFSET_DECREASE * state.offset
    return replace(state, back=None) if better or state.back is None else state.back


def _answer(state: State) -> Minimum:
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
        reason=state.reason or Reason.MAX_ITERATIONS,
        iterations=state.iterations,
        evaluations=state.evaluations,
        at_bound=sides,
        bad_row=state.bad_row,
    )


def _creeps(state: State, offset: float) -> bool:
    """Whether steps near the minimum need many more at the rate of the last one, which was whole."""
    slow = SLOW_OFFSET * state.before < offset <= CLOSE
    return slow and remaining(offset, state.before, state.tolerance) > MANY


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


def _accepted(state: State, point: Floats, residuals: Floats, share: float, rejected: State) -> State:
    """The state at a ``point``; factors go with it where they may be of use there."""
    damping = max(state.damping * (RELIEF if share > GOOD else damping_factor(share)), state.least)
    return replace(
        state,
        place=None,
        known=Known(factors=state.known.factors if state.offset <= CLOSE else None),
        point=point,
        residuals=residuals,
        damping=damping,
        growth=2.0,
        radius=radius_after(share, state.radius, state.length, int(not state.limited)),
        before=state.offset if damping <= state.least and not state.limited else inf,
        trials=0,
        back=replace(rejected, place=None, known=Known(whole=rejected.known.whole)),
        iterations=state.iterations + 1,
    )


def _ended(state: State, reason: Reason) -> State:
    return replace(state, reason=reason, iterations=state.iterations + 1)


def pushed(at_bound: NDArray[np.int8], slopes: Floats, lengths: Floats, x: Floats, cost: float) -> NDArray[np.int8]:
    """``at_bound`` (n,), 0 where the slopes ``Jᵀ r`` are nothing beside ``lengths`` of columns and ``cost`` = rᵀ r.

    Where data leave a combination of unknowns free, an iteration may end anywhere along it: whether that is just at a
    bound, and to which side rounding then tips the slope, says nothing. ``x`` (n,) are the coordinates.
    """
    from mbm.solver.decisions import IDLE, ROUNDED_PUSH

    made_of = np.sqrt(np.square(lengths * x).sum())
    idle = np.abs(slopes) <= lengths * (IDLE * np.sqrt(cost) + ROUNDED_PUSH * made_of)
    return np.where(idle, 0, at_bound).astype(np.int8)
