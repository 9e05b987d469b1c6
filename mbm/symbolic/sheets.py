"""Sheets of silhouettes → SymPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbm.expression.nodes import Sheet
from mbm.symbolic.conversion import Converter, as_written

if TYPE_CHECKING:
    import sympy


def converted(sheet: Sheet) -> tuple[tuple[sympy.Expr, ...], dict[int, sympy.Symbol]]:
    """u, v and the depth, and the symbols of the sheet's constants by their position; those not met are absent."""
    converter = Converter()
    with as_written():
        expressions = converter.convert(sheet.point)
    return expressions, {int(name): symbol for name, (_, symbol) in converter.constants.items()}
