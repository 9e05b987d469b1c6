"""Which unknowns can be solved for before which others, from the structure of the equations alone.

A random start for 25 angles rarely leads anywhere; one for the few that some equations determine by themselves often
does, and then the next few. The order is the block triangular form of a square subsystem (Dulmage and Mendelsohn 1958;
Pothen and Fan 1990, ACM TOMS 16, 303-324), chosen so that equations with few unknowns come first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field

from mbm.values import dataclass

MAXIMUM_ROWS = 4000
"""Scalar equations above which nothing is dissected: random starts are for small problems."""

MAXIMUM_PARTS = 100
"""Parts above which the search by parts costs more than it brings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Unknowns (columns, ascending) solved together, and the equations that mention nothing unsolved from then on."""

    columns: tuple[int, ...]
    equations: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Dissection:
    """Parts in the order in which to solve them: first the ``trunk``, then each of the ``branches`` on its own.

    The equations of the trunk check it: there are more of them than unknowns. Those of a branch are just as many as its
    unknowns, given the trunk, so that its residuals are zero wherever it has a solution (but for its priors); it may
    have several.
    """

    trunk: tuple[Part, ...]
    branches: tuple[tuple[Part, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mention:
    """An equation: the columns of the unknowns that it mentions, and how many scalars it says about them.

    One that does not decide (a prior) is taken along where its unknowns are solved for, but determines no order.
    """

    columns: frozenset[int]
    size: int
    decides: bool = True


def dissected(equations: Sequence[Mention], count: int) -> Dissection | None:
    """The order of solving for ``count`` unknowns; None where they can only be solved all together.

    That is so where every square subsystem ties all unknowns to each other, where some unknown has no equation of its
    own, and where there are too many equations to look at.
    """
    rows = _scalar_rows(equations)
    if not count or len(rows) > MAXIMUM_ROWS:
        return None
    owned = _matching(rows, [e.columns for e in equations])
    if len(owned) < count:
        return None
    needs = [equations[owned[column]].columns for column in range(count)]
    groups = list(_strong_components(needs))
    if not 1 < len(groups) <= MAXIMUM_PARTS:
        return None
    parts = tuple(_with_equations(groups, equations))
    checked = _checked(parts, equations, needs)
    trunk = tuple(p for p in parts if p.columns[0] in checked)
    return Dissection(trunk=trunk, branches=_branches([p for p in parts if p.columns[0] not in checked], needs))


def _scalar_rows(equations: Sequence[Mention]) -> list[int]:
    """Each equation as often as it may determine an unknown; those with few unknowns first."""
    deciding = [i for i, e in enumerate(equations) if e.decides]
    order = sorted(deciding, key=lambda i: (len(equations[i].columns), i))
    return [i for i in order for _ in range(min(equations[i].size, len(equations[i].columns)))]


@dataclass(slots=True)
class _Search:
    """Scalar rows matched to columns so far: ``row_of`` [column], and the equation that each scalar row belongs to."""

    columns: Sequence[Sequence[int]]
    row_of: dict[int, int] = field(default_factory=dict)

    def extend(self, row: int) -> None:
        """Match one more scalar row if an augmenting path allows it; breadth first."""
        came_from: dict[int, int] = {}
        queue = [row]
        for current in queue:
            for column in self.columns[current]:
                if column in came_from:
                    continue
                came_from[column] = current
                if column not in self.row_of:
                    self._shift(column, came_from, row)
                    return
                queue.append(self.row_of[column])

    def _shift(self, column: int, came_from: dict[int, int], start: int) -> None:
        taken = {row: c for c, row in self.row_of.items()}
        while True:
            row = came_from[column]
            before = taken.get(row)
            self.row_of[column] = row
            if row == start or before is None:
                return
            column = before


def _matching(rows: Sequence[int], columns: Sequence[frozenset[int]]) -> dict[int, int]:
    """For each column the equation that it owns: a maximum matching that prefers the first rows (a greedy basis)."""
    ordered = {i: tuple(sorted(columns[i])) for i in set(rows)}
    search = _Search([ordered[i] for i in rows])
    for row in range(len(rows)):
        search.extend(row)
    return {column: rows[row] for column, row in search.row_of.items()}


def _strong_components(needs: Sequence[frozenset[int]]) -> Iterator[tuple[int, ...]]:
    """Columns that need each other, each group after those it needs (Tarjan 1972, without recursion)."""
    number: dict[int, int] = {}
    low: dict[int, int] = {}
    stack: list[int] = []
    waiting: set[int] = set()
    for root in range(len(needs)):
        if root in number:
            continue
        work = [(root, iter(sorted(needs[root])))]
        number[root] = low[root] = len(number)
        stack.append(root)
        waiting.add(root)
        while work:
            column, others = work[-1]
            following = next(others, None)
            if following is None:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[column])
                if low[column] == number[column]:
                    cut = stack.index(column)
                    group = stack[cut:]
                    del stack[cut:]
                    waiting.difference_update(group)
                    yield tuple(sorted(group))
            elif following not in number:
                number[following] = low[following] = len(number)
                stack.append(following)
                waiting.add(following)
                work.append((following, iter(sorted(needs[following]))))
            elif following in waiting:
                low[column] = min(low[column], number[following])


def _with_equations(groups: Iterable[tuple[int, ...]], equations: Sequence[Mention]) -> Iterator[Part]:
    """The groups with the equations that each of them completes."""
    solved: set[int] = set()
    left = dict(enumerate(equations))
    for group in groups:
        solved.update(group)
        complete = tuple(i for i, e in left.items() if e.columns <= solved)
        for i in complete:
            del left[i]
        yield Part(columns=group, equations=complete)


def _checked(parts: Sequence[Part], equations: Sequence[Mention], needs: Sequence[frozenset[int]]) -> frozenset[int]:
    """Columns of parts with more equations than unknowns, and all that those need (the overdetermined part)."""
    found: set[int] = set()
    queue = [
        column
        for part in parts
        if sum(equations[i].size for i in part.equations if equations[i].decides) > len(part.columns)
        for i in part.equations
        for column in equations[i].columns
    ]
    while queue:
        column = queue.pop()
        if column not in found:
            found.add(column)
            queue.extend(needs[column])
    return frozenset(found)


def _branches(parts: Sequence[Part], needs: Sequence[frozenset[int]]) -> tuple[tuple[Part, ...], ...]:
    """The parts beyond the trunk, grouped into those that have to do with each other; in the order of solving."""
    leader: dict[int, int] = {}
    members: dict[int, list[Part]] = {}
    for number, part in enumerate(parts):
        joined = {leader[c] for own in part.columns for c in needs[own] if c in leader}
        members[number] = [p for i in sorted(joined) for p in members.pop(i)] + [part]
        leader.update({c: number for p in members[number] for c in p.columns})
    order = {part: i for i, part in enumerate(parts)}
    return tuple(tuple(sorted(group, key=order.__getitem__)) for group in members.values())
