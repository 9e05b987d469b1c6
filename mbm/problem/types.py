"""The problem as values: unknowns, equations, priors, derived quantities. Typed expressions, no data, no SymPy.

A problem is compiled once and solved for many data sets. Where the value of a data column decides what an equation *is*
(a part's name, an index), the rows are grouped by that value: one ``Case`` for each (LANGUAGE §4, static columns).
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from math import prod

from mbm.expression.nodes import Expression
from mbm.expression.projection import Projection
from mbm.expression.units import Dimension, Unit
from mbm.problem.aggregates import Aggregate, WrittenOut
from mbm.problem.grids import Grid
from mbm.problem.kinds import ConsensusKind, ConstraintKind, ConstraintMethod, Gauge, LossKind, Relation
from mbm.problem.likelihoods.types import Likelihood
from mbm.problem.manifold import Manifold, manifold_of
from mbm.problem.noise import PLAIN, NoiseStructure
from mbm.problem.overrides import NORMAL_LAW, ConstantValue, Law
from mbm.problem.requests import Enclosing, GivenStarts, RandomStarts, Window
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import CellKey, PairDeclaration, TableDeclaration
from mbm.text.types import Diagnostic, Span
from mbm.values import dataclass


class UnknownKind(StrEnum):
    """What kind of thing an unknown is; the value is how the result document calls it."""

    REAL = "real"
    POSITIVE = "positive"
    ANGLE = "angle"
    VECTOR = "vector"
    ARRAY = "array"
    DIRECTION = "direction"
    ROTATION = "rotation"
    POSE = "pose"
    SIMILARITY = "similarity"


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """One member for each row of ``table`` by its key, or for each distinct value of ``column`` of ``table``.

    ``rows`` is the table that holds one row for each member (``table`` itself, or a table made of the distinct values),
    ``key`` the column of it that holds the key; None where rows are named by their number. ``sources`` are the tables
    and columns that ``table`` is stacked from, where a family goes over the values of several. ``ordered``: the rows
    ascend with the key, which is a number.
    """

    table: str
    column: str | None
    rows: str
    key: str | None
    sources: tuple[tuple[str, str], ...] = ()
    ordered: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """The columns that hold a member's value, of a family over columns: a stacked one has several names."""
        return tuple(dict.fromkeys((str(self.column), *(column for _, column in self.sources))))


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

    ``shape`` is () for a number, (n,) or (n, m) else; components count row by row. Directions, rotations, poses and
    similarities have the shape (n,) of the numbers that hold them (``manifold``), and ``dimension`` 2 or 3 of their
    space; 0 for other kinds. ``start`` has one value per number, ``fixed`` one per coordinate of the tangent space;
    ``at``, one per number, is where what is fixed is held without a ``start``. ``lower``, ``upper`` are the hard
    bounds, ``start_lower``, ``start_upper`` the range of starts, each with one value per coordinate of the tangent
    space; NaN where there is none (rotations). ``unit`` is the unit that results are reported in, if one is stated.
    """

    name: str
    kind: UnknownKind
    shape: tuple[int, ...]
    dimension: int = 0
    family: Family | None
    start: RowValues | None
    lower: RowValues | None
    upper: RowValues | None
    start_lower: RowValues | None
    start_upper: RowValues | None
    fixed: RowValues | None
    at: RowValues | None = None
    unit: Unit | None
    doc: str
    span: Span

    @property
    def is_state(self) -> bool:
        """It has a value at every step of a sequence."""
        return self.family is not None and self.family.ordered

    @property
    def size(self) -> int:
        """Numbers that hold the value."""
        return prod(self.shape)

    @property
    def manifold(self) -> Manifold:
        """How the numbers vary."""
        return manifold_of(self.kind.value, self.dimension, self.size)

    @property
    def freedom(self) -> int:
        """Coordinates of the tangent space; plain numbers, of which there may be thousands, have as many."""
        return self.manifold.tangent if self.dimension else self.size

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
    BOUND = "bound"


@dataclass(frozen=True, slots=True, kw_only=True)
class Equation:
    """Components that should be zero (model − measured), and their noise; or what a constraint wants zero or below.

    ``noise`` holds for each component the standard deviation (``SIGMA``) or greatest absolute value (``BOUND``), else
    the n×n matrix row by row; it is empty for constraints. ``measured`` is the measured side (or a prior's mean) where
    it holds data only, None elsewhere: reports and pictures show it. ``measured_columns`` are the columns of the row at
    hand on the measured side, whatever it is: what a simulation replaces. ``units`` are those that the components of
    observations are reported in (None: none is known), ``projection`` is what the model side is the image of, if it is.
    ``placed``: the measured side is a line or a geometric value of data only, which ``measured`` does not hold.
    ``law`` is that of the mean of a prior, ``likelihood`` what is minimised in place of squares of whitened components.
    """

    components: tuple[Expression, ...]
    noise_kind: NoiseKind
    noise: tuple[Expression, ...]
    measured: tuple[Expression, ...] | None
    measured_columns: tuple[str, ...] = ()
    units: tuple[Unit | None, ...] = ()
    projection: Projection | None = None
    placed: bool = False
    relation: Relation = Relation.NEAR_ZERO
    law: Law = NORMAL_LAW
    likelihood: Likelihood | None = None
    span: Span

    @property
    def stated(self) -> tuple[Expression, ...]:
        """All expressions that the file states of it."""
        return (*self.components, *self.noise, *(() if self.likelihood is None else self.likelihood.own))


@dataclass(frozen=True, slots=True, kw_only=True)
class EquationCase:
    """The equations of the rows that have the values ``static``."""

    static: Static
    equations: tuple[Equation, ...]


class BlockRole(StrEnum):
    """Whether equations are measured, known besides with some uncertainty, demanded, or carry states on."""

    OBSERVATION = "observation"
    PRIOR = "prior"
    CONSTRAINT = "constraint"
    TRANSITION = "transition"


@dataclass(frozen=True, slots=True, kw_only=True)
class Loss:
    """A loss on the norm of an equation's whitened residual.

    ``scale`` is its parameter in standard deviations (None: 95 % efficiency for a residual of that many components),
    ``shape`` the exponent a of Barron's family (None for the others).
    """

    kind: LossKind
    scale: float | None = None
    shape: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class UncertainColumn:
    """``:errors ((col sigma)…)``: a measured column with an error of its own, one for each row of ``table``.

    ``table`` is the column's own table (that of a ``:with`` for a joined column), ``column`` its name there, ``key``
    the column of the block's table that holds the key of the row there (None: the row itself). The block's
    expressions hold it as ``Column(block table, name)``. ``sigma`` has one value for each row of the block's table;
    None where another observation states it.
    """

    name: str
    table: str
    column: str
    key: str | None
    sigma: RowValues | None
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Equations that hold for each row of ``table`` (once if None).

    ``unknown_factor``: the stated noise is known up to one factor, which is estimated. Of rows with the same values in
    the columns ``distinct`` one counts. ``loss`` acts on each equation and row. ``errors``: which measured columns are
    corrected; the equations' own noise adds to theirs (0 if not stated). ``constraint``: how one is written.
    ``earlier``: the row before is mentioned, so that the first of a key is unused.
    ``singular``: combinations of the components may be without noise. No outlier rule rejects rows of ``trust``.
    ``shared`` has the sizes of the common errors of the ``structure``, then the correlation that it states.
    """

    name: str
    role: BlockRole
    table: str | None
    cases: tuple[EquationCase, ...]
    when: RowValues | None
    unknown_factor: bool
    distinct: tuple[str, ...] = ()
    loss: Loss | None = None
    errors: tuple[UncertainColumn, ...] = ()
    constraint: ConstraintKind | None = None
    earlier: bool = False
    singular: bool = False
    trust: RowValues | None = None
    structure: NoiseStructure = PLAIN
    shared: tuple[RowValues, ...] = ()
    span: Span

    @property
    def factor_name(self) -> str:
        """What the factor of unknown noise is called."""
        return self.structure.shared or self.name


@dataclass(frozen=True, slots=True, kw_only=True)
class Derived:
    """A quantity computed from the estimates, once or for each row of ``table``, which ``grid`` makes if it is given.

    ``cases`` hold the matrix of a rotation (``kind``, ``dimension``) row by row, then translation, then scale.
    """

    name: str
    table: str | None
    kind: UnknownKind | None = None
    dimension: int = 0
    shape: tuple[int, ...]
    cases: tuple[ValueCase, ...]
    grid: Grid | None = None
    unit: Unit | None
    angle: bool
    span: Span

    @property
    def turns(self) -> bool:
        """It is one angle, which is reported in (−π, π]."""
        return self.angle and not self.shape


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
    IPOPT = "ipopt"
    CLOSED_FORM = "closed-form"
    DIRECT_SEARCH = "direct-search"
    INTERVAL = "interval"


@dataclass(frozen=True, slots=True, kw_only=True)
class Consensus:
    """``:robust``: how rows that agree are found; ``threshold`` in standard deviations, or ``quantile`` of χ²."""

    kind: ConsensusKind
    trials: int | None = None
    threshold: float | None = None
    quantile: float | None = None
    trusting: bool = False

    @property
    def literal(self) -> bool:
        """The answer is that of the rows kept, as if there had been no others."""
        return self.quantile is not None or self.trusting


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """How to solve, and which problems to make of the data. ``routine`` names a registered routine as the method;
    ``enclosing`` is what `Method.INTERVAL` is asked for (None: nothing more).
    """

    method: Method = Method.AUTO
    routine: str | None = None
    enclosing: Enclosing | None = None
    robust: Consensus | None = None
    starts: RandomStarts | GivenStarts | None = None
    constraints: ConstraintMethod = ConstraintMethod.PENALTY
    gauge: Gauge = Gauge.REPORT
    seed: int = 1
    max_iterations: int = 100
    tolerance: float = 1e-10
    coverage: float = 0.95
    for_each: tuple[str, ...] = ()
    window: Window | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """A whole problem. ``dimensions`` holds what unit inference found for components of unknowns and derived values.

    ``aggregates`` are those of derived quantities; ``written_out`` are those in constraints. ``earlier``
    are the tables of which a row sees the one before.
    """

    name: str
    doc: str
    plans: tuple[TablePlan, ...]
    pairs: tuple[PairDeclaration, ...] = ()
    constants: tuple[ConstantValue, ...]
    unknowns: tuple[Unknown, ...]
    blocks: tuple[Block, ...]
    derived: tuple[Derived, ...]
    aggregates: tuple[Aggregate, ...] = ()
    written_out: tuple[WrittenOut, ...] = ()
    earlier: tuple[str, ...] = ()
    request: Request
    sequence: Sequence | None = None
    dimensions: Mapping[tuple[str, int], Dimension | None]
    warnings: tuple[Diagnostic, ...] = ()
    span: Span

    @property
    def estimates_noise(self) -> bool:
        """Whether some noise follows from the residuals, so that the size of a fit does not tell whether it is good."""
        return any(block.unknown_factor or block.structure.estimated for block in self.blocks)

    def unknown(self, name: str) -> Unknown:
        """An unknown by name."""
        return next(u for u in self.unknowns if u.name == name)
