"""Many solves with errors in measured columns: corrections eliminated row by row, and what they are at the ends.

Rows whose values no other row of their solve uses are corrected by themselves (`mbm.equations.corrections.straight`),
other solves or not. The fit that takes the columns as exact leads starts on that fit badly, as in the general path.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mbm.equations.binding import EvaluationCache
from mbm.equations.corrections.elimination import root
from mbm.equations.corrections.feet import feet, first_feet
from mbm.equations.corrections.measured import Measured, UncertainRows, measured, rows_of_groups
from mbm.equations.corrections.search import FAR
from mbm.equations.corrections.straight import Builder, eliminating
from mbm.equations.corrections.system import Conditions, OwnInputs
from mbm.equations.losses import rooted_residuals
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.descent import solver_of
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Corrections, Ends, Errors, Solver, Which
from mbm.estimation.minimise.minimise import ROUGH, ROUGHLY
from mbm.estimation.settings import Settings
from mbm.kernels.types import Kernel
from mbm.problem.types import Problem
from mbm.values import dataclass


def straightened(problem: Problem, stack: Stack) -> Stack | None:
    """The equations, which take measured values as exact so far, with their corrections eliminated by the kernels.

    None where it cannot be done so, as rows of a solve share values, or there are none.

    Raises:
        MbmError: a standard deviation that is none, or two different ones of one value.

    """
    equations = stack.equations
    rows = rows_of_groups(equations.groups)
    found = measured(problem, stack.tables, rows)
    if not found.ids:
        return None  # no solve has a row of them
    joined = {error.table for block in problem.blocks for error in block.errors if error.key is not None}
    if joined & stack.arranged.spans.keys() or any(bool((column.rows < 0).any()) for column in found.columns):
        return None  # which row of another table is meant is a matter of each solve
    if _shared(stack, found) or any(_too_few(each, found.sigma[found.ids[n]]) for n, each in rows.items()):
        return None
    groups = eliminating(equations.groups, {number: found.sigma[ids] for number, ids in found.ids.items()})
    if groups is None:
        return None
    for group in groups:
        group.cache.stream(group.number, group.kernel)  # made here, so that threads find it there
    for group in equations.groups:
        if group.kernel.corrections is not None:
            group.cache.stream(-1 - group.number, group.kernel.corrections.kernel)
    return replace(
        stack,
        equations=replace(equations, groups=groups, linear=False, _scatters=()),
        errors=Errors(problem=problem, exact=equations, measured=found),
    )


def corrected_solver(stack: Stack, fine: Solver | None, settings: Settings) -> Solver | None:
    """What solves equations with errors by ``fine``, from where exact columns lead; None where native code cannot."""
    short = replace(settings, max_iterations=min(ROUGH, settings.max_iterations), tolerance=ROUGHLY)
    rough = solver_of(stack.exactly(), short)
    if rough is None or fine is None:
        return None

    def solve(which: Which, points: Floats) -> Ends:
        return fine(which, _approached(stack, rough, which, points))

    return solve


def _approached(stack: Stack, rough: Solver, which: Which, points: Floats) -> Floats:
    """The points (K, N), or where ``rough`` leads from them where that fits better (`implicit.approach.approached`)."""
    numbers = np.asarray(which)
    costs = _rough_costs(stack, which, points)
    far = np.flatnonzero(~(costs <= FAR**2 * stack.residuals[numbers]))
    if not len(far):
        return points
    others = rough(numbers[far], points[far]).points
    better = _rough_costs(stack, numbers[far], others) < costs[far]
    found = points.copy()
    found[far[better]] = others[better]
    return found


@np.errstate(all="ignore")
def _rough_costs(stack: Stack, which: Which, points: Floats) -> Floats:
    """The costs (K,) at points (K, N) with corrections to first order; infinite where they are not finite."""
    if stack.errors is None:
        message = "there are no errors in measured columns"
        raise ValueError(message)
    portion = Portion(stack.exactly(), which)
    residuals = portion.residuals(points)
    for number, each in enumerate(portion.lines):
        if number in stack.errors.measured.ids and len(each.solve):
            conditions = _conditions(stack, stack.errors, number, which, points)
            found = first_feet(conditions)
            whitened = root(found.slopes, conditions.noisy).apply(found.misclosures[:, :, None])[:, :, 0]
            residuals[each.solve[:, None], each.slots] = np.where(found.found[:, None], whitened, np.nan)
    costs = np.square(rooted_residuals(portion.acting(), residuals)).sum(axis=1)
    return np.where(np.isfinite(costs), costs, np.inf)


@np.errstate(all="ignore")
def corrections(stack: Stack, which: range, points: Floats, asked: Mask) -> tuple[Corrections, ...]:
    """The corrections at points (K, N) of the solves that are ``asked`` (K,) for, column by column."""
    if stack.errors is None:
        return ()
    known, chosen = stack.errors.measured, np.flatnonzero(asked)
    solves, places, values = [], [], []
    for number, ids in known.ids.items():
        solve, lines = stack.lines(number, which.start + chosen)
        if not len(solve):
            continue
        found = feet(_conditions(stack, stack.errors, number, which.start + chosen, points[chosen]))
        mine = ids[lines]
        real = known.sigma[mine] > 0.0
        solves.append(np.broadcast_to(solve[:, None], mine.shape)[real])
        places.append(mine[real])
        values.append(np.where(found.found[:, None], found.corrections * known.sigma[mine], np.nan)[real])
    solve, place = (np.concatenate([np.zeros(0, dtype=np.int64), *parts]) for parts in (solves, places))
    order = np.lexsort((place, solve))
    value = np.concatenate([np.zeros(0), *values])[order]
    return tuple(_columns(stack, known, len(which), chosen[solve[order]], place[order], value))


def _columns(
    stack: Stack, known: Measured, solves: int, solve: Indices, place: Indices, value: Floats
) -> Iterator[Corrections]:
    """Each column with its part of the corrections (R,) of values ``place`` (R,) in solves ``solve`` (R,)."""
    for column in known.columns:
        mine = (place >= column.first) & (place < column.first + len(column.rows))
        rows = column.rows[place[mine] - column.first]
        yield Corrections(
            table=column.table,
            column=column.column,
            first=np.searchsorted(solve[mine], np.arange(solves + 1)),
            rows=rows,
            keys=stack.tables[column.table].keys_of_rows(rows.tolist()),
            value=value[mine],
            sigma=known.sigma[place[mine]],
        )


def _shared(stack: Stack, found: Measured) -> bool:
    """Whether some value is used twice in a solve."""
    for which in stack.ranges():
        used = []
        for number, ids in found.ids.items():
            solve, lines = stack.lines(number, which)
            mine = ids[lines]
            real = found.sigma[mine] > 0.0
            used.append((solve[:, None] * len(found.sigma) + mine)[real])
        every = np.sort(np.concatenate(used))
        if bool((every[1:] == every[:-1]).any()):
            return True
    return False


def _too_few(rows: UncertainRows, sigma: Floats) -> bool:
    """Whether corrections with these deviations (rows, c) cannot meet the exact equations of some row."""
    return bool(((~rows.noisy).sum(axis=1) > (sigma > 0.0).sum(axis=1)).any())


def _conditions(stack: Stack, errors: Errors, number: int, which: Which, points: Floats) -> Conditions:
    """The conditions on the corrections of the rows of a group that solves have, at one point (K, N) for each."""
    solve, lines = stack.lines(number, which)
    rows = np.arange(lines.start, lines.stop) if isinstance(lines, slice) else lines
    groups = errors.exact.groups
    builder = Builder(errors.problem, groups, errors.measured, _Own(groups[number].cache), None)
    system = builder.alone(number, rows)
    group, inputs = system.parts[0].group, system.parts[0].evaluation.inputs
    variables = group.index.shape[1]
    inputs[:, :variables] = points[solve[:, None], group.index]
    inputs[:, variables : variables + group.parameters.shape[1]] = group.parameters
    return Conditions(system)


@dataclass(frozen=True, slots=True, eq=False)
class _Own:
    """Evaluations of which each has inputs of its own, as several threads are at work."""

    cache: EvaluationCache

    def evaluation(self, number: int, kernel: Kernel, rows: int) -> OwnInputs:
        """The evaluation of kernel ``number`` for ``rows`` rows."""
        width = len(kernel.variables) + len(kernel.parameters)
        return OwnInputs(self.cache.stream(number, kernel), np.zeros((rows, width)))
