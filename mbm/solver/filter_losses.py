"""How far estimates are off where rows have losses: the sandwich ``H⁻¹ G H⁻¹`` (Huber 1967), step by step.

With the vectors B of an update (`filter_update`) and the rows' weights w = ρ', ``A = B Jᵀ w J Bᵀ`` is the information
that the weights leave of them. The estimate is where prior and rows balance: with D the identity of what has a prior
and ``M = (D + c A)⁻¹``, an error e before the rows becomes ``e - c Bᵀ M B Jᵀ w J e``, and the rows add some of the
covariance ``v Bᵀ M A M B``. The factors c and v of each loss follow from the rows so far, as in
`mbm.solver.loss_spread`. So a filter has two covariances: that of `factor`, by which it weighs what it knows against
rows, as the losses state it; and that of `errors`, which is reported.
"""

from __future__ import annotations

from math import sqrt

from mbm.machine.words import ConstantReals, Integer, Reals
from mbm.solver.description import NO_LOSS, Unit
from mbm.solver.filter_records import Walk, step_lines, widen_losses
from mbm.solver.linear_algebra import (
    add_multiple,
    append_rows,
    copied,
    dot,
    filled,
    solve_transposed,
    solve_upper,
)
from mbm.solver.loss_pools import COUNT, TOTAL, TRACES, add_to_sums, same_loss, spread_of_loss
from mbm.solver.loss_spread import curvature_factor

WIDEST = 1e8
"""How many times as wide losses are for plain least squares to rounding."""

NARROWER = 0.5
"""How many times as wide they are next, on the way from there to what is stated."""

NOTHING = 1e-6
"""Share of the information of a row that losses leave, below which it has no standard deviation to speak of."""

SHARE = 6
"""Of the sums of a loss in a walk, behind those of `loss_pools`: the unknowns that its units determine."""

POOLED = 7
"""How many these are."""


def pool_of(walk: Walk, own: Unit) -> Integer:
    """Where the sums of a unit's loss stand: with the first unit that has it."""
    problem = walk.seen
    place = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        for u in range(block.unit_count):
            if block.units[u].loss != NO_LOSS:
                if same_loss(walk.stated, block.units[u], own) == 1:
                    return place
                place += 1
    return place


def weighed_lines(walk: Walk, point: ConstantReals) -> Integer:
    """The rows of the step that is loaded, as lines of ``√w [J r]``, added to `sums`; how many there are.

    `owners` says whose sums each line counts for, -1: it has no loss.
    """
    problem = walk.seen
    width = walk.chain.n + 1
    widen_losses(walk, WIDEST)
    m = step_lines(walk, point)
    walk.rows.constants = walk.stated
    first = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        for _ in range(walk.rows.data.blocks[b].rows):
            for u in range(block.unit_count):
                unit = block.units[u]
                lines = walk.jacobian[(first + unit.first) * width :]
                size = unit.last - unit.first
                place = -1
                if unit.loss != NO_LOSS:
                    place = pool_of(walk, unit)
                    square = 0.0
                    for i in range(size):
                        square += lines[i * width + width - 1] * lines[i * width + width - 1]
                    weight = sqrt(add_to_sums(unit, walk.stated, 1, square, walk.sums[place * POOLED :]))
                    for i in range(size * width):
                        lines[i] *= weight
                for i in range(size):
                    walk.owners[first + unit.first + i] = place
            first += block.outputs
    return m


def kept_lines(walk: Walk, point: ConstantReals) -> Integer:
    """`step_lines` without the rows that losses leave next to nothing of: these determine nothing."""
    width = walk.chain.n + 1
    widen_losses(walk, WIDEST)
    m = step_lines(walk, point)
    walk.rows.constants = walk.stated
    for i in range(m):
        line = walk.jacobian[i * width :]
        walk.scores[i] = dot(width - 1, line, line)
    step_lines(walk, point)
    for i in range(m):
        line = walk.jacobian[i * width :]
        if not dot(width - 1, line, line) > NOTHING * walk.scores[i]:
            filled(width, 0.0, line)
    return m


def settle_factors(walk: Walk) -> Integer:
    """The factors c and v of each loss, by the `sums`; 0: a loss has left no curvature."""
    found = 1
    for place in range(walk.chain.pools):
        sums = walk.sums[place * POOLED :]
        walk.curvatures[place] = 1.0
        walk.variances[place] = 1.0
        if sums[COUNT] > 0.0:
            walk.curvatures[place] = max(curvature_factor(sums[TRACES], sums[TOTAL]), 0.0)
            walk.variances[place] = spread_of_loss(sums[SHARE], sums)
            if not walk.curvatures[place] > 0.0:
                found = 0
    return found


