"""Which columns an equation measures: those of its measured side, or those that stand apart from the unknowns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from mbm.expression.nodes import Apply, Column, Component, Expression, Number, Operation, leaves
from mbm.expression.rows import RowChoice
from mbm.problem.tables import ROW
from mbm.problem.types import Block, BlockRole, Equation, Problem
from mbm.simulation import faults
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

_SUMS = frozenset({Operation.ADD, Operation.SUBTRACT, Operation.NEGATE, Operation.WRAP, Operation.AS_ANGLE})


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """One equation of a case of a block, with the columns that it determines and those that it only uses.

    ``projected``: the columns have errors of their own (`:errors`): true values are put on the curve first.
    """

    block: int
    case: int
    equation: int
    columns: tuple[str, ...]
    uses: frozenset[str]
    projected: bool


def measured_equations(
    problem: Problem, named: Mapping[str, tuple[str, ...]]
) -> tuple[tuple[Measured, ...], tuple[Diagnostic, ...]]:
    """All equations with something measured, each after those that determine columns it uses; and warnings.

    ``named`` gives the measured columns of observations by name, where the caller says so.

    Raises:
        MbmError: an equation that does not say what it measures; columns that determine one another.

    """
    blocks = {block.name: block for block in problem.blocks if block.role is BlockRole.OBSERVATION}
    for name in named:
        if name not in blocks:
            raise MbmError(faults.unknown_observation(name, blocks))
    found: list[Measured] = []
    notes: list[Diagnostic] = []
    for number, block in enumerate(problem.blocks):
        if block.role is not BlockRole.OBSERVATION:
            continue
        for case_number, case in enumerate(block.cases):
            for place, equation in enumerate(case.equations):
                own = _own_columns(problem, equation.components, block.table)
                columns, projected = _columns(block, equation, own, named.get(block.name))
                if not columns:
                    notes.append(faults.kept_equation(equation.span, block.name))
                    continue
                found.append(
                    Measured(
                        block=number,
                        case=case_number,
                        equation=place,
                        columns=columns,
                        uses=frozenset(own) - frozenset(columns),
                        projected=projected,
                    )
                )
    return _in_order(problem, found), tuple(notes)


def _own_columns(problem: Problem, nodes: tuple[Expression, ...], table: str | None) -> tuple[str, ...]:
    """The columns of numbers that stand in the table itself and are read from the row at hand; joined ones do not."""
    found: dict[str, None] = {}
    joined = tuple(f"{join.alias}." for plan in problem.plans if plan.name == table for join in plan.joins)
    for leaf in leaves(nodes):
        if isinstance(leaf, Column) and leaf.row is RowChoice.EACH and leaf.table == table and leaf.name != ROW:
            found[leaf.name] = None
    return tuple(name for name in found if not name.startswith(joined)) if joined else tuple(found)


def _columns(
    block: Block, equation: Equation, own: tuple[str, ...], named: tuple[str, ...] | None
) -> tuple[tuple[str, ...], bool]:
    if named is not None:
        wrong = [name for name in named if name not in own]
        if len(wrong) == len(named):
            raise MbmError(faults.unknown_observation(wrong[0], own, f"column in `{block.name}`"))
        return tuple(name for name in named if name in own), False
    uncertain = tuple(c.name for c in block.errors if c.name in own and c.sigma is not None)
    columns = tuple(name for name in own if name in equation.measured_columns)
    if columns:
        return columns, False
    if uncertain:
        return uncertain, True
    apart = _standing_apart(equation.components, own)
    if len(apart) > len(equation.components) or (own and not apart):
        raise MbmError(faults.unclear_measurement(equation.span, block.name, own))
    return apart, False


def _standing_apart(components: tuple[Expression, ...], own: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of terms without unknowns, that occur in no term with unknowns: h = model(x) − f(column)."""
    alone: set[str] = set()
    mixed: set[str] = set()
    for component in components:
        for term in _terms(component):
            found = leaves((term,))
            names = {leaf.name for leaf in found if isinstance(leaf, Column) and leaf.row is RowChoice.EACH}
            (mixed if any(isinstance(leaf, Component) for leaf in found) else alone).update(names)
    return tuple(name for name in own if name in alone - mixed)


def _terms(node: Expression) -> Iterator[Expression]:
    """The terms of a sum; a constant factor or divisor before a sum goes with each of them."""
    stack = [node]
    while stack:
        each = stack.pop()
        if isinstance(each, Apply) and each.operation in _SUMS:
            stack.extend(each.arguments)
        elif isinstance(each, Apply) and each.operation is Operation.DIVIDE and isinstance(each.arguments[1], Number):
            stack.append(each.arguments[0])
        elif isinstance(each, Apply) and each.operation is Operation.MULTIPLY:
            factors = [a for a in each.arguments if not isinstance(a, Number)]
            if len(factors) == 1:
                stack.append(factors[0])
            else:
                yield each
        else:
            yield each


def _in_order(problem: Problem, found: list[Measured]) -> tuple[Measured, ...]:
    """Each equation after those of the same table that determine columns it uses."""
    ordered: list[Measured] = []
    waiting = list(found)
    while waiting:
        for candidate in waiting:
            table = problem.blocks[candidate.block].table
            others = (o for o in waiting if o is not candidate and problem.blocks[o.block].table == table)
            if not any(candidate.uses & frozenset(o.columns) for o in others if not o.projected):
                ordered.append(candidate)
                waiting.remove(candidate)
                break
        else:
            block = problem.blocks[waiting[0].block]
            column = min(waiting[0].uses)
            raise MbmError(faults.measured_elsewhere(block.span, column, "used by an equation that it depends on"))
    return tuple(ordered)
