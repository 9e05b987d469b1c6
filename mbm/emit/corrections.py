"""`:errors` for solvers that have no elimination: the true values of measured columns become unknowns of their own.

`mbm.equations.corrections` finds the best corrections for every value of the unknowns. Here both are minimised
together, one member for each row, measured with the stated standard deviation. Minimum, cost, degrees of freedom and
the covariance of the other unknowns are the same (Koch 1999, 3.7). An equation without noise of its own has that of a
measured value which it alone holds, as its measured side; else it is a constraint.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

from mbm.emit import faults
from mbm.expression.nodes import (
    Apply,
    Column,
    ColumnMember,
    Component,
    Expression,
    Number,
    Operation,
    postorder,
)
from mbm.expression.rows import RowChoice
from mbm.expression.units import parse_unit
from mbm.problem.elaborated import Elaborated
from mbm.problem.kinds import ConstraintKind, Relation
from mbm.problem.tables import ROW
from mbm.problem.types import (
    Block,
    BlockRole,
    Equation,
    EquationCase,
    Family,
    NoiseKind,
    RowValues,
    Static,
    UncertainColumn,
    Unknown,
    UnknownKind,
    ValueCase,
)
from mbm.text.types import MbmError, Span

Place = tuple[str, str]
"""A table and a column of its own."""


def with_true_values(found: Elaborated) -> Elaborated:
    """The same problem without `:errors`.

    Raises:
        MbmError: it has them beside what acts on the whole misfit of a row, or a standard deviation cannot be moved.

    """
    problem = found.problem
    if not any(block.errors for block in problem.blocks):
        return found
    _refuse(found)
    alone = _held_alone(problem.blocks)
    blocks = tuple(_parted(found, block, alone) for block in problem.blocks)
    demanded = next((b for b, made in zip(problem.blocks, blocks, strict=True) if made.role is not b.role), None)
    lossy = next((block.name for block in blocks if block.loss is not None), None)
    if demanded is not None and lossy is not None:
        what = f"`:errors` of `{demanded.name}`, which has no measured side, beside the loss of `{lossy}`"
        raise MbmError(
            faults.not_emitted(demanded.span, what, "generated solvers have no covariance for both together")
        )
    estimated = next((block for block in blocks if block.unknown_factor), None)
    if estimated is not None and lossy is not None:
        what = f"the unknown noise of `{estimated.name}` beside the loss of `{lossy}` and `:errors`"
        raise MbmError(faults.not_emitted(estimated.span, what, "true values count as unknowns of the factor there"))
    sigmas = {_own(error): _sigma(found, block, error) for block in blocks for error in block.errors}
    unknowns = [_unknown(found, place, sigma.span) for place, sigma in sorted(sigmas.items())]
    measured = [_measured(found, place, sigma) for place, sigma in sorted(sigmas.items())]
    made = [_rewritten(found, block) for block in blocks]
    changed = replace(problem, unknowns=(*problem.unknowns, *unknowns), blocks=(*made, *measured))
    return replace(found, problem=changed)


def _refuse(found: Elaborated) -> None:
    problem = found.problem
    place = next(block.span for block in problem.blocks if block.errors)
    taken = next((block.span for block in problem.blocks if block.errors and block.loss is not None), None)
    if problem.request.robust is not None or taken is not None:
        why = "consensus and losses act on the whole misfit of a row, which generated solvers take apart"
        raise MbmError(faults.not_emitted(taken or place, "`:errors` beside consensus or a loss", why))
    stated = (u for u in problem.unknowns if u.name not in found.starts)
    loose = [u for u in stated if u.start is None and u.start_lower is None and u.lower is None]
    if loose:
        why = f"generated solvers begin at stated values, and `{loose[0].name}` has none"
        raise MbmError(faults.not_emitted(place, "`:errors` without starts", why, faults.STATE_ONE))


def _own(error: UncertainColumn) -> Place:
    return error.table, error.column


def _equations(block: Block) -> Iterator[Equation]:
    return (equation for case in block.cases for equation in case.equations)


def _held(block: Block, roots: tuple[Expression, ...]) -> Counter[Place]:
    """How often expressions of a block hold each of its uncertain columns; twice what comes by way of a key."""
    by_name = {error.name: error for error in block.errors}
    arguments = [a for n in postorder(roots) if isinstance(n, Apply) for a in n.arguments]
    met = [by_name[a.name] for a in (*roots, *arguments) if isinstance(a, Column) and _here(a, block)]
    return Counter(_own(error) for error in met for _ in range(1 if error.key is None else 2))


def _here(node: Column, block: Block) -> bool:
    """Whether a column is an uncertain one of the row at hand."""
    return (
        node.table == block.table
        and node.row is RowChoice.EACH
        and any(error.name == node.name for error in block.errors)
    )


def _held_by_case(block: Block) -> Iterator[Counter[Place]]:
    yield from (
        _held(block, tuple(c for equation in case.equations for c in equation.components)) for case in block.cases
    )


def _held_alone(blocks: tuple[Block, ...]) -> frozenset[Place]:
    """Uncertain columns that one block alone holds, once in each of its cases, in the row at hand."""
    most: Counter[Place] = Counter()
    for block in blocks:
        own: Counter[Place] = Counter()
        for held in _held_by_case(block):
            own |= held
        most += own
    return frozenset(place for place, count in most.items() if count == 1)


def _parted(found: Elaborated, block: Block, alone: frozenset[Place]) -> Block:
    """A block with the noise of its measured sides where it has none; what has no measured side is a constraint."""
    if not any(_exact(equation) for equation in _equations(block)):
        return block
    cases, taken, left = [], set(), set()
    for case, held in zip(block.cases, _held_by_case(block), strict=True):
        sides = [_measured_side(block, equation, alone) for equation in case.equations]
        own = {_own(error) for errors in sides for error in errors}
        taken |= own
        left |= set(held) - own
        cases.append(
            replace(
                case,
                equations=tuple(
                    _absorbed(found, block, case.static, equation, errors)
                    for equation, errors in zip(case.equations, sides, strict=True)
                ),
            )
        )
    exact = [_exact(equation) for case in cases for equation in case.equations]
    if taken & left or (any(exact) and not all(exact)):
        why = "some of its equations have a measured side of their own, others have none"
        raise MbmError(faults.not_emitted(block.span, f"`:errors` of `{block.name}`", why, "state them apart"))
    errors = tuple(error for error in block.errors if _own(error) not in taken)
    if not any(exact):
        return replace(block, cases=tuple(cases), errors=errors)
    demanded = tuple(replace(case, equations=tuple(_demanded(e) for e in case.equations)) for case in cases)
    return replace(block, role=BlockRole.CONSTRAINT, cases=demanded, errors=errors, constraint=ConstraintKind.EQUAL)


def _exact(equation: Equation) -> bool:
    """Whether an equation has no noise of its own."""
    return bool(equation.noise) and all(isinstance(n, Number) and n.value == 0 for n in equation.noise)


def _demanded(equation: Equation) -> Equation:
    return replace(equation, noise=(), measured=None, measured_columns=(), relation=Relation.ZERO)


def _measured_side(block: Block, equation: Equation, alone: frozenset[Place]) -> tuple[UncertainColumn, ...]:
    """For each component the value that it alone holds, on one side of it; () if one has none, or has noise."""
    sides = []
    for component in equation.components if _exact(equation) and equation.noise_kind is NoiseKind.SIGMA else ():
        subtracted = isinstance(component, Apply) and component.operation is Operation.SUBTRACT
        given = component.arguments if isinstance(component, Apply) and subtracted else ()
        names = [a.name for a in given if isinstance(a, Column) and _here(a, block)]
        sides += [e for e in block.errors if e.name in names and _own(e) in alone][:1]
    return tuple(sides) if len(sides) == len(equation.components) else ()


def _absorbed(
    found: Elaborated, block: Block, static: Static, equation: Equation, errors: tuple[UncertainColumn, ...]
) -> Equation:
    """The equation with the noise of its measured side."""
    if not errors:
        return equation
    return replace(equation, noise=tuple(_case(_sigma(found, block, e), static).values[0] for e in errors))


def _case(values: RowValues, static: Static) -> ValueCase:
    """The values for the rows of a case.

    Raises:
        MbmError: they differ where the equations do not.

    """
    chosen = [case for case in values.cases if set(case.static) <= set(static)]
    if len(chosen) != 1:
        why = "it differs between rows that the equations take together"
        raise MbmError(faults.not_emitted(values.span, "this standard deviation", why))
    return chosen[0]


def _sigma(found: Elaborated, block: Block, error: UncertainColumn) -> RowValues:
    """The standard deviation of a column, said of the rows of its own table.

    Raises:
        MbmError: another clause states it, or it takes more from the block's table than what is joined to it.

    """
    beside = (e for b in found.problem.blocks for e in b.errors if b.table == block.table and _own(e) == _own(error))
    stated = error.sigma or next((e.sigma for e in beside if e.sigma is not None), None)
    if stated is None:
        why = "its size is stated beside another table"
        raise MbmError(faults.not_emitted(error.span, f"the error of `{error.name}`", why))
    if error.key is None:
        return stated
    prefix = error.name.removesuffix(error.column)

    def moved(node: Expression) -> Expression:
        if not isinstance(node, Column):
            return node
        if not node.name.startswith(prefix):
            why = f"it depends on `{node.name}`, which is no column of `{error.table}`"
            raise MbmError(faults.not_emitted(stated.span, f"the standard deviation of `{error.name}`", why))
        return replace(node, table=error.table, name=node.name.removeprefix(prefix))

    cases = tuple(
        ValueCase(
            static=tuple((name.removeprefix(prefix), value) for name, value in case.static),
            values=tuple(_mapped(value, moved) for value in case.values),
        )
        for case in stated.cases
    )
    return replace(stated, table=error.table, cases=cases)


def _mapped(root: Expression, change: Callable[[Expression], Expression]) -> Expression:
    """An expression with other leaves."""
    made: dict[int, Expression] = {}
    for node in postorder((root,)):
        if isinstance(node, Apply):
            made[id(node)] = replace(node, arguments=tuple(made[id(a)] for a in node.arguments))
        else:
            made[id(node)] = change(node)
    return made[id(root)]


def _name(place: Place) -> str:
    """What the unknown of the true values of a column is called."""
    return ".".join(place)


def _member(found: Elaborated, table: str) -> ColumnMember:
    """The member for the row at hand of the column's own table."""
    return ColumnMember(table=table, column=found.raw[table].key or ROW)


