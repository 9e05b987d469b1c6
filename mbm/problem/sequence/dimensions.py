"""Dimensions in sequences: the steps' columns are one quantity, and the scales of transitions go with their states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from mbm.expression.derivative import substituted
from mbm.expression.inference import Inference
from mbm.expression.nodes import Column, Component, Constant, Expression, Number, leaves
from mbm.expression.units import NONE, Dimension
from mbm.problem import faults
from mbm.problem.sequence.types import INTERVAL, PREVIOUS, Sequence, Transition, TransitionKind
from mbm.problem.types import Block, EquationCase, RowValues, Unknown, UnknownKind
from mbm.text.types import Diagnostic, Span

Place = tuple[str, str]

_POWER = {TransitionKind.RANDOM_WALK: 0, TransitionKind.CONSTANT_VELOCITY: 2}
"""The power of the time by which the unit of a scale may differ from that of its state."""


def undimensioned(nodes: tuple[Expression, ...]) -> tuple[Expression, ...]:
    """``nodes`` with numbers and constants that take whatever dimension is asked for: the time part may be left out."""
    stated = [leaf for leaf in leaves(nodes) if isinstance(leaf, Number | Constant) and leaf.dimension is not None]
    return substituted(nodes, {leaf: _open(leaf) for leaf in stated})


def _open(leaf: Number | Constant) -> Number | Constant:
    if isinstance(leaf, Number):
        return Number(leaf.value, None, leaf.span, leaf.angle, leaf.absolute)
    return Constant(leaf.name, leaf.value, None, leaf.span, leaf.angle, leaf.absolute)


def same_columns(
    sequence: Sequence, columns: Mapping[Place, Dimension], same: Mapping[Place, Place]
) -> tuple[dict[Place, Place], list[tuple[Place, Place]]]:
    """``same`` with the steps' column of all tables as one, and the pairs whose stated units differ."""
    roots = list(dict.fromkeys(same.get(source, source) for source in sequence.sources))
    known = [root for root in roots if root in columns]
    chosen = (known or roots)[0]
    clashes = [(chosen, other) for other in known if columns[other] != columns[chosen]]
    found = {place: chosen if root in roots else root for place, root in same.items()}
    found.update({root: chosen for root in roots if root != chosen})
    made = [(sequence.steps, sequence.column), (f"all {sequence.column}", sequence.column)]
    made += [(sequence.reached, name) for name in (sequence.column, PREVIOUS, INTERVAL)]
    found.update(dict.fromkeys(made, chosen))
    for table, column in sequence.joined:
        found[sequence.reached, f"{table}.{column}"] = found.get((table, column), (table, column))
    return found, clashes


def scale_faults(sequence: Sequence, unknowns: tuple[Unknown, ...], inference: Inference) -> Iterator[Diagnostic]:
    """The scales and velocities of transitions whose unit is not that of their state, with the time part or without."""
    time = inference.dimension(Column(sequence.reached, INTERVAL))
    by_name = {unknown.name: unknown for unknown in unknowns}
    for transition in sequence.transitions:
        state = by_name.get(transition.states[0])
        if state is None:
            continue
        wanted = list(_dimensions(state, inference))
        power = _POWER.get(transition.kind, 0)
        yield from _faults(transition, transition.scale, wanted, time, power, inference)
        velocity = transition.velocity
        yield from _faults(transition, velocity, wanted * (len(velocity) // max(len(wanted), 1)), time, 1, inference)


def _dimensions(state: Unknown, inference: Inference) -> Iterator[Dimension | None]:
    """The dimension of each tangent coordinate of a state."""
    indices = state.indices()
    lengths = state.manifold.translation() if state.dimension else range(state.size)
    if not state.dimension:
        for index in indices:
            yield inference.dimension(Component(state.name, index, None, state.kind is UnknownKind.ANGLE))
        return
    for piece, number, _ in state.manifold.spans():
        for _ in range(piece.tangent):
            yield inference.dimension(Component(state.name, indices[number])) if number in lengths else NONE


def _faults(
    transition: Transition,
    stated: tuple[Expression, ...],
    wanted: list[Dimension | None],
    time: Dimension | None,
    power: int,
    inference: Inference,
) -> Iterator[Diagnostic]:
    told: set[Span | None] = set()
    for node, own in zip(stated, wanted, strict=False):
        found = inference.dimension(node)
        if found is None or own is None or found == own or node.span in told:
            continue
        if power and (time is None or found == own * time**-power):
            continue
        told.add(node.span)
        span = node.span or transition.span
        shown = f"`{span.text}`, {found.describe()},"
        yield faults.unit_clash(span, shown, f"the state `{transition.states[0]}`, {own.describe()}", ())


def open_rates(
    sequence: Sequence, unknowns: tuple[Unknown, ...], priors: tuple[Block, ...]
) -> tuple[Sequence, tuple[Unknown, ...], tuple[Block, ...]]:
    """The rates with starts and priors that take any dimension; the transitions keep them as they were stated."""
    of_prior = {state.prior: state for state in sequence.states if state.rate_of is not None and state.prior}
    rates = {state.name for state in sequence.states if state.rate_of is not None}
    stated: dict[str, tuple[Expression, ...]] = {}
    opened: list[Unknown] = []
    for unknown in unknowns:
        if unknown.name in rates and unknown.start is not None:
            stated[unknown.name] = unknown.start.cases[0].values
            unknown = replace(unknown, start=_open_values(unknown.start))
        opened.append(unknown)
    found = []
    for prior in priors:
        state = of_prior.get(prior.name)
        if state is not None:
            stated[state.name] = (*stated[state.name], *prior.cases[0].equations[0].noise)
        found.append(prior if state is None else replace(prior, cases=tuple(_open_case(c) for c in prior.cases)))
    transitions = tuple(replace(t, velocity=stated.get(t.states[-1], ())) for t in sequence.transitions)
    return replace(sequence, transitions=transitions), tuple(opened), tuple(found)


def _open_values(values: RowValues) -> RowValues:
    return replace(values, cases=tuple(replace(case, values=undimensioned(case.values)) for case in values.cases))


def _open_case(case: EquationCase) -> EquationCase:
    return replace(
        case,
        equations=tuple(
            replace(e, components=undimensioned(e.components), noise=undimensioned(e.noise)) for e in case.equations
        ),
    )
