"""Values of the emitting stage: a solver as plain data, before it is text in some language.

A *row* of a table is its position (from 0) in the table as it is given; *kept* rows are those that ``:where`` leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from enum import StrEnum
from math import isfinite
from typing import TypeAlias

from mbm.emit.answers import Agreement, Floats, Reference, Whole
from mbm.emit.foreign import Foreign
from mbm.kernels.types import Kernel
from mbm.machine.program import Program
from mbm.problem.kinds import ConstraintMethod
from mbm.problem.manifold import Piece
from mbm.problem.types import BlockRole, Loss, Method, NoiseKind, UnknownKind
from mbm.scales import Scale
from mbm.solver.range_maps import RangeMaps
from mbm.values import dataclass

Key: TypeAlias = Foreign | float
"""What a cell holds that names or tells rows apart."""


class Target(StrEnum):
    """What a solver is written in; the value is the name in ``--target``."""

    C = "c"
    PYTHON = "python"
    CASADI = "casadi"

    @property
    def solves(self) -> bool:
        """Whether what is made solves by itself; else it is functions for solvers of others."""
        return self is not Target.CASADI


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputFile:
    """A file of the folder that is made: its path there, of identifiers and mbm's own words, and its content."""

    path: str
    content: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class TableColumn:
    """A column of a table: ``source`` is its name in the file's header, ``name`` that of the problem.

    Numbers are given to the solver in SI; ``unit`` with its ``scale`` is what the file states them in, "" for none.
    """

    name: Foreign
    identifier: str
    source: Foreign
    is_text: bool
    unit: Foreign
    scale: Scale


@dataclass(frozen=True, slots=True, kw_only=True)
class TableShape:
    """A table that the solver is given: the columns that it reads, and the condition on the rows that it keeps."""

    name: Foreign
    identifier: str
    columns: tuple[TableColumn, ...]
    where: RowPrograms | None = None

    def column(self, name: Foreign) -> TableColumn:
        """A column by the problem's name."""
        return next(c for c in self.columns if c.name == name)


class Choice(StrEnum):
    """Which row of a table is meant."""

    HERE = "here"
    FIRST = "first"
    LAST = "last"


@dataclass(frozen=True, slots=True, kw_only=True)
class RowPlace:
    """A row: the one of ``table`` at hand, or its first or last kept, and from there the one that ``links`` lead to."""

    table: Foreign
    choice: Choice
    links: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnValue:
    """A cell: ``column`` of table ``owner``, where the links of ``place`` end; None: the row's number, from 1."""

    place: RowPlace
    owner: Foreign
    column: Foreign | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantValue:
    """An element of a constant of the problem, by the name that expressions have for it."""

    name: Foreign


@dataclass(frozen=True, slots=True, kw_only=True)
class LiteralKey:
    """A key that stands in the problem."""

    key: Key


