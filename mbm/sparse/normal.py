"""Jacobian → normal equations in blocks: ``JᵀJ`` by pairs of families, its pattern found once."""

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
    """The nonzero blocks between two families (``left`` ≤ ``right``): block p is at members ``(i[p], j[p])``.

    ``members`` are those of the two families. Sorted by the members of the larger family, then by those of the other:
    so are equations, most often. Within one family only blocks with i ≤ j are kept.
    """

    left: int
    right: int
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
    return PairPattern(
        left=key[0], right=key[1], i=i, j=j, members=members, shape=shape, contributions=tuple(contributions)
    )


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
