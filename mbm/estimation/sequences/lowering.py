"""A problem with states → the equations of a step and of a transition, over the rows that the whole problem has.

Kernels, whitening and losses are those of the whole problem: only the places of numbers and coordinates change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.excerpt import with_rows
from mbm.equations.layout import Layout, places_in
from mbm.equations.types import Floats, Indices, Mask
from mbm.equations.whitening import Whitener
from mbm.estimation.minimise.native.packing import triangle_kind
from mbm.estimation.native.code import native_code
from mbm.estimation.sequences import faults
from mbm.estimation.sequences.local import Local, local
from mbm.estimation.sequences.noise import Spreads, spread_of
from mbm.estimation.sequences.places import NOT_OF_A_STEP, Places, moves, step_layout, transition_layout
from mbm.estimation.sequences.walk import Chained
from mbm.problem.kinds import ConstraintKind
from mbm.problem.sequence.types import Estimator, Sequence
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Problem
from mbm.symbolic.types import ColumnInput
from mbm.text.types import MbmError
from mbm.values import dataclass

PASSES_OF_CUTS = 50
"""Passes over all rows until the cuts of a smoother fit one another, as a guess: 55 frames of a hand took 80."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lowered:
    """``chained`` is the sequence, ``priors`` are the groups with what is known of states at the first step."""

    chained: Chained
    priors: tuple[Group, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rows:
    """A group with its rows step by step: ``first`` and ``counts`` (T,)."""

    group: Group
    equal: Mask
    first: Indices
    counts: Indices


def lowered(
    problem: Problem,
    sequence: Sequence,
    equations: Assembled,
    places: Places,
    tables: Mapping[str, Table],
    cache: EvaluationCache,
    *,
    new: Mask | None = None,
) -> Lowered:
    """The local problems of a sequence. Rows of no step are those of the first: all of them, or those with numbers
    that are ``new`` (N,).

    Raises:
        MbmError: equations such as filters do not take: with states of several steps, sampled at times that are
            estimated, with errors in measured columns.

    """
    steps = len(places.numbers)
    exact = {t.exact for t in sequence.transitions if t.exact is not None}
    known = {state.prior for state in sequence.states if state.prior is not None}
    seen: list[_Rows] = []
    limits: list[_Rows] = []
    moving: list[_Rows] = []
    priors: list[Group] = []
    undivided: list[tuple[Group, Mask]] = []
    for group, equal in _with_equality(equations):
        block = problem.blocks[group.kernel.owner]
        _refuse(block, group, equations, sequence.estimator)
        if block.role is BlockRole.TRANSITION or block.name in exact:
            moving.append(_by_step(group, equal, np.asarray(group.positions), steps - 1))
        elif block.name in known:
            priors.append(group)
        elif block.role is BlockRole.CONSTRAINT and of_no_step(group, block, places, sequence, tables):
            undivided.append((group, equal))
        elif block.role is BlockRole.CONSTRAINT and says_the_same(group, block, equations.layout, sequence):
            if block.table in (None, sequence.steps):
                undivided.append((with_rows(group, np.arange(1)), equal))
                continue
            at = steps_of(group, block, places, sequence, tables)
            first = np.argsort(at, kind="stable")[:1]
            limits.append(_by_step(with_rows(group, first), equal, at[first], steps))
        else:
            stepped = block.table is not None and sequence.column in tables[block.table].columns
            own = group if new is None or stepped else with_rows(group, np.flatnonzero(new[group.index].any(axis=1)))
            rows = _by_step(own, equal, steps_of(own, block, places, sequence, tables), steps)
            (limits if block.role is BlockRole.CONSTRAINT else seen).append(rows)
    observed = [each for each in seen if problem.blocks[each.group.kernel.owner].role is BlockRole.OBSERVATION]
    counted = sum((each.counts for each in observed), np.zeros(steps, dtype=np.int64))
    begin = int(np.argmax(counted > 0)) if bool((counted > 0).any()) else 0
    limits += [_by_step(group, equal, np.full(group.rows, begin), steps) for group, equal in undivided]
    limits.sort(key=lambda each: each.group.kernel.owner)
    passes = PASSES_OF_CUTS if sequence.estimator.cuts and sequence.estimator.whole else 1
    step = _local(equations, places, seen, limits, cache, passes)
    transitions = _transitions(problem, equations, places, moving, tables, cache, passes)
    return Lowered(
        chained=Chained(
            seen=step,
            moving=transitions[0],
            still=places.still,
            still_numbers=places.still_numbers,
            plain=places.plain,
            spreads=transitions[1],
            rates=_rates(sequence, equations, places),
            begin=begin,
        ),
        priors=tuple(priors),
    )


def _rates(sequence: Sequence, equations: Assembled, places: Places) -> Indices:
    """The free coordinate of the rate of each (n,), -1 where there is none, -2 of rates."""
    column = places_in(places.free, len(places.coordinates[0]))
    found = np.full(len(places.free), -1, dtype=np.int64)
    for state in sequence.states:
        if state.rate_of is None:
            continue
        own, rate = equations.layout.entry(state.rate_of), equations.layout.entry(state.name)
        size = own.unknown.freedom
        pairs = [column[places.coordinate[first : first + size]] for first in (own.first, rate.first)]
        found[pairs[0][pairs[0] >= 0]] = pairs[1][pairs[0] >= 0]
        found[pairs[1][pairs[1] >= 0]] = -2
    return found


def _with_equality(equations: Assembled) -> list[tuple[Group, Mask]]:
    """All groups; of those of constraints, which outputs are equations."""
    found = [(group, np.zeros(0, dtype=bool)) for group in equations.groups]
    equal = equations.equality
    found.extend((g, equal[g.first : g.first + g.kernel.outputs]) for g in equations.constraints)
    return found


def _refuse(block: Block, group: Group, equations: Assembled, estimator: Estimator) -> None:
    if block.unknown_factor:
        what = f"needs the noise of `{block.name}`: a factor follows from the residuals of all steps"
        raise MbmError(faults.not_for_filters(block.span, estimator, what, f"state `:sigma`, or {estimator.instead}"))
    if block.structure.joins:
        what = f"takes one step after the other, and {block.structure.what} of `{block.name}` joins their rows"
        raise MbmError(faults.not_for_filters(block.span, estimator, what, estimator.instead))
    if equations.implicit is not None and block.errors:
        what = f"takes no `:errors` in measured columns, as `{block.name}` has"
        raise MbmError(faults.not_for_filters(block.span, estimator, what, f"{estimator.instead}, or `:sigma` instead"))
    if group.sampled or any(triangle_kind(w) is None for w in group.whiteners):
        what = f"does not take the rows of `{block.name}`: they are sampled, or their noise is no triangle"
        raise MbmError(faults.not_for_filters(block.span, estimator, what, estimator.instead))


def of_no_step(group: Group, block: Block, places: Places, sequence: Sequence, tables: Mapping[str, Table]) -> bool:
    """Whether no row mentions what moves, or belongs to a step."""
    stepped = block.table is not None and sequence.column in tables[block.table].columns
    return not stepped and bool((places.step_of_number[group.index] == NOT_OF_A_STEP).all())


def says_the_same(group: Group, block: Block, layout: Layout, sequence: Sequence) -> bool:
    """Whether a constraint says the same of what does not move in each row: it tells something once, by the first.

    Of inequalities a filter cuts by every row.

    Its rows then differ neither in numbers of a table nor in the members of families that they pick, however many
    there are.
    """
    states = {state.name for state in sequence.states}
    same = not any(isinstance(each, ColumnInput) for each in group.kernel.parameters)
    same &= all(slot.member is None or slot.unknown in states for slot in group.kernel.variables)
    still = not any(moves(layout.entry(slot.unknown)) for slot in group.kernel.variables)
    once = block.constraint is ConstraintKind.EQUAL or sequence.estimator.whole
    return same and still and once


def steps_of(group: Group, block: Block, places: Places, sequence: Sequence, tables: Mapping[str, Table]) -> Indices:
    """The step (rows,) that each row belongs to: that of the states in it, else by its own column, else the first.

    Raises:
        MbmError: a row mentions states of several steps.

    """
    steps = places.step_of_number[group.index]
    most = steps.max(axis=1, initial=NOT_OF_A_STEP)
    if bool(((steps != most[:, None]) & (steps != NOT_OF_A_STEP)).any()):
        estimator, what = sequence.estimator, f"takes no rows with states of several steps (`{block.name}`)"
        raise MbmError(faults.not_for_filters(block.span, estimator, what, estimator.instead))
    table = None if block.table is None else tables[block.table]
    if table is not None and group.positions is not None and sequence.column in table.columns:
        keys = tables[sequence.steps].numbers(sequence.column)
        own = np.searchsorted(keys, table.numbers(sequence.column)[group.positions])
        return np.asarray(np.where(most == NOT_OF_A_STEP, own, most))
    return np.asarray(np.maximum(most, 0))


def _by_step(group: Group, equal: Mask, steps: Indices, count: int) -> _Rows:
    """The rows in the order of their steps."""
    order = np.argsort(steps, kind="stable")
    counts = np.bincount(steps, minlength=count)
    moved = replace(
        group,
        index=np.ascontiguousarray(group.index[order]),
        columns=np.ascontiguousarray(group.columns[order]),
        shared=(False,) * len(group.shared),
        shared_columns=(False,) * len(group.shared_columns),
        parameters=np.ascontiguousarray(group.parameters[order]),
        positions=None if group.positions is None else np.asarray(group.positions)[order],
        whiteners=tuple(replace(w, weights=np.ascontiguousarray(w.weights[order])) for w in group.whiteners),
    )
    return _Rows(group=moved, equal=equal, first=np.cumsum(counts) - counts, counts=counts)


def _local(
    equations: Assembled,
    places: Places,
    rows: list[_Rows],
    limits: list[_Rows],
    cache: EvaluationCache,
    passes: int,
    *,
    transition: bool = False,
) -> Local:
    """The equations of a step, or of a transition, for so many passes over all rows."""
    layout = (transition_layout if transition else step_layout)(equations.layout, places)
    free = places.free
    if transition:
        moving = free[places.still :]
        free = np.concatenate([free, moving + len(places.coordinates[0]) - places.still_coordinates])
    made, done = [], [0, 0, 0]
    for number, each in enumerate((*rows, *limits)):
        if number == len(rows):
            done = [0, 0, 0]
        group = _placed(each, places, transition=transition)
        made.append(replace(group, first=done[0], first_unit=done[1]))
        done = [done[0] + group.count, done[1] + group.rows * len(group.whiteners), 0]
    equality = [np.tile(each.equal, each.group.rows) for each in limits]
    whole = replace(
        equations,
        layout=layout,
        groups=tuple(made[: len(rows)]),
        constraints=tuple(made[len(rows) :]),
        equality=np.concatenate([np.zeros(0, dtype=bool), *equality]),
        numbers=layout.start,
        used=np.ones(len(layout.number), dtype=bool),
        free=free,
        factors=None,
        rows=None,
        _scatters=(),
    )
    every = (*rows, *limits)
    steps = len(places.numbers) - int(transition)
    first, counts = np.zeros((2, len(every), steps), dtype=np.int64)
    for number, each in enumerate(every):
        first[number], counts[number] = each.first, each.counts
    return local(whole, first, counts, cache, calls=passes * int(np.count_nonzero(counts)))


def _placed(rows: _Rows, places: Places, *, transition: bool) -> Group:
    """A group with the places of a step, or of a transition: states of the step reached stand behind the others."""
    group = rows.group
    index, columns = places.number[group.index], places.coordinate[group.columns]
    if transition:
        reached = np.repeat(np.arange(len(rows.counts)), rows.counts)[:, None] + 1
        ahead = len(places.numbers[0]) - places.still_numbers
        index = index + np.where(places.step_of_number[group.index] == reached, ahead, 0)
        ahead = len(places.coordinates[0]) - places.still_coordinates
        columns = columns + np.where(places.step_of_coordinate[group.columns] == reached, ahead, 0)
    return replace(group, index=index, columns=columns)


def _transitions(
    problem: Problem,
    equations: Assembled,
    places: Places,
    moving: list[_Rows],
    tables: Mapping[str, Table],
    cache: EvaluationCache,
    passes: int,
) -> tuple[Local, Floats]:
    """The rows of transitions as they are, not whitened, and L of each."""
    found = Spreads(steps=len(places.numbers) - 1, rows=len(places.free) - places.still)
    plain = []
    for each in moving:
        group = each.group
        block = problem.blocks[group.kernel.owner]
        stated = block.cases[group.kernel.case].equations
        code = native_code(cache).filters
        found.add(spread_of(stated, block.table, group.positions, tables, code), each.first, each.counts)
        ones = Whitener(0, group.kernel.outputs, np.ones((group.rows, group.kernel.outputs)))
        plain.append(replace(each, group=replace(group, whiteners=(ones,), losses=())))
    return _local(equations, places, plain, [], cache, passes, transition=True), found.matrices()
