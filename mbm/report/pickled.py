"""Results as data alone: what is made when it is asked for is made now, so that they pickle without any code.

What asks for the equations again (files for other programs, errors of trajectories, budgets) is not to be had from it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np

from mbm.report.spreads import Floats, Spread
from mbm.report.types import Alternative, DerivedValue, Estimate, FreeDirection, Observability, Result, SolveReport
from mbm.values import dataclass

T = TypeVar("T")
Item = TypeVar("Item", bound=Estimate | DerivedValue)

LEVELS = (0.5, 0.6827, 0.9, 0.95, 0.9545, 0.99, 0.9973)
"""Levels at which intervals by profile are kept, beside the coverage of the solve."""


@dataclass(frozen=True, slots=True)
class Made(Generic[T]):
    """A function without arguments that answers what was made once."""

    value: T

    def __call__(self) -> T:
        """The value."""
        return self.value


@dataclass(frozen=True, slots=True)
class KeptEnds:
    """The ends of intervals by profile, by their level."""

    ends: dict[float, tuple[Floats, Floats]]

    def __call__(self, level: float) -> tuple[Floats, Floats]:
        """The ends at a ``level``.

        Raises:
            LookupError: they were not followed to this level.

        """
        found = self.ends.get(level)
        if found is None:
            known = ", ".join(f"{each:g}" for each in sorted(self.ends))
            message = f"a result that was pickled has its intervals by profile at the levels {known}; solve again"
            raise LookupError(message)
        return found


def as_data(result: Result) -> Result:
    """The result without functions."""
    return replace(
        result,
        solves=tuple(map(solve_as_data, result.solves)),
        options=dict(result.options),
        seen=None,
        described=None,
        propagate=None,
    )


def solve_as_data(solve: SolveReport) -> SolveReport:
    """The report of a solve without functions."""
    return replace(
        solve,
        key=dict(solve.key),
        reasons=dict(solve.reasons),
        estimates=tuple(_items(solve.estimates, solve.coverage)),
        derived=tuple(_items(solve.derived, solve.coverage)),
        observability=None if solve.observability is None else _observability(solve.observability),
        noise=dict(solve.noise),
        noise_units=dict(solve.noise_units),
        summaries=Made(dict(solve.residual_summaries)),
        raw_residuals=Made(dict(solve.raw_residuals())),
        rows=Made(solve.rows()),
        row_data=Made(dict(solve.row_data())),
        pictures=Made(solve.pictures()),
        maps=Made(solve.maps()),
        pieces=tuple(
            replace(
                each,
                estimates=tuple(_items(each.estimates, solve.coverage)),
                derived=tuple(_items(each.derived, solve.coverage)),
            )
            for each in solve.pieces
        ),
        hypotheses=tuple(_alternative(each, solve.coverage) for each in solve.hypotheses),
        examination=replace(
            solve.examined(),
            alternatives=tuple(_alternative(each, solve.coverage) for each in solve.alternatives),
            not_examined=dict(solve.not_examined),
        ),
        made_from=None,
        considered=tuple(replace(each, elsewhere=None) for each in solve.considered),
    )


def _alternative(found: Alternative, coverage: float) -> Alternative:
    return replace(found, estimates=tuple(_items(found.estimates, coverage)))


def item_as_data(item: Item, coverage: float) -> Item:
    """An estimate or derived quantity without functions."""
    return item if item.spread is None else replace(item, spread=_spread(item.spread, coverage))


def _items(items: Iterable[Item], coverage: float) -> Iterable[Item]:
    return (item_as_data(item, coverage) for item in items)


def _spread(spread: Spread, coverage: float) -> Spread:
    spread = replace(spread, released=None)  # what only the making of a report wants
    if spread.ends is None or isinstance(spread.ends, KeptEnds):
        return spread
    kept = {level: spread.ends(level) for level in sorted({*LEVELS, coverage})}
    nowhere = all(bool(np.isnan(each).all()) for pair in kept.values() for each in pair)
    return replace(spread, ends=None if nowhere else KeptEnds(kept))


def _observability(found: Observability) -> Observability:
    free: tuple[FreeDirection, ...] = found.unobservable
    return replace(found, unobservable=tuple(replace(each, coefficients=dict(each.coefficients)) for each in free))