def spread_lines(walk: Walk, m: Integer) -> None:
    """The lines of `weighed_lines` → of H, and of G as `scores` behind the first n."""
    n = walk.chain.n
    for i in range(m):
        place = walk.owners[i]
        line = walk.jacobian[i * (n + 1) :]
        own = walk.scores[(n + i) * n :]
        copied(n, line, own)
        if place >= 0:
            for j in range(n):
                own[j] *= sqrt(walk.variances[place])
            for j in range(n + 1):
                line[j] *= sqrt(walk.curvatures[place])


def add_shares(walk: Walk, m: Integer, size: Integer) -> None:
    """Add what m lines of ``√w J`` determine, of the triangle `square`, to the sums of their losses."""
    n = walk.chain.n
    for i in range(m):
        place = walk.owners[i]
        if place >= 0:
            for j in range(size):
                walk.share[j] = dot(n, walk.jacobian[i * (n + 1) :], walk.local[j * n :])
            solve_transposed(size, walk.square, walk.share)
            walk.sums[place * POOLED + SHARE] += walk.curvatures[place] * dot(size, walk.share, walk.share)


def set_lossy_triangle(walk: Walk, m: Integer, free: Integer, size: Integer) -> None:
    """`square` becomes the triangle of ``D + c A`` along the `local` vectors, of which ``free`` have no prior."""
    n = walk.chain.n
    for i in range(m):
        root = 1.0
        if walk.owners[i] >= 0:
            root = sqrt(walk.curvatures[walk.owners[i]])
        for j in range(size):
            walk.chunk[j * m + i] = root * dot(n, walk.jacobian[i * (n + 1) :], walk.local[j * n :])
    filled(size * size, 0.0, walk.square)
    for j in range(free, size):
        walk.square[j * size + j] = 1.0
    append_rows(size, m, m, walk.chunk, walk.square)


def renew_errors(walk: Walk, told: Integer, lines: ConstantReals, m: Integer, scores: Reals, size: Integer) -> None:
    """`errors` before rows → those with them: what the information leaves of the prior's, and what the rows add.

    ``lines`` (told, n + 1) are those of H, and ``scores`` (m, n) those of G; these are destroyed.
    """
    n = walk.chain.n
    count = n + m
    for i in range(count):
        filled(size, 0.0, walk.share)
        own = walk.errors[i * n :] if i < n else scores[(i - n) * n :]
        if i < n:
            for k in range(told):
                line = lines[k * (n + 1) :]
                value = -dot(n, line, own)
                for j in range(size):
                    walk.share[j] += value * dot(n, line, walk.local[j * n :])
        else:
            for j in range(size):
                walk.share[j] = dot(n, own, walk.local[j * n :])
            filled(n, 0.0, own)
        solve_transposed(size, walk.square, walk.share)
        solve_upper(size, walk.square, walk.share)
        for j in range(size):
            add_multiple(n, walk.share[j], walk.local[j * n :], own)
        for j in range(n):
            walk.chunk[j * count + i] = own[j]
    filled(n * n, 0.0, walk.errors)
    append_rows(n, count, count, walk.chunk, walk.errors)


def spread_update(walk: Walk, point: ConstantReals, free: Integer, size: Integer, new: Integer) -> None:
    """`errors` at a point, about which they and the `local` vectors are, of rows with losses.

    ``new`` 1: what the rows tell of their noise is counted, too. Where the weights leave no curvature they are those of
    the factor.
    """
    n = walk.chain.n
    count = walk.chain.pools * POOLED
    copied(count, walk.pools, walk.sums)
    m = weighed_lines(walk, point)
    if new == 0:
        copied(count, walk.pools, walk.sums)
    if settle_factors(walk) == 0:
        copied(n * n, walk.factor, walk.errors)
        return
    set_lossy_triangle(walk, m, free, size)
    if new == 1:
        add_shares(walk, m, size)
        copied(count, walk.sums, walk.pools)
        settle_factors(walk)
    spread_lines(walk, m)
    renew_errors(walk, m, walk.jacobian, m, walk.scores[n * n :], size)
