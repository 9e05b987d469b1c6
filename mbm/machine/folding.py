"""Operations of restricted Python, and what constant integers in them decide when the text is read."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from operator import add, eq, floordiv, ge, gt, le, lt, mod, mul, ne, sub

from mbm.machine.kinds import Type
from mbm.machine.tree import Binary, Compare, Expression, Literal

OPERATORS: Mapping[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "//",
    ast.Mod: "%",
}
COMPARISONS: Mapping[type[ast.cmpop], str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}
_COMPUTE: Mapping[str, Callable[[int, int], int]] = {
    "+": add,
    "-": sub,
    "*": mul,
    "//": floordiv,
    "%": mod,
}
_DECIDE: Mapping[str, Callable[[float, float], bool]] = {
    "<": lt,
    "<=": le,
    ">": gt,
    ">=": ge,
    "==": eq,
    "!=": ne,
}


def folded(operator: str, left: Expression, right: Expression) -> Expression:
    """``left operator right``, where the integers in it decide it without computation."""
    if left.type is Type.INTEGER:
        match operator, left, right:
            case _, Literal(value=int(a)), Literal(value=int(b)) if b or operator in "+-*":
                return Literal(_COMPUTE[operator](a, b))
            case ("*" | "//", _, Literal(value=1)) | ("+" | "-", _, Literal(value=0)):
                return left
            case ("*", Literal(value=1), _) | ("+", Literal(value=0), _):
                return right
            case "%", _, Literal(value=1):
                return Literal(0)
    return Binary(operator, left, right)


def compared(operator: str, left: Expression, right: Expression) -> Expression:
    """``left operator right``, likewise."""
    if isinstance(left, Literal) and isinstance(right, Literal) and left.type is Type.INTEGER:
        return Literal(int(_DECIDE[operator](left.value, right.value)))
    return Compare(operator, left, right)


def assigned(body: list[ast.stmt]) -> set[str]:
    """The names that the body of a loop assigns, those of elements and fields left aside."""
    inner = (node for statement in body for node in ast.walk(statement))
    return {node.id for node in inner if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}


def leaves(body: list[ast.stmt]) -> bool:
    """Whether the body of a loop holds a ``break`` or ``continue``."""
    return any(isinstance(node, ast.Break | ast.Continue) for statement in body for node in ast.walk(statement))
