"""What is known before the first step: the means and covariances that the states have there, and what has none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.types import Floats
from mbm.equations.whitening import stated_noise
from mbm.estimation.sequences.local import Local
from mbm.estimation.sequences.noise import covariance_of
from mbm.estimation.sequences.places import Places
from mbm.estimation.sequences.walk import Prior
from mbm.problem.sequence.types import Sequence as Steps
from mbm.problem.tables import Table
from mbm.problem.types import Problem

MEAN_STEPS = 20
"""Newton's steps from the start of a state to the mean of its prior: where both are stated alike, none is needed."""


def prior_of(
    problem: Problem,
    sequence: Steps,
    equations: Assembled,
    places: Places,
    groups: Sequence[Group],
    tables: Mapping[str, Table],
    seen: Local,
) -> Prior:
    """The prior of the first step, from the ``groups`` of its rows."""
    layout = seen.equations.layout
    n = len(places.free)
    column = np.full(len(equations.layout.number), -1, dtype=np.int64)
    column[places.coordinates[0][places.free]] = np.arange(n)
    open_ = np.ones(n, dtype=bool)
    covariance = np.zeros((n, n))
    point = equations.numbers.copy()
    point[places.numbers[0]] = layout.start
    for group in groups:
        block = problem.blocks[group.kernel.owner]
        own = None if block.table is None else tables[block.table]
        stated = block.cases[group.kernel.case].equations
        known = [covariance_of(e, stated_noise(e, own, group.positions, tables))[0] for e in stated]
        size = sum(len(each) for each in known)
        noise = np.zeros((size, size))
        done = 0
        for each in known:
            noise[done : done + len(each), done : done + len(each)] = each
            done += len(each)
        touched = np.unique(column[group.columns[0]])
        touched = touched[touched >= 0]
        for _ in range(MEAN_STEPS):
            slopes = group.dense_jacobian(point, column, n)[0][:, touched]
            inverse = np.linalg.pinv(slopes)
            step = -inverse @ group.values(point)[0]
            if not np.abs(step).max(initial=0.0) > 0.0:
                break
            every = np.zeros(len(equations.layout.number))
            every[places.coordinates[0][places.free[touched]]] = step
            point = equations.layout.retract(point, every)
        covariance[np.ix_(touched, touched)] = inverse @ noise @ inverse.T
        open_[touched] = False
    for entry in equations.layout.entries:
        state = next((each for each in sequence.states if each.name == entry.unknown.name), None)
        if state is not None and state.certain:
            mine = column[entry.first : entry.first + entry.unknown.freedom][np.array(state.certain)]
            open_[mine[mine >= 0]] = False
    return Prior(point=point[places.numbers[0]], covariance=covariance, open=open_)


def missing_start(point: Floats) -> bool:
    """Whether something has no value to begin with."""
    return bool(np.isnan(point).any())
