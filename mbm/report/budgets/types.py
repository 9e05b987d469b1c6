"""Values of uncertainty budgets; numbers are in the units that are shown beside them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from mbm.report.types import Key
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
