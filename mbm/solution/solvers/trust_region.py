"""The trust-region iteration that Marquardt's method, the dogleg and Gauss-Newton share.

Moré (1978) for the radius and its update. Added to it: trial points without a finite residual or Jacobian are refused
and the radius shrinks; hard bounds; a second try along the curve where a step met curvature; Newton's steps at the end
where Gauss-Newton's are slow; and last steps that are judged by the relative offset of Bates and Watts (1981) instead
of the sum of squares, because the sum of squares stops telling points apart at half the digits.
"""

from __future__ import annotations

from dataclasses import replace
from math import isfinite, sqrt

import numpy as np

from mbm.solution.solvers.box import Step, StepRule, boxed_step
from mbm.solution.solvers.curvature import residual_curvature, spread_of
from mbm.solution.solvers.state import Place, State, answer, begin, place_at
from mbm.solution.types import Equations, Floats, Minimum, Reason
from mbm.target.decisions import (
    BEND,
    CREEP,
    CURVED_SHARE,
    LEAST_GAIN_RATIO,
    NEAR_OFFSET,
    NEVER,
    OFFSET_DECREASE,
    PATIENCE,
    REACH,
    SLOW_OFFSET,
    TRIAL_POINTS,
    UNDECIDED,
)
from mbm.target.step_control import radius_after, remaining, shortened
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """A point that was tried: the step to it, what the equations say there."""

    step: Step
    point: Floats
    residuals: Floats
    cost: float
    evaluations: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TrustRegion:
    """A method of this family: ``rule`` says where to step inside the radius."""

    name: str
    rule: StepRule

    @np.errstate(all="ignore")
    def init(self, equations: Equations, start: Floats, tolerance: float) -> State:
        """The state at the start (projected into the bounds)."""
        return begin(equations, start, tolerance)

    @np.errstate(all="ignore")
    def step(self, equations: Equations, state: State) -> State:
        """Trial steps until one is accepted, or none can be; the cost never grows by more than its rounding."""
        here, radius, evaluations, finite = state.place, state.radius, state.evaluations, True
        for _ in range(TRIAL_POINTS):
            trial = _try(equations, state, _step_within(state, self.rule, radius))
            evaluations += trial.evaluations
            if np.array_equal(trial.point, here.point):
                break
            finite = isfinite(trial.cost)
            if not finite:
                radius = 0.25 * min(radius, trial.step.length)
                continue
            actual = here.cost - trial.cost
            decided = trial.step.predicted > UNDECIDED * here.slack
            if decided:
                share = actual / trial.step.predicted
                acceptable = share > LEAST_GAIN_RATIO
            else:
                share = 1.0
                acceptable = trial.step is here.full and actual >= -here.slack
            if acceptable:
                jacobian = equations.jacobian(trial.point)
                finite = bool(np.isfinite(jacobian).all())
                if not finite:
                    radius = 0.25 * min(radius, trial.step.length)
                    continue
                done = _counted(state, evaluations)
                new = _moved(equations, done, trial, jacobian, radius, share if decided else None)
                if not decided and not new.place.offset <= OFFSET_DECREASE * here.offset:
                    return _no_better(equations, done)
                return new
            if not decided:
                break
            radius = _shorter(here, trial.step, actual) * min(radius, trial.step.length)
        return _stuck(equations, _counted(replace(state, radius=radius), evaluations), finite)

    def finished(self, state: State) -> Reason | None:
        """Why the iteration is over, or None while it is not."""
        return state.reason

    def minimum(self, state: State, reason: Reason) -> Minimum:
        """The state as an answer."""
        return answer(state, reason)


def _step_within(state: State, rule: StepRule, radius: float) -> Step:
    here = state.place
    if here.full.length <= 1.1 * radius:
        return here.full
    if here.free is not None:
        gaps = state.box.gaps(here.coordinates)
        return boxed_step(here.jacobian, here.residuals, here.scale, here.free, gaps, rule, radius)
    scaled = rule(here.parts, radius)
    length = sqrt(float(scaled @ scaled))
    return Step(vector=scaled / here.scale, predicted=here.parts.predicted(scaled), length=length)


