"""``(pair NAME (A B) :by t …)``: two timed tables → one, whose rows hold a row of each at the same time."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbm.expression.units import NONE, parse_unit
from mbm.problem import faults
from mbm.problem.provenance import Origin
from mbm.problem.rows import MAXIMUM_REPORTED, by_key, later_rows, starts_anew
from mbm.problem.tables import TIME, CellKey, Column, Numbers, PairDeclaration, StepKind, Table
from mbm.text.types import MbmError
from mbm.values import dataclass

TURNING_UNITS = frozenset({"rad", "mrad", "urad", "deg", "arcmin", "arcsec", "rev"})
QUATERNION = ("qx", "qy", "qz", "qw")


Positions = NDArray[np.int64]
_NONE: Positions = np.empty(0, dtype=np.int64)
_NO_STEPS: Numbers = np.empty(0)


def with_pairs(tables: Mapping[str, Table], pairs: tuple[PairDeclaration, ...]) -> dict[str, Table]:
    """``tables`` with those that the pairs make, in the order of the pairs."""
    found = dict(tables)
    for pair in pairs:
        found[pair.name] = paired(pair, found)
    return found


def paired(pair: PairDeclaration, tables: Mapping[str, Table]) -> Table:
    """The table that a pair makes: columns ``A.x``, ``B.x`` and what has a plain name, in A's order.

    Raises:
        MbmError: a time that is missing, text or (of B, when interpolating) there twice.

    """
    first, second = tables[pair.first], tables[pair.second]
    if pair.steps is not None:
        rows, others = paired_rows(pair, first)
        taken = {name: column.take(others) for name, column in second.columns.items()}
        return _together(pair, (first, second), (rows, others), taken)
    a, b = _times(first, pair), _times(second, pair)
    parts = tuple(_parts(_within(pair, first, second), first, second))
    if pair.interpolate:
        rows, where = _between_parts(pair, second, (a, b), parts)
        taken = {name: _interpolated(second, name, where) for name in second.columns}
        taken.update(_turned(second, where))
        taken[pair.by] = replace(second.columns[pair.by], numbers=a[rows])
        others = np.where(where.fraction > 0.5, where.later, where.earlier)
    else:
        rows, others = _associated_parts(pair, (a, b), parts)
        taken = {name: column.take(others) for name, column in second.columns.items()}
    return _together(pair, (first, second), (rows, others), taken)


def _within(pair: PairDeclaration, first: Table, second: Table) -> PairDeclaration:
    """The pair with those of the windows' columns among its keys with which the times of a table start anew."""
    name = pair.by if pair.steps is None or pair.steps.kind is StepKind.TIME else TIME
    both = [c for c in pair.passing if c in first.columns and c in second.columns]
    timed = [table for table in (first, second) if both and name in table.columns]
    anew = [c for c in both if any(starts_anew(table, name, c) for table in timed)]
    return replace(pair, keys=(*pair.keys, *anew))


def _parts(pair: PairDeclaration, first: Table, second: Table) -> Iterator[tuple[Positions, Positions]]:
    """The rows of both tables that one solve has together: those with the same keys, as far as both have these."""
    own, others = (tuple(key for key in pair.keys if key in table.columns) for table in (first, second))
    common = [key for key in own if key in others]
    theirs: dict[tuple[CellKey, ...], list[Positions]] = {}
    for cells, rows in by_key(second, others).items():
        theirs.setdefault(tuple(cells[others.index(key)] for key in common), []).append(rows)
    for cells, rows in by_key(first, own).items():
        for found in theirs.get(tuple(cells[own.index(key)] for key in common), ()):
            yield rows, found


def _associated_parts(
    pair: PairDeclaration, times: tuple[Numbers, Numbers], parts: Sequence[tuple[Positions, Positions]]
) -> tuple[Positions, Positions]:
    rows, others = [_NONE], [_NONE]
    tolerance = usual_tolerance(times, parts) if pair.tolerance is None else pair.tolerance
    for own, theirs in parts:
        here, there = associated(times[0][own], times[1][theirs], tolerance)
        rows.append(own[here])
        others.append(theirs[there])
    found = np.concatenate(rows)
    order = np.argsort(found, kind="stable")
    return found[order], np.concatenate(others)[order]