InputValue: TypeAlias = ColumnValue | ConstantValue
"""Where an input of a program comes from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """For each row of ``table`` (None: once) what the key in ``cell`` names.

    It names a row of table ``target`` by its column ``key``, or (``family`` not None) a member of that family.
    """

    number: int
    identifier: str
    table: Foreign | None
    cell: ColumnValue | LiteralKey
    target: Foreign
    key: Foreign | None
    family: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FamilyShape:
    """Members: the kept rows of ``table`` (``distinct`` False), or one for each distinct value of ``key`` in them.

    ``key`` None: rows are named by their number.
    """

    number: int
    identifier: str
    table: Foreign
    key: Foreign | None
    distinct: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseProgram:
    """A program for the rows that have the ``static`` values; what it computes, in words, in ``names``."""

    static: tuple[tuple[ColumnValue, Key], ...]
    inputs: tuple[InputValue, ...]
    program: Program


@dataclass(frozen=True, slots=True, kw_only=True)
class RowPrograms:
    """Numbers computed from the row at hand of ``table`` (once if None): ``width`` of them."""

    identifier: str
    table: Foreign | None
    width: int
    cases: tuple[CaseProgram, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownShape:
    """An unknown: ``size`` numbers and ``freedom`` coordinates for each member of ``family`` (None: one member).

    ``pieces`` are the parts of its manifold in order: label, numbers, coordinates. ``angles`` are those of the numbers
    of a member that are one. ``unit`` has a ``scale``. ``bounded`` are the coordinates that
    ``lower`` and ``upper`` speak of; ``fallback`` are the numbers to begin with where the problem states none, or
    (``replaced``) instead of what it states, given by the caller of the compiler: NaN where nothing is known.
    """

    name: Foreign
    identifier: str
    kind: UnknownKind
    dimension: int
    shape: tuple[int, ...]
    size: int
    freedom: int
    pieces: tuple[tuple[str, int, int], ...]
    angles: tuple[int, ...]
    positive: bool
    family: int | None
    start: RowPrograms | None
    start_range: tuple[RowPrograms, RowPrograms] | None
    fallback: tuple[float, ...]
    replaced: bool
    lower: RowPrograms | None
    upper: RowPrograms | None
    bounded: tuple[int, ...]
    fixed: RowPrograms | None
    unit: Foreign
    scale: Scale
    doc: Foreign

    @property
    def falls_back(self) -> bool:
        """Whether it begins at the ``fallback``: a range says where to look for a start, and is none itself.

        Where nothing else is known, as of the members of a family, the middle of the range has to do.
        """
        ranged = not self.dimension and (self.start_range is not None or self.lower is not None)
        known = bool(self.fallback) and all(map(isfinite, self.fallback))
        return self.start is None and (self.replaced or known or not ranged)

    @property
    def quaternions(self) -> tuple[int, ...]:
        """Where quaternions begin among the numbers of a member."""
        return tuple(number for label, number, _ in self.pieces if label == Piece.QUATERNION.label)


@dataclass(frozen=True, slots=True, kw_only=True)
class SlotPlace:
    """An input or tangent of a kernel: component of an unknown, of the member that a link names (None: the one).

    ``shown`` is the unknown, with the member that is meant, for readers. ``ahead``: a state at the step reached.
    """

    unknown: int
    component: int
    member: int | None
    shown: Foreign
    ahead: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class EquationShape:
    """Components ``first … last`` of a kernel's outputs, their noise, the parameter of their loss (0: none)."""

    first: int
    last: int
    noise_kind: NoiseKind
    loss_scale: float
    equality: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockCase:
    """A kernel and the rows it holds for; ``noise`` computes what is stated of all equations, one after the other.

    ``input_names`` and ``equations`` are for readers.
    """

    identifier: str
    kernel: Kernel = field(repr=False)
    static: tuple[tuple[ColumnValue, Key], ...]
    variables: tuple[SlotPlace, ...]
    tangents: tuple[SlotPlace, ...]
    parameters: tuple[InputValue, ...]
    equations: tuple[EquationShape, ...]
    noise: CaseProgram | None
    input_names: tuple[Foreign, ...]
    text: tuple[Foreign, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockShape:
    """A clause: observation, prior or constraint, with its rows and cases; ``factor`` is what its noise is called."""

    name: Foreign
    identifier: str
    role: BlockRole
    table: Foreign | None
    when: RowPrograms | None
    distinct: tuple[ColumnValue, ...]
    cases: tuple[BlockCase, ...]
    unknown_factor: bool
    factor: Foreign
    loss: Loss | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DerivedShape:
    """A quantity computed from the estimates: ``size`` numbers, once or for each kept row of ``table``.

    Its cases have no equations and no noise. ``unit`` has a ``scale``. An ``angle`` is given in (−π, π].
    """

    name: Foreign
    identifier: str
    table: Foreign | None
    size: int
    angle: bool
    cases: tuple[BlockCase, ...]
    unit: Foreign
    scale: Scale


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantShape:
    """An element of a constant, in SI."""

    name: Foreign
    identifier: str
    value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverSettings:
    """How the iteration goes on, and ends."""

    method: Method
    constraints: ConstraintMethod
    max_iterations: int
    tolerance: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GivenTable:
    """The rows of a table at compile time: numbers in SI or texts, by the problem's column name."""

    name: Foreign
    columns: Mapping[Foreign, Floats | tuple[Foreign, ...]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blueprint:
    """A solver as plain data: what is given to it, how the equations are made of that, what it answers."""

    name: Foreign
    identifier: str
    version: str
    doc: Foreign
    tables: tuple[TableShape, ...]
    links: tuple[Link, ...]
    families: tuple[FamilyShape, ...]
    constants: tuple[ConstantShape, ...]
    unknowns: tuple[UnknownShape, ...]
    blocks: tuple[BlockShape, ...]
    derived: tuple[DerivedShape, ...]
    for_each: tuple[Foreign, ...]
    settings: SolverSettings
    references: tuple[Reference, ...]
    given: tuple[GivenTable, ...]
    whole: Whole
    agreement: Agreement | None
    ranges: RangeMaps | None

    @property
    def startless(self) -> frozenset[int]:
        """The unknowns (positions) that begin where the data say, unless the caller states a start."""
        own = self.ranges if self.agreement is None else self.agreement
        return frozenset() if own is None else own.startless

    def table(self, name: Foreign) -> TableShape:
        """A table by name."""
        return next(t for t in self.tables if t.name == name)

    @property
    def cases(self) -> tuple[tuple[BlockShape, BlockCase], ...]:
        """All kernels with the clause of each, those of constraints last: kernel k of the solver is element k."""
        every = [(block, case) for block in self.blocks for case in block.cases]
        return tuple(sorted(every, key=lambda each: each[0].role is BlockRole.CONSTRAINT))
