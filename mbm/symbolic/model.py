"""Problem → SymbolicModel."""

from __future__ import annotations

from mbm.expression.nodes import Column, Component, Expression
from mbm.problem.types import Block, Derived, Problem
from mbm.symbolic.conversion import Converter
from mbm.symbolic.types import ColumnInput, ConstantInput, Purpose, ResidualBlock, Slot, SymbolicModel
from mbm.text.types import Span


def symbolic_model(problem: Problem) -> SymbolicModel:
    """The residual blocks of all observations and priors, and the derived quantities, of ``problem``."""
    places = {(u.name, index): i for u in problem.unknowns for i, index in enumerate(u.indices())}
    blocks = [b for i, block in enumerate(problem.blocks) for b in _equations(i, block, places)]
    derived = [b for i, each in enumerate(problem.derived) for b in _derived(i, each, places)]
    return SymbolicModel(name=problem.name, blocks=(*blocks, *derived))


_Places = dict[tuple[str, tuple[int, ...]], int]


def _equations(owner: int, block: Block, places: _Places) -> list[ResidualBlock]:
    found = []
    for number, case in enumerate(block.cases):
        components = tuple(c for equation in case.equations for c in equation.components)
        span = case.equations[0].span if case.equations else block.span
        found.append(_block(block.name, Purpose.EQUATION, owner, number, components, places, span))
    return found


def _derived(owner: int, derived: Derived, places: _Places) -> list[ResidualBlock]:
    return [
        _block(derived.name, Purpose.DERIVED, owner, number, case.values, places, derived.span)
        for number, case in enumerate(derived.cases)
    ]


def _block(
    name: str,
    purpose: Purpose,
    owner: int,
    case: int,
    values: tuple[Expression, ...],
    places: _Places,
    span: Span,
) -> ResidualBlock:
    converter = Converter()
    expressions = converter.convert(values)
    components = tuple(converter.components.values())
    columns = tuple(converter.columns.values())
    constants = tuple(converter.constants.values())
    return ResidualBlock(
        name=name,
        purpose=purpose,
        owner=owner,
        case=case,
        variables=tuple(_slot(component, places) for component, _ in components),
        variable_symbols=tuple(symbol for _, symbol in components),
        parameters=(*(_column(c) for c, _ in columns), *(ConstantInput(c.name) for c, _ in constants)),
        parameter_symbols=(*(symbol for _, symbol in columns), *(symbol for _, symbol in constants)),
        expressions=expressions,
        span=span,
    )


def _slot(component: Component, places: _Places) -> Slot:
    return Slot(component.unknown, places[component.unknown, component.index], component.member)


def _column(column: Column) -> ColumnInput:
    return ColumnInput(column.table, column.name, column.row)
