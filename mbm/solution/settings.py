"""How to solve: what ``(solve …)`` says, as a value."""

from __future__ import annotations

from dataclasses import dataclass

from mbm.problem.types import Consensus, ConstraintMethod, Gauge, GivenStarts, Method, RandomStarts, Request


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """``tolerance`` bounds the relative offset: the next step in standard deviations of the estimates."""

    method: Method = Method.AUTO
    routine: str | None = None
    robust: Consensus | None = None
    starts: RandomStarts | GivenStarts | None = None
    constraints: ConstraintMethod = ConstraintMethod.PENALTY
    gauge: Gauge = Gauge.REPORT
    seed: int = 1
    max_iterations: int = 100
    tolerance: float = 1e-10


def settings_of(request: Request) -> Settings:
    """What a problem asks of the solver."""
    return Settings(
        method=request.method,
        routine=request.routine,
        robust=request.robust,
        starts=request.starts,
        constraints=request.constraints,
        gauge=request.gauge,
        seed=request.seed,
        max_iterations=request.max_iterations,
        tolerance=request.tolerance,
    )
