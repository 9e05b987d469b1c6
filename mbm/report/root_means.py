"""Root mean squares of raw residuals, MODEL − MEASURED in the unit of what was measured, as people quote them.

Of a vector there are two that are easily confused: per point, the root of the mean squared length ``√(Σ|r|²/N)`` (what
OpenCV calls the reprojection error), and per coordinate, ``√(Σ|r|²/(N d))``, which is smaller by ``√d``. Both have
their names. Residuals that do not count are left out: those of rows that were rejected as outliers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.at_rows import AtRows, rows_at
from mbm.equations.binding import Group
from mbm.estimation.search.solution import RawRows, Solution
from mbm.expression.units import Unit
from mbm.problem.types import BlockRole, Problem
from mbm.report.row_data import COORDINATE, OVER_POINTS, OVER_ROWS, RawResiduals, RootMean
from mbm.report.types import Floats, Mask
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.batches.types import Block


@dataclass(frozen=True, slots=True, kw_only=True)
class _Part:
    """What one number is of: components ``first`` to ``last`` of an equation (from 1, None: the clause has only one).

    ``joint``: of their lengths, else of single components. ``brief`` as `RootMean` has it.
    """

    per: str
    equation: int | None
    unit: str | None
    factor: float
    first: int
    last: int
    joint: bool
    brief: bool


@dataclass(frozen=True, slots=True, eq=False)
class RootMeans:
    """The numbers of one clause in K solves: ``parts`` says what they are, ``values`` (K, parts), NaN: none counted.

    ``behind`` has, for some solves, the rows that see a point behind its camera.
    """

    parts: tuple[_Part, ...]
    values: Floats
    behind: Mapping[int, list[int]]

    def of(self, place: int) -> RawResiduals:
        """Those of one solve; a mean without a finite value is None, one over nothing is left out."""
        return RawResiduals(means=self._means(place), behind=tuple(sorted(self.behind.get(place, ()))))

    def _means(self, place: int) -> tuple[RootMean, ...]:
        return tuple(
            RootMean(
                per=part.per,
                value=value if np.isfinite(value) else None,
                unit=part.unit,
                equation=part.equation,
                brief=part.brief,
            )
            for part, value in zip(self.parts, self.values[place].tolist(), strict=True)
            if not np.isnan(value)
        )


def of_solution(problem: Problem, solution: Solution) -> Mapping[str, RawResiduals]:
    """What is said of the raw residuals of each observation of a solve, by its name."""
    found = _of_rows(problem, _raw(problem, solution), 1)
    return {name: each.of(0) for name, each in found.items()}


def of_block(problem: Problem, block: Block) -> Mapping[str, RootMeans]:
    """The same of the solves of a block, from their columns."""
    return _of_rows(problem, block.raw(), len(block.which))


def rows_of(problem: Problem, solution: Solution, group: Group) -> AtRows:
    """The rows of a group at the estimates."""
    return rows_at(problem, group, solution.layout, solution.tables, solution.numbers)


@np.errstate(all="ignore")
def _raw(problem: Problem, solution: Solution) -> Iterator[RawRows]:
    for group in solution.groups:
        if problem.blocks[group.kernel.owner].role is not BlockRole.OBSERVATION or not group.rows:
            continue
        values, rows = group.written.values(solution.numbers), rows_of(problem, solution, group)
        counting = np.ones(values.shape, dtype=bool)
        if solution.weights is not None:
            counting &= _weights(solution.weights, group)
        yield RawRows(
            owner=group.kernel.owner,
            case=group.kernel.case,
            solve=np.zeros(group.rows, dtype=np.int64),
            values=values,
            counting=counting,
            behind=rows.behind(),
            rows=np.ones(group.rows, dtype=np.int64) if rows.table is None else rows.table.rows[group.positions],
        )


def _weights(weights: Floats, group: Group) -> Mask:
    """Which residuals (rows, 1 or outputs) of a group count; a row of a likelihood does as a whole."""
    counting = weights[group.first : group.first + group.count].reshape(group.rows, -1) > 0.0
    return counting if group.readings is None else np.asarray(counting.any(axis=1, keepdims=True))


@np.errstate(all="ignore")
def _of_rows(problem: Problem, rows: Iterable[RawRows], solves: int) -> Mapping[str, RootMeans]:
    """Those of each observation: sums over its rows, solve by solve, in their order."""
    sums: dict[int, dict[_Part, Floats]] = {}
    behind: dict[int, dict[int, list[int]]] = {}
    for each in rows:
        for place in np.flatnonzero(each.behind).tolist() if each.behind is not None else ():
            found = behind.setdefault(each.owner, {})
            found.setdefault(int(each.solve[place]), []).append(int(each.rows[place]))
        equations = problem.blocks[each.owner].cases[each.case].equations
        own = sums.setdefault(each.owner, {})
        begin = 0
        for number, equation in enumerate(equations, 1):
            end = begin + len(equation.components)
            counting: Mask = each.counting[:, begin:end].min(axis=1)
            # infinite stands for what is not finite: NaN says that nothing counted
            values = np.where(np.isfinite(each.values[:, begin:end]), each.values[:, begin:end], np.inf)
            for part in _parts(equation.units, number if len(equations) > 1 else None):
                total = own.setdefault(part, np.zeros((2, solves)))
                total += _squares(values[:, part.first : part.last] / part.factor, counting, part, each.solve, solves)
            begin = end
    return {
        block.name: RootMeans(
            tuple(sums.get(owner, ())),
            _roots(tuple(sums.get(owner, {}).values()), solves),
            behind.get(owner, {}),
        )
        for owner, block in enumerate(problem.blocks)
        if block.role is BlockRole.OBSERVATION
    }


def _squares(values: Floats, counting: Mask, part: _Part, solve: np.ndarray, solves: int) -> Floats:
    """Sums (2, K) of the squares of values (R, c), and how many there are."""
    squares = np.square(values[counting]).sum(axis=1)
    weight = 1 if part.joint else values.shape[1]
    solve = solve[counting]
    return np.stack(
        [np.bincount(solve, weights=squares, minlength=solves), weight * np.bincount(solve, minlength=solves)]
    )


def _roots(sums: Sequence[Floats], solves: int) -> Floats:
    return np.stack([np.sqrt(s / n) for s, n in sums], axis=1) if sums else np.empty((solves, 0))


def _parts(units: tuple[Unit | None, ...], equation: int | None) -> Iterator[_Part]:
    """What is said of an equation: of the vector as a whole where it has one unit, of each coordinate."""

    def part(per: str, first: int, last: int, *, joint: bool = False, brief: bool = True) -> _Part:
        unit = units[first]
        symbol, factor = (None, 1.0) if unit is None else (unit.symbol, unit.scale.factor)
        return _Part(
            per=per, equation=equation, unit=symbol, factor=factor, first=first, last=last, joint=joint, brief=brief
        )

    size = len(units)
    if size == 1:
        yield part(OVER_ROWS, 0, 1)
        return
    first, single = 0, []
    for _, run in groupby(units):
        last = first + len(list(run))
        if last - first == size:
            yield part(OVER_POINTS, first, last, joint=True)
            yield part(COORDINATE, first, last)
        elif last - first > 1:
            yield part(f"{COORDINATE}s {first + 1}-{last}", first, last, joint=True)
        else:
            yield part(f"{COORDINATE} {last}", first, last)
            single.append(first)
        first = last
    for place in range(size):
        if place not in single:
            yield part(f"{COORDINATE} {place + 1}", place, place + 1, brief=False)
