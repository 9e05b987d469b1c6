"""Jacobian → normal equations in blocks, and Schur elimination of a family of which no two members meet."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.sparse.structure import Piece, Structure, distinct, firsts
from mbm.values import dataclass

FEW = 20_000
"""Numbers of all blocks of a pair up to which each part of the rows has sums of its own (160 kB, in the cache)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contribution:
    """Products ``J_leftᵀ J_right`` of rows of one piece, from their columns ``left …`` and ``right …`` on.

    They are in the order in which they are made, so that the rows are read as they stand in memory: those for target
    ``targets[t]`` are ``rows[starts[t]:starts[t + 1]]``. ``apart``: a target comes more than once, so that what works
    on other parts of this at the same time needs sums of its own. ``mirrored`` adds the transpose as well: two
    different local blocks that are the same member.
    """

    piece: int
    left: int
    right: int
    rows: Indices
    starts: Indices
    targets: Indices
    apart: bool
    mirrored: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairPattern:
    """The nonzero blocks between two families, the first no later than the second: block p is at
    members ``(i[p], j[p])``.

    ``members`` are those of the two families. Sorted by the members of the larger family, then by those of the other:
    so are equations, most often. Within one family only blocks with i ≤ j are kept.
    """

    i: Indices
    j: Indices
    members: tuple[int, int]
    shape: tuple[int, int]
    contributions: tuple[Contribution, ...]

    def places(self, i: Indices, j: Indices) -> Indices:
        """The blocks at members i and j."""
        return np.asarray(np.searchsorted(_codes(self.i, self.j, self.members), _codes(i, j, self.members)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NormalPattern:
    """The pattern of ``JᵀJ``; every family has all its diagonal blocks, ``diagonal[f]`` (members,) says where."""

    structure: Structure
    pairs: Mapping[tuple[int, int], PairPattern]
    diagonal: tuple[Indices, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Normal:
    """``JᵀJ``: for each pair of families the blocks (blocks, size, size) in the order of its pattern."""

    pattern: NormalPattern
    blocks: Mapping[tuple[int, int], Floats]

    def diagonal(self) -> Floats:
        """The diagonal (columns,): squared norms of the Jacobian's columns."""
        found = [
            np.einsum("bii->bi", self.blocks[f, f][where]).reshape(-1) for f, where in enumerate(self.pattern.diagonal)
        ]
        return np.concatenate(found) if found else np.zeros(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Meeting:
    """Rows of a piece where the members ``i`` of the left and ``j`` of the right block meet."""

    piece: int
    left: int
    right: int
    rows: Indices
    i: Indices
    j: Indices
    mirrored: bool = False


def normal_pattern(found: Structure) -> NormalPattern:
    """Which members of which families meet in an equation, and where each product goes."""
    meetings: dict[tuple[int, int], list[_Meeting]] = {(f, f): [] for f in range(len(found.families))}
    for number, piece in enumerate(found.pieces):
        for left in range(len(piece.families)):
            for right in range(left, len(piece.families)):
                for key, meeting in _meetings(number, piece, left, right):
                    meetings.setdefault(key, []).append(meeting)
    pairs = {key: _pair(found, key, each) for key, each in meetings.items()}
    diagonal = tuple(np.flatnonzero(pairs[f, f].i == pairs[f, f].j) for f in range(len(found.families)))
    return NormalPattern(structure=found, pairs=pairs, diagonal=diagonal)


def _meetings(number: int, piece: Piece, left: int, right: int) -> list[tuple[tuple[int, int], _Meeting]]:
    """The meetings of two local blocks, each with its pair of families; the smaller number to the left."""
    if piece.families[left] > piece.families[right]:
        left, right = right, left
    key = (piece.families[left], piece.families[right])
    i, j = piece.members[left], piece.members[right]
    every = np.arange(piece.rows)
    if left == right or key[0] != key[1]:
        return [(key, _Meeting(piece=number, left=left, right=right, rows=every, i=i, j=j))]
    found = []
    for a, b, chosen, mirrored in (
        (left, right, i < j, False),
        (right, left, i > j, False),
        (left, right, i == j, True),
    ):
        rows = every[chosen]
        if rows.size:
            ends = (piece.members[a][rows], piece.members[b][rows])
            meeting = _Meeting(piece=number, left=a, right=b, rows=rows, i=ends[0], j=ends[1], mirrored=mirrored)
            found.append((key, meeting))
    return found


def _pair(found: Structure, key: tuple[int, int], meetings: list[_Meeting]) -> PairPattern:
    left, right = found.families[key[0]], found.families[key[1]]
    members = (left.members, right.members)
    codes = [_codes(m.i, m.j, members) for m in meetings]
    if key[0] == key[1]:
        codes.append(np.arange(left.members) * (right.members + 1))
    unique = distinct(np.concatenate(codes))
    shape = (left.size, right.size)
    contributions = []
    for meeting, code in zip(meetings, codes, strict=False):
        if not code.size:
            continue
        piece = found.pieces[meeting.piece]
        rows, starts, targets, apart = _ordered(meeting.rows, np.searchsorted(unique, code), len(unique) * prod(shape))
        contributions.append(
            Contribution(
                piece=meeting.piece,
                left=piece.starts[meeting.left],
                right=piece.starts[meeting.right],
                rows=rows,
                starts=starts,
                targets=targets,
                apart=apart,
                mirrored=meeting.mirrored,
            )
        )
    i, j = np.divmod(unique, left.members)[::-1] if _turned(members) else np.divmod(unique, right.members)
    return PairPattern(i=i, j=j, members=members, shape=shape, contributions=tuple(contributions))


def _ordered(rows: Indices, targets: Indices, numbers: int) -> tuple[Indices, Indices, Indices, bool]:
    """``rows``, ``starts``, ``targets`` and ``apart`` of a contribution to blocks of so many ``numbers``.

    Where they are few, row by row. Else by the first row of each target, if targets have few rows: blocks that are
    written here and there are waited for less than rows that are read here and there.
    """
    order = np.argsort(targets, kind="stable")
    begins = firsts(targets[order])
    if numbers <= FEW and len(rows) > len(begins):
        return rows, np.arange(len(rows) + 1), targets, True
    counts = np.diff(begins, append=len(order))
    sequence = np.argsort(rows[order[begins]], kind="stable")
    starts = np.append(0, np.cumsum(counts[sequence]))
    places = np.arange(len(order)) + np.repeat(begins[sequence] - starts[:-1], counts[sequence])
    return rows[order[places]], starts, targets[order[begins[sequence]]], False


def _turned(members: tuple[int, int]) -> bool:
    """Whether blocks between families with so many members are sorted by those of the second first."""
    return members[1] > members[0]


def _codes(i: Indices, j: Indices, members: tuple[int, int]) -> Indices:
    """Numbers by which blocks at the members i and j are sorted."""
    return j * members[0] + i if _turned(members) else i * members[1] + j


WORTH = 8
"""A family is eliminated if it has at least so many members …"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cross:
    """The blocks between the eliminated family and another one; ``i`` are the members of the eliminated one.

    ``flipped``: their rows are the other family's. ``places``: where the first row of each stands in ``Y``.
    """

    pair: tuple[int, int]
    flipped: bool
    i: Indices
    shape: tuple[int, int]
    places: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Links:
    """All links, by member, then by column.

    Those of member m are ``begins[m] … begins[m + 1]``, its panel has ``lengths[m]`` columns. Link l is of member
    ``members[l]`` and has ``wides[l]`` columns, from the column ``columns[l]`` of the rest on; its first row is at
    ``places[l]``. Block i of the rest has its first column at ``heads[i]``, is ``sizes[i]`` wide, and has the links
    ``order[starts[i]:starts[i + 1]]``.
    """

    begins: Indices
    lengths: Indices
    members: Indices
    columns: Indices
    wides: Indices
    places: Indices
    heads: Indices
    sizes: Indices
    starts: Indices
    order: Indices

    @property
    def blocks(self) -> Indices:
        """The block of the rest (links,) of each link."""
        return np.asarray(np.searchsorted(self.heads, self.columns))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Elimination:
    """``family``, with members of ``size`` columns, goes.

    ``rest`` (columns,) gives the place of each padded column among the ``width`` others, -1 in the family; ``Y`` has
    ``numbers`` numbers.
    """

    family: int
    size: int
    crosses: tuple[Cross, ...]
    rest: Indices
    width: int
    links: Links
    numbers: int

    def coupled(self) -> tuple[Indices, Indices]:
        """The blocks (i ≤ j) of the rest that ``YᵀY`` fills."""
        from scipy.sparse import csr_array, triu

        links = self.links
        shape = (len(links.begins) - 1, len(links.heads))
        ones = csr_array((np.ones(len(links.columns)), links.blocks, links.begins), shape=shape)
        found = triu(ones.T @ ones).tocoo()
        return found.row.astype(np.int64), found.col.astype(np.int64)


def eliminable(pattern: NormalPattern) -> int | None:
    """The largest family of which no two members meet; None where it is not worth while.

    It should outweigh the rest of the unknowns: else the order of elimination in sparse Cholesky does as well.
    """
    families = pattern.structure.families
    best, size = None, 0
    for number, family in enumerate(families):
        pair = pattern.pairs[number, number]
        if len(pair.i) == family.members and family.members >= WORTH and family.members * family.size > size:
            best, size = number, family.members * family.size
    return best if 2 * size >= pattern.structure.columns else None


def elimination(pattern: NormalPattern, family: int) -> Elimination:
    """The places of everything once ``family`` is gone."""
    families = pattern.structure.families
    gone = families[family]
    rest = np.full(pattern.structure.columns, -1, dtype=np.int64)
    kept = np.ones(len(rest), dtype=bool)
    kept[gone.columns] = False
    width = int(kept.sum())
    rest[kept] = np.arange(width)
    found = []
    for (left, right), pair in pattern.pairs.items():
        if left == right or family not in (left, right) or not len(pair.i):
            continue
        flipped = right == family
        ends = (pair.j, pair.i) if flipped else (pair.i, pair.j)
        found.append(((left, right), flipped, *ends, families[left if flipped else right]))
    none = np.zeros(0, dtype=np.int64)
    members = np.concatenate([none, *(i for _, _, i, _, _ in found)])
    columns = np.concatenate([none, *(rest[other.first] + j * other.size for _, _, _, j, other in found)])
    wides = np.concatenate([none, *(np.full(len(j), other.size) for _, _, _, j, other in found)])
    others = [f for n, f in enumerate(families) if n != family]
    heads = np.concatenate([none, *(rest[f.first] + np.arange(f.members) * f.size for f in others)])
    sizes = np.concatenate([none, *(np.full(f.members, f.size) for f in others)])
    links, places = _links(gone.members, gone.size, (members, columns, wides), heads, sizes, width)
    crosses, reached = [], 0
    for key, flipped, i, _, other in found:
        own = places[reached : reached + len(i)]
        crosses.append(Cross(pair=key, flipped=flipped, i=i, shape=(gone.size, other.size), places=own))
        reached += len(i)
    return Elimination(
        family=family,
        size=gone.size,
        crosses=tuple(crosses),
        rest=rest,
        width=width,
        links=links,
        numbers=gone.size * int(wides.sum()),
    )


def _links(
    count: int, size: int, given: tuple[Indices, Indices, Indices], heads: Indices, sizes: Indices, width: int
) -> tuple[Links, Indices]:
    """The links from members, columns and widths in any order, and the place in ``Y`` of each in the order given."""
    order = np.argsort(given[0] * max(width, 1) + given[1], kind="stable")
    members, columns, wides = (each[order] for each in given)
    begins = np.searchsorted(members, np.arange(count + 1))
    ends = np.concatenate([[0], np.cumsum(wides)])
    lengths = np.diff(ends[begins])
    places = size * ends[begins[members]] + ends[:-1] - ends[begins[members]]
    blocks = np.searchsorted(heads, columns)
    by_block = np.argsort(blocks, kind="stable")
    links = Links(
        begins=begins,
        lengths=lengths,
        members=members,
        columns=columns,
        wides=wides,
        places=places,
        heads=heads,
        sizes=sizes,
        starts=np.searchsorted(blocks[by_block], np.arange(len(heads) + 1)),
        order=by_block,
    )
    given_places = np.empty_like(places)
    given_places[order] = places
    return links, given_places
