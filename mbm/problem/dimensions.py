"""Unit inference through a whole problem: every clash with both places, and the units that results are given in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import chain

from mbm.expression.algebra import ONE, number
from mbm.expression.inference import Clash, Declared, Inference, origin
from mbm.expression.nodes import Apply, Column, Component, Expression, Number, Operation, leaves
from mbm.expression.units import NONE, Dimension, parse_unit
from mbm.problem import faults
from mbm.problem.aggregates import Aggregate, AggregateKind
from mbm.problem.previous import column_before
from mbm.problem.residual_units import factor_faults, with_units
from mbm.problem.sequence.dimensions import same_columns, scale_faults
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import PairDeclaration, Table
from mbm.problem.types import Block, BlockRole, Derived, Equation, NoiseKind, TablePlan, Unknown, UnknownKind
from mbm.problem.zero_points import zero_faults
from mbm.text.types import Diagnostic, Label, Place, Span


def infer(
    unknowns: tuple[Unknown, ...],
    blocks: tuple[Block, ...],
    wanted: tuple[tuple[Derived, ...], tuple[Aggregate, ...]],
    plans: tuple[TablePlan, ...],
    pairs: tuple[PairDeclaration, ...],
    tables: Mapping[str, Table],
    stated: Iterable[Mapping[str, tuple[Number, ...]]],
    sequence: Sequence | None = None,
) -> tuple[dict[tuple[str, int], Dimension | None], tuple[Block, ...], list[Diagnostic]]:
    """Dimensions of the components of unknowns and derived quantities, the blocks with their units, and the clashes.

    ``wanted`` are the derived quantities and the aggregates in them; ``stated`` are numbers given for components
    besides, such as starts from outside.
    """
    derived, aggregates = wanted
    declared, diagnostics = _with_steps(_declared(unknowns, plans, pairs, tables), sequence)
    inference = Inference(declared)
    scaled = {t.block for t in sequence.transitions if t.scale} if sequence is not None else set()
    for plan in plans:
        for kept in plan.where.cases if plan.where is not None else ():
            inference.visit(kept.values)
    for block in blocks:
        _visit_block(inference, block, noisy=block.name not in scaled)
    for unknown in unknowns:
        _visit_unknown(inference, unknown)
        angle = unknown.kind is UnknownKind.ANGLE
        given_numbers = (zip(unknown.indices(), each.get(unknown.name, ()), strict=False) for each in stated)
        for index, given in chain.from_iterable(given_numbers):
            inference.equate(Component(unknown.name, index, None, angle, unknown.span), given, given.span)
    for aggregate in aggregates:
        for _, value in aggregate.cases:
            result = number(1) if aggregate.kind is AggregateKind.COUNT else value
            inference.visit((value,))
            inference.equate(Component(aggregate.name, (), None, aggregate.angle), result, aggregate.span)
    for each in derived:
        if each.grid is not None:
            variable = Column(each.grid.table, each.grid.variable, span=each.grid.span)
            for end in each.grid.ends:
                inference.equate(variable, end, end.span)
        for case in each.cases:
            inference.visit(case.values)
            if each.unit is not None:
                unit = Number(0.0, each.unit.dimension, each.span)
                square = each.dimension**2
                lengths = case.values if not each.dimension else case.values[square : square + each.dimension]
                for value in lengths:
                    inference.equate(value, unit, each.span)
    inference.settle()
    diagnostics += [_diagnostic(clash, inference, unknowns) for clash in inference.clashes]
    diagnostics += factor_faults(blocks, inference)
    if sequence is not None:
        diagnostics += scale_faults(sequence, unknowns, inference)
    if not diagnostics:
        diagnostics += zero_faults(
            (inference, declared), (unknowns, blocks, *wanted), tables, stated, (plans, sequence)
        )
    united = blocks if diagnostics else with_units(blocks, inference, tables)
    return _dimensions(inference, unknowns, derived), united, _without_repeats(diagnostics)


def _without_repeats(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """One clash per place: the components of a vector say the same thing."""
    found: dict[Place | None, Diagnostic] = {}
    for diagnostic in diagnostics:
        found.setdefault(diagnostic.place, diagnostic)
    return list(found.values())


def _declared(
    unknowns: tuple[Unknown, ...],
    plans: tuple[TablePlan, ...],
    pairs: tuple[PairDeclaration, ...],
    tables: Mapping[str, Table],
) -> Declared:
    components = {
        (u.name, index): u.unit.dimension
        for u in unknowns
        if u.unit is not None and u.kind is not UnknownKind.ANGLE
        for index in _united(u)
    }
    components |= {
        (u.name, index): NONE
        for u in unknowns
        if u.dimension
        for index in u.indices()
        if index not in _united(u) and not (u.kind is UnknownKind.SIMILARITY and index == u.indices()[-1])
    }
    columns: dict[tuple[str, str], Dimension] = {}
    for table in tables.values():
        for column in table.columns.values():
            unit = parse_unit(column.unit) if column.unit is not None else None
            if unit is not None:
                columns[table.name, column.name] = unit.dimension
    same = {}
    for plan in plans:
        for join in plan.joins:
            for name in tables[join.table].columns if join.table in tables else ():
                same[plan.name, f"{join.alias}.{name}"] = (join.table, name)
    for pair in pairs:
        same |= _paired_columns(pair, tables, columns, same)
    for table in tables.values():
        for name in table.columns:
            before = column_before(name)
            if before:
                same[table.name, name] = same.get((table.name, before), (table.name, before))
    for unknown in unknowns:
        family = unknown.family
        if family is not None and family.column is not None:
            same[family.rows, family.column] = (family.table, family.column)
    return Declared(components=components, columns=columns, same_column=same)


def _paired_columns(
    pair: PairDeclaration,
    tables: Mapping[str, Table],
    columns: Mapping[tuple[str, str], Dimension],
    same: Mapping[tuple[str, str], tuple[str, str]],
) -> dict[tuple[str, str], tuple[str, str]]:
    """The columns of a pair are those of its tables, and its two times are of one dimension."""
    found: dict[tuple[str, str], tuple[str, str]] = {}
    if pair.steps is None:
        times = [(name, pair.by) for name in (pair.first, pair.second)]
        first, second = (same.get(time, time) for time in times)
        if second not in columns:
            found[second] = first
        elif first not in columns:
            found[first] = second
    for alias, name in pair.sides:
        for column in tables[name].columns:
            place = same.get((name, column), (name, column))
            found[pair.name, f"{alias}.{column}"] = found.get(place, place)
    found |= {(pair.name, plain): found[pair.name, name] for plain, name in pair.plain}
    return found


def _united(unknown: Unknown) -> tuple[tuple[int, ...], ...]:
    """The indices of the numbers that a unit stated for the unknown belongs to."""
    indices = unknown.indices()
    return tuple(indices[i] for i in unknown.manifold.translation()) if unknown.dimension else indices


def _with_steps(declared: Declared, sequence: Sequence | None) -> tuple[Declared, list[Diagnostic]]:
    """``declared`` with the steps' columns as one quantity, and those whose stated units differ."""
    if sequence is None:
        return declared, []
    same, clashes = same_columns(sequence, declared.columns, declared.same_column)
    shown = [
        [f"column `{name}` of `{table}`, {declared.columns[table, name].describe()}" for table, name in pair]
        for pair in clashes
    ]
    return replace(declared, same_column=same), [
        faults.unit_clash(sequence.span, left, right, ()) for left, right in shown
    ]


