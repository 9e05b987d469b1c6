"""After the elimination: right sides carried to the rest and solutions back, and the inverse at the couplings.

Links, panels and the other names are those of `mbm.sparse.blocks.elimination`.
"""

from __future__ import annotations

from mbm.machine.words import ConstantReals, Integer, Reals, distinct_arrays
from mbm.sparse.blocks.parts import SIZE, Entries, Links, Rest

WIDE = 4
"""Columns of a link that are worked on side by side."""


@distinct_arrays
def solve_triangular(count: Integer, lower: ConstantReals, right: Reals) -> None:
    """``right = (L Lᵀ)⁻¹ right`` for a lower triangle (count, count) and one right side."""
    for i in range(count):
        total = right[i]
        for j in range(i):
            total -= lower[i * count + j] * right[j]
        right[i] = total / lower[i * count + i]
    for i in range(count):
        k = count - 1 - i
        value = right[k] / lower[k * count + k]
        right[k] = value
        for j in range(k):
            right[j] -= lower[k * count + j] * value


@distinct_arrays
def put_rooted(
    first: Integer,
    last: Integer,
    transposed: Integer,
    roots: ConstantReals,
    sides: Integer,
    right: ConstantReals,
    result: Reals,
) -> None:
    """``R right``, or ``Rᵀ right``, (members · SIZE, sides), with the lower triangles R of ``first … last``."""
    for m in range(first, last):
        own = m * (SIZE * SIZE)
        source = m * SIZE * sides
        for k in range(SIZE):
            for q in range(sides):
                total = 0.0
                if transposed:
                    for e in range(k, SIZE):
                        total += roots[own + e * SIZE + k] * right[source + e * sides + q]
                else:
                    for e in range(k + 1):
                        total += roots[own + k * SIZE + e] * right[source + e * sides + q]
                result[source + k * sides + q] = total


@distinct_arrays
def add_coupled(
    first: Integer,
    last: Integer,
    transposed: Integer,
    links: Links,
    sides: Integer,
    given: ConstantReals,
    result: Reals,
) -> None:
    """``result += Y given``, or ``Yᵀ given``, for the members ``first … last``.

    The rest has (width, sides) numbers, the members have (members · SIZE, sides).
    """
    y = links.y
    for m in range(first, last):
        own = m * SIZE * sides
        length = links.lengths[m]
        for link in range(links.begins[m], links.begins[m + 1]):
            for c in range(links.wides[link]):
                across = (links.columns[link] + c) * sides
                place = links.places[link] + c
                for q in range(sides):
                    if transposed:
                        total = 0.0
                        for k in range(SIZE):
                            total += y[place + k * length] * given[own + k * sides + q]
                        result[across + q] += total
                    else:
                        value = given[across + q]
                        for k in range(SIZE):
                            result[own + k * sides + q] += y[place + k * length] * value


@distinct_arrays
def carry(wide: Integer, length: Integer, panel: ConstantReals, inner: ConstantReals, rest: Reals) -> None:
    """``rest += panelᵀ inner`` for (SIZE, wide), rows ``length`` apart."""
    for c in range(wide):
        total = 0.0
        for k in range(SIZE):
            total += panel[k * length + c] * inner[k]
        rest[c] += total


@distinct_arrays
def bring_back(wide: Integer, length: Integer, panel: ConstantReals, rest: ConstantReals, inner: Reals) -> None:
    """``inner += panel rest`` for (SIZE, wide), rows ``length`` apart."""
    for k in range(SIZE):
        total = 0.0
        for c in range(wide):
            total += panel[k * length + c] * rest[c]
        inner[k] += total


@distinct_arrays
def add_coupled_once(
    first: Integer,
    last: Integer,
    transposed: Integer,
    links: Links,
    given: ConstantReals,
    result: Reals,
) -> None:
    """`add_coupled` with one right side, as every step has it."""
    y = links.y
    for m in range(first, last):
        length = links.lengths[m]
        for link in range(links.begins[m], links.begins[m + 1]):
            column = links.columns[link]
            place = links.places[link]
            wide = links.wides[link]
            c = 0
            if transposed:
                while c + WIDE <= wide:
                    carry(WIDE, length, y[place + c :], given[m * SIZE :], result[column + c :])
                    c += WIDE
                carry(wide - c, length, y[place + c :], given[m * SIZE :], result[column + c :])
            else:
                while c + WIDE <= wide:
                    bring_back(WIDE, length, y[place + c :], given[column + c :], result[m * SIZE :])
                    c += WIDE
                bring_back(wide - c, length, y[place + c :], given[column + c :], result[m * SIZE :])


@distinct_arrays
def put_between(root: ConstantReals, inner: ConstantReals, diagonal: Reals) -> None:
    """``Rᵀ inner R`` of one member, with the lower triangle R."""
    for k in range(SIZE):
        for e in range(SIZE):
            total = 0.0
            for a in range(k, SIZE):
                for b in range(e, SIZE):
                    total += root[a * SIZE + k] * inner[a * SIZE + b] * root[b * SIZE + e]
            diagonal[k * SIZE + e] = total


