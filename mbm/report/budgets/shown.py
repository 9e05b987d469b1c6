"""Estimates and derived quantities as a budget shows them: what their scalars have, made once for each."""

from __future__ import annotations

from math import isfinite

import numpy as np

from mbm.report.budgets.targets import Target, item_of
from mbm.report.elements import Scalar, factors, scalars, shown_sigma
from mbm.report.intervals import Intervals, intervals
from mbm.report.types import SolveReport
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """A scalar, SI per unit of it (``factor``), and its ``interval``."""

    scalar: Scalar
    factor: float
    interval: Intervals

    @property
    def why_none(self) -> str | None:
        """Why it has no standard deviation; None where it has one."""
        if self.scalar.fixed:
            return "it is fixed"
        if self.scalar.at_bound:
            return "it is held at its bound, where no standard deviation is known"
        return None if isfinite(self.scalar.sigma) else self.scalar.reason or "no standard deviation is known"


def shown(solve: SolveReport, targets: list[Target]) -> list[Shown]:
    """What the ``targets`` are shown as, one for each."""
    made: dict[tuple[bool, int], tuple[list[Scalar], np.ndarray, Intervals]] = {}
    found = []
    for target in targets:
        own = (target.derived, target.number)
        if own not in made:
            item = item_of(solve, target)
            each = np.broadcast_to(factors(item.quantity), np.shape(shown_sigma(item)))
            made[own] = list(scalars(item)), np.ravel(each), intervals(item, solve.coverage).flat()
        every, units, flat = made[own]
        place = target.place
        found.append(Shown(scalar=every[place], factor=float(units[place]), interval=flat.at((place,))))
    return found