def _between_parts(
    pair: PairDeclaration, second: Table, times: tuple[Numbers, Numbers], parts: Sequence[tuple[Positions, Positions]]
) -> tuple[Positions, Between]:
    rows, earlier, later, fractions = [_NONE], [_NONE], [_NONE], [np.empty(0)]
    for own, theirs in parts:
        a, b = times[0][own], times[1][theirs]
        _refuse_repeated(second, theirs, b, pair)
        here, where = _near_enough(between(a, b), a, b, pair.tolerance)
        rows.append(own[here])
        earlier.append(theirs[where.earlier])
        later.append(theirs[where.later])
        fractions.append(where.fraction)
    found = np.concatenate(rows)
    order = np.argsort(found, kind="stable")
    return found[order], Between(
        inside=np.isin(np.arange(len(times[0])), found),
        earlier=np.concatenate(earlier)[order],
        later=np.concatenate(later)[order],
        fraction=np.concatenate(fractions)[order],
    )


def _together(
    pair: PairDeclaration,
    tables: tuple[Table, Table],
    positions: tuple[Positions, Positions],
    taken: Mapping[str, Column],
) -> Table:
    """The rows at ``positions`` side by side; the columns of the second are ``taken``."""
    first, second = tables
    rows = positions[0]
    mine = {name: column.take(rows) for name, column in first.columns.items()}
    both: dict[str, Column] = {}
    origins: dict[str, Origin] = {}
    for alias, table, found, place in zip(pair.aliases, tables, (mine, taken), positions, strict=True):
        for name, column in found.items():
            both[f"{alias}.{name}"] = replace(column, name=f"{alias}.{name}")
            origins[f"{alias}.{name}"] = Origin(provenance=table.provenance, rows=table.rows[place], column=name)
    columns = {plain: replace(both[name], name=plain) for plain, name in pair.plain} | both
    origins.update({plain: origins[name] for plain, name in pair.plain})
    return Table(
        name=pair.name,
        columns=columns,
        rows=np.arange(1, len(rows) + 1, dtype=np.int64),
        provenance=replace(first.provenance.taking(first.rows[rows]), origins=origins),
        groups={**first.groups_called(pair.aliases[0]), **second.groups_called(pair.aliases[1])},
    )


def paired_rows(pair: PairDeclaration, table: Table) -> tuple[Positions, Positions]:
    """Positions (from 0) of the rows that a pair of ``table`` with itself makes, and of those they are paired with.

    Raises:
        MbmError: a time or coordinate that is missing or text.

    """
    if pair.steps is None:
        raise TypeError(pair.name)
    for name in pair.steps.along:
        _numbers(table, name, pair)
    scale = _times(table, pair) if pair.steps.kind is StepKind.TIME else None
    return later_rows(table, pair.steps, _within(pair, table, table).keys, scale, pair.tolerance)


def unpaired(pairs: Sequence[PairDeclaration], tables: Mapping[str, Table]) -> str:
    """What the times are of the first pair that has no rows although both of its tables have some; empty if none is."""
    for pair in pairs:
        sides = [(side, tables[side]) for side in (pair.first, pair.second)]
        if pair.steps is None and not len(tables[pair.name]) and all(len(table) for _, table in sides):
            spans = [(side, times.min(), times.max()) for side, table in sides for times in (_times(table, pair),)]
            said = " and ".join(f"from {low:.10g} to {high:.10g} in `{side}`" for side, low, high in spans)
            return f"`{pair.name}` pairs no rows, as `{pair.by}` goes {said}"
    return ""


def _times(table: Table, pair: PairDeclaration) -> Numbers:
    """The times of a table, all finite."""
    return _numbers(table, pair.by, pair)


def _numbers(table: Table, name: str, pair: PairDeclaration) -> Numbers:
    """A column of finite numbers."""
    column = table.columns.get(name)
    if column is None:
        raise MbmError(faults.unknown_column(pair.span, name, table.name, tuple(table.columns)))
    if column.numbers is None:
        position = column.first_text() or 0
        place = table.place(position, name)
        raise MbmError(faults.bad_time(place, name, str(column.cell(position)), pair.span))
    wrong = np.flatnonzero(~np.isfinite(column.numbers))[:MAXIMUM_REPORTED]
    if wrong.size:
        cells = [(table.place(int(i), name), float(column.numbers[i])) for i in wrong]
        raise MbmError(*(faults.not_finite_cell(place, name, value, pair.span) for place, value in cells))
    return column.numbers


