"""Values of uncertainty budgets; numbers are in the units that are shown beside them. The numbers that a solve
estimates and derives, by the names that the covariance gives them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.report.budgets import faults
from mbm.report.elements import element_names, own_name
from mbm.report.types import DerivedValue, Estimate, Floats, Key, SolveReport
from mbm.text.types import MbmError
from mbm.values import dataclass


class InputKind(StrEnum):
    """What an input is: rows of an observation or values of a column, a prior, a constant, the noise of `dynamics`."""

    ROWS = "rows"
    PRIOR = "prior"
    CONSTANT = "constant"
    TRANSITION = "transition"


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetRow:
    """An input: a clause, a column (``table.column``), a prior or a constant; or one row of these.

    ``count`` inputs stand in it. ``u`` is the standard uncertainty in ``unit``, that of several their root mean square;
    ``sensitivity`` c is the derivative of the quantity by the ``value``, that of several the root of the sum of their
    squares. They are None where the inputs have no common unit, or are components of one measurement with a covariance;
    ``value`` is None of several. ``contribution`` is |c|u in the unit of the quantity, of several in quadrature;
    ``share`` its square beside that of the standard deviation. ``dof`` are the degrees of freedom of u, infinite where
    it was stated. ``row`` counts the rows of the unfiltered table from 1, ``component`` the numbers of the row.
    """

    input: str
    kind: InputKind
    count: int
    contribution: float
    share: float
    dof: float
    value: float | None = None
    unit: str | None = None
    u: float | None = None
    sensitivity: float | None = None
    row: int | None = None
    component: int | None = None

    @property
    def label(self) -> str:
        """The input, with its row and component where it is one."""
        row = "" if self.row is None else f" row {self.row}"
        return f"{self.input}{row}" if self.component is None else f"{self.input}{row} [{self.component}]"


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The uncertainty of one scalar, input by input; value, ``sigma`` and ``U`` in ``unit``.

    ``rows`` are in the order of the problem; the squares of their contributions add up to ``sigma²``. ``dof``, ``k``
    and ``U`` are those of the interval at ``coverage``. ``inflation`` is by how much k is larger than the quantile of
    Student's t, as the weights are uncertain where several noises are estimated: it belongs to no input.
    ``key`` tells solves of `for-each` apart.
    """

    quantity: str
    value: float
    sigma: float
    unit: str | None
    dof: float
    k: float
    U: float
    coverage: float
    inflation: float
    rows: tuple[BudgetRow, ...]
    key: Mapping[str, Key]


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
