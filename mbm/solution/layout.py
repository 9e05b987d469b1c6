"""Where each number of each unknown stands in the vector of all of them: start, bounds, whether it is free."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mbm.problem import faults as problem_faults
from mbm.problem.naming import scalar_name
from mbm.problem.rows import decided, row_values
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem, RowValues, Unknown, UnknownKind
from mbm.solution import faults
from mbm.solution.types import Floats, Indices, Mask
from mbm.text.types import MbmError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Entry:
    """An unknown's place: numbers ``offset … offset + members·size``, member by member, components row by row."""

    unknown: Unknown
    offset: int
    keys: tuple[CellKey, ...] | None
    index: Mapping[CellKey, int]

    @property
    def members(self) -> int:
        """Number of members; 1 without a family."""
        return 1 if self.keys is None else len(self.keys)

    @property
    def count(self) -> int:
        """Numbers of all members."""
        return self.members * self.unknown.size

    @property
    def range(self) -> slice:
        """Where they stand."""
        return slice(self.offset, self.offset + self.count)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layout:
    """The vector of all numbers (N,): starts (NaN where none is known), bounds, and masks; all in SI."""

    entries: tuple[Entry, ...]
    by_name: Mapping[str, Entry] = field(repr=False)
    start: Floats
    lower: Floats
    upper: Floats
    fixed: Mask
    positive: Mask
    angle: Mask

    def entry(self, name: str) -> Entry:
        """The place of an unknown."""
        return self.by_name[name]

    def owner(self, position: int) -> Entry:
        """The unknown that a number belongs to."""
        return self.entries[bisect_right(self.entries, position, key=lambda e: e.offset) - 1]

    def name(self, position: int) -> str:
        """The name of a number as CONTRACT §2 writes it: ``p[1]``, ``theta[2,1]``, ``q["waist"]``."""
        entry = self.owner(position)
        member, component = divmod(position - entry.offset, entry.unknown.size)
        key = None if entry.keys is None else entry.keys[member]
        return scalar_name(entry.unknown.name, key, entry.unknown.indices()[component])


def layout(problem: Problem, tables: Mapping[str, Table], starts: Mapping[str, Floats]) -> Layout:
    """The layout for these tables; ``starts`` overrides ``:init``, by name, in SI.

    Raises:
        MbmError: bounds the wrong way round, or a start of the wrong shape.

    """
    entries: list[Entry] = []
    offset = 0
    for unknown in problem.unknowns:
        keys: tuple[CellKey, ...] | None = None
        if unknown.family is not None:
            keys = tuple(tables[unknown.family.rows].keys(unknown.family.key))
        index = {key: i for i, key in enumerate(keys or ())}
        entry = Entry(unknown=unknown, offset=offset, keys=keys, index=index)
        entries.append(entry)
        offset += entry.count
    start, lower, upper = np.full(offset, np.nan), np.full(offset, -np.inf), np.full(offset, np.inf)
    fixed, positive, angle = (np.zeros(offset, dtype=bool) for _ in range(3))
    for entry in entries:
        place = entry.range
        _fill(entry, entry.unknown.lower, tables, lower)
        _fill(entry, entry.unknown.upper, tables, upper)
        is_positive = entry.unknown.kind is UnknownKind.POSITIVE
        if bool((lower[place] >= upper[place]).any()) or (is_positive and bool((upper[place] <= 0).any())):
            raise MbmError(problem_faults.bad_bounds(entry.unknown.span, entry.unknown.name))
        start[place] = _start(entry, tables, starts, lower[place], upper[place])
        if is_positive and bool((start[place] <= 0).any()):
            raise MbmError(problem_faults.start_not_positive(entry.unknown.span, entry.unknown.name))
        positive[place] = is_positive
        angle[place] = entry.unknown.kind is UnknownKind.ANGLE
        if entry.unknown.fixed is not None:
            fixed[place] = decided(entry.unknown.fixed, tables).reshape(-1)
    turned = angle & np.isfinite(lower) & np.isfinite(upper)
    middle = (lower[turned] + upper[turned]) / 2
    start[turned] = middle + np.remainder(start[turned] - middle + np.pi, 2 * np.pi) - np.pi
    return Layout(
        entries=tuple(entries),
        by_name={e.unknown.name: e for e in entries},
        start=start,
        lower=lower,
        upper=upper,
        fixed=fixed,
        positive=positive,
        angle=angle,
    )


def _fill(entry: Entry, values: RowValues | None, tables: Mapping[str, Table], target: Floats) -> None:
    if values is not None:
        target[entry.range] = _checked(entry, row_values(values, tables), values)


def _checked(entry: Entry, found: Floats, values: RowValues) -> Floats:
    numbers = found.reshape(-1)
    if bool(np.isnan(numbers).any()):
        row = int(np.flatnonzero(np.isnan(found).any(axis=1))[0])
        key = entry.keys[row] if entry.keys is not None else None
        raise MbmError(faults.option_not_finite(values.span, entry.unknown.name, key))
    return numbers


def _start(
    entry: Entry, tables: Mapping[str, Table], starts: Mapping[str, Floats], lower: Floats, upper: Floats
) -> Floats:
    """The starts of an unknown: those given from outside (NaN: not given), else what the problem says."""
    given = _given_start(entry, starts.get(entry.unknown.name))
    if not bool(np.isnan(given).any()):
        return given
    stated = _stated_start(entry, tables, lower, upper)
    return np.where(np.isnan(given), stated, given)


def _given_start(entry: Entry, given: Floats | None) -> Floats:
    unknown = entry.unknown
    if given is not None:
        numbers = np.asarray(given, dtype=np.float64).reshape(-1)
        if numbers.size == 1 and entry.count > 1:
            numbers = np.repeat(numbers, entry.count)
        if numbers.size == unknown.size and entry.count > unknown.size:
            numbers = np.tile(numbers, entry.members)
        if numbers.size != entry.count:
            message = f"has {numbers.size} numbers; {entry.count} are wanted"
            raise MbmError(problem_faults.bad_override(unknown.name, message))
        if bool(np.isinf(numbers).any()):
            raise MbmError(problem_faults.bad_override(unknown.name, "is not finite"))
        return numbers
    return np.full(entry.count, np.nan)


def _stated_start(entry: Entry, tables: Mapping[str, Table], lower: Floats, upper: Floats) -> Floats:
    unknown = entry.unknown
    if unknown.start is not None:
        return _checked(entry, row_values(unknown.start, tables), unknown.start)
    if unknown.start_lower is not None and unknown.start_upper is not None:
        low, high = (row_values(v, tables).reshape(-1) for v in (unknown.start_lower, unknown.start_upper))
        return (low + high) / 2
    middle = np.full(entry.count, np.nan)
    bounded = np.isfinite(lower) & np.isfinite(upper)
    middle[bounded] = (lower[bounded] + upper[bounded]) / 2
    return middle


def free_positions(found: Layout, used: Mask) -> Indices:
    """Positions of the numbers to be estimated: not fixed, and not members that no equation mentions.

    An unknown of which nothing is mentioned stays in: it is unobservable, and the rank decision says so.
    """
    free = ~found.fixed
    for entry in found.entries:
        if entry.keys is not None and bool(used[entry.range].any()):
            mentioned = used[entry.range].reshape(entry.members, -1).any(axis=1)
            free[entry.range] &= np.repeat(mentioned, entry.unknown.size)
    return np.flatnonzero(free)
