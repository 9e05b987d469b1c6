"""The problem as values: unknowns, equations, priors, derived quantities. Typed expressions, no data, no SymPy.

A problem is compiled once and solved for many data sets. Where the value of a data column decides what an equation *is*
(a part's name, an index), the rows are grouped by that value: one ``Case`` for each (LANGUAGE §4, static columns).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from mbm.expression.dimension import Dimension
from mbm.expression.nodes import Expression
from mbm.expression.units import Unit
from mbm.problem.tables import CellKey, TableDeclaration
from mbm.text.types import Diagnostic, Span


class UnknownKind(StrEnum):
    """What kind of thing an unknown is; the value is how the result document calls it."""

    REAL = "real"
    POSITIVE = "positive"
    ANGLE = "angle"
    VECTOR = "vector"
    ARRAY = "array"


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """One member for each row of ``table`` by its key, or for each distinct value of ``column`` of ``table``.

    ``rows`` is the table that holds one row for each member (``table`` itself, or a table made of the distinct values),
    ``key`` the column of it that holds the key; None where rows are named by their number.
    """

    table: str
    column: str | None
    rows: str
    key: str | None


Static = tuple[tuple[str, CellKey], ...]
"""Columns whose values are known while compiling, with those values; in the order in which they were needed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueCase:
    """The expressions for the rows that have the values ``static``, one for each component."""

    static: Static
    values: tuple[Expression, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RowValues:
    """Numbers computed from the row at hand: ``:init``, ``:in``, ``:fixed`` of a family, filters."""

    table: str | None
    cases: tuple[ValueCase, ...]
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """What is to be estimated.

    ``shape`` is () for a number, (n,) or (n, m) else; components count row by row. ``lower``, ``upper`` are the hard
    bounds, ``start_lower``, ``start_upper`` the range of starts, each with one value per component.
    ``unit`` is the unit that results are reported in, if one is stated.
    """

    name: str
    kind: UnknownKind
    shape: tuple[int, ...]
    family: Family | None
    start: RowValues | None
    lower: RowValues | None
    upper: RowValues | None
    start_lower: RowValues | None
    start_upper: RowValues | None
    fixed: RowValues | None
    unit: Unit | None
    doc: str
    span: Span

    @property
    def size(self) -> int:
        """Number of components."""
        result = 1
        for extent in self.shape:
            result *= extent
        return result

    def indices(self) -> tuple[tuple[int, ...], ...]:
        """The indices of the components, from 1, row by row; ``((),)`` for a number."""
        if not self.shape:
            return ((),)
        if len(self.shape) == 1:
            return tuple((i + 1,) for i in range(self.shape[0]))
        return tuple((i + 1, j + 1) for i in range(self.shape[0]) for j in range(self.shape[1]))


class NoiseKind(StrEnum):
    """How the weight of an equation is stated."""

    SIGMA = "sigma"
    COVARIANCE = "covariance"
    INFORMATION = "information"


@dataclass(frozen=True, slots=True, kw_only=True)
class Equation:
    """Residual components that should be zero (model − measured), and their noise.

    ``noise`` holds the standard deviation of each component for ``SIGMA``, else the n×n matrix row by row. ``measured``
    is the measured side (or a prior's mean) where it holds data only, None elsewhere: reports and pictures show it.
    """

    components: tuple[Expression, ...]
    noise_kind: NoiseKind
    noise: tuple[Expression, ...]
    measured: tuple[Expression, ...] | None
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class EquationCase:
    """The equations of the rows that have the values ``static``."""

    static: Static
    equations: tuple[Equation, ...]


class BlockRole(StrEnum):
    """Whether a block of equations is measured, or known besides."""

    OBSERVATION = "observation"
    PRIOR = "prior"


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Equations that hold for each row of ``table`` (once if None).

    ``unknown_factor``: the stated noise is known up to one factor, which is estimated. ``distinct`` names columns of
    which each combination of values counts once: rows that repeat one are left out.
    """

    name: str
    role: BlockRole
    table: str | None
    cases: tuple[EquationCase, ...]
    when: RowValues | None
    unknown_factor: bool
    distinct: tuple[str, ...] = ()
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Derived:
    """A quantity computed from the estimates, once or for each row of ``table``."""

    name: str
    table: str | None
    shape: tuple[int, ...]
    cases: tuple[ValueCase, ...]
    unit: Unit | None
    angle: bool
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Join:
    """``:with (TABLE COL)`` or ``:with (ALIAS TABLE COL)``: column ``column`` holds keys of ``table``."""

    alias: str
    table: str
    column: str
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class TablePlan:
    """How a table comes to be: what is read, what is joined to it, which rows are kept."""

    declaration: TableDeclaration
    joins: tuple[Join, ...] = ()
    where: RowValues | None = None

    @property
    def name(self) -> str:
        """The table's name."""
        return self.declaration.name


class Method(StrEnum):
    """Solvers that a problem may ask for."""

    AUTO = "auto"
    MARQUARDT = "lm"
    DOGLEG = "dogleg"
    GAUSS_NEWTON = "gauss-newton"


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """How to solve, and which problems to make of the data."""

    method: Method = Method.AUTO
    seed: int = 1
    max_iterations: int = 100
    tolerance: float = 1e-10
    for_each: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantValue:
    """A constant of the problem with its elements (one for a number) and their names in expressions."""

    name: str
    values: tuple[float, ...]
    elements: tuple[str, ...]
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """A whole problem. ``dimensions`` holds what unit inference found for components of unknowns and derived values."""

    name: str
    doc: str
    plans: tuple[TablePlan, ...]
    constants: tuple[ConstantValue, ...]
    unknowns: tuple[Unknown, ...]
    blocks: tuple[Block, ...]
    derived: tuple[Derived, ...]
    request: Request
    dimensions: Mapping[tuple[str, int], Dimension | None]
    warnings: tuple[Diagnostic, ...] = ()
    span: Span

    def unknown(self, name: str) -> Unknown:
        """An unknown by name."""
        return next(u for u in self.unknowns if u.name == name)


@dataclass(frozen=True, slots=True, kw_only=True)
class Override:
    """A constant or start given from outside: as a form of the language, or as numbers in SI."""

    name: str
    text: str | None = None
    values: tuple[float, ...] | None = None


Overrides = Mapping[str, Override]
"""What the caller gives instead of what the file says, by name."""