def _try(equations: Equations, state: State, step: Step) -> Trial:
    """Evaluate a step, and once more with the curvature answered where it brought too little."""
    here = state.place
    point = equations.retract(here.point, step.vector)
    if state.box.present:
        point = equations.placed(point, state.box.landed(equations.coordinates(point), step))
    residuals = equations.residuals(point)
    cost = float(residuals @ residuals)
    plain = Trial(step=step, point=point, residuals=residuals, cost=cost, evaluations=1)
    promising = isfinite(cost) and here.free is None and step.predicted > UNDECIDED * here.slack
    if not promising or here.cost - cost >= CURVED_SHARE * step.predicted:
        return plain
    scaled = step.vector * here.scale
    missed = residuals - here.residuals - here.jacobian @ step.vector
    bend = here.parts.bent((missed @ here.jacobian) / here.scale, scaled)
    if not float(bend @ bend) <= (BEND * step.length) ** 2:
        return plain
    curved = equations.retract(here.point, (scaled + bend) / here.scale)
    there = equations.residuals(curved)
    lower = float(there @ there)
    if lower < cost:
        return Trial(step=step, point=curved, residuals=there, cost=lower, evaluations=2)
    return replace(plain, evaluations=2)


def _moved(
    equations: Equations, state: State, trial: Trial, jacobian: Floats, radius: float, share: float | None
) -> State:
    """The state at an accepted point, with the second-order term where convergence is slow enough to pay for it."""
    here = state.place
    there = place_at(
        equations, trial.point, trial.residuals, jacobian, state.box, state.tolerance, here, state.curvature
    )
    if share is not None:
        radius = radius_after(share, radius, trial.step.length, int(trial.step is here.full))
    new = replace(state, place=there, radius=radius, reason=there.ending, patience=max(state.patience - 1, 0))
    if there.ending is not None or there.offset <= SLOW_OFFSET * here.offset or new.patience > 0:
        return new
    if there.offset < NEAR_OFFSET:
        if remaining(there.offset, here.offset, state.tolerance) <= there.coordinates.size + 2:
            return new
    elif here.cost - trial.cost > CREEP * here.cost:
        return new
    second = _with_curvature(equations, new)
    return replace(second, radius=max(radius, min(second.place.full.length, REACH * radius)))


def _with_curvature(equations: Equations, state: State) -> State:
    """The state with the second-order term at its point."""
    here = state.place
    spread = spread_of(here.cost, here.freedom)
    curvature = residual_curvature(equations, here.point, here.residuals, here.jacobian, here.scale, spread)
    again = place_at(equations, here.point, here.residuals, here.jacobian, state.box, state.tolerance, here, curvature)
    patience = PATIENCE if again.offset >= NEAR_OFFSET else 0
    return replace(state, place=again, curvature=curvature, patience=patience, reason=again.ending)


def _stuck(equations: Equations, state: State, finite: bool) -> State:
    """No trial was accepted: the end, unless Newton's step shows a way that Gauss-Newton's did not."""
    here = state.place
    if here.full.predicted <= UNDECIDED * here.slack:
        return _no_better(equations, state)
    if not finite:
        return replace(state, reason=Reason.NO_FINITE_STEP)
    if state.patience > 0:
        return replace(state, reason=Reason.FLAT)
    second = _with_curvature(equations, state)
    return replace(second, patience=PATIENCE, radius=max(state.radius, second.place.full.length))


def _no_better(equations: Equations, state: State) -> State:
    """No better point: the end, unless the second-order term was too inexact for the last digits."""
    if state.curvature is None:
        return replace(state, reason=Reason.ROUNDING)
    here = state.place
    plain = place_at(equations, here.point, here.residuals, here.jacobian, state.box, state.tolerance, here, None)
    radius = max(state.radius, plain.full.length)
    return replace(state, place=plain, curvature=None, patience=NEVER, radius=radius, reason=plain.ending)


def _shorter(here: Place, step: Step, actual: float) -> float:
    """The factor for the radius after a step that was refused."""
    return shortened(float((here.jacobian @ step.vector) @ here.residuals) if actual < 0.0 else 0.0, actual)


def _counted(state: State, evaluations: int) -> State:
    return replace(state, iterations=state.iterations + 1, evaluations=evaluations)
