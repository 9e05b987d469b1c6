"""Elaborated problem with states + plan of its filter → blueprint: what the caller gives at a step, and the clauses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mbm.emit.answers import Answers, Whole
from mbm.emit.blueprint import Drafting, LossScale
from mbm.emit.filtering.types import FilterBlueprint, FilterGroup, FilterPlan, WindowShape
from mbm.emit.foreign import Foreign
from mbm.emit.identifiers import FILTER_CASE_FORMS, FILTER_DERIVED_FORMS, FILTER_FORMS, TAKEN_IN_FILTERS, Identifiers
from mbm.emit.places import Places
from mbm.emit.reading import counted_tables, used_columns
from mbm.emit.routines.modules import known
from mbm.emit.types import (
    BlockCase,
    BlockShape,
    Blueprint,
    Choice,
    ColumnValue,
    ConstantValue,
    DerivedShape,
    FamilyShape,
    SlotPlace,
    TableShape,
)
from mbm.expression.nodes import ColumnMember
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.problem.requests import Window, divided_by
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import Column, TableDeclaration
from mbm.problem.types import Block, BlockRole, Family, Problem, TablePlan, Unknown
from mbm.symbolic.types import Slot, SymbolicModel

KEY = "key"
"""The column of the keys of a family's members."""


def filter_blueprint(
    found: Elaborated,
    model: SymbolicModel,
    kernels: KernelSet,
    plan: FilterPlan,
    loss_scale: LossScale,
    version: str,
) -> FilterBlueprint:
    """The filter of a problem as plain data."""
    drafting = _FilterDrafting(_with_tables(found, plan), model, kernels, plan, loss_scale)
    drafted = drafting.whole(version)
    links = tuple(replace(link, family=None) for link in drafted.links)
    given = {table.name: table for table in drafted.given}
    tables = tuple(_read_columns(drafted, plan))
    request = found.problem.request
    families = tuple(given[family.table].columns[Foreign(KEY)] for family in drafted.families)
    cases = {id(case.kernel): case for block in drafted.blocks for case in block.cases}

    def picked(groups: tuple[FilterGroup, ...]) -> tuple[BlockCase, ...]:
        return tuple(cases[id(group.kernel)] for group in groups)

    return FilterBlueprint(
        blueprint=replace(drafted, tables=tables, links=links, families=(), for_each=()),
        plan=plan,
        seen=picked(plan.seen.groups),
        moving=picked(plan.moving.groups),
        given=tuple(t.name for t in tables if t.name in plan.rows and t.name not in plan.beside),
        beside=tuple(t.name for t in tables if t.name in plan.beside),
        files=replace(
            drafted,
            tables=tuple(t for t in drafted.tables if t.name in plan.rows),
            for_each=tuple(map(Foreign, request.for_each)),
        ),
        window=None if request.window is None else _window(found.problem, request.window),
        family_sizes=tuple(map(len, families)),
    )


def _read_columns(drafted: Blueprint, plan: FilterPlan) -> Iterator[TableShape]:
    """The tables with the columns that the filter itself reads, and those of steps."""
    clauses: list[BlockShape | DerivedShape] = [*drafted.blocks, *drafted.derived]
    wheres = [table.where for table in drafted.tables]
    used = used_columns(clauses, drafted.unknowns, wheres, drafted.links, drafted.families)
    counted = counted_tables(clauses, drafted.unknowns, drafted.links, drafted.families)
    for table in drafted.tables:
        columns = tuple(c for c in table.columns if (table.name, c.name) in used or c.name == plan.key)
        if columns or table.name in counted:
            yield replace(table, columns=columns or table.columns[:1])


def _window(problem: Problem, window: Window) -> WindowShape:
    observed = (b.table for b in problem.blocks if b.role is BlockRole.OBSERVATION and b.table is not None)
    return WindowShape(
        column=Foreign(window.column),
        length=window.length,
        step=window.step,
        least=window.min_rows,
        observed=tuple(map(Foreign, dict.fromkeys(observed))),
    )


def _sequence(found: Elaborated) -> Sequence:
    if found.problem.sequence is None:
        raise TypeError(found.problem.name)
    return found.problem.sequence


def _with_tables(found: Elaborated, plan: FilterPlan) -> Elaborated:
    """The same with the tables that are made, and with the first steps alone; states are no families."""
    problem, sequence = found.problem, _sequence(found)
    steps = found.tables[sequence.steps]
    made = {sequence.steps: steps, sequence.reached: found.tables[sequence.reached]}
    families = {u.family.rows: u.family for u in problem.unknowns if u.family is not None and not u.is_state}
    for family in families.values():
        rows = found.tables[family.rows]
        numbers = np.arange(1.0, len(rows) + 1.0)
        keys = Column(name=KEY, numbers=numbers) if family.key is None else replace(rows.columns[family.key], name=KEY)
        name = _members(family)
        made[name] = replace(rows, name=name, columns={KEY: keys}, key=KEY, groups={})
        if family.rows not in found.raw:
            made[family.rows] = rows
    plans = tuple(
        TablePlan(declaration=TableDeclaration(name=name, source="table", path=None, span=problem.span))
        for name in made
    )
    raw = {**found.raw, **made}
    unknowns = tuple(_plain(unknown) for unknown in problem.unknowns)
    return replace(
        found,
        problem=replace(
            problem,
            plans=(*problem.plans, *plans),
            unknowns=unknowns,
            # their columns are in files, whatever reads them
            request=replace(
                problem.request,
                for_each=(sequence.column, *divided_by(problem.request.for_each, problem.request.window)),
            ),
        ),
        raw=raw,
    )


