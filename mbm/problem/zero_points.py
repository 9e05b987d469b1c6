"""Where a temperature stands for a difference of temperatures, or a difference for a temperature."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain

from mbm.expression.inference import Declared, Inference
from mbm.expression.nodes import Column, Component, Constant, Expression, Leaf, Number, leaves
from mbm.expression.units import scale_of
from mbm.expression.zero_points import DIFFERENCE, KELVIN, TEMPERATURE, Weights, ZeroPoints, without_unit
from mbm.problem import faults
from mbm.problem.aggregates import Aggregate, AggregateKind
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import Table
from mbm.problem.types import Block, Derived, RowValues, TablePlan, Unknown
from mbm.text.types import Diagnostic, MbmError, Span


class Check:
    """What is stated on a scale with a zero of its own in a problem, and the faults in its use."""

    def __init__(
        self,
        inference: Inference,
        same_column: Mapping[tuple[str, str], tuple[str, str]],
        unknowns: tuple[Unknown, ...],
        tables: Mapping[str, Table],
        blocks: tuple[Block, ...],
        wanted: tuple[tuple[Derived, ...], tuple[Aggregate, ...]],
    ) -> None:
        self._same, self._tables, self._unknowns, self._blocks = same_column, tables, unknowns, blocks
        self._dimension = inference.dimension
        self._derived, aggregates = wanted
        self._names = {each.name for each in unknowns if each.unit is not None and each.unit.zero}
        self._grids = {
            (each.grid.table, each.grid.variable)
            for each in self._derived
            if each.grid is not None and each.grid.scale.zero
        }
        self._add_equated()
        known: dict[str, Weights] = {}
        self._points = ZeroPoints(self._absolute, inference.dimension, known)
        for each in aggregates:
            known[each.name] = self._of_aggregate(each)
        self._aggregates = aggregates

    def _of_aggregate(self, aggregate: Aggregate) -> Weights:
        """The weights of an aggregate: of its values. A root mean square is a size, of temperatures one in kelvin."""
        if aggregate.kind in (AggregateKind.COUNT, AggregateKind.RMS):
            return frozenset({DIFFERENCE})
        found: frozenset[float] = frozenset()
        for _, value in aggregate.cases:
            weights = self._points.weights(value)
            if weights is None:
                return None
            found |= weights
        return found

    def faults(
        self,
        stated: Mapping[str, tuple[Number, ...]],
        plans: tuple[TablePlan, ...],
        sequence: Sequence | None,
    ) -> Iterator[Diagnostic]:
        """All of them. ``stated`` are starts from outside, ``plans`` say which rows are kept."""
        for plan in plans:
            for value in _every(plan.where):
                yield from self._mixed(value)
        for block in self._blocks:
            yield from self._of_block(block)
        for unknown in self._unknowns:
            yield from self._of_unknown(unknown, stated.get(unknown.name, ()))
        for aggregate in self._aggregates:
            for _, value in aggregate.cases:
                yield from self._mixed(value)
        for derived in self._derived:
            yield from self._of_derived(derived)
        for transition in sequence.transitions if sequence is not None else ():
            for value in (*transition.scale, *transition.velocity):
                yield from self._difference(value, value.span or transition.span)

    def _add_equated(self) -> None:
        """Unknowns without a unit are temperatures in degC where an equation has no other sense: ``x`` in (= 20degC x).

        What one equation says of an unknown may decide about another in the next.
        """
        equations = [
            (component, {leaf.unknown for leaf in leaves((component,)) if isinstance(leaf, Component)})
            for block in self._blocks
            for component in chain.from_iterable(each.components for case in block.cases for each in case.equations)
            if self._dimension(component) == KELVIN
        ]
        undecided = {each.name for each in self._unknowns if each.unit is None and not each.dimension}
        while True:
            points = ZeroPoints(self._absolute, self._dimension)
            possible = [(each, names) for each, names in equations if points.may_be(each, DIFFERENCE)]
            added = {name for name in undecided if self._is_temperature(name, possible)}
            if not added:
                return
            self._names |= added
            undecided -= added

    def _is_temperature(self, name: str, equations: Iterable[tuple[Expression, set[str]]]) -> bool:
        points = ZeroPoints(self._absolute, self._dimension, {name: frozenset({DIFFERENCE})})
        return any(name in names and not points.may_be(each, DIFFERENCE) for each, names in equations)

    def _absolute(self, leaf: Leaf) -> bool:
        if isinstance(leaf, Number | Constant):
            return leaf.absolute
        if isinstance(leaf, Component):
            return leaf.unknown in self._names
        if not isinstance(leaf, Column):
            return False
        place = self._same.get((leaf.table, leaf.name), (leaf.table, leaf.name))
        column = self._tables[place[0]].columns.get(place[1]) if place[0] in self._tables else None
        return place in self._grids or (column is not None and scale_of(column.unit).zero != 0.0)

    def _of_block(self, block: Block) -> Iterator[Diagnostic]:
        errors = (column.sigma for column in block.errors)
        for values in (*block.shared[: len(block.structure.per)], *errors):
            for value in _every(values):
                yield from self._difference(value, value.span or block.span)
        for values in (block.when, block.trust):
            for value in _every(values):
                yield from self._mixed(value)
        for equation in chain.from_iterable(case.equations for case in block.cases):
            for component in equation.components:
                yield from self._mixed(component)
                if not self._points.may_be(component, DIFFERENCE):
                    yield self._fault(component, DIFFERENCE, component.span or equation.span)
            truncation = None if equation.likelihood is None else equation.likelihood.truncation
            step = None if truncation is None else truncation.step
            for noise in (*equation.noise, *(() if step is None else (step,))):
                yield from self._difference(noise, noise.span or equation.span)

    def _of_unknown(self, unknown: Unknown, stated: tuple[Number, ...]) -> Iterator[Diagnostic]:
        if unknown.name not in self._names:
            return
        ends = (unknown.lower, unknown.upper, unknown.start_lower, unknown.start_upper, unknown.start, unknown.at)
        if unknown.dimension:
            yield faults.no_temperature(unknown.span, unknown.name, unknown.kind.value)
            return
        for value in (*chain.from_iterable(map(_every, ends)), *stated):
            if not self._points.may_be(value, TEMPERATURE):
                yield self._fault(value, TEMPERATURE, value.span or unknown.span)

    def _of_derived(self, derived: Derived) -> Iterator[Diagnostic]:
        values = [value for case in derived.cases for value in case.values]
        for value in values:
            yield from self._mixed(value)
        if derived.unit is not None and derived.unit.zero:
            if derived.kind is not None:
                yield faults.no_temperature(derived.span, derived.name, derived.kind.value)
            for value in values:
                if not self._points.may_be(value, TEMPERATURE):
                    yield faults.reported_difference(derived.span, derived.name, derived.unit.symbol)
        if derived.grid is not None and derived.grid.scale.zero:
            for end in derived.grid.ends:
                if not self._points.may_be(end, TEMPERATURE):
                    yield self._fault(end, TEMPERATURE, end.span or derived.grid.span)

    def _difference(self, value: Expression, place: Span) -> Iterator[Diagnostic]:
        found = self._points.misplaced(value)
        if found is not None:
            yield self._fault(found, DIFFERENCE, place)
        yield from self._plain(value, place)

    def _mixed(self, value: Expression) -> Iterator[Diagnostic]:
        found = self._points.mixed(value)
        if found is not None:
            yield self._fault(found, DIFFERENCE, found.span or value.span)
        yield from self._plain(value, value.span)

    def _plain(self, value: Expression, place: Span | None) -> Iterator[Diagnostic]:
        for found in self._points.plain(value):
            own = [leaf for leaf in leaves((found,)) if without_unit(leaf)]
            blamed = next((leaf for leaf in own if self._dimension(leaf) == KELVIN), own[0])
            yield faults.temperature_without_unit(blamed.span or place, blamed)

    def _fault(self, value: Expression, wanted: float, place: Span | None) -> Diagnostic:
        """What is wrong with ``value``, at the number, column or unknown in it that is to blame."""
        own = leaves((value,))
        plain = [each for each in own if without_unit(each) and self._dimension(each) == KELVIN]
        written = [each for each in own if isinstance(each, Number) and each.absolute]
        if plain and (wanted == TEMPERATURE or not written):
            return faults.temperature_without_unit(plain[-1].span or place, plain[-1])
        if wanted == TEMPERATURE:
            return faults.difference_for_temperature(place)
        if written:
            return faults.temperature_for_difference(written[-1].span or place, written[-1])
        column = next((each for each in own if isinstance(each, Column) and self._absolute(each)), None)
        name = next((each.unknown for each in own if isinstance(each, Component) and self._absolute(each)), None)
        constant = next((each.name for each in own if isinstance(each, Constant) and each.absolute), None)
        what = f"column `{column.name}`" if column is not None else f"`{name or constant or '…'}`"
        return faults.zero_counts(place, what)


def zero_faults(
    known: tuple[Inference, Declared],
    stated: tuple[tuple[Unknown, ...], tuple[Block, ...], tuple[Derived, ...], tuple[Aggregate, ...]],
    tables: Mapping[str, Table],
    starts: Iterable[Mapping[str, tuple[Number, ...]]],
    rows: tuple[tuple[TablePlan, ...], Sequence | None],
) -> Iterator[Diagnostic]:
    """Temperatures that stand for differences, and differences for temperatures; ``starts`` are given from outside."""
    inference, declared = known
    unknowns, blocks, derived, aggregates = stated
    units = [each.unit for each in unknowns] + [each.unit for each in derived]
    units += [each.grid.unit for each in derived if each.grid is not None]
    columns = (column for table in tables.values() for column in table.columns.values())
    if not (
        inference.has_absolute
        or any(unit is not None and unit.zero for unit in units)
        or any(scale_of(column.unit).zero for column in columns if column.unit is not None)
    ):
        return
    given: dict[str, tuple[Number, ...]] = {}
    for each in starts:
        for name, numbers in each.items():
            given[name] = given.get(name, ()) + numbers
    check = Check(inference, declared.same_column, unknowns, tables, blocks, (derived, aggregates))
    yield from check.faults(given, *rows)


def _every(values: RowValues | None) -> Iterator[Expression]:
    for case in values.cases if values is not None else ():
        yield from case.values


def is_temperature(value: Expression, place: Span) -> bool:
    """Whether a number known while compiling is a temperature on a scale with a zero of its own.

    Raises:
        MbmError: it is neither that nor a difference, such as the sum of two.

    """
    if isinstance(value, Number | Constant):
        return value.absolute
    found = _static().weights(value)
    if found is not None and not found & {DIFFERENCE, TEMPERATURE}:
        raise MbmError(faults.zero_counts(place, f"`{place.text}`"))
    return found is not None and TEMPERATURE in found and DIFFERENCE not in found


def stated_difference(value: Expression, place: Span) -> None:
    """Check that a number known while compiling may be a difference of temperatures.

    Raises:
        MbmError: it is a temperature on a scale with a zero of its own.

    """
    written = [each for each in leaves((value,)) if isinstance(each, Number | Constant) and each.absolute]
    if not written:
        return
    if _static().misplaced(value) is not None:
        raise MbmError(faults.temperature_for_difference(written[-1].span or place, written[-1]))


def _static() -> ZeroPoints:
    inference = Inference(Declared(components={}, columns={}, same_column={}))
    return ZeroPoints(lambda leaf: isinstance(leaf, Number | Constant) and leaf.absolute, inference.dimension)
