"""How to solve: what ``(solve …)`` says, as a value."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

from mbm.equations.interruption import Interruption
from mbm.problem.kinds import ConstraintMethod, Gauge
from mbm.problem.requests import GivenStarts, RandomStarts
from mbm.problem.types import Consensus, Method, Request
from mbm.solver.description import RULES
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.types import Floats
    from mbm.estimation.starts.closed_forms.types import ClosedForm
    from mbm.problem.tables import CellKey

FEW = 50
"""Starts that are not worth a thread of their own."""

Forms: TypeAlias = "Callable[[], tuple[ClosedForm, ...]]"
"""What gives the closed forms; called only where they are needed."""


Moves: TypeAlias = "Callable[[Mapping[str, CellKey]], Floats | None]"
"""By the key of a solve, what one standard deviation of each of k uncertain constants does to its residuals (k, m),
divided by the noise as it is stated; None where that is not known."""


def standard_forms() -> tuple[ClosedForm, ...]:
    """The closed forms that mbm itself brings."""
    # Loaded by the problems that need them only, so that the others start at once.
    from mbm.estimation.starts.closed_forms.standard import STANDARD

    return STANDARD


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """``tolerance`` bounds the relative offset: the next step in standard deviations of the estimates.

    ``forms`` gives the closed forms that may give starts. ``interruption`` is asked between iterations, through
    ``stopped()``. ``moved`` as `Moves`. ``workers`` threads share many starts, and what is heavy in a large solve
    (None: one for each processor); the answers do not depend on their number.
    """

    method: Method = Method.AUTO
    routine: str | None = None
    robust: Consensus | None = None
    starts: RandomStarts | GivenStarts | None = None
    constraints: ConstraintMethod = ConstraintMethod.PENALTY
    gauge: Gauge = Gauge.REPORT
    seed: int = 1
    max_iterations: int = 100
    tolerance: float = 1e-10
    interruption: Interruption | None = None
    forms: Forms = standard_forms
    moved: Moves | None = None
    workers: int | None = None

    @property
    def closed_forms(self) -> tuple[ClosedForm, ...]:
        """The closed forms, in the order in which they are tried."""
        return self.forms()

    @property
    def iterative(self) -> bool:
        """The method goes on from any start, by one of the rules of steps of the trust region."""
        return self.method is Method.AUTO or self.method.value in RULES

    def threads(self, starts: int) -> int:
        """Threads for so many starts."""
        return max(1, min(self.workers or os.cpu_count() or 1, starts // FEW))

    def stopped(self) -> bool:
        """The solve is to end with the best point so far."""
        return self.interruption is not None and self.interruption.requested


def settings_of(request: Request, interruption: Interruption | None = None, forms: Forms = standard_forms) -> Settings:
    """What a problem asks of the solver, with the closed forms that are plugged in."""
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
        interruption=interruption,
        forms=forms,
    )
