"""Values of the symbolic stage."""

from __future__ import annotations

from dataclasses import field
from enum import StrEnum
from typing import TYPE_CHECKING

from mbm.expression.nodes import Member, Sampling
from mbm.expression.rows import Row
from mbm.problem.manifold import Piece
from mbm.text.types import Span
from mbm.values import dataclass

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, slots=True)
class Slot:
    """One number of an unknown, or one coordinate of its tangent space.

    ``component`` counts from 0, row by row, in the member that ``member`` picks.
    """

    unknown: str
    component: int
    member: Member | None


@dataclass(frozen=True, slots=True)
class ColumnInput:
    """An input that is a number from a table; ``member`` names the row where a key does, ``sampling`` where a time."""

    table: str
    name: str
    row: Row
    member: Member | None = None
    sampling: Sampling | None = None


@dataclass(frozen=True, slots=True)
class ConstantInput:
    """An input that is a constant of the problem."""

    name: str


Parameter = ColumnInput | ConstantInput


class Purpose(StrEnum):
    """What a block is for; an aggregate is made of the rows of one."""

    EQUATION = "equation"
    DERIVED = "derived"
    AGGREGATE = "aggregate"


@dataclass(frozen=True, slots=True)
class Chart:
    """How inputs vary together: the variables (their positions) that hold a piece, and its tangent coordinates."""

    piece: Piece
    variables: tuple[int, ...]
    tangents: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualBlock:
    """Outputs as functions of unknowns (``variables``) and data (``parameters``), for the rows of one case.

    Derivatives are wanted with respect to ``tangents``, coordinates of the tangent spaces; ``charts`` says how the
    variables vary with them. For plain numbers the two are the same.

    ``owner`` and ``case`` index the problem's blocks (or derived quantities, or aggregates) and their cases.
    ``expressions`` are in SymPy's unevaluated form; ``variable_symbols`` and ``parameter_symbols`` are its real
    symbols, in the order of ``variables`` and ``parameters``. ``fixed`` are the positions of the variables that are
    fixed whatever the row: no derivative by them is ever used. ``corrected`` are the positions of the parameters that
    are uncertain themselves: derivatives by them are wanted too. Where errors are not normal with stated weights,
    ``likelihood`` is what is minimised in place of ``expressions``, and ``information`` (as many) what tells how well.
    """

    name: str
    purpose: Purpose
    owner: int
    case: int
    variables: tuple[Slot, ...]
    variable_symbols: tuple[sympy.Symbol, ...] = field(repr=False)
    tangents: tuple[Slot, ...]
    charts: tuple[Chart, ...]
    parameters: tuple[Parameter, ...]
    parameter_symbols: tuple[sympy.Symbol, ...] = field(repr=False)
    expressions: tuple[sympy.Expr, ...] = field(repr=False)
    fixed: tuple[int, ...] = ()
    corrected: tuple[int, ...] = ()
    likelihood: tuple[sympy.Expr, ...] = field(default=(), repr=False)
    information: tuple[sympy.Expr, ...] = field(default=(), repr=False)
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class SymbolicModel:
    """All blocks of a problem."""

    name: str
    blocks: tuple[ResidualBlock, ...]
