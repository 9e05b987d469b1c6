"""Trials → the scalars that are reported, in their units."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.manifolds import numbers_of_stated
from mbm.estimation.uncertainty.derived import reported
from mbm.problem.types import Problem
from mbm.report.elements import element_names, factors, shown_sigma, shown_values
from mbm.report.geometric import difference
from mbm.report.intervals import intervals
from mbm.report.types import DerivedValue, Estimate, Floats, Kind, SolveReport
from mbm.simulation.trials.drawn import Drawn
from mbm.values import dataclass

Item = Estimate | DerivedValue


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """An estimate or derived quantity and its ``columns`` of the samples; ``linear`` (k, 2) are its linear intervals.

    ``sigma`` (k,) are its linear standard deviations. NaN where there are none.
    """

    item: Item
    columns: slice
    names: tuple[str, ...]
    linear: Floats
    sigma: Floats

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the item's standard deviations."""
        return np.shape(shown_values(self.item))


def parts_of(solve: SolveReport) -> tuple[Part, ...]:
    """The items of a solve that trials speak of: directions have no coordinates that could be compared."""
    found: list[Part] = []
    place = 0
    items: tuple[Item, ...] = (*solve.estimates, *solve.derived)
    for item in items:
        values = shown_values(item)
        if item.quantity.kind is Kind.DIRECTION or not bool(np.isfinite(values).all()):
            continue
        told = intervals(item, solve.coverage)
        ends = np.stack([values - told.expanded, values + told.expanded], axis=-1)
        columns = slice(place, place + values.size)
        place = columns.stop
        found.append(
            Part(
                item=item,
                columns=columns,
                names=element_names(item.quantity, item.keys),
                linear=ends.reshape(-1, 2),
                sigma=np.ravel(shown_sigma(item)),
            )
        )
    return tuple(found)


def scalars_of(problem: Problem, parts: tuple[Part, ...], drawn: Drawn) -> Callable[[Floats], Floats]:
    """From points (T, N) to the scalars of the ``parts`` (T, S), in their units."""
    owners = {derived.name: owner for owner, derived in enumerate(problem.derived)}

    def values(item: Item, points: Floats) -> Floats:
        count, shape = len(points), np.shape(item.value)
        if isinstance(item, Estimate):
            return points[:, drawn.equations.layout.entry(item.quantity.name).range].reshape(count, *shape)
        owner = owners[item.quantity.name]
        derived, stated = problem.derived[owner], drawn.derived_values(owner, points)
        if derived.kind is None:
            return np.asarray(reported(derived, stated)).reshape(count, *shape)
        flat = numbers_of_stated(derived.kind, derived.dimension, stated.reshape(-1, stated.shape[-1]))
        return np.asarray(flat).reshape(count, *shape)

    def scalars(points: Floats) -> Floats:
        found = np.empty((len(points), parts[-1].columns.stop if parts else 0))
        for part in parts:
            item = part.item
            moved = difference(item.quantity, np.asarray(item.value), values(item, points)) / factors(item.quantity)
            found[:, part.columns] = (shown_values(item) + moved).reshape(len(points), -1)
        return found

    return scalars
