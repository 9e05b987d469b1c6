"""A problem with states → the filter that generated code is, as plain data, with the answers that its test wants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence as Many
from dataclasses import replace

import numpy as np

from mbm.emit.c.files import CHUNK
from mbm.emit.c.filter_files import filter_files
from mbm.emit.faults import not_emitted
from mbm.emit.filtering.draft import filter_blueprint
from mbm.emit.filtering.types import FilterGroup, FilterPlan, FilterSystem, FixedRows, Moment, Part, StepReferences
from mbm.emit.foreign import Foreign, told
from mbm.emit.refusals import refuse_cells
from mbm.emit.routines.systems import set_capacities
from mbm.emit.types import OutputFile, Target
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.selection import groups, selections
from mbm.equations.types import Floats, Indices
from mbm.estimation.sequences.answer import Walked, derived_after
from mbm.estimation.sequences.embedded import Embedded, embedded, numbered
from mbm.estimation.sequences.places import spread_entries
from mbm.estimation.sequences.room import GroupRows, Room
from mbm.estimation.sequences.run import Begun, begun, memory_of, walk_of
from mbm.estimation.sequences.unsuited import derived_elsewhere, unsuited
from mbm.estimation.settings import Forms, settings_of
from mbm.kernels.types import KernelSet
from mbm.machine.records import reals_in, slots_by_name, view
from mbm.problem.elaborated import Elaborated
from mbm.problem.requests import divided_by
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import CellKey, Table
from mbm.report.references import loss_scale
from mbm.solver import description as of
from mbm.solver.filter_records import Chain, walk_integers, walk_reals
from mbm.solver.workspace import Rows
from mbm.symbolic.types import SymbolicModel
from mbm.text.types import MbmError
from mbm.values import dataclass
from mbm.version import __version__

MOST_REFERENCES = 500
"""Steps of the data of compile time whose answers go into the test of a generated filter: the first ones."""

ENDLESS = 2**31 - 1
"""Stands for the number of steps where integers have 32 bits; steps are counted round."""


def filter_files_of(
    found: Elaborated, model: SymbolicModel, kernels: KernelSet, cache: EvaluationCache, forms: Forms
) -> tuple[OutputFile, ...]:
    """The files of the filter of a problem, in C.

    Raises:
        MbmError: as `filter_plan`.

    """
    walks = _walks(found, kernels, cache, forms)
    plan = filter_plan(found, kernels, cache, walks)
    first = replace(found, tables=walks[0].ready.tables, raw=_first_rows(found, walks))
    drafted = filter_blueprint(first, model, kernels, plan, loss_scale, __version__)
    refuse_cells(found, Target.C, drafted.blueprint.given)
    return filter_files(drafted)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sequenced:
    """A sequence of the data of compile time, by its ``key``: the first ``count`` steps of its ``walk`` are told."""

    key: Mapping[str, CellKey]
    ready: Begun
    walk: Walked
    count: int

    @property
    def steps(self) -> Floats:
        """Where these steps are."""
        return self.ready.tables[self.ready.sequence.steps].numbers(self.ready.sequence.column)[: self.count]


def _walks(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, forms: Forms) -> list[Sequenced]:
    """The first sequences, up to one that cannot be estimated.

    Raises:
        MbmError: already the first one cannot.

    """
    problem, window = found.problem, found.problem.request.window
    starts = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    settings = settings_of(problem.request, None, forms)
    walks: list[Sequenced] = []
    left = MOST_REFERENCES
    for selection in selections(problem, found.tables)[1]:
        if window is not None and selection.rows is not None and selection.rows < window.min_rows:
            continue
        try:
            ready = begun(problem, kernels, selection.tables, starts, settings, cache)
            walk = walk_of(ready, kernels, key=selection.key, starts=starts, memory=memory_of(ready))
        except MbmError:
            if not walks:
                raise
            break
        walks.append(Sequenced(key=selection.key, ready=ready, walk=walk, count=min(walk.track.made, left)))
        left -= walks[-1].count
        if left <= 0 or walk.track.made < ready.chained.steps:
            break
    return walks


def filter_plan(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, walks: Many[Sequenced]) -> FilterPlan:
    """The filter of a problem whose method is one, by its first sequences.

    Raises:
        MbmError: it has what filters do not take, or what the rows of one step do not tell.

    """
    ready = walks[0].ready
    sequence = ready.sequence
    for what in (*unsuited(ready), *derived_elsewhere(ready, kernels)):
        why = "a generated filter is given the rows of one step at a time"
        raise MbmError(not_emitted(sequence.span, f"a problem {what}", why))
    beside = _beside(found, sequence)
    most = {**_rows_of_steps(found, sequence), **beside}
    made = embedded(ready, kernels, cache, most, frozenset(beside))
    seen = _system(made.seen, 0, _seen_groups(made))
    moving = _system(made.moving, len(seen.groups), _moving_groups(made))
    chain = made.chain.copy()
    chain[Chain.steps], chain[Chain.held], chain[Chain.begin] = ENDLESS, made.held, -1
    chain[Chain.lag] = ready.rules.lag or 0 if ready.rules.smooth else ENDLESS
    chain[Chain.kept] = made.held
    sizes = view(Chain, chain)
    places, layout = ready.places, ready.chained.seen.equations.layout
    parts, names = _parts(ready)
    moves = len(places.numbers[0]) - places.still_numbers, len(places.coordinates[0]) - places.still_coordinates
    return FilterPlan(
        method=sequence.estimator.method.value,
        chain={name: int(chain[place]) for name, place in slots_by_name(Chain).items()},
        seen=seen,
        moving=moving,
        reals=walk_reals(sizes),
        integers=walk_integers(sizes),
        skip=ready.rules.skip,
        tolerance=ready.rules.tolerance,
        smooth=ready.rules.smooth,
        point=ready.prior.point,
        factor=ready.prior.factor,
        open=ready.prior.open,
        rates=tuple(ready.chained.rates.tolist()),
        column=_columns(made.seen),
        pair_column=_columns(made.moving),
        ahead=moves,
        parts=parts,
        angles=tuple(layout.number[layout.angle & (layout.number >= 0)].tolist()),
        names=tuple(names[int(c)] for c in places.free),
        rows={Foreign(table): count for table, count in most.items()},
        beside=tuple(map(Foreign, beside)),
        key=Foreign(sequence.column),
        steps=Foreign(sequence.steps),
        reached=Foreign(sequence.reached),
        joined=tuple(map(Foreign, dict.fromkeys(table for table, _ in sequence.joined))),
        references=_references(walks),
    )


def _rows_of_steps(found: Elaborated, sequence: Sequence) -> dict[str, int]:
    """The most rows that each table with steps has at one of them in one sequence, at least 1."""
    most = {}
    for table, column in sequence.sources:
        raw = found.raw[table]
        held = raw if column in raw.columns else found.tables[table]
        most[table] = _most(held, [*(c for c in found.problem.request.for_each if c in held.columns), column])
    return most


def _beside(found: Elaborated, sequence: Sequence) -> dict[str, int]:
    """The tables without steps that have other rows in each sequence, with the most that they have in one."""
    request, stepped = found.problem.request, {table for table, _ in sequence.sources}
    most = {}
    for plan in found.problem.plans:
        raw = found.raw[plan.name]
        if plan.name not in stepped and any(
            column in raw.columns for column in divided_by(request.for_each, request.window)
        ):
            columns = [column for column in request.for_each if column in raw.columns]
            most[plan.name] = _most(raw, columns) if columns else max(len(raw), 1)
    return most


def _most(table: Table, columns: Many[str]) -> int:
    """The most rows that share the cells of some columns, at least 1."""
    return int(np.diff(groups(table, columns).first).max(initial=1))


def _first_rows(found: Elaborated, walks: Many[Sequenced]) -> dict[str, Table]:
    """The tables as they were read, with the rows of the sequences at hand up to their last step; in their order."""
    ready = walks[0].ready
    sources, keys = dict(ready.sequence.sources), found.problem.request.for_each
    more = 0 if found.problem.request.window is None else 1  # a row behind the last window tells where it ends
    ends: dict[tuple[CellKey, ...], float] = {}
    for each in walks:
        key = tuple(each.key[column] for column in keys)
        ends[key] = max([ends.get(key, -np.inf), *each.steps.tolist()])
    made = dict(found.raw)
    for name in {*sources, *(n for n, t in made.items() if any(column in t.columns for column in keys))}:
        made[name] = _of_sequences(made[name], sources.get(name), keys, ends, more)
    return made


def _of_sequences(
    table: Table, step: str | None, keys: Many[str], ends: Mapping[tuple[CellKey, ...], float], more: int
) -> Table:
    """The rows of each key in the order of their steps, as far as its end and so many ``more``."""
    places = [place for place, column in enumerate(keys) if column in table.columns]
    own: dict[tuple[CellKey, ...], float] = {}
    for key, end in ends.items():
        mine = tuple(key[place] for place in places)
        own[mine] = max(own.get(mine, -np.inf), end)
    every = groups(table, [keys[place] for place in places]) if places else None
    picked = []
    for key, end in own.items():
        rows = np.arange(len(table))
        if every is not None:
            rows = every.positions(every.cells.index(key)) if key in every.cells else rows[:0]
        if step is not None:
            at = table.numbers(step)[rows]
            order = np.argsort(at, kind="stable")
            rows = rows[order[: int((at <= end).sum()) + more]]
        picked.append(rows)
    return table.take(np.concatenate(picked))


def _parts(ready: Begun) -> tuple[dict[Foreign, Part], list[Foreign]]:
    """Where the unknowns stand, and what coordinates are called."""
    parts: dict[Foreign, Part] = {}
    names: list[Foreign] = []
    number = coordinate = 0
    for entry in spread_entries(ready.equations.layout):
        unknown = entry.unknown
        moves = unknown.is_state and entry.steps is None
        parts[Foreign(unknown.name)] = Part(number=number, coordinate=coordinate, moves=moves)
        keys: tuple[CellKey | None, ...] = (None,) if unknown.is_state or entry.keys is None else entry.keys
        number += len(keys) * unknown.size
        coordinate += len(keys) * unknown.freedom
        for key in keys:
            name = told(unknown.name) if key is None else told(unknown.name, " of ", _shown(key))
            names += [told(name, f", coordinate {k + 1}") for k in range(unknown.freedom)]
    return parts, names


def _shown(key: CellKey) -> str:
    """A key for readers."""
    return key if isinstance(key, str) else f"{key:.15g}"


def _columns(room: Room) -> tuple[int, ...]:
    equations = room.local.equations
    column = equations.columns
    return tuple(column.tolist())


def _system(room: Room, first: int, groups: tuple[FilterGroup, ...]) -> FilterSystem:
    """A room's equations with capacities for rows one by one."""
    problem = numbered(room, first)
    native = room.local.native
    largest = max((group.kernel.outputs for group in groups), default=1)
    problem[of.Problem.chunk] = max(CHUNK, 4 * -(-largest // 4))
    data = native.rows.data.copy()
    whole = data[0].copy()
    whole[of.DATA_HEAD + of.DataBlock.rows :: of.DATA_BLOCK] = [group.capacity for group in groups]
    sizes = view(of.Problem, problem)
    set_capacities(sizes, view(of.DataSet, whole))
    rows = native.rows
    return FilterSystem(
        problem=tuple(problem.tolist()),
        constants=tuple(native.constants.tolist()),
        data=tuple(data.ravel().tolist()),
        sizes=(len(rows.parameters), len(rows.weights), len(rows.index), len(rows.columns)),
        reals=reals_in(Rows, sizes),
        groups=groups,
    )


def _seen_groups(made: Embedded) -> tuple[FilterGroup, ...]:
    groups = (*made.seen.local.equations.groups, *made.seen.local.equations.constraints)
    return tuple(
        FilterGroup(
            kernel=group.kernel, moment=Moment(when), capacity=int(capacity), fixed=None if own is None else _fixed(own)
        )
        for group, when, capacity, own in zip(groups, made.whens, made.seen.capacity, made.fixed, strict=True)
    )


def _moving_groups(made: Embedded) -> tuple[FilterGroup, ...]:
    equations = made.moving.local.equations
    groups: tuple[Group, ...] = (*equations.groups, *equations.constraints)
    return tuple(
        FilterGroup(kernel=group.kernel, moment=Moment.ALWAYS, capacity=1, noise=noise)
        for group, noise in zip(groups, made.noises, strict=True)
    )


def _fixed(rows: GroupRows) -> FixedRows:
    def whole(numbers: Indices) -> tuple[int, ...]:
        return tuple(np.asarray(numbers).ravel().tolist())

    return FixedRows(
        count=len(rows),
        parameters=tuple(rows.parameters.ravel().tolist()),
        weights=tuple(rows.weights.ravel().tolist()),
        index=whole(rows.index),
        columns=whole(rows.columns),
    )


def _references(walks: Many[Sequenced]) -> StepReferences:
    """The answers of the first steps, sequence by sequence."""
    numbers, covariances, costs, derived = [], [], [], []
    for each in walks:
        track, count = each.walk.track, each.count
        touched = track.touched[:count]
        known = np.swapaxes(track.factors[:count], 1, 2) @ track.factors[:count]
        covariances.append(np.where(touched[:, :, None] | touched[:, None, :], np.nan, known))
        numbers.append(each.ready.chained.seen.equations.layout.reported(track.points[:count]))
        costs.append(track.costs[:count])
        derived += [derived_after(each.walk, k) for k in range(count if each.ready.problem.derived else 0)]
    return StepReferences(
        keys=np.concatenate([each.steps for each in walks]),
        numbers=np.concatenate(numbers),
        covariances=np.concatenate(covariances),
        costs=np.concatenate(costs),
        derived=tuple(derived),
    )
