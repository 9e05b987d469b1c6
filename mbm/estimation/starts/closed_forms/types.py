"""What closed forms are given and answer: which numbers are unknown, what equations say of them, and plans."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from hashlib import sha256
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.layout import Entry, Layout, places_in
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.closed_forms.rows import Piece, Rows, thinned
from mbm.problem.types import BlockRole
from mbm.values import dataclass

Table = TypeVar("Table", Indices, Mask)

AGREEMENT = 1e-6
"""How well an equation must agree with what it was recognised as, beside its size."""


class Support(NamedTuple):
    """What a candidate is of: the numbers of its unknowns, and whether it is ``paired``."""

    entries: tuple[int, ...]
    paired: bool = False


def all_of_them(_support: Support) -> bool:
    """Every candidate is wanted."""
    return True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """Unknowns that are determined together, once for each of K members.

    ``places`` (K, s) are the places of their numbers among all, unknown by unknown; ``coordinates`` (K, q) those of
    their coordinates. ``lines`` holds the rows of each group that mention no other unknown number, with their member.
    ``paired``: these are the members of one family, which rows mention two at a time; they have no lines.
    """

    situation: Situation = field(repr=False)
    support: Support
    entries: tuple[Entry, ...] = field(repr=False)
    places: Indices = field(repr=False)
    coordinates: Indices = field(repr=False)
    lines: tuple[tuple[Group, Indices, Indices], ...] = field(repr=False)

    @property
    def paired(self) -> bool:
        """As above."""
        return self.support.paired

    @property
    def names(self) -> tuple[str, ...]:
        """The unknowns."""
        return tuple(entry.unknown.name for entry in self.entries)

    @property
    def members(self) -> int:
        """K."""
        return len(self.places)

    @property
    def coupled(self) -> bool:
        """Members share numbers, so that they can only be determined together."""
        return bool((np.bincount(self.places.ravel()) > 1).any())

    @property
    def flat(self) -> bool:
        """All numbers vary by addition."""
        return all(entry.unknown.manifold.flat for entry in self.entries)

    @property
    def angles(self) -> Mask:
        """Which of the numbers (s,) of flat unknowns are angles."""
        return np.asarray(self.situation.layout.angle[self.coordinates[0]])

    def rows(self, width: int) -> Rows:
        """The equations of ``width`` components; where there are none, rows whose equations together have so many."""
        found = self._rows(width, whole=False)
        return found if len(found) or width == 1 else self._rows(width, whole=True)

    def scalars(self) -> Rows:
        """Every component of every equation as a row of its own."""
        return self._gathered(lambda group: [(i, i + 1) for i in range(group.kernel.outputs)])

    def _rows(self, width: int, *, whole: bool) -> Rows:
        def ranges(group: Group) -> list[tuple[int, int]]:
            every = [(0, group.kernel.outputs)] if whole else [(w.first, w.last) for w in group.whiteners]
            return [(first, last) for first, last in every if last - first == width]

        return self._gathered(ranges, width)

    def _gathered(self, ranges: Callable[[Group], list[tuple[int, int]]], width: int = 1) -> Rows:
        """The rows of the outputs that ``ranges`` names for each group."""
        pieces, members, units, weights = [], [], [], []
        numbers = self.situation.numbers
        role = places_in(self.places, len(numbers))
        columns = places_in(self.coordinates, len(self.situation.layout.number))
        for group, lines, member in self.lines:
            scale = precision(group, lines)
            index = group.index[lines]
            for first, last in ranges(group):
                piece = Piece(
                    group=group,
                    lines=lines,
                    first=first,
                    last=last,
                    inputs=numbers[index],
                    roles=role[index],
                    columns=columns,
                )
                pieces.append(piece)
                members.append(member)
                units.append(group.units[lines, first])
                weights.append(scale[:, first:last].mean(axis=1))
        return Rows(
            columns=columns,
            pieces=tuple(pieces),
            width=width,
            member=np.concatenate(members) if members else np.empty(0, dtype=np.int64),
            unit=np.concatenate(units) if units else np.empty(0, dtype=np.int64),
            weight=np.concatenate(weights) if weights else np.empty(0),
        )


def precision(group: Group, lines: Indices) -> Floats:
    """1/σ² of each output (lines, outputs) of some rows, for weighting among these; correlations are left out."""
    weights = [each.weights[lines] for each in group.whiteners]
    return np.hstack([w**2 if w.ndim == 2 else np.square(w).sum(axis=1) for w in weights])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Situation:
    """The observations of one solve and what is known so far: ``numbers`` (N,), NaN where a value is wanted.

    ``asked`` (N,) is what was known to begin with, before closed forms gave any; ``numbers`` if left out.
    Closed forms are given at most so many rows of a group for each member; all of them if ``most`` is None.
    ``mentioning`` has, for each unknown of the layout, the groups of measured equations that mention it. ``absent`` is
    found when it is asked for: for each group (by number) which of its numbers are missing, as a digest, and of whom.
    """

    layout: Layout
    groups: tuple[Group, ...] = field(repr=False)
    numbers: Floats = field(repr=False)
    asked: Floats = field(default_factory=lambda: np.empty(0), repr=False)
    most: int | None = None
    mentioning: tuple[tuple[Group, ...], ...] = field(default=(), repr=False)
    absent: dict[int, Absent] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if len(self.asked) != len(self.numbers):
            object.__setattr__(self, "asked", self.numbers)
        if not self.mentioning:
            found: list[list[Group]] = [[] for _ in self.layout.entries]
            number_of = self.layout.number_of()
            for group in self.observations():
                for entry in {number_of[slot.unknown] for slot in group.kernel.variables}:
                    found[entry].append(group)
            object.__setattr__(self, "mentioning", tuple(map(tuple, found)))

    @property
    def thins(self) -> bool:
        """Some group has more rows than closed forms are given."""
        return self.most is not None and any(group.rows > self.most for group in self.groups)

    def with_numbers(self, numbers: Floats) -> Situation:
        """The same with other knowledge."""
        changed = self._entries_of(np.isnan(numbers) != np.isnan(self.numbers))
        stale = {group.number for entry in changed for group in self.mentioning[entry]}
        kept = {number: known for number, known in self.absent.items() if number not in stale}
        return replace(self, numbers=numbers, absent=kept)

    def candidates(self, wanted: Callable[[Support], bool] = all_of_them) -> Iterator[Candidate]:
        """What may be determined on its own: what single rows mention, the fewest numbers first; then all together.

        Asked for one after the other; only what is ``wanted`` by then is made.
        """
        missing = np.isnan(self.numbers)
        lacking = self._entries_of(missing)
        found: dict[tuple[int, ...], list[Indices]] = {}
        for group in self.observations():
            for entries, members in self._absent_of(group).supports:
                found.setdefault(entries, []).append(members)
        size = {key: sum(self.layout.entries[e].unknown.size for e in key) for key in found}
        for key in sorted(found, key=lambda k: (size[k], k)):
            candidate = self.candidate(key, _distinct(np.concatenate(found[key]))) if wanted(Support(key)) else None
            if candidate is not None:
                yield candidate
        for number in lacking:
            entry = self.layout.entries[number]
            if not entry.unknown.dimension or entry.members <= 1:
                continue
            absent = np.flatnonzero(missing[entry.range].reshape(entry.members, entry.unknown.size).all(axis=1))
            paired = Support((number,), paired=True)
            candidate = self.candidate((number,), absent[:, None]) if len(absent) and wanted(paired) else None
            if candidate is not None:
                yield replace(candidate, lines=(), support=paired)
        whole = self._together(lacking)
        if whole is not None and whole not in found and wanted(Support(whole)):
            candidate = self.candidate(whole, np.zeros((1, len(whole)), dtype=np.int64))
            if candidate is not None:
                yield candidate

    def candidate(self, entries: tuple[int, ...], members: Indices) -> Candidate | None:
        """The candidate of ``entries`` (numbers of unknowns) for the members (K, entries) of each.

        None if these miss different numbers.
        """
        owners = tuple(self.layout.entries[e] for e in entries)
        places, coordinates = [], []
        for column, entry in zip(members.T, owners, strict=True):
            unknown = entry.unknown
            first = entry.offset + int(column[0]) * unknown.size
            absent = np.flatnonzero(np.isnan(self.numbers[first : first + unknown.size]))
            if len(absent) < unknown.size and not unknown.manifold.flat:
                absent = np.flatnonzero(np.isnan(self.numbers[first : first + unknown.size]) | self._idle(entry, first))
                if len(absent) < unknown.size:
                    return None
            free = absent if unknown.manifold.flat else np.arange(unknown.freedom)
            places.append(entry.offset + column[:, None] * unknown.size + absent)
            coordinates.append(entry.first + column[:, None] * unknown.freedom + free)
        every = np.hstack(places)
        open_ones = np.isnan(self.numbers[every])
        if not bool((open_ones == open_ones[0]).all() and open_ones.any(axis=1).all()):
            return None
        lines = tuple(self._lines(entries, every))
        return Candidate(
            situation=self,
            support=Support(entries),
            entries=owners,
            places=every,
            coordinates=np.hstack(coordinates),
            lines=lines,
        )

    def _idle(self, entry: Entry, first: int) -> Mask:
        """Which numbers of the member of an unknown that begins at ``first`` no equation mentions: a depth."""
        places = first + np.arange(entry.unknown.size)
        groups = self.mentioning[self.layout.entries.index(entry)]
        used = np.concatenate([np.unique(group.index) for group in groups])
        return np.asarray(~np.isin(places, used))

    def absences(self, support: Support) -> bytes:
        """Which numbers are missing in the equations that mention the unknowns of a candidate, as a digest."""
        groups = {group.number: group for entry in support.entries for group in self.mentioning[entry]}
        return sha256(b"".join(self._absent_of(groups[number]).digest for number in sorted(groups))).digest()

    def _absent_of(self, group: Group) -> Absent:
        """What the rows of a group miss."""
        found = self.absent.get(group.number)
        if found is None:
            pattern = np.isnan(self.numbers)[group.index]
            digest = sha256(np.packbits(pattern).tobytes()).digest()
            supports = tuple(_supports(group, pattern, self.layout, self.layout.number_of()))
            found = self.absent[group.number] = Absent(digest=digest, supports=supports)
        return found

    def observations(self) -> tuple[Group, ...]:
        """Groups of measured equations; priors take no part in starts."""
        return tuple(g for g in self.groups if g.role is BlockRole.OBSERVATION and g.rows)

    def _lines(self, entries: tuple[int, ...], places: Indices) -> Iterator[tuple[Group, Indices, Indices]]:
        """Rows of each group whose unknown numbers are all of one member, or of all of them, and that member."""
        groups = {group.number: group for entry in entries for group in self.mentioning[entry]}
        owner = np.full(len(self.numbers), -1, dtype=np.int64)
        owner[places] = np.arange(len(places))[:, None]
        if len(places) > 1:
            found, times = np.unique(places, return_counts=True)
            owner[found[times > 1]] = -2
        missing = np.isnan(self.numbers)
        for number in sorted(groups):
            group = groups[number]
            absent = missing[group.index]
            owners = np.where(absent, owner[group.index], -2)
            highest = owners.max(axis=1, initial=-2)
            same = ((owners == -2) | (owners == highest[:, None])).all(axis=1) & (highest >= 0)
            rows = np.flatnonzero(same)
            if len(rows):
                kept = rows if self.most is None else rows[thinned(highest[rows], self.most)]
                yield group, kept, highest[kept]

    def _together(self, lacking: Sequence[int]) -> tuple[int, ...] | None:
        """All unknowns that have missing numbers, if none of them is a family."""
        families = any(self.layout.entries[i].members != 1 for i in lacking)
        return None if families or not lacking else tuple(lacking)

    def _entries_of(self, places: Mask) -> list[int]:
        """The unknowns that have numbers at some ``places`` (N,), ascending."""
        offsets = np.array([entry.offset for entry in self.layout.entries], dtype=np.int64)
        found = np.searchsorted(offsets, np.flatnonzero(places), side="right") - 1
        return np.flatnonzero(np.bincount(found)).tolist()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Absent:
    """Which numbers the rows of a group miss, as a digest; ``supports`` as `_supports` says."""

    digest: bytes
    supports: tuple[tuple[tuple[int, ...], Indices], ...] = field(repr=False)


def _supports(
    group: Group, absent: Mask, layout: Layout, number_of: Mapping[str, int]
) -> Iterator[tuple[tuple[int, ...], Indices]]:
    """The unknowns (by number) that rows of a group miss values of, with the members (K, unknowns) they do it for.

    ``absent`` (rows, variables) says where.
    """
    owners = [number_of[slot.unknown] for slot in group.kernel.variables]
    for pattern in _distinct(absent):
        if not bool(pattern.any()):
            continue
        rows = np.flatnonzero((absent == pattern).all(axis=1))
        entries = tuple(sorted({owners[j] for j in np.flatnonzero(pattern)}))
        members = []
        for e in entries:
            entry = layout.entries[e]
            slots = [j for j in np.flatnonzero(pattern) if owners[j] == e]
            each = (group.index[np.ix_(rows, slots)] - entry.offset) // entry.unknown.size
            if bool((each != each[:, :1]).any()):
                break
            members.append(each[:, 0])
        else:
            yield entries, _distinct(np.stack(members, axis=1))


def _distinct(lines: Table) -> Table:
    """The lines (n, k) of a table that differ, in ascending order; n ≥ 1."""
    if bool((lines == lines[0]).all()):
        return lines[:1]
    ordered: Table = lines[np.lexsort(lines.T[::-1])]
    kept: Table = ordered[np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))]
    return kept


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """A closed form that fits some unknowns: the rows that it uses, and what it found out about them.

    ``minimal`` rows determine the unknowns up to a few solutions. ``data`` is the form's own, with one entry for each
    of ``rows``; members of a family share the plan, and each has its own rows (``rows.member``).
    """

    form: ClosedForm
    candidate: Candidate
    rows: Rows
    minimal: int
    data: Any = field(repr=False)

    @property
    def description(self) -> str:
        """For people: the form and what it gives."""
        return f"{self.form.name}: {', '.join(self.candidate.names)}"

    def solved(self, subsets: Indices) -> Floats:
        """What the form's ``solve`` answers; NaN for subsets of which it meets a singular matrix."""
        try:
            return self.form.solve(self, subsets)
        except np.linalg.LinAlgError:
            if len(subsets) == 1:
                places = self.candidate.places
                return np.full((1, 1, places.size if self.form.joint else places.shape[1]), np.nan)
        each = [self.solved(subset[None])[0] for subset in subsets]
        most = max(map(len, each))
        return np.stack([np.pad(one, ((0, most - len(one)), (0, 0)), constant_values=np.nan) for one in each])


class ClosedForm(Protocol):
    """A method that computes unknowns directly where the equations are of its kind."""

    @property
    def name(self) -> str:
        """As in ``(solve :method NAME)`` and in ``mbm explain``."""
        ...

    @property
    def joint(self) -> bool:
        """It solves all members of a candidate together, and may be given members that share numbers.

        ``solve`` then answers for all: shape (T, S, K·s), member by member.
        """
        ...

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """How to compute the candidate's numbers, or None if its equations are of another kind."""
        ...

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """The numbers that follow from each of T subsets of k rows of the plan, with up to S solutions each.

        ``subsets`` (T, k) indexes the plan's rows, k ≥ ``minimal``; rows of one subset belong to one member. The answer
        has shape (T, S, s), s as ``candidate.places`` has it; NaN where there is no solution.
        """
        ...
