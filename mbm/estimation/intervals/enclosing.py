"""One solve by interval methods: the box that is stated, contracted, bisected, and what is left of each number."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.selection import Selection, selections
from mbm.equations.types import Floats, Mask
from mbm.estimation.intervals import faults
from mbm.estimation.intervals.building import network as network_of
from mbm.estimation.intervals.contraction import FIXED, Boxes, contracted, evaluated
from mbm.estimation.intervals.extremes import scalars_of
from mbm.estimation.intervals.network import Enclosure, Network, Ranges
from mbm.estimation.intervals.points import meets
from mbm.estimation.intervals.search import FINEST, Aims, Paving, components, paved, ranges
from mbm.problem.requests import Contractor, Enclosing
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic, MbmError

MOST_NUMBERS = 50_000_000
"""Numbers of all boxes that are kept: 800 MB with both ends."""

MOST_PIECES = 100
"""Parts of a set that are told one by one; more are what the width asked for tears apart."""


def enclose(
    problem: Problem, selection: Selection, starts: Mapping[str, Floats], stopped: Callable[[], bool]
) -> Enclosure:
    """Bounds of every parameter vector with which all observations hold within their bounds, and all constraints.

    The search ends where ``stopped`` says so: the bounds hold, but are wider.

    Raises:
        MbmError: an unknown that nothing bounds, or a bound that is no number ≥ 0.

    """
    began = time.perf_counter()
    asked = problem.request.enclosing or Enclosing()
    network = network_of(problem, selection.tables, starts)
    turning = _turning(network)
    found = _found(problem, network, asked, stopped)
    whole: Ranges | None = None
    pieces: tuple[Ranges, ...] = ()
    if len(found.boxes):
        whole = ranges(found.boxes, network.full_turn, turning)
        labels = components(found.boxes, network.full_turn)
        if 0 < labels.max() < MOST_PIECES:
            parts = (found.boxes.at(labels == part) for part in range(int(labels.max()) + 1))
            pieces = tuple(ranges(part, network.full_turn, turning) for part in parts)
    return Enclosure(
        key=selection.key,
        tables=selection.tables,
        layout=network.layout,
        wanted=network.wanted,
        whole=whole,
        pieces=pieces,
        method=f"interval-{asked.contractor.value}",
        boxes=found.examined,
        reached=found.reached,
        seconds=time.perf_counter() - began,
    )


def refusals(problem: Problem, tables: Mapping[str, Table]) -> tuple[Diagnostic, ...]:
    """What `enclose` would refuse in the first solve: looked at by contracting its box once."""
    selection = next(selections(problem, tables)[1], None)
    if selection is None:
        return ()
    asked = problem.request.enclosing or Enclosing()
    try:
        network = network_of(problem, selection.tables, {})
        if problem.sequence is not None:
            _found(problem, network, asked, lambda: True)
            return ()
        searched = network if asked.contractor is not Contractor.FORWARD else network.without_observations()
        first = contracted(searched, network.low[None], network.high[None], shrink=FIXED)
        if len(first):
            _refuse_unbounded(network, first)
    except MbmError as error:
        return error.diagnostics
    return ()


def _found(problem: Problem, network: Network, asked: Enclosing, stopped: Callable[[], bool]) -> Paving:
    """The boxes of the set: of a sequence one, frame by frame."""
    forward = asked.contractor is Contractor.FORWARD
    if problem.sequence is None:
        return _forward(network) if forward else _searched(network, asked, stopped)
    # Loaded by problems with states only, so that the others start at once.
    from mbm.estimation.intervals.frames import framed

    found = framed(network.without_observations() if forward else network, stopped)
    if not len(found.boxes):
        return found
    _refuse_unbounded(network, found.boxes)
    boxes = found.boxes
    possible = meets(network, boxes.low, boxes.high) if forward else np.ones(1, dtype=bool)
    return replace(found, boxes=boxes.at(possible))


def _turning(network: Network) -> Mask:
    """Which scalars of derived quantities (Q,) are angles."""
    found: list[bool] = []
    for wanted in network.wanted:
        rows = 1 if wanted.positions is None else len(wanted.positions)
        found += [wanted.angle] * (rows * len(wanted.nodes))
    return np.array(found, dtype=bool)


def _forward(network: Network) -> Paving:
    """The box of ``:in`` and the constraints, and what follows from it."""
    first = contracted(network.without_observations(), network.low[None], network.high[None], shrink=FIXED)
    if len(first):
        _refuse_unbounded(network, first)
        first = evaluated(network, first.low, first.high).at(meets(network, first.low, first.high))
    return Paving(boxes=first, examined=1, reached=True)


def _searched(network: Network, asked: Enclosing, stopped: Callable[[], bool]) -> Paving:
    first = contracted(network, network.low[None], network.high[None], shrink=FIXED)
    if not len(first):
        return Paving(boxes=first, examined=1, reached=True)
    _refuse_unbounded(network, first)
    aims = _aims(network, first, asked)
    if not np.isfinite(aims.widths).any():
        return Paving(boxes=first, examined=1, reached=True)
    return paved(network, first, aims, stopped)


def _aims(network: Network, first: Boxes, asked: Enclosing) -> Aims:
    """Widths and tolerances: parts of what contraction alone leaves, or as stated."""
    sides = (first.high - first.low)[0]
    widths = np.where(network.free & (sides > 0.0), asked.fraction * sides, np.inf)
    if asked.fraction >= 1.0:
        widths = np.full_like(widths, np.inf)
    for name, stated in asked.widths.items():
        entry = network.layout.entry(name)
        places = np.arange(entry.range.start, entry.range.stop)
        numbers = np.tile([float(each.value) for each in stated], entry.members)
        free = network.free[places] & (sides[places] > 0.0)
        widths[places] = np.where(free, numbers, np.inf)
    mentioned = np.zeros(len(widths), dtype=bool)
    for node in network.nodes:
        if node.places is not None:
            mentioned[node.places] = True
    widths = np.where(mentioned, widths, np.inf)
    low, high = scalars_of(network, first.low, first.high, (first.derived_low, first.derived_high))
    tolerances = asked.fraction * (high - low)[0]
    free_widths = widths[network.free]
    tolerances[: len(free_widths)] = free_widths
    tolerances[len(free_widths) :][_over_tables(network)] = np.inf
    tolerances = np.where(np.isfinite(tolerances) & (tolerances > 0.0), tolerances, np.inf)
    limit = min(asked.boxes, max(MOST_NUMBERS // (len(widths) + len(tolerances)), 1))
    finest, part = (FINEST, asked.fraction) if asked.contractor is Contractor.HULL else (1.0, np.inf)
    return Aims(widths=widths, tolerances=tolerances, limit=limit, finest=finest, part=part)


def _over_tables(network: Network) -> Mask:
    """Which scalars of derived quantities (Q,) are of rows of tables: they are as narrow as the boxes make them."""
    found: list[bool] = []
    for wanted in network.wanted:
        rows = 1 if wanted.positions is None else len(wanted.positions)
        found += [wanted.positions is not None] * (rows * len(wanted.nodes))
    return np.array(found, dtype=bool)


def _refuse_unbounded(network: Network, first: Boxes) -> None:
    wrong = ~(np.isfinite(first.low[0]) & np.isfinite(first.high[0]))
    if not wrong.any():
        return
    layout = network.layout
    coordinates = np.flatnonzero(wrong[layout.number])
    names = [layout.name(int(i)) for i in coordinates]
    raise MbmError(faults.not_bounded(layout.owner(int(coordinates[0])).unknown.span, names))
