"""A start for many steps: few are estimated, carried on by a step or more, and estimated again, until all are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import Group
from mbm.equations.excerpt import excerpt
from mbm.equations.metric import cost_at
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.estimation.starts.carried import nothing, walk_of
from mbm.kernels.types import KernelSet

POOR = 10.0
"""Mean square of whitened residuals from which on a start is worth more than to be carried on."""

GROWTH = 1.15
"""How many times as many steps are estimated next, one more at least: as far as states are carried on well."""

ROUGH_TOLERANCE, ROUGH_ITERATIONS = 1e-3, 40
"""Of an estimate that is but a start."""


@np.errstate(all="ignore")  # what is no value shows in the numbers
def begun_step_by_step(
    equations: Assembled, binder: Binder, kernels: KernelSet, starts: Mapping[str, Floats], settings: Settings
) -> Assembled:
    """The equations with a better start, if theirs is poor and one is found.

    States with ``starts`` from outside begin there, and so do all others then. Constraints are left out.
    """
    layout = equations.layout
    states = [entry for entry in layout.entries if entry.unknown.is_state]
    known = any(entry.unknown.name in starts for entry in states)
    if known or equations.linear or not states or np.isnan(layout.start).any() or equations.implicit is not None:
        return equations
    cost = cost_at(equations, layout.start)
    if cost <= POOR * equations.count:
        return equations
    point = _grown(equations, binder, kernels, settings)
    if point is None or not cost_at(equations, point) < cost:
        return equations
    return replace(equations, layout=replace(layout, start=point), numbers=point)


def _grown(equations: Assembled, binder: Binder, kernels: KernelSet, settings: Settings) -> Floats | None:
    """The point (N,) that estimates of more and more steps lead to; None where they do not lead to the last."""
    walk = walk_of(binder, kernels, nothing)
    if walk is None:
        return None
    rough = replace(settings, tolerance=ROUGH_TOLERANCE, max_iterations=ROUGH_ITERATIONS)
    point, done = equations.layout.start, 1
    while True:
        last = min(max(done + 1, int(GROWTH * done)), walk.count)
        for step in range(done, last):
            ahead = walk.next(point, step)
            if ahead is None:
                return None
            point = ahead
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
