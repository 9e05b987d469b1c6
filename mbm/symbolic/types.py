"""Values of the symbolic stage."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from mbm.expression.nodes import Member, RowChoice
from mbm.text.types import Span

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True, slots=True)
class Slot:
    """An input that is one number of an unknown: component (from 0, row by row) of the member that ``member`` picks."""

    unknown: str
    component: int
    member: Member | None


@dataclass(frozen=True, slots=True)
class ColumnInput:
    """An input that is a number from a table."""

    table: str
    name: str
    row: RowChoice


@dataclass(frozen=True, slots=True)
class ConstantInput:
    """An input that is a constant of the problem."""

    name: str


Parameter = ColumnInput | ConstantInput


class Purpose(StrEnum):
    """What a block is for."""

    EQUATION = "equation"
    DERIVED = "derived"


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualBlock:
    """Outputs as functions of unknowns (``variables``) and data (``parameters``), for the rows of one case.

    ``owner`` and ``case`` index the problem's blocks (or derived quantities) and their cases. ``expressions`` are in
    SymPy's unevaluated form; ``variable_symbols`` and ``parameter_symbols`` are its real symbols, in the order of
    ``variables`` and ``parameters``.
    """

    name: str
    purpose: Purpose
    owner: int
    case: int
    variables: tuple[Slot, ...]
    variable_symbols: tuple[sympy.Symbol, ...] = field(repr=False)
    parameters: tuple[Parameter, ...]
    parameter_symbols: tuple[sympy.Symbol, ...] = field(repr=False)
    expressions: tuple[sympy.Expr, ...] = field(repr=False)
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class SymbolicModel:
    """All blocks of a problem."""

    name: str
    blocks: tuple[ResidualBlock, ...]