@distinct_arrays
def put_images(i: Integer, rest: Rest, links: Links, line: ConstantReals, images: Reals) -> None:
    """``Y Z`` at the links of the block row i of the rest; ``images`` are panels as ``y`` is.

    ``line`` is that block row of the symmetric ``Z``, (size, width).
    """
    y = links.y
    for t in range(rest.starts[i], rest.starts[i + 1]):
        link = rest.links[t]
        m = rest.members[link]
        length = links.lengths[m]
        for a in range(rest.sizes[i]):
            for k in range(SIZE):
                total = 0.0
                for j in range(links.begins[m], links.begins[m + 1]):
                    place = links.places[j] + k * length
                    column = a * rest.width + links.columns[j]
                    for b in range(links.wides[j]):
                        total += y[place + b] * line[column + b]
                images[links.places[link] + k * length + a] = total


@distinct_arrays
def images_dense(
    first: Integer, last: Integer, rest: Rest, links: Links, inverse: ConstantReals, images: Reals
) -> None:
    """``Y Z`` at the links of the block rows ``first … last``, where ``inverse`` is all of ``Z`` (width, width)."""
    for i in range(first, last):
        put_images(i, rest, links, inverse[rest.heads[i] * rest.width :], images)


@distinct_arrays
def images_sparse(
    first: Integer,
    last: Integer,
    rest: Rest,
    links: Links,
    pattern: Entries,
    inverse: ConstantReals,
    images: Reals,
    line: Reals,
) -> None:
    """The same where ``Z`` is known at entries alone, both triangles.

    ``line`` is scratch for the widest block row, (rows, width), zero before and after.
    """
    width = rest.width
    for i in range(first, last):
        for a in range(rest.sizes[i]):
            for e in range(pattern.pointers[rest.heads[i] + a], pattern.pointers[rest.heads[i] + a + 1]):
                line[a * width + pattern.indices[e]] = inverse[e]
        put_images(i, rest, links, line, images)
        for a in range(rest.sizes[i]):
            for e in range(pattern.pointers[rest.heads[i] + a], pattern.pointers[rest.heads[i] + a + 1]):
                line[a * width + pattern.indices[e]] = 0.0


@distinct_arrays
def put_diagonals(
    first: Integer,
    last: Integer,
    links: Links,
    width: Integer,
    inverse: ConstantReals,
    roots: ConstantReals,
    inner: Reals,
    diagonal: Reals,
) -> None:
    """``diagonal`` as `put_inverse_blocks` has it, where ``inverse`` is all of ``Z`` (width, width): without panels."""
    y = links.y
    for m in range(first, last):
        own = inner[m * (SIZE * SIZE) :]
        length = links.lengths[m]
        for k in range(SIZE):
            for e in range(SIZE):
                own[k * SIZE + e] = 0.0
            own[k * SIZE + k] = 1.0
        for link in range(links.begins[m], links.begins[m + 1]):
            for c in range(links.wides[link]):
                line = inverse[(links.columns[link] + c) * width :]
                for e in range(SIZE):
                    total = 0.0
                    for j in range(links.begins[m], links.begins[m + 1]):
                        for b in range(links.wides[j]):
                            total += y[links.places[j] + e * length + b] * line[links.columns[j] + b]
                    for k in range(SIZE):
                        own[k * SIZE + e] += y[links.places[link] + k * length + c] * total
        put_between(roots[m * (SIZE * SIZE) :], own, diagonal[m * (SIZE * SIZE) :])


@distinct_arrays
def put_inverse_blocks(
    first: Integer,
    last: Integer,
    links: Links,
    images: ConstantReals,
    roots: ConstantReals,
    inner: Reals,
    across: Reals,
    diagonal: Reals,
) -> None:
    """The blocks of the inverse that belong to the members ``first … last``.

    ``across`` (panels, as ``y``) = ``-Rᵀ Y Z`` with the ``roots`` R (members, SIZE, SIZE) and ``images`` = Y Z;
    ``diagonal`` (members, SIZE, SIZE) = ``Rᵀ (I + Y Z Yᵀ) R``. ``inner`` (members, SIZE, SIZE) is scratch.
    """
    y = links.y
    for m in range(first, last):
        own = m * (SIZE * SIZE)
        length = links.lengths[m]
        for k in range(SIZE):
            for e in range(SIZE):
                inner[own + k * SIZE + e] = 0.0
            inner[own + k * SIZE + k] = 1.0
        for link in range(links.begins[m], links.begins[m + 1]):
            place = links.places[link]
            for k in range(SIZE):
                for c in range(links.wides[link]):
                    for e in range(SIZE):
                        inner[own + k * SIZE + e] += images[place + k * length + c] * y[place + e * length + c]
                    total = 0.0
                    for e in range(k, SIZE):
                        total -= roots[own + e * SIZE + k] * images[place + e * length + c]
                    across[place + k * length + c] = total
        put_between(roots[own:], inner[own:], diagonal[own:])