def _unknown(found: Elaborated, place: Place, span: Span) -> Unknown:
    """The true values of a column, begun at the measured ones."""
    table, column = place
    unit = found.raw[table].columns[column].unit
    return Unknown(
        name=_name(place),
        kind=UnknownKind.REAL,
        shape=(),
        family=Family(table=table, column=None, rows=table, key=found.raw[table].key),
        start=RowValues(table=table, cases=(ValueCase(static=(), values=(Column(table, column),)),), span=span),
        lower=None,
        upper=None,
        start_lower=None,
        start_upper=None,
        fixed=None,
        unit=parse_unit(unit) if unit else None,
        doc=f"true values of the column {column}, which is measured with errors",
        span=span,
    )


def _measured(found: Elaborated, place: Place, sigma: RowValues) -> Block:
    """That the values of a column are measured."""
    table, column = place
    value = Column(table, column)
    component = Apply(Operation.SUBTRACT, (Component(_name(place), (), _member(found, table)), value))
    cases = tuple(
        EquationCase(
            static=case.static,
            equations=(
                Equation(
                    components=(component,),
                    noise_kind=NoiseKind.SIGMA,
                    noise=case.values,
                    measured=(value,),
                    measured_columns=(column,),
                    span=sigma.span,
                ),
            ),
        )
        for case in sigma.cases
    )
    return Block(
        name=_name(place),
        role=BlockRole.OBSERVATION,
        table=table,
        cases=cases,
        when=None,
        unknown_factor=False,
        span=sigma.span,
    )


def _rewritten(found: Elaborated, block: Block) -> Block:
    """A block about the true values in place of the measured ones."""
    by_name = {error.name: error for error in block.errors}

    def true(node: Expression) -> Expression:
        if not isinstance(node, Column) or not _here(node, block):
            return node
        error = by_name[node.name]
        own = _member(found, error.table)
        member = own if error.key is None else ColumnMember(table=node.table, column=error.key)
        return Component(_name(_own(error)), (), member, angle=node.angle, span=node.span)

    cases = tuple(
        replace(
            case,
            equations=tuple(
                replace(equation, components=tuple(_mapped(c, true) for c in equation.components))
                for equation in case.equations
            ),
        )
        for case in block.cases
    )
    return replace(block, cases=cases, errors=())
