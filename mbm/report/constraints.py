"""What became of the constraints: one entry for each that the problem states, and what is to be said of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.binding import Group, affine
from mbm.equations.faults import probability_of
from mbm.equations.metric import violations
from mbm.equations.types import Conflict
from mbm.estimation.search.solution import Solution
from mbm.problem.kinds import ConstraintKind
from mbm.problem.types import Block, Problem
from mbm.report import faults
from mbm.report.types import ConstraintReport, Floats, Mask
from mbm.solver.decisions import EPSILON, MET, ROUNDING_ERRORS
from mbm.text.types import Diagnostic, Label

if TYPE_CHECKING:
    from mbm.estimation.batches.types import Limits

MOST_LABELS = 8

CONTRADICTS = 1e-4
"""Probability of so large a fall of χ² without a limit, below which the data contradict it: four standard deviations,
as for priors."""


def constraint_reports(problem: Problem, solution: Solution) -> tuple[ConstraintReport, ...]:
    """An entry for each constraint, in the order of the problem; those over a table gather their rows."""
    if not solution.constraints:
        return ()
    state = solution.minimum.constraints
    values = _values(solution) if state is None else state.values
    violated = _beyond_rounding(problem, solution, values) if state is None else state.violated
    active = np.zeros(len(values), dtype=bool) if state is None else state.active
    owners = dict.fromkeys(group.kernel.owner for group in solution.constraints)
    return tuple(_report(problem.blocks[owner], owner, solution, values, violated, active) for owner in owners)


def _values(solution: Solution) -> Floats:
    return np.concatenate([group.values(solution.numbers).ravel() for group in solution.constraints])


def _beyond_rounding(problem: Problem, solution: Solution, values: Floats) -> Mask:
    """Which constraints are violated by more than can be told, as `met` of the constrained search decides it."""
    layout, numbers = solution.layout, solution.numbers
    spread = np.zeros(len(layout.number))
    spread[solution.free] = 1.0 / solution.observability.scale
    size = np.where(layout.number >= 0, np.abs(numbers[layout.number]), 1.0)
    rounding = ROUNDING_ERRORS * EPSILON
    lengths = [
        MET * each.slope_lengths(numbers, spread) + rounding * each.slope_lengths(numbers, size)
        for each in solution.constraints
    ]
    told = np.concatenate([each.ravel() for each in lengths]) + rounding * np.abs(values)
    return ~(violations(values, _equality(problem, solution)) <= told)


def _equality(problem: Problem, solution: Solution) -> Mask:
    return np.concatenate(
        [
            np.full(group.count, problem.blocks[group.kernel.owner].constraint is ConstraintKind.EQUAL)
            for group in solution.constraints
        ]
    )


def _report(
    block: Block, owner: int, solution: Solution, values: Floats, violated: Mask, active: Mask
) -> ConstraintReport:
    equation = block.constraint is ConstraintKind.EQUAL
    groups = [g for g in solution.constraints if g.kernel.owner == owner]
    places = np.concatenate([g.first + np.arange(g.count) for g in groups])
    own = values[places]
    worst = float(own[int(np.argmax(np.abs(own) if equation else own))]) if own.size else 0.0
    violation = float(violations(own, equation).max(initial=0.0))
    broken, limiting = bool(violated[places].any()), bool(active[places].any())
    table = solution.tables[block.table] if block.table is not None else None
    rows_of = [_rows(g, table.rows) for g in groups] if table is not None else []
    rows = np.concatenate(rows_of) if rows_of else np.empty(0, dtype=np.int64)
    return ConstraintReport(
        name=block.name,
        kind=block.constraint.value if block.constraint is not None else "",
        value=worst if equation else 0.0 - worst,
        violation=violation if broken or not np.isfinite(violation) else 0.0,
        active=limiting,
        violated=broken,
        over=block.table,
        rows=sum(g.rows for g in groups),
        violated_rows=_numbers(rows[violated[places]]) if table is not None else (),
        active_rows=_numbers(rows[active[places]]) if table is not None and not equation else (),
    )


def limit_reports(problem: Problem, limits: Limits, place: int) -> tuple[ConstraintReport, ...]:
    """The same for one of many solves, from their columns; no constraint is violated there."""
    found = []
    for number, owner in enumerate(limits.owners):
        block, reached = problem.blocks[owner], limits.at_limit[number]
        active = () if reached is None else sorted({int(reached.table.rows[p]) for p in reached.of(place)})
        found.append(
            ConstraintReport(
                name=block.name,
                kind=block.constraint.value if block.constraint is not None else "",
                value=float(limits.values[place, number]),
                violation=0.0,
                active=bool(limits.active[place, number]),
                violated=False,
                over=block.table,
                rows=int(limits.rows[place, number]),
                active_rows=tuple(active),
            )
        )
    return tuple(found)


def _rows(group: Group, numbers: np.ndarray) -> np.ndarray:
    """The row (from 1, of the unfiltered table) of each scalar output of a group."""
    positions = group.positions if group.positions is not None else np.arange(group.rows)
    return np.repeat(numbers[positions], group.kernel.outputs)


def _numbers(rows: np.ndarray) -> tuple[int, ...]:
    return tuple(int(row) for row in np.unique(rows))


def constraint_diagnostics(problem: Problem, solution: Solution, names: tuple[str, ...]) -> tuple[Diagnostic, ...]:
    """The constraints that contradict one another; else those that the data push against."""
    state = solution.minimum.constraints
    if state is None:
        return ()
    if state.conflict is not None:
        return (_conflict(problem, solution, state.conflict, names),)
    pushed = state.forcing & ~state.equality
    blocks = {o: problem.blocks[o] for o in _owners(solution, np.flatnonzero(pushed))}
    owners = np.array([*_owners(solution, np.arange(len(pushed)))], dtype=np.int64)
    return tuple(
        faults.active_constraint(
            block.span,
            block.name,
            uniform=block.constraint is ConstraintKind.UNIFORM,
            contradiction=_contradiction(problem, solution, constraints=pushed & (owners == owner)),
        )
        for owner, block in blocks.items()
    )


def bound_diagnostics(problem: Problem, solution: Solution, names: tuple[str, ...]) -> tuple[Diagnostic, ...]:
    """A warning for each unknown that is held at its bounds or by its model, or was driven to the zero above it."""
    if not solution.minimum.at_bound.any():
        return ()
    sides = np.zeros(len(solution.layout.number), dtype=np.int8)
    sides[solution.free] = solution.minimum.at_bound
    layout = solution.layout
    zero = (sides < 0) & layout.positive & ~(layout.lower > 0)
    lower, upper = (sides < 0) & np.isfinite(layout.lower) & ~zero, (sides > 0) & np.isfinite(layout.upper)
    ended = (sides != 0) & ~(zero | lower | upper)
    kinds = (("its lower bound", lower), ("its upper bound", upper), ("zero", zero), ("the end of its model", ended))
    found = []
    for entry in layout.entries:
        places = range(entry.coordinates.start, entry.coordinates.stop)
        for what, which in kinds:
            held = [i for i in places if which[i]]
            if held:
                own = np.isin(solution.free, held)
                against = None if which is ended else _contradiction(problem, solution, bounds=own)
                beside = _moving_with(problem, solution, held)
                found.append(faults.near_bound(entry.unknown.span, [names[i] for i in held], what, against, beside))
    return tuple(found)


def _moving_with(problem: Problem, solution: Solution, coordinates: Sequence[int]) -> list[str]:
    """The derived quantities that some of the coordinates change, and that have standard deviations."""
    places = np.flatnonzero(np.isin(solution.free, coordinates))
    return [
        problem.derived[one.owner].name
        for one in solution.derived
        if one.gradient is not None and bool(np.nan_to_num(one.gradient[..., places][one.sigma.ravel() > 0.0]).any())
    ]


@np.errstate(all="ignore")
def _contradiction(
    problem: Problem, solution: Solution, constraints: Mask | None = None, bounds: Mask | None = None
) -> str | None:
    """How the data contradict limits that they push against, in words; None: not so that it is known.

    The limits are some of the ``constraints`` (k,), or of the ``bounds`` that hold free coordinates (n,). Without them
    χ² falls, to first order, by what the residuals have along the movements that these limits alone hold back: a
    variate of χ² where the noise is stated, else one of F over what is left. Losses follow neither law.
    """
    minimum, scale = solution.minimum, solution.observability.scale
    if solution.robust_cost is not None or minimum.blocks is not None:
        return None
    bounded, state = minimum.at_bound != 0, minimum.constraints
    own = np.zeros(bounded.sum(), dtype=bool) if bounds is None else bounds[bounded]
    held = np.eye(len(scale))[bounded]
    if state is not None:
        pushed = np.zeros(state.forcing.sum(), dtype=bool) if constraints is None else constraints[state.forcing]
        own, held = np.append(own, pushed), np.vstack([held, state.slopes[state.forcing] / scale])
    others = held[~own]
    kept = np.eye(len(scale)) - np.linalg.pinv(others) @ others
    along = minimum.jacobian / scale @ kept
    fall = float(np.square(along @ np.linalg.lstsq(along, minimum.residuals, rcond=None)[0]).sum())
    released = int(np.linalg.matrix_rank(held[own] @ kept))
    left, freedom = minimum.cost - fall, solution.fit.dof - released
    if not (released > 0 and np.isfinite(fall) and freedom > 0):
        return None
    from scipy.special import chdtrc, fdtrc  # where a limit holds alone, so that other problems start at once

    if problem.estimates_noise:
        rounding = ROUNDING_ERRORS * EPSILON * minimum.cost
        chance = float(fdtrc(released, freedom, fall / released / (max(left, rounding) / freedom)))
    else:
        chance = float(chdtrc(released, fall))
    if not chance < CONTRADICTS:
        return None
    about = "" if _affine(solution) else ", to first order,"
    without = f"and without it{about} {max(left, 0.0):.3g}"
    return f"the sum of squares is {minimum.cost:.3g}, {without} ({probability_of(chance)})"


def _affine(solution: Solution) -> bool:
    """Whether equations and constraints are affine in all that is estimated."""
    free = np.zeros(len(solution.layout.number), dtype=bool)
    free[solution.free] = True
    return all(affine(group, free) for group in (*solution.groups, *solution.constraints))


def _owners(solution: Solution, places: np.ndarray) -> Iterator[int]:
    for place in places.tolist():
        yield next(g.kernel.owner for g in solution.constraints if g.first <= place < g.first + g.count)


def _conflict(problem: Problem, solution: Solution, conflict: Conflict, names: tuple[str, ...]) -> Diagnostic:
    blocks = list(dict.fromkeys(_owners(solution, np.array(conflict.constraints, dtype=np.int64))))
    members = [f"`{problem.blocks[owner].name}`" for owner in blocks]
    spans = [problem.blocks[owner].span for owner in blocks]
    bounds = (("lower", conflict.lower), ("upper", conflict.upper))
    labels = [Label(span, "and this") for span in spans[1 : MOST_LABELS + 1]]
    for side, coordinates in bounds:
        for each in coordinates:
            coordinate = int(solution.free[each])
            members.append(f"the {side} bound of `{names[coordinate]}`")
            labels.append(Label(solution.layout.owner(coordinate).unknown.span, f"and its {side} bound"))
    for coordinate in _fixed_ones(solution, np.array(conflict.constraints, dtype=np.int64)):
        members.append(f"the fixed `{names[coordinate]}`")
        labels.append(Label(solution.layout.owner(coordinate).unknown.span, "and this is fixed"))
    return faults.conflicting_constraints(spans[0], members, tuple(labels), smallest=conflict.smallest)


def _fixed_ones(solution: Solution, places: np.ndarray) -> list[int]:
    """The fixed coordinates, in order, that the constraints at some places depend on."""
    fixed, found = solution.layout.fixed, set[int]()
    for group in solution.constraints:
        mine = places[(places >= group.first) & (places < group.first + group.count)] - group.first
        touched = group.columns[np.unique(mine // group.kernel.outputs)]
        if group.gathered is not None:
            touched = np.concatenate([touched.ravel(), group.gathered.touched])
        own = touched[(touched >= 0) & (touched < len(fixed))]
        found.update(own[fixed[own]].tolist())
    return sorted(found)


def conflict_sentence(problem: Problem, solution: Solution, names: tuple[str, ...]) -> str | None:
    """Which constraints contradict one another, as the message of the solve."""
    state = solution.minimum.constraints
    if state is None or state.conflict is None:
        return None
    return _conflict(problem, solution, state.conflict, names).message


def violated_sentence(reports: tuple[ConstraintReport, ...]) -> str | None:
    """Which constraints do not hold."""
    broken = [f"`{r.name}`" for r in reports if r.violated]
    if not broken:
        return None
    shown = ", ".join(broken[:MOST_LABELS]) + (" …" if len(broken) > MOST_LABELS else "")
    return f"{shown} {'does' if len(broken) == 1 else 'do'} not hold"
