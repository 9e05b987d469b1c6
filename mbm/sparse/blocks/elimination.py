"""Schur elimination member by member: inverse roots of the diagonal blocks, couplings, the reduced matrix.

Notation as in `mbm.sparse.normal`: ``A = L Lᵀ`` the diagonal blocks of the family that goes, ``W`` its
coupling to the rest, ``Y = L⁻¹ W``, and ``S = B - YᵀY`` what the rest obeys. The couplings of member m stand together
as a panel (SIZE, lengths[m]) at ``bases[m]`` of ``y``; *link* l is the part of a panel that belongs to one block of the
rest, at ``places[l]`` (first row of the panel), ``wides[l]`` columns that are columns ``columns[l] …`` of the rest.
The links of member m are ``begins[m] … begins[m + 1]``, ascending in their columns.
"""

from __future__ import annotations

from math import isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Reals, distinct_arrays
from mbm.sparse.blocks.parts import SIZE, Cross, Entries, Links, Rest

WIDE = 8
"""Columns of a product that are worked on side by side."""


@distinct_arrays
def inverse_roots(first: Integer, last: Integer, blocks: ConstantReals, added: ConstantReals, roots: Reals) -> Integer:
    """``roots[m] = L⁻¹`` where ``L Lᵀ = blocks[m] + diag(added[m])``, for the members ``first … last``.

    ``blocks``, ``roots`` (members, SIZE, SIZE), the upper triangles of the latter left alone; ``added`` (members,
    SIZE). Returns the number (from 1) of the first member that is not positive definite, else 0.
    """
    for m in range(first, last):
        block = blocks[m * (SIZE * SIZE) :]
        root = roots[m * (SIZE * SIZE) :]
        for j in range(SIZE):
            total = block[j * SIZE + j] + added[m * SIZE + j]
            for k in range(j):
                total -= root[j * SIZE + k] * root[j * SIZE + k]
            if not (total > 0.0) or not isfinite(total):
                return m + 1
            root[j * SIZE + j] = sqrt(total)
            for i in range(j + 1, SIZE):
                value = block[i * SIZE + j]
                for k in range(j):
                    value -= root[i * SIZE + k] * root[j * SIZE + k]
                root[i * SIZE + j] = value / root[j * SIZE + j]
        for j in range(SIZE):
            root[j * SIZE + j] = 1.0 / root[j * SIZE + j]
            for i in range(j + 1, SIZE):
                value = 0.0
                for k in range(j, i):
                    value -= root[i * SIZE + k] * root[k * SIZE + j]
                root[i * SIZE + j] = value / root[i * SIZE + i]
    return 0


@distinct_arrays
def put_couplings(first: Integer, last: Integer, cross: Cross, roots: ConstantReals, y: Reals) -> None:
    """``Y = L⁻¹ W`` of the blocks ``first … last`` between the family and another one."""
    wide = cross.wide
    along = cross.along
    across = cross.across
    for p in range(first, last):
        m = cross.members[p]
        length = cross.lengths[m]
        root = roots[m * (SIZE * SIZE) :]
        block = cross.blocks[p * (SIZE * wide) :]
        panel = y[cross.targets[p] :]
        for k in range(SIZE):
            for c in range(wide):
                total = 0.0
                for e in range(k + 1):
                    total += root[k * SIZE + e] * block[e * along + c * across]
                panel[k * length + c] = total


@distinct_arrays
def subtract_three(
    wide: Integer, length: Integer, left: ConstantReals, right: ConstantReals, stride: Integer, target: Reals
) -> None:
    """``target -= leftᵀ right`` for three columns of ``left``."""
    for b in range(wide):
        first = 0.0
        second = 0.0
        third = 0.0
        for k in range(SIZE):
            factor = right[k * length + b]
            first += left[k * length] * factor
            second += left[k * length + 1] * factor
            third += left[k * length + 2] * factor
        target[b] -= first
        target[stride + b] -= second
        target[2 * stride + b] -= third


