"""Linear equations in one step: least squares from the decomposition of the Jacobian, with refinement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.solution.solvers.state import State, answer, begin, place_at
from mbm.solution.types import Equations, Floats, Minimum, Reason
from mbm.target.decisions import REFINEMENTS
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Linear:
    """Residuals affine in the unknowns and no bounds."""

    name: str = "linear"

    @np.errstate(all="ignore")
    def init(self, equations: Equations, start: Floats, tolerance: float) -> State:
        """The state at the start; never finished there (unless not finite), so that one step is counted."""
        state = begin(equations, start, tolerance)
        return state if state.bad_row is not None else replace(state, reason=None)

    @np.errstate(all="ignore")
    def step(self, equations: Equations, state: State) -> State:
        """The minimum (the one nearest the start in the scaled metric, where there are many)."""
        best, evaluations, finite = state.place, state.evaluations, True
        for _ in range(1 + REFINEMENTS):
            point = equations.retract(best.point, best.full.vector)
            residuals = equations.residuals(point)
            evaluations += 1
            cost = float(residuals @ residuals)
            finite = bool(np.isfinite(cost))
            if not finite or cost > best.cost + best.slack:
                break
            new = place_at(equations, point, residuals, best.jacobian, state.box, state.tolerance, best, None)
            if best is not state.place and not new.full.length < best.full.length:
                break
            best = new
        reason = Reason.NO_FINITE_STEP if best is state.place and not finite else Reason.ONE_STEP
        return replace(state, place=best, iterations=1, evaluations=evaluations, reason=reason)

    def finished(self, state: State) -> Reason | None:
        """Over after the step."""
        return state.reason

    def minimum(self, state: State, reason: Reason) -> Minimum:
        """The state as an answer."""
        return answer(state, reason)


LINEAR = Linear()