def _refuse_repeated(table: Table, rows: Positions, times: Numbers, pair: PairDeclaration) -> None:
    """Refuse ``rows`` two of which have the same of the ``times``."""
    order = np.argsort(times, kind="stable")
    repeated = np.flatnonzero(np.diff(times[order]) == 0)
    if repeated.size:
        here, there = (int(order[repeated[0] + i]) for i in (1, 0))
        places = table.place(int(rows[here]), pair.by), table.place(int(rows[there]), pair.by)
        raise MbmError(faults.repeated_time(*places, pair.by, float(times[here]), pair.span))


def _near_enough(where: Between, a: Numbers, b: Numbers, tolerance: float | None) -> tuple[Positions, Between]:
    """The rows of A that are used, and where they fall: both neighbours lie within the tolerance, if one is stated."""
    rows = np.flatnonzero(where.inside)
    if tolerance is None:
        return rows, where
    times = a[rows]
    slack = 4 * np.finfo(np.float64).eps * float(np.abs(times).max(initial=0.0))
    before = (times - b[where.earlier] <= tolerance + slack) | (where.fraction == 1)
    after = (b[where.later] - times <= tolerance + slack) | (where.fraction == 0)
    kept = before & after
    inside = np.zeros(len(a), dtype=bool)
    inside[rows[kept]] = True
    taken = Between(inside=inside, earlier=where.earlier[kept], later=where.later[kept], fraction=where.fraction[kept])
    return rows[kept], taken


def _interpolated(table: Table, name: str, where: Between) -> Column:
    """A column on the straight line between two rows; angles go the shorter way round, texts are the nearer row's."""
    column = table.columns[name]
    if column.numbers is None:
        return column.take(np.where(where.fraction > 0.5, where.later, where.earlier))
    start, end = column.numbers[where.earlier], column.numbers[where.later]
    step = end - start
    if turns(column):
        step = step - 2 * np.pi * np.round(step / (2 * np.pi))
    return replace(column, numbers=np.where(where.fraction == 0, start, start + where.fraction * step))


def turns(column: Column) -> bool:
    """Whether the column states a unit of angle: a whole turn makes no difference then."""
    unit = parse_unit(column.unit) if column.unit is not None else None
    return unit is not None and unit.symbol in TURNING_UNITS and unit.dimension == NONE


def _turned(table: Table, where: Between) -> dict[str, Column]:
    """Columns ``qx qy qz qw`` (whatever stands before these names) on the great circle between two rotations.

    Spherical linear interpolation (Shoemake 1985), the shorter way round.
    """
    found: dict[str, Column] = {}
    for name in table.columns:
        if not name.endswith(QUATERNION[0]):
            continue
        names = [name.removesuffix(QUATERNION[0]) + part for part in QUATERNION]
        columns = [table.columns[each] for each in names if each in table.columns]
        numbers = [column.numbers for column in columns if column.numbers is not None]
        if len(numbers) < len(QUATERNION):
            continue
        quaternions = np.column_stack(numbers)
        turned = _slerp(quaternions[where.earlier], quaternions[where.later], where.fraction)
        for i, column in enumerate(columns):
            found[names[i]] = replace(column, numbers=turned[:, i])
    return found


def _slerp(start: Numbers, end: Numbers, fraction: Numbers) -> Numbers:
    """Quaternions (n, 4) between two, of length 1; those at a node stay as they are."""
    with np.errstate(all="ignore"):  # a quaternion of zeros is no rotation: NaN, found where it is used
        p = start / np.linalg.norm(start, axis=1, keepdims=True)
        q = end / np.linalg.norm(end, axis=1, keepdims=True)
        cosine = np.einsum("ni,ni->n", p, q)
        q = np.where(cosine[:, None] < 0, -q, q)
        # the half angle from chord and sum: exact for small angles, where the cosine has lost its digits
        angle = 2 * np.arctan2(np.linalg.norm(q - p, axis=1), np.linalg.norm(q + p, axis=1))
        near = angle < 1e-9
        sine = np.where(near, 1.0, np.sin(angle))
        a = np.where(near, 1 - fraction, np.sin((1 - fraction) * angle) / sine)
        b = np.where(near, fraction, np.sin(fraction * angle) / sine)
        found = a[:, None] * p + b[:, None] * q
    return np.asarray(np.where(fraction[:, None] == 0, start, found))