@distinct_arrays
def subtract_one(wide: Integer, length: Integer, left: ConstantReals, right: ConstantReals, target: Reals) -> None:
    """``target -= leftᵀ right`` for one column of ``left``."""
    for b in range(wide):
        total = 0.0
        for k in range(SIZE):
            total += left[k * length] * right[k * length + b]
        target[b] -= total


@distinct_arrays
def subtract_product(
    high: Integer,
    wide: Integer,
    length: Integer,
    left: ConstantReals,
    right: ConstantReals,
    stride: Integer,
    target: Reals,
) -> None:
    """``target -= leftᵀ right``: (SIZE, high) and (SIZE, wide), rows ``length`` apart; those of target ``stride``."""
    a = 0
    while a + 3 <= high:
        b = 0
        while b + WIDE <= wide:
            subtract_three(WIDE, length, left[a:], right[b:], stride, target[a * stride + b :])
            b += WIDE
        subtract_three(wide - b, length, left[a:], right[b:], stride, target[a * stride + b :])
        a += 3
    while a < high:
        b = 0
        while b + WIDE <= wide:
            subtract_one(WIDE, length, left[a:], right[b:], target[a * stride + b :])
            b += WIDE
        subtract_one(wide - b, length, left[a:], right[b:], target[a * stride + b :])
        a += 1


@distinct_arrays
def subtract_links(
    link: Integer, end: Integer, wide: Integer, length: Integer, links: Links, stride: Integer, line: Reals
) -> None:
    """``line -= YᵀY`` of one member, for the block row of its link ``link``, ``wide`` columns wide, from there on.

    ``end`` is the first link of the next member, ``length`` the panel's; rows of ``line`` are ``stride`` apart. Links
    to blocks that stand side by side are worked on together.
    """
    own = links.y[links.places[link] :]
    j = link
    while j < end:
        column = links.columns[j]
        place = links.places[j]
        many = links.wides[j]
        j += 1
        while j < end and links.columns[j] == column + many:
            many += links.wides[j]
            j += 1
        subtract_product(wide, many, length, own, links.y[place:], stride, line[column:])


@distinct_arrays
def reduce_members(first: Integer, last: Integer, links: Links, width: Integer, matrix: Reals) -> None:
    """``matrix -= YᵀY`` for the members ``first … last``, block upper triangle: for a small matrix (width, width)."""
    for m in range(first, last):
        end = links.begins[m + 1]
        for link in range(links.begins[m], end):
            line = matrix[links.columns[link] * width :]
            subtract_links(link, end, links.wides[link], links.lengths[m], links, width, line)


@distinct_arrays
def subtract_line(i: Integer, rest: Rest, links: Links, line: Reals) -> None:
    """``line -= (YᵀY)ᵢ``: the block row i of the rest, from its diagonal on; ``line`` has rows of its width."""
    for t in range(rest.starts[i], rest.starts[i + 1]):
        link = rest.links[t]
        m = rest.members[link]
        subtract_links(link, links.begins[m + 1], rest.sizes[i], links.lengths[m], links, rest.width, line)


@distinct_arrays
def reduce_blocks(first: Integer, last: Integer, rest: Rest, links: Links, matrix: Reals) -> None:
    """The same for the block rows ``first … last`` and a large matrix."""
    for i in range(first, last):
        subtract_line(i, rest, links, matrix[rest.heads[i] * rest.width :])


@distinct_arrays
def reduce_sparse(
    first: Integer, last: Integer, rest: Rest, links: Links, pattern: Entries, entries: Reals, line: Reals
) -> None:
    """``entries -= YᵀY`` for the block rows ``first … last`` of a sparse matrix, from the diagonal on.

    ``line`` is scratch for the widest block row, (rows, width), zero before and after.
    """
    width = rest.width
    for i in range(first, last):
        subtract_line(i, rest, links, line)
        for a in range(rest.sizes[i]):
            row = rest.heads[i] + a
            for e in range(pattern.pointers[row], pattern.pointers[row + 1]):
                entries[e] += line[a * width + pattern.indices[e]]
            for e in range(pattern.pointers[row], pattern.pointers[row + 1]):
                line[a * width + pattern.indices[e]] = 0.0
            for b in range(a):
                line[a * width + rest.heads[i] + b] = 0.0
