"""No iteration: the answer is the start, as a closed form gave it."""

from __future__ import annotations

import numpy as np

from mbm.solution.solvers.state import State, answer, begin
from mbm.solution.types import Equations, Floats, Minimum, Reason
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """Stays where it is put; rank, covariance and residuals are those of that point."""

    name: str = "closed-form"

    @np.errstate(all="ignore")
    def init(self, equations: Equations, start: Floats, tolerance: float) -> State:
        """The state at the start (projected into the bounds)."""
        return begin(equations, start, tolerance)

    def step(self, equations: Equations, state: State) -> State:
        """The same state."""
        del equations
        return state

    def finished(self, state: State) -> Reason | None:
        """Over at once."""
        return Reason.CLOSED_FORM if state.bad_row is None else Reason.NOT_FINITE_AT_START

    def minimum(self, state: State, reason: Reason) -> Minimum:
        """The state as an answer."""
        return answer(state, reason)


STANDING = Standing()
