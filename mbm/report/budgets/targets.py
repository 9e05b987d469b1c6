"""The numbers that a solve estimates and derives, by the names that the covariance gives them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.report.budgets import faults
from mbm.report.elements import element_names, own_name
from mbm.report.types import DerivedValue, Estimate, Floats, SolveReport
from mbm.text.types import MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Target:
    """A scalar: of the item at ``number`` among the estimates, or ``derived`` quantities, the one at ``place``."""

    name: str
    derived: bool
    number: int
    place: int


def _items(solve: SolveReport) -> Iterator[tuple[bool, int, Estimate | DerivedValue]]:
    yield from ((False, number, item) for number, item in enumerate(solve.estimates))
    yield from ((True, number, item) for number, item in enumerate(solve.derived))


def targets_of(solve: SolveReport) -> Iterator[Target]:
    """All numbers, estimates first."""
    for derived, number, item in _items(solve):
        for place, name in enumerate(element_names(item.quantity, item.keys)):
            yield Target(name=name, derived=derived, number=number, place=place)


def called(solve: SolveReport, name: str, targets: Sequence[Target]) -> list[Target]:
    """The scalars that ``name`` means. Raises MbmError (unknown-quantity)."""
    exact = [target for target in targets if target.name == name]
    if exact:
        return exact[:1]
    whole: dict[str, list[Target]] = {}
    for target in targets:
        item = item_of(solve, target)
        names = {item.quantity.name}
        if item.keys is not None:
            each = max(len(element_names(item.quantity, item.keys)) // max(len(item.keys), 1), 1)
            names.add(own_name(item.quantity, item.keys[target.place // each]))
        for each_name in names:
            whole.setdefault(each_name, []).append(target)
    if name in whole:
        return whole[name]
    raise MbmError(faults.unknown_quantity(name, (*whole, *(target.name for target in targets))))


def item_of(solve: SolveReport, target: Target) -> Estimate | DerivedValue:
    """The estimate or derived quantity that a number belongs to."""
    return solve.derived[target.number] if target.derived else solve.estimates[target.number]


def gradient_of(solution: Solution, target: Target) -> Floats | None:
    """The derivatives (n,) of a scalar by the free coordinates; None where they were not kept."""
    if target.derived:
        kept = solution.derived[target.number].gradient
        return None if kept is None else kept[target.place]
    place = solution.layout.entries[target.number].coordinates
    coordinate = place.start + target.place % max(place.stop - place.start, 1)
    return np.asarray(solution.free == coordinate, dtype=np.float64)
