"""Rows that a descending loss or consensus leaves out, and that other rows could be left out for at the same cost.

The end of a chain of poses hangs on one step; a false loop from there to elsewhere holds it as well, at another place.
One of the two is left out, and the cost is that of one row either way: which of them is wrong, nobody can tell. So are
the steps between two ends of loops: one of them is wrong, any of them could be.
A row holds something alone where its redundancy is nothing, and a row that is left out would hold the same where the
errors of the one move the value of the other in all directions: ``J (HᵀH)⁻¹ Hᵀ`` has full rank.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.excerpt import excerpt
from mbm.equations.losses import loss_weights
from mbm.equations.types import Floats, Indices, Mask, Minimum, Observability
from mbm.estimation.trust.faults import equal_rows
from mbm.estimation.trust.leverage import ALONE, KEPT
from mbm.estimation.uncertainty.observability import covariance
from mbm.estimation.uncertainty.statistics import RowInfluence
from mbm.estimation.uncertainty.variance import redundancy_numbers
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic

LEFT_OUT = 0.05
"""Weight up to which rows count as left out: a Cauchy loss leaves it at 4.4 times its parameter."""

HOLDS = 1e-3
"""Deviations by which one deviation of a row moves another that would hold the same: an angle far away shifts a
thousand times as far as it turns, and rounding makes 1e-8 of nothing."""

TRIED = 100
"""Rows left out that are looked at, the first in their tables: each takes about as long as an iteration."""


@np.errstate(all="ignore")
def swapped(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, influence: RowInfluence
) -> tuple[Diagnostic, ...]:
    """A warning about the first row of each clause that is left out, and could take the place of others."""
    if not minimum.reason.converged or len(minimum.residuals) != equations.count:
        return ()
    weights = equations.expanded(loss_weights(loss_lines(equations), equations.plain_residuals(minimum.point)))
    ruled = [lines for lines in _ruled(problem, equations) if len(lines)]
    out = [first for lines in ruled for first in lines[weights[lines[:, 0]] < LEFT_OUT, 0].tolist()]
    if not out:
        return ()
    observed, informing = influence.observed, _as_rows_inform(minimum, influence.informing)
    redundancy = equations.expanded(redundancy_numbers(informing.jacobian, observed, informing.blocks))
    alone = [lines[(redundancy[lines].max(axis=1) < ALONE) & (weights[lines[:, 0]] > KEPT)] for lines in ruled]
    if not any(len(lines) for lines in alone):
        return ()
    found: dict[int, tuple[int, list[int]]] = {}
    owners = _owners(equations)
    for line in sorted(out)[:TRIED]:
        owner = int(owners[line])
        if owner not in found:
            moved = equations.expanded(_moved(equations, minimum, observed, line))
            others = [first for lines in alone for first in lines[_holding(moved, lines), 0].tolist()]
            if others:
                found[owner] = line, others
    return tuple(_said(problem, tables, equations, owner, *each) for owner, each in found.items())


def _as_rows_inform(minimum: Minimum, informing: Floats | None) -> Minimum:
    """The minimum with the rows of its Jacobian times ``informing`` (m,), as the rank decision has them (None: 1)."""
    if informing is None:
        return minimum
    if minimum.blocks is None:
        return replace(minimum, jacobian=minimum.jacobian * informing[:, None])
    from mbm.estimation.uncertainty.sparse import weighted_rows  # likewise
    from mbm.sparse.system import blocks_of

    blocks = blocks_of(minimum)
    return replace(minimum, blocks=replace(blocks, values=weighted_rows(blocks, informing)))


def _ruled(problem: Problem, equations: Assembled) -> Iterator[Indices]:
    """The places of residuals (U, d), picked or not, of the units that a descending loss or consensus may leave out."""
    for group in equations.groups:
        chosen = problem.request.robust is not None and problem.blocks[group.kernel.owner].role is BlockRole.OBSERVATION
        starts = group.first + np.arange(group.rows) * group.kernel.outputs
        for number, whitener in enumerate(group.whiteners):
            if chosen or (number < len(group.losses) and not group.losses[number].convex):
                held = group.left_out[:, number] if group.trusted is None else group.trusted | group.left_out[:, number]
                yield starts[~held, None] + np.arange(whitener.first, whitener.last)


def _owners(equations: Assembled) -> Indices:
    """The block of each residual (m,)."""
    found = np.zeros(equations.whole, dtype=np.int64)
    for group in equations.groups:
        found[group.first : group.first + group.count] = group.kernel.owner
    return found


def _moved(equations: Assembled, minimum: Minimum, observed: Observability, line: int) -> Floats:
    """By how much one deviation of each residual (m, d) moves the unit of a residual that is left out."""
    own = excerpt(equations, equations.free, equations.every_unit[[line]])
    slopes = own.plain_jacobian(minimum.point).T
    if observed.inverse is None:
        factor = covariance(observed).factor
        return np.asarray(minimum.jacobian @ (factor @ (factor.T @ slopes)))
    from mbm.sparse.inverse import inverse_of  # loaded by sparse problems only, so that the others start at once

    spread = inverse_of(observed.inverse).solve(slopes)
    return np.stack([minimum.jacobian @ column for column in spread.T], axis=1)


def _holding(moved: Floats, lines: Indices) -> Mask:
    """Which units (U, d) among the residuals the one that ``moved`` (m, d) tells would hold in all directions."""
    if not len(lines) or lines.shape[1] > moved.shape[1]:
        return np.zeros(len(lines), dtype=bool)
    parts = np.nan_to_num(moved[lines])
    return np.asarray(np.linalg.svd(parts, compute_uv=False)[:, -1] > HOLDS)


def _said(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, owner: int, line: int, others: list[int]
) -> Diagnostic:
    """The rows by their numbers, those of other clauses by the names of these."""
    owners, numbers = _owners(equations), np.full(equations.whole, -1, dtype=np.int64)
    for group in equations.groups:
        table = problem.blocks[group.kernel.owner].table
        if table is not None and group.positions is not None:
            rows = np.asarray(tables[table].rows)[group.positions]
            numbers[group.first : group.first + group.count] = np.repeat(rows, group.kernel.outputs)
    block = problem.blocks[owner]
    alike = sorted(int(numbers[each]) for each in others if owners[each] == owner)
    names = sorted({problem.blocks[int(owners[each])].name for each in others} - {block.name})
    return equal_rows(block.span, block.name, int(numbers[line]), alike, names)
