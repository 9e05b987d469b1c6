"""Rows of a pose graph that the others contradict: a false loop bends all that it spans, and its own residual is small.

What shows it is the residual over the root of its redundancy (Baarda 1968): its square is what χ² falls by, without
that number. Under true noise it is a standard normal variate, however little a row is checked by others. A convex loss
bounds the pull of such rows, but goes on being drawn by them; what they cost is then the least that χ² falls by.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import log, sqrt

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.binding import Group
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices, Mask, Minimum, Observability
from mbm.estimation.trust import faults
from mbm.estimation.trust.plausibility import IMPROBABLE
from mbm.problem.tables import Table
from mbm.problem.types import Problem, UnknownKind
from mbm.text.types import Diagnostic, Label
from mbm.values import dataclass

SCATTER = 30.0
"""Multiple of the scatter of the other residuals that is beyond any noise, where the noise is stated too large …"""

ESTIMATED = 10.0
"""… and where it is estimated: residuals of real loop closures have long tails."""

UNCHECKED = 1e-3
"""Redundancy below which nothing checks a row: rounding is all that is left of it."""

FREED = 1e-9
"""Relative accuracy of the step without constraints: far below what is told apart."""

MOST_STEPS = 5000
"""Iterations for it: long chains of poses need some for each pose."""

FEWEST = 6.0
"""Degrees of freedom from which the scatter of the others is told well enough for that."""

LEAST_MISFIT, ROUNDED = 1e-3, 1e-6
"""Misfits in stated deviations, and shares of χ², that are taken for rounding."""


BENT = 2.0
"""Standard deviations by which rows under a loss draw estimates from which on intervals of 95 % may miss the truth."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Edges:
    """Rows of a group that join two poses: their misfits (rows,), and whether they join neighbours of ordered keys.

    ``falls`` (rows,) is what χ² falls by without each, but for the correlation of its numbers.
    """

    group: Group
    misfits: Floats
    falls: Floats
    early: Mask


@np.errstate(all="ignore")
def contradictions(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, observed: Observability
) -> tuple[Diagnostic, ...]:
    """A warning for each clause of a pose graph some of whose rows the others contradict, at a minimum."""
    if not minimum.reason.converged or len(minimum.residuals) != equations.count:
        return ()
    losses = loss_lines(equations) if equations.lossy else ()
    if losses and (problem.estimates_noise or equations.rows is not None or any(not loss.convex for loss, _ in losses)):
        return ()
    poses = [e for e in equations.layout.entries if e.unknown.kind is UnknownKind.POSE and e.members > 1]
    if not poses:
        return ()
    # Loaded by graphs only, so that other problems start at once.
    from mbm.estimation.starts.closed_forms.relative_poses import relates

    pairs = [(group, entry) for group in equations.groups for entry in poses if group.rows and relates(group, entry)]
    if not pairs:
        return ()
    from mbm.estimation.uncertainty.variance import redundancy_numbers

    redundancy = redundancy_numbers(minimum.jacobian, observed, minimum.blocks)
    misfits = np.zeros(equations.whole)
    residuals = _released(minimum)
    cost = float(residuals @ residuals)
    misfits[slice(None) if equations.rows is None else equations.rows] = np.where(
        redundancy > UNCHECKED, np.abs(residuals) / np.sqrt(redundancy), 0.0
    )
    falls = np.square(misfits)
    if losses:  # false rows bend the others less, and are far out themselves
        misfits, falls = np.abs(equations.plain_residuals(minimum.point)), np.square(residuals)
    freedom = float(redundancy.sum())
    every = [_edges(group, entry, misfits, falls) for group, entry in pairs]
    width = max(group.kernel.outputs for group, _ in pairs)
    without = max(cost - max(float(each.falls.max()) for each in every), ROUNDED * cost)
    told = freedom >= FEWEST + width and not losses
    scatter = sqrt(without / (freedom - width)) if told else np.inf
    found = []
    for owner in sorted({group.kernel.owner for group, _ in pairs}):
        block = problem.blocks[owner]
        if block.table is None:
            continue
        edges = [each for each in every if each.group.kernel.owner == owner]
        relative = ESTIMATED if block.unknown_factor else SCATTER
        stated = np.inf if block.unknown_factor else sqrt(2.0 * log(len(misfits) / IMPROBABLE))
        wrong, falls = _beyond(edges, max(min(stated, relative * scatter), LEAST_MISFIT))
        if len(wrong) and (not losses or _bend(minimum, edges, wrong) > BENT):
            table = tables[block.table]
            rows = [(int(table.rows[p]), min(fall, cost)) for p, fall in zip(wrong, falls.tolist(), strict=True)]
            label = Label(table.place(int(wrong[0])), "the worst of them")
            found.append(faults.contradicting_rows(block.span, block.name, rows, cost, label))
    return tuple(found)