def _plain(unknown: Unknown) -> Unknown:
    """An unknown without what says where it begins and ends: numbers say that."""
    family = None if unknown.is_state else unknown.family
    return replace(
        unknown,
        family=family,
        start=None,
        lower=None,
        upper=None,
        start_lower=None,
        start_upper=None,
        fixed=None,
        at=None,
    )


def _members(family: Family) -> str:
    return f"members of {family.rows}"


class _FilterPlaces(Places):
    """Places in the rows of one step: columns of transitions are those of the only row that a table has there."""

    __slots__ = ("sequence",)
    sequence: Sequence

    def own_table(self, name: str) -> str:
        """Tables that are made are given too."""
        return name

    def distinct(self, name: str) -> tuple[ColumnValue, ...]:
        """No table is made of the distinct values of a column: what it is made of is given."""
        del name
        return ()

    def cell(self, table: str, name: str, choice: Choice = Choice.HERE) -> ColumnValue:
        """The cell of a column in the chosen row of a table."""
        if table == self.sequence.reached:
            joined = next((each for each in self.sequence.joined if ".".join(each) == name), None)
            if joined is not None:
                return super().cell(*joined, Choice.FIRST)
        return super().cell(table, name, choice)

    def family(self, family: Family) -> FamilyShape:
        """A family by the keys that it has."""
        identity = (family.rows, family.key)
        if identity not in self.families:
            self.families[identity] = FamilyShape(
                number=len(self.families),
                identifier=self.names.made(f"{family.rows}_members"),
                table=Foreign(_members(family)),
                key=Foreign(KEY),
                distinct=False,
            )
        return self.families[identity]


class _FilterDrafting(Drafting):
    """A blueprint of a filter under construction."""

    problem_forms = FILTER_FORMS
    case_forms = FILTER_CASE_FORMS
    derived_forms = FILTER_DERIVED_FORMS
    NO_CELL = Foreign("")
    """Stands where a number is that no cell gives."""

    def __init__(
        self,
        found: Elaborated,
        model: SymbolicModel,
        kernels: KernelSet,
        plan: FilterPlan,
        loss_scale: LossScale,
    ) -> None:
        taken = TAKEN_IN_FILTERS.union(f"function.{name}" for name in known())
        super().__init__(found, model, kernels, NOTHING, loss_scale, taken)
        self.plan = plan
        self.places: _FilterPlaces = _places(found, self.names)
        groups = (*plan.seen.groups, *plan.moving.groups)
        self.kernels = {id(group.kernel) for group in groups}  # of kinds of rows that there are
        owners = {group.kernel.owner for group in groups}
        self.owners = sorted(owners)
        self.fixed = {group.kernel.owner for group in plan.seen.groups if group.fixed is not None}

    def clauses(self) -> tuple[BlockShape, ...]:
        """Those of steps and of transitions: what is known of the first step is no clause."""
        return tuple(self.clause(owner, self.problem.blocks[owner]) for owner in self.owners)

    def clause(self, number: int, block: Block) -> BlockShape:
        """A clause with its kernels; where the filter has the rows itself, with nothing that makes them of tables."""
        if number not in self.fixed:
            made = super().clause(number, block)
            return replace(made, cases=tuple(case for case in made.cases if id(case.kernel) in self.kernels))
        links, families = dict(self.places.links), dict(self.places.families)
        made = super().clause(number, replace(block, when=None, distinct=()))
        self.places.links, self.places.families = links, families
        cases = tuple(
            replace(case, static=(), noise=None, parameters=(ConstantValue(name=self.NO_CELL),) * len(case.parameters))
            for case in made.cases
        )
        return replace(made, table=None, cases=cases)

    def place(self, slot: Slot, table: str | None) -> SlotPlace:
        """Of a state that moves there are two in a transition: that of the step before, and of the one reached."""
        found = super().place(slot, table)
        moves = self.plan.parts[Foreign(slot.unknown)].moves
        sequence = self.places.sequence
        reached = isinstance(slot.member, ColumnMember) and slot.member.column == sequence.column
        return replace(found, ahead=moves and reached and table == sequence.reached)


def _places(found: Elaborated, names: Identifiers) -> _FilterPlaces:
    places = _FilterPlaces(found, names)
    places.sequence = _sequence(found)
    return places


_NONE = np.empty(0)
NOTHING = Answers(
    references=(),
    whole=Whole(
        start=_NONE,
        names=(),
        bound=(),
        residuals=_NONE,
        jacobian=np.empty((0, 0)),
        answer=_NONE,
        covariance=np.empty((0, 0)),
        derived=(),
    ),
    agreement=None,
    ranges=None,
)
"""No answers of solves: those of steps are the plan's."""
