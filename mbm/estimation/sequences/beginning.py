"""A start for all steps of ``batch``: what a smoother makes of them, or estimates of more and more steps.

A smoother takes one step after the other, which finds its way where a start for the first step is good. Where it does
not take the problem, or its path is poor, too, few steps are estimated, carried on by a step or more, and estimated
again, until all are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.excerpt import excerpt
from mbm.equations.metric import cost_at
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.sequences.run import begun
from mbm.estimation.settings import Settings
from mbm.estimation.solve.estimate import assemble
from mbm.estimation.starts.carried import nothing, walk_of
from mbm.kernels.types import KernelSet
from mbm.problem.sequence.types import SequenceMethod
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.text.types import MbmError

POOR = 10.0
"""Mean square of whitened residuals from which on a start is worth more than to be carried on."""

GROWTH = 1.15
"""How many times as many steps are estimated next, one more at least: as far as states are carried on well."""

ROUGH_TOLERANCE, ROUGH_ITERATIONS = 1e-3, 40
"""Of an estimate that is but a start."""


@np.errstate(all="ignore")  # what is no value shows in the numbers
def starts_of_all_steps(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    starts: Mapping[str, Floats],
    settings: Settings,
    cache: EvaluationCache,
) -> Mapping[str, Floats]:
    """``starts`` with those of all unknowns where states carried on from the first step fit poorly, or losses may have
    several minima, and others fit better.

    States with ``starts`` from outside begin there, and so do all others then. Constraints are left out.
    """
    states = [unknown.name for unknown in problem.unknowns if unknown.is_state]
    if any(name in starts for name in states):
        return starts
    equations, binder = assemble(problem, kernels, tables, starts, cache)
    layout = equations.layout
    if equations.linear or np.isnan(layout.start).any() or equations.implicit is not None:
        return starts
    carried = {e.unknown.name: layout.start[e.range] for e in layout.entries if e.unknown.is_state}
    convex = all(loss.convex for loss, _ in loss_lines(equations))
    if convex and not _poor(equations, layout.start):
        return {**carried, **starts}
    best, settled = _smoothed(problem, kernels, tables, starts, settings, cache)
    if best is None or not settled or cost_at(equations, best) > POOR * equations.count:
        ends = [_grown(equations, binder, kernels, settings), best]
        found = [minimise(equations, point, _rough(settings)) for point in ends if point is not None]
        best = min(found, key=lambda end: end.cost).point if found else layout.start
    elif not convex:
        ended = minimise(equations, layout.start, _rough(settings))
        best = ended.point if ended.cost < cost_at(equations, best) else best
    if not cost_at(equations, best) < cost_at(equations, layout.start):
        return {**carried, **starts}
    return {**{e.unknown.name: best[e.range] for e in layout.entries}, **starts}


def _poor(equations: Assembled, point: Floats) -> bool:
    """Whether a point is too far off to be a start; what a loss makes of residuals does not tell."""
    residuals = equations.plain_residuals(point)
    return not residuals @ residuals <= POOR * equations.count


def _smoothed(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    starts: Mapping[str, Floats],
    settings: Settings,
    cache: EvaluationCache,
) -> tuple[Floats | None, bool]:
    """The numbers (N,) along a smoother's path, and whether it ends where its cost is least.

    None where it does not take the problem, or comes to no end.
    """
    sequence = problem.sequence
    if sequence is None:
        return None, False
    estimator = replace(sequence.estimator, method=SequenceMethod.SMOOTHER)
    try:
        ready = begun(
            replace(problem, sequence=replace(sequence, estimator=estimator)), kernels, tables, starts, settings, cache
        )
    except MbmError:
        return None, False
    track = ready.chained.walk(ready.prior, ready.rules, settings.stopped)
    if track.made < len(track.points):
        return None, False
    numbers = ready.equations.numbers.copy()
    numbers[ready.places.numbers] = track.points
    return numbers, track.settled


def _rough(settings: Settings) -> Settings:
    return replace(settings, tolerance=ROUGH_TOLERANCE, max_iterations=ROUGH_ITERATIONS)


def _grown(equations: Assembled, binder: Binder, kernels: KernelSet, settings: Settings) -> Floats | None:
    """The point (N,) that estimates of more and more steps lead to; None where they do not lead to the last."""
    walk = walk_of(binder, kernels, nothing)
    if walk is None:
        return None
    rough = _rough(settings)
    point, done = equations.layout.start.copy(), 1
    while True:
        last = min(max(done + 1, int(GROWTH * done)), walk.count)
        for step in range(done, last):
            if not walk.next(point, step):
                return None
        done = last
        if done == walk.count or settings.stopped():
            return point
        part = _steps(equations, done, point)
        if part is None:
            return None
        point = minimise(part, point, rough).point


def _steps(equations: Assembled, count: int, point: Floats) -> Assembled | None:
    """The equations of the first ``count`` steps alone, over their states and all constants; None: there are none."""
    layout = equations.layout
    inside = np.ones(len(layout.number), dtype=bool)
    for entry in layout.entries:
        if entry.unknown.is_state and entry.steps is None:
            inside[entry.first + count * entry.unknown.freedom : entry.coordinates.stop] = False
    units = [_units(each, np.asarray(inside[each.columns].all(axis=1))) for each in equations.groups]
    columns = equations.free[inside[equations.free]]
    chosen = np.concatenate(units) if units else np.empty(0, dtype=np.int64)
    if not len(chosen) or not len(columns):
        return None
    return excerpt(replace(equations, numbers=point), columns, chosen)


def _units(group: Group, rows: Mask) -> Indices:
    """The units of some rows."""
    per_row = len(group.whiteners)
    return (group.first_unit + np.flatnonzero(rows)[:, None] * per_row + np.arange(per_row)).ravel()