def usual_tolerance(times: tuple[Numbers, Numbers], parts: Sequence[tuple[Positions, Positions]]) -> float:
    """Half the median distance of neighbouring times in the denser of two tables (n,), (m,).

    At this distance a time is as near to one row of the denser table as to the next. Neighbours are those within the
    ``parts`` that are laid on one another; in a table without two different times in a part, those of the whole table.
    0 where no table has two different times: only equal ones are then taken together.
    """
    medians = []
    for side, whole in enumerate(times):
        apart = [np.diff(np.unique(whole[part[side]])) for part in parts]
        steps = np.concatenate([_NO_STEPS, *apart])
        steps = steps if steps.size else np.diff(np.unique(whole))
        if steps.size:
            medians.append(float(np.median(steps)))
    return min(medians) / 2 if medians else 0.0


def associated(a: Numbers, b: Numbers, tolerance: float) -> tuple[Positions, Positions]:
    """Positions in ``a`` (n,) and ``b`` (m,) of rows that belong together, in the order of ``a``.

    The two times that are nearest to one another are taken first, then the nearest two of those left, as long as they
    differ by no more than ``tolerance``: each row is used once. This is the association of the TUM benchmark's tools
    (Sturm and others 2012); equal distances go to the earlier times.

    The nearest two always stand side by side among all times in order, so a queue of neighbours suffices.
    """
    times = np.concatenate([a, b])
    order = np.lexsort((np.arange(len(times)), times))
    sorted_times = times[order].tolist()
    first = (order < len(a)).tolist()
    before = list(range(-1, len(times) - 1))
    after = list(range(1, len(times) + 1))
    slack = 4 * np.finfo(np.float64).eps * float(np.abs(times).max(initial=0.0))

    def distance(left: int) -> tuple[float, int, int]:
        right = after[left]
        return (sorted_times[right] - sorted_times[left], left, right)

    queue = [distance(i) for i in range(len(times) - 1) if first[i] != first[i + 1]]
    heapq.heapify(queue)
    used = [False] * len(times)
    pairs = []
    while queue:
        gap, left, right = heapq.heappop(queue)
        if gap > tolerance + slack:
            break
        if used[left] or used[right]:
            continue
        used[left] = used[right] = True
        pairs.append((left, right) if first[left] else (right, left))
        outer, next_outer = before[left], after[right]
        if outer >= 0:
            after[outer] = next_outer
        if next_outer < len(times):
            before[next_outer] = outer
        if outer >= 0 and next_outer < len(times) and first[outer] != first[next_outer]:
            heapq.heappush(queue, distance(outer))
    found = np.array([(order[i], order[j] - len(a)) for i, j in pairs], dtype=np.int64).reshape(-1, 2)
    found = found[np.argsort(found[:, 0], kind="stable")]
    return found[:, 0], found[:, 1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Between:
    """Where times fall between nodes: ``inside`` (n,) says which do.

    For those ``earlier``, ``later`` (k,) are the positions of the nodes before and after in the table as it stands, and
    ``fraction`` (k,) how far on the way from one to the other.
    """

    inside: NDArray[np.bool_]
    earlier: Positions
    later: Positions
    fraction: Numbers


def between(times: Numbers, nodes: Numbers) -> Between:
    """Where ``times`` (n,) fall between ``nodes`` (m,), all different, in any order."""
    order = np.argsort(nodes, kind="stable")
    ordered = nodes[order]
    if len(ordered) == 0:
        none = np.empty(0, dtype=np.int64)
        return Between(inside=np.zeros(len(times), dtype=bool), earlier=none, later=none, fraction=np.empty(0))
    inside = (times >= ordered[0]) & (times <= ordered[-1])
    within = times[inside]
    place = np.clip(np.searchsorted(ordered, within, side="right") - 1, 0, max(len(ordered) - 2, 0))
    follows = np.minimum(place + 1, len(ordered) - 1)
    width = ordered[follows] - ordered[place]
    fraction = np.where(width > 0, (within - ordered[place]) / np.where(width > 0, width, 1.0), 0.0)
    return Between(inside=inside, earlier=order[place], later=order[follows], fraction=fraction)
