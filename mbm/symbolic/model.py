"""Problem → SymbolicModel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from mbm.expression.nodes import Column, Component, Expression, Number
from mbm.problem.manifold import Piece
from mbm.problem.naming import place_of
from mbm.problem.stand_ins import stand_in
from mbm.problem.types import Block, Derived, EquationCase, Problem, Unknown
from mbm.symbolic.conversion import Converter, as_written
from mbm.symbolic.types import Chart, ColumnInput, ConstantInput, Purpose, ResidualBlock, Slot, SymbolicModel
from mbm.text.types import Span

if TYPE_CHECKING:
    import sympy


def symbolic_model(problem: Problem) -> SymbolicModel:
    """The residual blocks of all observations and priors, the derived quantities, and the rows of aggregates."""
    unknowns = {u.name: u for u in (*problem.unknowns, *map(stand_in, problem.aggregates))}
    with as_written():
        blocks = [b for i, block in enumerate(problem.blocks) for b in _equations(i, block, unknowns)]
        derived = [b for i, each in enumerate(problem.derived) for b in _derived(i, each, unknowns)]
        gathered = [
            _block(each.name, Purpose.AGGREGATE, i, number, (value,), unknowns, each.span)
            for i, each in enumerate(problem.aggregates)
            for number, (_, value) in enumerate(each.cases)
        ]
    return SymbolicModel(name=problem.name, blocks=(*blocks, *derived, *gathered))


_Unknowns = Mapping[str, Unknown]


def _equations(owner: int, block: Block, unknowns: _Unknowns) -> list[ResidualBlock]:
    found = []
    for number, case in enumerate(block.cases):
        components = tuple(c for equation in case.equations for c in equation.components)
        span = case.equations[0].span if case.equations else block.span
        errors = _errors(case)
        made = _block(block.name, Purpose.EQUATION, owner, number, (*components, *errors), unknowns, span)
        if errors:
            made = _divided(made, len(components))
        found.append(replace(made, corrected=_corrected(made, block)) if block.errors else made)
    return found


def _errors(case: EquationCase) -> tuple[Expression, ...]:
    """What is minimised, and behind it what tells how well, where some equation has a likelihood; else nothing.

    Another equation of the case keeps its components, which its weights whiten.
    """
    if all(equation.likelihood is None for equation in case.equations):
        return ()
    found = [
        (e.components, e.components) if e.likelihood is None else (e.likelihood.residuals, e.likelihood.information)
        for e in case.equations
    ]
    return tuple(each for part in (0, 1) for pair in found for each in pair[part])


def _divided(made: ResidualBlock, components: int) -> ResidualBlock:
    """The block with its expressions apart: the equations' own, their likelihood, and its information."""
    middle = components + (len(made.expressions) - components) // 2
    return replace(
        made,
        expressions=made.expressions[:components],
        likelihood=made.expressions[components:middle],
        information=made.expressions[middle:],
    )


def _corrected(made: ResidualBlock, block: Block) -> tuple[int, ...]:
    """The positions of the parameters that are uncertain columns of the block."""
    names = {error.name for error in block.errors}
    return tuple(
        i
        for i, parameter in enumerate(made.parameters)
        if isinstance(parameter, ColumnInput) and parameter.table == block.table and parameter.name in names
    )


def _derived(owner: int, derived: Derived, unknowns: _Unknowns) -> list[ResidualBlock]:
    return [
        _block(derived.name, Purpose.DERIVED, owner, number, case.values, unknowns, derived.span)
        for number, case in enumerate(derived.cases)
    ]


def _block(
    name: str,
    purpose: Purpose,
    owner: int,
    case: int,
    values: tuple[Expression, ...],
    unknowns: _Unknowns,
    span: Span,
) -> ResidualBlock:
    converter = Converter()
    expressions = converter.convert(values)
    variables = _variables(converter, unknowns)
    tangents, charts = _charts(tuple(slot for slot, _ in variables), unknowns)
    columns = tuple(converter.columns.values())
    constants = tuple(converter.constants.values())
    return ResidualBlock(
        name=name,
        purpose=purpose,
        owner=owner,
        case=case,
        variables=tuple(slot for slot, _ in variables),
        variable_symbols=tuple(symbol for _, symbol in variables),
        tangents=tangents,
        charts=charts,
        parameters=(*(_column(c) for c, _ in columns), *(ConstantInput(c.name) for c, _ in constants)),
        parameter_symbols=(*(symbol for _, symbol in columns), *(symbol for _, symbol in constants)),
        expressions=expressions,
        fixed=tuple(
            i
            for chart in charts
            if all(_always_fixed(unknowns[tangents[k].unknown], tangents[k].component) for k in chart.tangents)
            for i in chart.variables
        ),
        span=span,
    )


def _always_fixed(unknown: Unknown, coordinate: int) -> bool:
    """Whether ``:fixed`` holds a coordinate of the tangent space of every member."""
    values = [] if unknown.fixed is None else [case.values[coordinate] for case in unknown.fixed.cases]
    return bool(values) and all(isinstance(value, Number) and value.value == 1 for value in values)


def _variables(converter: Converter, unknowns: _Unknowns) -> tuple[tuple[Slot, sympy.Symbol], ...]:
    """The inputs that are numbers of unknowns; a piece that is held by several numbers enters with all of them."""
    found: dict[Slot, sympy.Symbol] = {}
    for component in [c for c, _ in converter.components.values()]:
        unknown = unknowns[component.unknown]
        indices = unknown.indices() if unknown.dimension else ()
        number = indices.index(component.index) if unknown.dimension else place_of(component.index, unknown.shape)
        first, count = number, 1
        if unknown.dimension:
            first, count = next(
                (start, piece.size)
                for piece, start, _ in unknown.manifold.spans()
                if start <= number < start + piece.size
            )
        for i in range(first, first + count):
            slot = Slot(component.unknown, i, component.member)
            if slot not in found:
                index = component.index if i == number else indices[i]
                found[slot] = converter.symbol(Component(component.unknown, index, component.member))
    return tuple(found.items())


def _charts(variables: tuple[Slot, ...], unknowns: _Unknowns) -> tuple[tuple[Slot, ...], tuple[Chart, ...]]:
    """The tangent coordinates of the pieces that ``variables`` hold, and how these vary with them."""
    places = {slot: i for i, slot in enumerate(variables)}
    tangents: list[Slot] = []
    charts: list[Chart] = []
    for slot in variables:
        unknown = unknowns[slot.unknown]
        piece, number, coordinate = Piece.NUMBER, slot.component, slot.component
        if unknown.dimension:
            piece, number, coordinate = next(
                span for span in unknown.manifold.spans() if span[1] <= slot.component < span[1] + span[0].size
            )
        if slot.component != number:
            continue  # the piece came in with its first number
        first = len(tangents)
        tangents.extend(Slot(slot.unknown, coordinate + i, slot.member) for i in range(piece.tangent))
        held = tuple(places[Slot(slot.unknown, number + i, slot.member)] for i in range(piece.size))
        charts.append(Chart(piece, held, tuple(range(first, len(tangents)))))
    return tuple(tangents), tuple(charts)


def _column(column: Column) -> ColumnInput:
    return ColumnInput(column.table, column.name, column.row, column.member, column.sampling)
