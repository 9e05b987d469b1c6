"""A problem with states → the filter that generated code is, as plain data, with the answers that its test wants."""

from __future__ import annotations

from collections.abc import Mapping

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
from mbm.equations.types import Floats, Indices
from mbm.estimation.sequences.answer import derived_after
from mbm.estimation.sequences.embedded import Embedded, embedded, numbered
from mbm.estimation.sequences.places import spread_entries
from mbm.estimation.sequences.room import GroupRows, Room
from mbm.estimation.sequences.run import Begun, begun, walk_of
from mbm.estimation.sequences.unsuited import derived_elsewhere, unsuited
from mbm.estimation.settings import Forms, settings_of
from mbm.kernels.types import KernelSet
from mbm.machine.records import reals_in, slots_by_name, view
from mbm.problem.elaborated import Elaborated
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import CellKey
from mbm.report.references import loss_scale
from mbm.solver import description as of
from mbm.solver.filter_records import Chain, walk_integers, walk_reals
from mbm.solver.workspace import Rows
from mbm.symbolic.types import SymbolicModel
from mbm.text.types import MbmError
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
    plan = filter_plan(found, kernels, cache, forms)
    drafted = filter_blueprint(found, model, kernels, plan, loss_scale, __version__)
    refuse_cells(found, Target.C, drafted.blueprint.given)
    return filter_files(drafted)


def filter_plan(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, forms: Forms) -> FilterPlan:
    """The filter of a problem whose method is one.

    Raises:
        MbmError: it has what filters do not take, or what the rows of one step do not tell.

    """
    problem = found.problem
    sequence = problem.sequence
    if sequence is None:
        raise TypeError(problem.name)
    starts = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    ready = begun(problem, kernels, found.tables, starts, settings_of(problem.request, None, forms), cache)
    for what in (*unsuited(ready), *derived_elsewhere(ready, kernels)):
        why = "a generated filter is given the rows of one step at a time"
        raise MbmError(not_emitted(sequence.span, f"a problem {what}", why))
    most = _rows_of_steps(found, sequence)
    made = embedded(ready, kernels, cache, most)
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
        factor=ready.prior.factor(),
        open=np.eye(len(ready.prior.open))[ready.prior.open],
        rates=tuple(ready.chained.rates.tolist()),
        column=_columns(made.seen),
        pair_column=_columns(made.moving),
        ahead=moves,
        parts=parts,
        angles=tuple(layout.number[layout.angle & (layout.number >= 0)].tolist()),
        names=tuple(names[int(c)] for c in places.free),
        rows={Foreign(table): count for table, count in most.items()},
        key=Foreign(sequence.column),
        steps=Foreign(sequence.steps),
        reached=Foreign(sequence.reached),
        joined=tuple(map(Foreign, dict.fromkeys(table for table, _ in sequence.joined))),
        references=_references(ready, kernels, starts),
    )


def _rows_of_steps(found: Elaborated, sequence: Sequence) -> dict[str, int]:
    """The most rows that each table with steps has at one of them, at least 1."""
    most = {}
    for table, column in sequence.sources:
        raw = found.raw[table]
        keys = raw.numbers(column) if column in raw.columns else found.tables[table].numbers(column)
        counts = np.unique(keys[np.isfinite(keys)], return_counts=True)[1]
        most[table] = int(counts.max(initial=1))
    return most


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
    column = np.full(len(equations.layout.number), -1, dtype=np.int64)
    column[equations.free] = np.arange(len(equations.free))
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


def _references(ready: Begun, kernels: KernelSet, starts: Mapping[str, Floats]) -> StepReferences:
    """The answers of the first steps."""
    walk = walk_of(ready, kernels, key={}, starts=starts)
    track = walk.track
    count = min(track.made, MOST_REFERENCES)
    layout = ready.chained.seen.equations.layout
    keys = ready.tables[ready.sequence.steps].numbers(ready.sequence.column)
    touched = track.touched[:count]
    covariances = np.swapaxes(track.factors[:count], 1, 2) @ track.factors[:count]
    return StepReferences(
        keys=keys[:count],
        numbers=layout.reported(track.points[:count]),
        covariances=np.where(touched[:, :, None] | touched[:, None, :], np.nan, covariances),
        costs=track.costs[:count],
        derived=tuple(derived_after(walk, k) for k in range(count)) if ready.problem.derived else (),
    )
