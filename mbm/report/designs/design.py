"""From a solve of exact measurements, candidates among them, to the accuracy to expect and what to measure next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf, isfinite, prod
from typing import Any

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.design.choice import Choice, Criterion, Expected, Information, Wish, choose, objective, repeats_for
from mbm.estimation.search.solution import Solution
from mbm.expression.nodes import Number
from mbm.expression.units import NONE, Dimension, Unit, parse_unit
from mbm.problem import faults as problem_faults
from mbm.problem.types import Problem
from mbm.report.budgets.types import Target, called, gradient_of, item_of, targets_of
from mbm.report.considered import Pair, moves_by_name, shares_of
from mbm.report.designs import faults
from mbm.report.designs.answer import Design
from mbm.report.designs.types import Candidate, ChosenSet, DesignWish, ExpectedSigma, RowWorth
from mbm.report.elements import coordinate_quantity, factors, scalars, shown_sigma, unit_text
from mbm.report.spreads import ConsideredConstant
from mbm.report.types import Key, Kind, Quantity, SolveReport, SolveStatus
from mbm.scales import SI
from mbm.text.types import Diagnostic, MbmError, Source, Span
from mbm.values import dataclass

_ANSWERED = (SolveStatus.CONVERGED, SolveStatus.UNOBSERVABLE)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Offered:
    """Rows of ``table`` from number ``first`` on are candidates: their columns as given, and their ``costs`` (c,).

    ``keyless`` are columns that tell solves apart, and that the candidates have not: they belong to each.
    """

    table: str
    first: int
    cells: Mapping[str, Sequence[Any]]
    costs: Floats
    keyless: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rows:
    """Places of residuals: of each row of each clause, and of each candidate (none where no equation uses it)."""

    units: tuple[tuple[str, int | None, Indices], ...]
    candidates: tuple[Indices, ...]


def designed(
    solve: SolveReport,
    offered: Offered | None,
    wish: DesignWish,
    *,
    key: Mapping[str, Key],
    point: str,
    notes: Sequence[Diagnostic],
    moved: Sequence[tuple[ConsideredConstant, Pair]],
) -> Design:
    """The design of a problem whose solve has exact measurements, candidates among them.

    ``key`` tells the solve from others of the problem, ``moved`` are each uncertain constant and the solves of the same
    measurements with it below and above its value.

    Raises:
        MbmError: not-designed, no-candidates, unknown-quantity; unit-clash or temperature-and-difference for a wanted
            standard deviation of another unit.

    """
    problem, solution = _solved(solve)
    rows = _rows(problem, solution, offered)
    targets = list(targets_of(solve))
    shifted = _shifted(solve, moved)
    every = _information(solve, problem, solution, rows, targets, shifted)
    nothing = np.zeros(len(rows.candidates), dtype=np.int64)
    expected = every.expected(nothing)
    asked = called(solve, wish.quantity, targets) if wish.quantity is not None else _estimates(solve, targets)
    information = _information(solve, problem, solution, rows, asked, shifted)
    units = {unit_text(item_of(solve, each).quantity) for each in asked}
    motions = any(item_of(solve, each).quantity.kind in (Kind.POSE, Kind.SIMILARITY) for each in asked)
    alike = len(units) == 1 and (len(asked) == 1 or not motions)
    told = information.expected(nothing)
    wanted = _wanted(wish.sigma, solve, problem, asked)
    return Design(
        problem=problem.name,
        key=key,
        point=point,
        expected=tuple(_expected(solve, each, expected, i) for i, each in enumerate(targets)),
        worth=_worth(information, rows, asked, told),
        free=_free(targets, expected),
        quantity=wish.quantity,
        unit=(next(iter(units)) or None) if alike else None,
        determined=told.determined,
        sigma=_one(told, alike),
        wanted=wanted,
        candidates=_candidates(information, offered, told, wanted, alike),
        chosen=_chosen(information, offered, wish, alike),
        notes=tuple(notes),
    )


def _solved(solve: SolveReport) -> tuple[Problem, Solution]:
    if solve.made_from is None:
        raise MbmError(faults.not_designed(solve.message, "correct what the message says"))
    problem, solution = solve.made_from()
    if solution.minimum.blocks is not None:
        why = "it has too many unknowns for dense equations"
        raise MbmError(faults.not_designed(why, "fix what the quantity does not depend on (`:fixed true`)"))
    if solution.minimum.bad_row is not None or not bool(np.isfinite(solution.minimum.jacobian).all()):
        why = "an equation has no finite value or derivative at the point"
        raise MbmError(faults.not_designed(why, "give other values with `--at`"))
    return problem, solution


def _rows(problem: Problem, solution: Solution, offered: Offered | None) -> _Rows:
    units: dict[tuple[str, int | None], list[Indices]] = {}
    found: dict[int, list[Indices]] = {}
    for group in solution.groups:
        block = problem.blocks[group.kernel.owner]
        table = solution.tables[block.table] if block.table is not None else None
        for i in range(group.rows):
            places = group.first + i * group.kernel.outputs + np.arange(group.kernel.outputs)
            row = int(table.rows[group.positions[i]]) if table is not None and group.positions is not None else None
            if offered is not None and block.table == offered.table and row is not None and row >= offered.first:
                found.setdefault(row - offered.first, []).append(places)
            else:
                units.setdefault((block.name, row), []).append(places)
    count = len(offered.costs) if offered is not None else 0
    none = np.zeros(0, dtype=np.int64)
    return _Rows(
        units=tuple((name, row, np.concatenate(places)) for (name, row), places in units.items()),
        candidates=tuple(np.concatenate([none, *found.get(i, [])]) for i in range(count)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Shifted:
    """What a standard deviation of each of c constants does to all ``numbers`` (c,), by name and in SI, and to the
    ``residuals`` (m, c).
    """

    numbers: Mapping[str, Floats]
    residuals: Floats


def _shifted(solve: SolveReport, moved: Sequence[tuple[ConsideredConstant, Pair]]) -> _Shifted:
    """What uncertain constants do to a solve.

    Raises:
        MbmError: not-designed.

    """
    left = []
    for (constant, pair), share in zip(moved, shares_of([constant for constant, _ in moved]), strict=True):
        below, above = (_solved(each)[1].minimum.residuals for each in pair)
        if below.shape != above.shape or any(each.status not in _ANSWERED for each in pair):
            why = f"the solves with `{constant.name}` moved by a part of its standard deviation find no other answer"
            raise MbmError(faults.not_designed(why, "make it an unknown with a prior: `(h :init 70cm :sigma 1mm)`"))
        left.append((above - below) / (2 * share))
    count = len(_solved(solve)[1].minimum.jacobian)
    numbers = moves_by_name(solve, moved) if moved else {}
    return _Shifted(numbers=numbers, residuals=np.array(left).reshape(len(moved), count).T)


def _information(
    solve: SolveReport, problem: Problem, solution: Solution, rows: _Rows, targets: Sequence[Target], shifted: _Shifted
) -> Information:
    """What the rows tell of some numbers, in the units of the report."""
    jacobian, gradients, moves, nothing = solution.minimum.jacobian, [], [], np.zeros(0)
    for each in targets:
        gradient = gradient_of(solution, each)
        if gradient is None:
            why = "too many numbers are derived to keep their derivatives"
            raise MbmError(faults.not_designed(why, "derive fewer"))
        item = item_of(solve, each)
        scale = np.ravel(np.broadcast_to(factors(item.quantity), np.shape(shown_sigma(item))))[each.place]
        value = list(scalars(item))[each.place].value
        gradients.append(gradient / scale if isfinite(value) else np.full(len(gradient), np.nan))
        moves.append(shifted.numbers.get(each.name, nothing) / scale)
    lines = [places for _, _, places in rows.units]
    kept = np.concatenate([np.zeros(0, dtype=np.int64), *lines])
    told = np.hstack([jacobian, shifted.residuals])
    return Information(
        minimum=solution.minimum,
        layout=solution.layout,
        free=solution.free,
        gauge=problem.request.gauge,
        rows=told[kept],
        candidates=tuple(told[places] for places in rows.candidates),
        gradient=np.array(gradients).reshape(len(targets), jacobian.shape[1]),
        moves=np.array(moves).reshape(len(targets), shifted.residuals.shape[1]),
    )


def _estimates(solve: SolveReport, targets: Sequence[Target]) -> list[Target]:
    """All numbers that are estimated."""
    return [t for t in targets if not t.derived and not list(scalars(item_of(solve, t)))[t.place].fixed]


def _expected(solve: SolveReport, target: Target, told: Expected, place: int) -> ExpectedSigma:
    item = item_of(solve, target)
    scalar = list(scalars(item))[target.place]
    sigma = float(told.sigma[place])
    return ExpectedSigma(
        name=target.name,
        value=float(scalar.value) if isfinite(scalar.value) else None,
        sigma=sigma if isfinite(sigma) else None,
        unit=unit_text(scalar.quantity) or None,
    )


def _free(targets: Sequence[Target], told: Expected) -> tuple[str, ...]:
    """What is not determined without candidates."""
    loose = [t.name for t, known in zip(targets, told.estimable, strict=True) if not t.derived and not known]
    return tuple(f"`{name}` is not determined" for name in loose)


def _one(told: Expected, alike: bool) -> float | None:
    """One standard deviation for several numbers of one unit; None where one is not determined, or units differ."""
    if not told.determined or not alike or not len(told.sigma):
        return None
    return float(np.sqrt(np.square(told.sigma).mean()))


def _worth(information: Information, rows: _Rows, asked: Sequence[Target], told: Expected) -> tuple[RowWorth, ...]:
    """What each row contributes, the most valuable first: of all numbers the one that suffers most."""
    known = np.flatnonzero(told.estimable & (told.sigma > 0.0))
    if not len(known):
        return ()
    kept = replace(information, gradient=information.gradient[known], moves=information.moves[known])
    variances = kept.without(_places(rows))
    growth = np.sqrt(variances / np.square(told.sigma[known]))
    worst = growth.argmax(axis=1)
    found = [
        RowWorth(
            clause=clause,
            row=row,
            quantity=asked[int(known[worst[i]])].name,
            growth=float(growth[i, worst[i]]) if isfinite(growth[i, worst[i]]) else None,
        )
        for i, (clause, row, _) in enumerate(rows.units)
    ]
    return tuple(sorted(found, key=lambda each: -inf if each.growth is None else -each.growth))


def _places(rows: _Rows) -> tuple[Indices, ...]:
    """The rows of each unit in the Jacobian that holds the units one behind the other."""
    ends = np.cumsum([0, *(len(places) for _, _, places in rows.units)])
    return tuple(np.arange(a, b) for a, b in pairwise(ends))


def _wanted(sigma: float | str | None, solve: SolveReport, problem: Problem, asked: Sequence[Target]) -> float | None:
    """The wanted standard deviation in the unit of the quantity."""
    if sigma is None:
        return None
    number, unit = sigma, None
    if isinstance(sigma, str):
        text = sigma.strip()
        digits = next((n for n in range(len(text), 0, -1) if _is_number(text[:n])), 0)
        number = float(text[:digits]) if digits else float("nan")
        unit = parse_unit(text[digits:].strip()) if text[digits:].strip() else None
        if text[digits:].strip() and unit is None:
            raise MbmError(faults.no_candidates(f"`{sigma}` is no standard deviation", "write it as in `--sigma 1mm`"))
    if not isinstance(number, int | float) or not 0 < float(number) < inf:
        raise MbmError(faults.no_candidates(f"`{sigma}` is no standard deviation", "write it as in `--sigma 1mm`"))
    if unit is None:
        return float(number)
    _check_unit(float(number), unit, str(sigma).strip(), solve, problem, asked)
    scale = _quantity(solve, asked[0]).scale if asked else SI
    return scale.difference_from_si(unit.scale.difference_to_si(float(number)))


def _check_unit(
    number: float, unit: Unit, text: str, solve: SolveReport, problem: Problem, asked: Sequence[Target]
) -> None:
    """Check that a standard deviation in ``unit`` may be one of all that is asked.

    Raises:
        MbmError: unit-clash, temperature-and-difference.

    """
    place = Span(source=Source("<sigma>", text), start=0, end=len(text))
    for target in asked:
        dimension = _dimension(problem, _quantity(solve, target), target.place)
        if dimension is not None and dimension != unit.dimension:
            left, right = f"`{text}`, {unit.dimension.describe()},", f"`{target.name}`, {dimension.describe()}"
            raise MbmError(problem_faults.unit_clash(place, left, right, ()))
    if unit.zero:
        temperature = Number(unit.scale.to_si(number), unit.dimension, place, absolute=True)
        raise MbmError(problem_faults.temperature_for_difference(place, temperature))


def _quantity(solve: SolveReport, target: Target) -> Quantity:
    return coordinate_quantity(item_of(solve, target).quantity, target.place)


def _dimension(problem: Problem, quantity: Quantity, place: int) -> Dimension | None:
    """The dimension of a number; None: nothing says it."""
    if quantity.kind is Kind.ANGLE:
        return NONE
    if quantity.dimension:
        unit = None if quantity.unit is None else parse_unit(quantity.unit)
        return None if unit is None else unit.dimension
    return problem.dimensions.get((quantity.name, place % max(prod(quantity.shape), 1)))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _candidates(
    information: Information, offered: Offered | None, told: Expected, wanted: float | None, alike: bool
) -> tuple[Candidate, ...]:
    if offered is None:
        return ()
    compressed, before, found = information.compressed(), _one(told, alike), []
    for place in range(len(offered.costs)):
        counts = np.zeros(len(offered.costs), dtype=np.int64)
        counts[place] = 1
        then = compressed.expected(counts)
        sigma = _one(then, alike)
        found.append(
            Candidate(
                row=place + 1,
                cells={name: cells[place] for name, cells in offered.cells.items()},
                cost=float(offered.costs[place]),
                determined=then.determined,
                sigma=sigma,
                gain=told.gain(then) if not alike else before / sigma if before is not None and sigma else None,
                observable=then.missing < told.missing,
                repeats=None if wanted is None else repeats_for(compressed, place, wanted),
            )
        )
    return tuple(found)


def _chosen(information: Information, offered: Offered | None, wish: DesignWish, alike: bool) -> ChosenSet | None:
    if offered is None or (wish.choose is None and wish.budget is None):
        return None
    if wish.repeats and wish.choose is None and bool((offered.costs <= 0).any()):
        why = "a candidate without cost may be repeated for ever"
        raise MbmError(faults.no_candidates(why, "say with `--choose` how many to choose"))
    criterion = _criterion(wish.criterion, len(information.gradient), alike)
    asked = Wish(
        criterion=criterion,
        costs=offered.costs,
        count=wish.choose,
        budget=inf if wish.budget is None else wish.budget,
        repeats=wish.repeats,
    )
    return _set(choose(information, asked, wish.seed), asked, alike)


def _criterion(word: str | None, size: int, alike: bool) -> Criterion:
    if word is None:
        return Criterion.C if size == 1 else Criterion.A if alike else Criterion.D
    if word not in {each.value for each in Criterion}:
        raise MbmError(faults.no_candidates(f"`{word}` is no criterion", "use A, c or D"))
    if Criterion(word) is Criterion.C and size != 1:
        why = f"the criterion c is for one number, and {size} are to be accurate"
        raise MbmError(faults.no_candidates(why, "name one number with `--for`, as in `p[1]`, or use A or D"))
    if Criterion(word) is Criterion.A and not alike:
        why = "the criterion A adds variances, and the numbers that are to be accurate have different units"
        raise MbmError(faults.no_candidates(why, "name a quantity of one unit with `--for`, or use D"))
    return Criterion(word)


def _set(found: Choice, wish: Wish, alike: bool) -> ChosenSet:
    rows = np.flatnonzero(found.counts)
    return ChosenSet(
        criterion=wish.criterion.value,
        rows=tuple((rows + 1).tolist()),
        counts=tuple(found.counts[rows].tolist()),
        cost=float(wish.costs @ found.counts),
        determined=found.expected.determined,
        sigma=_one(found.expected, alike),
        sigmas=tuple(float(s) if isfinite(s) else None for s in found.expected.sigma),
        objective=objective(found.expected, wish.criterion) if found.expected.determined else None,
        exhaustive=found.exhaustive,
    )