def _visit_block(inference: Inference, block: Block, *, noisy: bool) -> None:
    """``noisy``: the noise has the dimension of the components."""
    for condition in (block.when, block.trust):
        for values in condition.cases if condition is not None else ():
            inference.visit(values.values)
    for column in block.errors:
        for values in column.sigma.cases if column.sigma is not None else ():
            measured = Column(block.table or "", column.name, span=column.span)
            inference.equate(measured, values.values[0], values.values[0].span or column.span)
    _visit_shared(inference, block)
    for case in block.cases:
        for equation in case.equations:
            inference.visit(equation.stated)
            _visit_errors(inference, equation)
            if block.unknown_factor or block.role is BlockRole.CONSTRAINT or not noisy:
                continue
            size = len(equation.components)
            if equation.noise_kind in (NoiseKind.SIGMA, NoiseKind.BOUND):
                for component, sigma in zip(equation.components, equation.noise, strict=True):
                    inference.equate(component, sigma, sigma.span)
            else:
                for i, entry in enumerate(equation.noise):
                    product = _product(equation.components[i // size], equation.components[i % size])
                    if isinstance(entry, Number) and entry.value == 0:
                        continue  # a zero has any dimension
                    if equation.noise_kind is NoiseKind.INFORMATION:
                        inference.equate(entry, _reciprocal(product), entry.span)
                    else:
                        inference.equate(product, entry, entry.span)


def _visit_shared(inference: Inference, block: Block) -> None:
    """Common errors have the dimension of what they change; a correlation is a pure number."""
    components = [[c for equation in case.equations for c in equation.components] for case in block.cases]
    for place, values in enumerate(block.shared):
        for value in values.cases:
            inference.visit(value.values)
            if place >= len(block.structure.per):
                inference.equate(ONE, value.values[0], values.span)
                continue
            for own in components:
                for component, deviation in zip(own, value.values, strict=True):
                    inference.equate(component, deviation, deviation.span)


def _visit_errors(inference: Inference, equation: Equation) -> None:
    """Parameters of distributions are pure numbers; a step has the dimension of what is measured."""
    errors = equation.likelihood
    if errors is None:
        return
    if errors.parameter is not None:
        inference.equate(errors.parameter, ONE, errors.parameter.span or equation.span)
    step = None if errors.truncation is None else errors.truncation.step
    if step is not None:
        inference.equate(equation.components[0], step, step.span or equation.span)


def _product(a: Expression, b: Expression) -> Expression:
    return Apply(Operation.MULTIPLY, (a, b), span=a.span)


def _reciprocal(node: Expression) -> Expression:
    return Apply(Operation.DIVIDE, (ONE, node), span=node.span)


def _visit_unknown(inference: Inference, unknown: Unknown) -> None:
    angle = unknown.kind is UnknownKind.ANGLE
    bounds = (unknown.lower, unknown.upper, unknown.start_lower, unknown.start_upper)
    for values in (unknown.start, unknown.at, *bounds):
        if values is None:
            continue
        for case in values.cases:
            stated = case.values
            if unknown.dimension and values in (unknown.start, unknown.at):
                stated = _stated_translation(inference, unknown, stated)
            indices = _united(unknown) if len(stated) < unknown.size else unknown.indices()
            for index, value in zip(indices, stated, strict=False):
                component = Component(unknown.name, index, None, angle, unknown.span)
                inference.equate(component, value, value.span or values.span)
    for case in unknown.fixed.cases if unknown.fixed is not None else ():
        inference.visit(case.values)
    if unknown.unit is not None and angle and not unknown.unit.dimension.is_none:
        component = Component(unknown.name, (), None, angle, unknown.span)
        inference.equate(component, Number(0.0, unknown.unit.dimension, unknown.span), unknown.span)


def _stated_translation(
    inference: Inference, unknown: Unknown, stated: tuple[Expression, ...]
) -> tuple[Expression, ...]:
    """Of what ``:init`` states for a rotation, pose or similarity, the translation; the scale has a unit of its own."""
    inference.visit(stated)
    square = unknown.dimension**2
    if unknown.kind is UnknownKind.SIMILARITY:
        component = Component(unknown.name, unknown.indices()[-1], None, False, unknown.span)
        inference.equate(component, stated[-1], stated[-1].span or unknown.span)
    return stated[square : square + unknown.dimension]


def _dimensions(
    inference: Inference, unknowns: tuple[Unknown, ...], derived: tuple[Derived, ...]
) -> dict[tuple[str, int], Dimension | None]:
    found: dict[tuple[str, int], Dimension | None] = {}
    for unknown in unknowns:
        for i, index in enumerate(unknown.indices()):
            angle = unknown.kind is UnknownKind.ANGLE
            found[unknown.name, i] = inference.dimension(Component(unknown.name, index, None, angle))
    for each in derived:
        if each.cases:
            for i, value in enumerate(each.cases[0].values):
                found[each.name, i] = NONE if value.angle else inference.dimension(value)
    return found


def _diagnostic(clash: Clash, inference: Inference, unknowns: tuple[Unknown, ...]) -> Diagnostic:
    labels = []
    sides = ((clash.left, clash.left_dimension), (clash.right, clash.right_dimension))
    for side, dimension in sides:
        leaf = origin(side, inference, dimension) if side is not None else None
        place = _place(leaf, unknowns)
        if leaf is not None and place is not None and place != clash.span:
            labels.append(Label(place, f"{_name(leaf)} is {dimension.describe()}"))
    left = f"{_shown(clash.left)}, {clash.left_dimension.describe()},"
    if clash.right is None:
        return faults.impure(clash.span, left, tuple(labels))
    right = f"{_shown(clash.right)}, {clash.right_dimension.describe()}"
    return faults.unit_clash(clash.span, left, right, tuple(labels))


def _place(leaf: Expression | None, unknowns: tuple[Unknown, ...]) -> Span | None:
    if leaf is None:
        return None
    if isinstance(leaf, Component):
        declared = next((u for u in unknowns if u.name == leaf.unknown and u.unit is not None), None)
        return declared.span if declared is not None else leaf.span
    return leaf.span


def _name(leaf: Expression) -> str:
    if isinstance(leaf, Component):
        return f"`{leaf.unknown}`"
    if isinstance(leaf, Column):
        return f"column `{leaf.name}`"
    return "this"


def _shown(node: Expression) -> str:
    if isinstance(node, Component | Column):
        return _name(node)
    text = node.span.text if node.span is not None else ""
    return f"`{text}`" if 0 < len(text) <= 40 and "\n" not in text else "this"


def missing_units(
    unknowns: tuple[Unknown, ...], blocks: tuple[Block, ...], tables: Mapping[str, Table]
) -> list[Diagnostic]:
    """For ``--strict-units``: the unknowns and the columns in use that state no unit."""
    found: dict[tuple[str, str], Diagnostic] = {}
    for unknown in unknowns:
        pure = unknown.kind in (UnknownKind.ANGLE, UnknownKind.ROTATION, UnknownKind.DIRECTION)
        if unknown.unit is None and not pure:
            found["unknown", unknown.name] = faults.missing_unit(unknown.span, f"the unknown `{unknown.name}`")
    forms = [e.stated for block in blocks for case in block.cases for e in case.equations]
    sigmas = [error.sigma for block in blocks for error in block.errors if error.sigma is not None]
    forms += [case.values for sigma in sigmas for case in sigma.cases]
    for form in forms:
        for leaf in leaves(form):
            column = tables[leaf.table].columns.get(leaf.name) if isinstance(leaf, Column) else None
            if isinstance(leaf, Column) and column is not None and column.unit is None:
                fault = faults.missing_unit(leaf.span, f"column `{leaf.name}`")
                found.setdefault((leaf.table, leaf.name), fault)
    return list(found.values())
