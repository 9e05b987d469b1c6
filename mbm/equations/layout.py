"""Where each number of each unknown stands in the vector of all of them, and each coordinate in that of the steps."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import field, replace

import numpy as np

from mbm.equations import faults
from mbm.equations.manifolds import (
    Curved,
    bounded_coordinates,
    held_numbers,
    moved,
    numbers_of_stated,
    of_arrays,
    stated_width,
)
from mbm.equations.types import Floats, Indices, Mask
from mbm.problem import faults as problem_faults
from mbm.problem.manifold import Piece
from mbm.problem.naming import member_name, scalar_name
from mbm.problem.rows import decided, row_values
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem, RowValues, Unknown, UnknownKind
from mbm.solver.turns import turned_to
from mbm.text.types import Diagnostic, MbmError, Span
from mbm.values import dataclass


def places_in(chosen: Indices, count: int) -> Indices:
    """The place of each of ``count`` in ``chosen`` (…, k), along its last axis; -1 of what is not chosen."""
    places = np.full(count, -1, dtype=np.int64)
    places[chosen] = np.arange(chosen.shape[-1])
    return places


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Entry:
    """An unknown's place, member by member, components row by row.

    Its numbers are ``offset … offset + members·size``, its coordinates ``first … first + members·freedom``. A state
    that does not change has one member, which is that of all ``steps``.
    """

    unknown: Unknown
    offset: int
    first: int
    keys: tuple[CellKey, ...] | None
    index: Mapping[CellKey, int]
    steps: tuple[CellKey, ...] | None = None

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
        """Where the numbers stand."""
        return slice(self.offset, self.offset + self.count)

    @property
    def coordinates(self) -> slice:
        """Where the coordinates stand."""
        return slice(self.first, self.first + self.members * self.unknown.freedom)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layout:
    """The vector of all numbers (N,) and that of all coordinates (M,), in SI.

    ``start`` (N,) holds NaN where none is known; ``guessed`` (N,) marks those that are but the middle of a range. Per
    coordinate: bounds, masks, and ``number``, the place of the number
    that a step adds to, -1 where it turns or scales something (``curved``).
    """

    entries: tuple[Entry, ...]
    by_name: Mapping[str, Entry] = field(repr=False)
    start: Floats
    guessed: Mask
    lower: Floats
    upper: Floats
    start_lower: Floats
    start_upper: Floats
    fixed: Mask
    positive: Mask
    angle: Mask
    number: Indices
    curved: tuple[Curved, ...]

    def entry(self, name: str) -> Entry:
        """The place of an unknown."""
        return self.by_name[name]

    def reported(self, points: Floats) -> Floats:
        """The points (…, N) as they are reported, and derived quantities computed from them: angles in (−π, π]."""
        return _turned(points, self.number[self.angle & (self.number >= 0)], np.zeros(()))

    def number_of(self) -> dict[str, int]:
        """Which of the unknowns each is, by name."""
        return {name: number for number, name in enumerate(self.by_name)}

    def owner(self, coordinate: int) -> Entry:
        """The unknown that a coordinate belongs to."""
        return self.entries[bisect_right(self.entries, coordinate, key=lambda e: e.first) - 1]

    def name(self, coordinate: int) -> str:
        """A coordinate as CONTRACT §2 writes it: ``p[1]``, ``theta[2,1]``, ``q["waist"]``, ``T["a"].rot[1]``."""
        entry = self.owner(coordinate)
        member, component = divmod(coordinate - entry.first, entry.unknown.freedom)
        key = None if entry.keys is None else entry.keys[member]
        labels, at_step = entry.unknown.manifold.labels, entry.unknown.is_state
        if labels:
            return member_name(entry.unknown.name, key, at_step=at_step) + labels[component]
        return scalar_name(entry.unknown.name, key, entry.unknown.indices()[component], at_step=at_step)

    def missing(self) -> Mask:
        """Coordinates (M,) of pieces without a start."""
        found = np.zeros(len(self.number), dtype=bool)
        plain = self.number >= 0
        found[plain] = np.isnan(self.start[self.number[plain]])
        for curved in self.curved:
            unknown = np.isnan(self.start[curved.numbers]).any(axis=1)
            found[curved.coordinates[unknown]] = True
        return found

    def retract(self, numbers: Floats, step: Floats) -> Floats:
        """All numbers (…, N) after a step of all coordinates (…, M)."""
        result = numbers.copy()
        if not self.curved:
            result[..., self.number] += step
            return result
        plain = self.number >= 0
        result[..., self.number[plain]] += step[..., plain]
        for curved in self.curved:
            before = numbers[..., curved.numbers]
            flat = before.reshape(-1, curved.piece.size)
            turned = moved(curved.piece, flat, step[..., curved.coordinates].reshape(-1, curved.piece.tangent))
            result[..., curved.numbers] = turned.reshape(before.shape)
        return result


def layout(
    problem: Problem, tables: Mapping[str, Table], starts: Mapping[str, Floats], *, spread: bool = False
) -> Layout:
    """The layout for these tables; ``starts`` overrides ``:init``, by name, in SI.

    ``spread``: states that do not change have a member for each step, as the others have.

    Raises:
        MbmError: bounds the wrong way round, or a start of the wrong shape.

    """
    entries: list[Entry] = []
    offset = first = 0
    still = frozenset() if problem.sequence is None or spread else problem.sequence.static
    for unknown in problem.unknowns:
        keys: tuple[CellKey, ...] | None = None
        if unknown.family is not None:
            keys = tuple(tables[unknown.family.rows].keys(unknown.family.key))
        index = {key: i for i, key in enumerate(keys or ())}
        entry = Entry(unknown=unknown, offset=offset, first=first, keys=keys, index=index)
        if unknown.name in still:
            entry = replace(entry, keys=None, index=dict.fromkeys(index, 0), steps=keys)
        entries.append(entry)
        offset += entry.count
        first += entry.members * unknown.freedom
    number, curved = _places(entries, first)
    start = np.full(offset, np.nan)
    lower, upper, start_lower, start_upper = (np.full(first, v) for v in (-np.inf, np.inf, np.nan, np.nan))
    fixed, positive, angle = (np.zeros(first, dtype=bool) for _ in range(3))
    for entry in entries:
        place = entry.coordinates
        _fill(entry, entry.unknown.lower, tables, lower)
        _fill(entry, entry.unknown.upper, tables, upper)
        _fill(entry, entry.unknown.start_lower, tables, start_lower)
        _fill(entry, entry.unknown.start_upper, tables, start_upper)
        is_positive = entry.unknown.kind is UnknownKind.POSITIVE
        if bool((lower[place] >= upper[place]).any()) or (is_positive and bool((upper[place] <= 0).any())):
            raise MbmError(problem_faults.bad_bounds(entry.unknown.span, entry.unknown.name))
        start[entry.range] = _start(entry, tables, starts)
        positive[place] = is_positive
        angles = [
            a
            for p, a in zip(entry.unknown.manifold.pieces, entry.unknown.manifold.angles, strict=True)
            for _ in range(p.tangent)
        ]
        angle[place] = np.tile(angles, entry.members)
        if entry.unknown.fixed is not None:
            fixed[place] = decided(entry.unknown.fixed, tables)[: entry.members].reshape(-1)
    guessed = np.isnan(start)
    _middles(start, number, (lower, upper), (start_lower, start_upper))
    guessed &= ~np.isnan(start)
    for entry in entries:
        if entry.unknown.kind is UnknownKind.POSITIVE and bool((start[entry.range] <= 0).any()):
            raise MbmError(problem_faults.start_not_positive(entry.unknown.span, entry.unknown.name))
    return Layout(
        entries=tuple(entries),
        by_name={e.unknown.name: e for e in entries},
        start=within_turns(start, number, angle, lower, upper),
        guessed=guessed,
        lower=lower,
        upper=upper,
        start_lower=start_lower,
        start_upper=start_upper,
        fixed=fixed,
        positive=positive,
        angle=angle,
        number=number,
        curved=curved,
    )


def within_turns(points: Floats, number: Indices, angle: Mask, lower: Floats, upper: Floats) -> Floats:
    """The points (…, N) with bounded angles in the turn whose middle is that of their bounds, which are per coordinate.

    The other arguments are those of `Layout`.
    """
    turned = np.flatnonzero(angle & np.isfinite(lower) & np.isfinite(upper))
    return _turned(points, number[turned], (lower[turned] + upper[turned]) / 2)


def half_turns(angles: Floats) -> Floats:
    """Angles of any shape, by whole turns in (−π, π]: as they are reported."""
    return of_arrays(turned_to)(angles, np.zeros(()))


def _turned(points: Floats, places: Indices, middles: Floats) -> Floats:
    if not len(places):
        return points
    result = points.copy()
    result[..., places] = of_arrays(turned_to)(points[..., places], middles)
    return result


def _places(entries: list[Entry], coordinates: int) -> tuple[Indices, tuple[Curved, ...]]:
    """The number of each coordinate (-1: none), and the pieces that do not vary by addition."""
    number = np.full(coordinates, -1, dtype=np.int64)
    found: dict[Piece, list[tuple[Indices, Indices]]] = {}
    for entry in entries:
        unknown = entry.unknown
        if unknown.manifold.flat:
            number[entry.coordinates] = np.arange(entry.offset, entry.offset + entry.count)
            continue
        member = np.arange(entry.members)[:, None]
        for piece, first, coordinate in unknown.manifold.spans():
            places = entry.offset + member * unknown.size + first + np.arange(piece.size)
            lines = entry.first + member * unknown.freedom + coordinate + np.arange(piece.tangent)
            if piece is Piece.NUMBER:
                number[lines] = places
            else:
                found.setdefault(piece, []).append((places, lines))
    curved = tuple(
        Curved(
            piece=piece,
            numbers=np.vstack([places for places, _ in parts]),
            coordinates=np.vstack([lines for _, lines in parts]),
        )
        for piece, parts in found.items()
    )
    return number, curved


def _middles(start: Floats, number: Indices, bounds: tuple[Floats, Floats], ranges: tuple[Floats, Floats]) -> None:
    """Numbers without a start begin in the middle of ``:start``, else of ``:in``."""
    for low, high in (ranges, bounds):
        bounded = np.flatnonzero(np.isfinite(low) & np.isfinite(high) & (number >= 0))
        bounded = bounded[np.isnan(start[number[bounded]])]
        start[number[bounded]] = (low[bounded] + high[bounded]) / 2


def _fill(entry: Entry, values: RowValues | None, tables: Mapping[str, Table], target: Floats) -> None:
    if values is not None:
        numbers = _checked(entry, row_values(values, tables), values)
        places = bounded_coordinates(entry.unknown.manifold)
        part = target[entry.coordinates].reshape(entry.members, entry.unknown.freedom)
        part[:, places] = numbers.reshape(-1, len(places))[: entry.members]
        target[entry.coordinates] = part.ravel()


def _checked(
    entry: Entry,
    found: Floats,
    values: RowValues,
    fault: Callable[[Span, str, CellKey | None], Diagnostic] = faults.option_not_finite,
) -> Floats:
    """The numbers (members, …) of an option in one row; a ``fault`` where one is NaN."""
    numbers = found.reshape(-1)
    if bool(np.isnan(numbers).any()):
        row = int(np.flatnonzero(np.isnan(found).any(axis=1))[0])
        key = entry.keys[row] if entry.keys is not None else None
        raise MbmError(fault(values.span, entry.unknown.name, key))
    return numbers


def _start(entry: Entry, tables: Mapping[str, Table], starts: Mapping[str, Floats]) -> Floats:
    """The starts of an unknown: those given from outside (NaN: not given), else what the problem says."""
    given = given_numbers(entry, starts.get(entry.unknown.name))  # of a state that does not change, at the first step
    values = stated_values(entry.unknown)
    if values is None or not bool(np.isnan(given).any()):
        return given
    numbers, known = stated_start(entry.unknown, values, tables)
    _checked(entry, np.where(known.any(axis=1, keepdims=True), row_values(values, tables), 0.0), values)
    _checked(entry, np.where(known, numbers, 0.0), values, faults.no_direction)
    return np.where(np.isnan(given), np.where(known, numbers, np.nan)[: entry.members].reshape(-1), given)


def stated_values(unknown: Unknown) -> RowValues | None:
    """What the problem says of the numbers of an unknown before the solve: ``:init``, else ``:at`` of what is fixed."""
    return unknown.at if unknown.start is None else unknown.start


def stated_start(unknown: Unknown, values: RowValues, tables: Mapping[str, Table]) -> tuple[Floats, Mask]:
    """The numbers (members, size) that ``values`` state, and which of them count: ``:at`` is for what is fixed."""
    numbers = numbers_of_stated(unknown.kind, unknown.dimension, row_values(values, tables))
    if values is unknown.start or unknown.fixed is None:
        return numbers, np.ones(numbers.shape, dtype=bool)
    return numbers, held_numbers(unknown.manifold, decided(unknown.fixed, tables))


def given_numbers(entry: Entry, given: Floats | None) -> Floats:
    """The numbers of an unknown (of all its members) that are given from outside, NaN where none is.

    One number stands for all components of plain numbers, one member for all members.

    Raises:
        MbmError: there are too many or too few, or one is not finite.

    """
    unknown = entry.unknown
    if given is None:
        return np.full(entry.count, np.nan)
    numbers = np.asarray(given, dtype=np.float64).reshape(-1)
    if entry.steps is not None and numbers.size % len(entry.steps) == 0:
        numbers = numbers[: numbers.size // len(entry.steps)]
    width = stated_width(unknown.kind, unknown.dimension, unknown.size)
    if unknown.dimension and numbers.size in (width, width * entry.members) and width != unknown.size:
        numbers = numbers_of_stated(unknown.kind, unknown.dimension, numbers.reshape(-1, width)).reshape(-1)
    if numbers.size == 1 and entry.count > 1 and not unknown.dimension:
        numbers = np.repeat(numbers, entry.count)
    if numbers.size == unknown.size and entry.count > unknown.size:
        numbers = np.tile(numbers, entry.members)
    if numbers.size != entry.count:
        message = f"has {numbers.size} numbers; {'one is' if entry.count == 1 else f'{entry.count} are'} wanted"
        raise MbmError(problem_faults.wrong_value(unknown.name, message))
    if bool(np.isinf(numbers).any()):
        raise MbmError(problem_faults.wrong_value(unknown.name, "is not finite"))
    return numbers if unknown.manifold.flat else _on_manifold(unknown, numbers.reshape(-1, unknown.size)).reshape(-1)


def _on_manifold(unknown: Unknown, numbers: Floats) -> Floats:
    """Numbers (members, size) with quaternions and directions of unit length."""
    found = numbers.copy()
    for piece, first, _ in unknown.manifold.spans():
        part = found[:, first : first + piece.size]
        if piece is Piece.SCALE and bool((part <= 0.0).any()):
            raise MbmError(
                problem_faults.wrong_value(
                    unknown.name, "has a scale that is not above 0", "leave it out where it is not known"
                )
            )
        if piece in (Piece.QUATERNION, Piece.SPHERE):
            largest = np.abs(part).max(axis=1, keepdims=True)  # the square of 1e200 is infinite
            part /= np.where(largest > 0.0, largest, 1.0)
            length = np.linalg.norm(part, axis=1, keepdims=True)
            if bool((length == 0.0).any()):
                none, one = ("rotation", "[1, 0, 0, 0]") if piece is Piece.QUATERNION else ("direction", "[0, 0, 1]")
                message, hint = f"is no {none}: its length is 0", f"{one} is one; leave it out where it is not known"
                raise MbmError(problem_faults.wrong_value(unknown.name, message, hint))
            part /= length
    return found


def free_positions(found: Layout, used: Mask) -> Indices:
    """Coordinates to be estimated: not fixed, and not of members that no equation mentions; ``used`` (M,).

    An unknown of which nothing is mentioned stays in: it is unobservable, and the rank decision says so.
    """
    free = ~found.fixed
    for entry in found.entries:
        if entry.keys is not None and bool(used[entry.coordinates].any()):
            mentioned = used[entry.coordinates].reshape(entry.members, entry.unknown.freedom).any(axis=1)
            free[entry.coordinates] &= np.repeat(mentioned, entry.unknown.freedom)
    return np.flatnonzero(free)