def _released(minimum: Minimum) -> Floats:
    """The residuals (m,) without what constraints and bounds force upon the rows, to first order.

    A limit that the rows push against bends them all: they contradict it, and not one another.
    """
    state = minimum.constraints
    if (state is None or not bool(state.forcing.any())) and not bool(minimum.at_bound.any()):
        return minimum.residuals
    return np.asarray(minimum.residuals - _followed(minimum, minimum.residuals))


def _followed(minimum: Minimum, residuals: Floats) -> Floats:
    """What unknowns can follow of ``residuals`` (m,), to first order."""
    slopes = minimum.jacobian
    if minimum.blocks is None:
        return np.asarray(slopes @ np.linalg.lstsq(slopes, residuals, rcond=None)[0])
    from scipy.sparse.linalg import LinearOperator, lsmr

    operator = LinearOperator(slopes.shape, matvec=lambda x: slopes @ x, rmatvec=lambda r: r @ slopes)
    step = lsmr(operator, residuals, atol=FREED, btol=FREED, maxiter=MOST_STEPS)[0]
    return np.asarray(slopes @ step)


def _bend(minimum: Minimum, edges: list[_Edges], wrong: Indices) -> float:
    """How far the rows ``wrong`` of the table draw estimates, in standard deviations of what they draw farthest."""
    pull = np.zeros(len(minimum.residuals))
    for group in (each.group for each in edges):
        if group.positions is None:
            continue
        there = np.repeat(np.isin(group.positions, wrong), group.kernel.outputs)
        own = slice(group.first, group.first + group.count)
        pull[own] = np.where(there, minimum.residuals[own], 0.0)
    return float(np.linalg.norm(_followed(minimum, pull)))


def _edges(group: Group, entry: Entry, misfits: Floats, falls: Floats) -> _Edges:
    from mbm.estimation.starts.closed_forms.trees import behind_one_another, related

    own, fall = (each[group.first : group.first + group.count].reshape(group.rows, -1) for each in (misfits, falls))
    early = behind_one_another(entry, *related(group, entry))
    return _Edges(group=group, misfits=own.max(axis=1), falls=fall.sum(axis=1), early=early)


def _beyond(edges: list[_Edges], limit: float) -> tuple[Indices, Floats]:
    """Positions in the table of the rows beyond the limit, and what χ² falls by without each, the worst first.

    Loop closures alone if there are some.

    A false loop leaves the steps that it spans with misfits like its own.
    """
    misfits = np.concatenate([each.misfits for each in edges])
    early = np.concatenate([each.early for each in edges])
    positions = np.concatenate([each.group.positions for each in edges if each.group.positions is not None])
    wrong = misfits > limit
    if bool((wrong & ~early).any()):
        wrong &= ~early
    order = np.argsort(-misfits[wrong], kind="stable")
    falls = np.concatenate([each.falls for each in edges])
    return positions[wrong][order], falls[wrong][order]
