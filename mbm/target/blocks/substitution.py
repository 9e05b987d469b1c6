"""After the elimination: right sides carried to the rest and solutions back, and the inverse at the couplings.

Links, panels and the other names are those of `mbm.target.blocks.elimination`.
"""

from __future__ import annotations

from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Reals, distinct_arrays

SIZE = 3
"""Columns of a member of the family that went."""


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
def add_carried(
    first: Integer,
    last: Integer,
    begins: ConstantIntegers,
    columns: ConstantIntegers,
    places: ConstantIntegers,
    wides: ConstantIntegers,
    lengths: ConstantIntegers,
    y: ConstantReals,
    sides: Integer,
    inner: ConstantReals,
    rest: Reals,
) -> None:
    """``rest += Yᵀ inner`` for the members ``first … last``: (width, sides) and (members · SIZE, sides)."""
    for m in range(first, last):
        source = m * SIZE * sides
        for link in range(begins[m], begins[m + 1]):
            for c in range(wides[link]):
                target = (columns[link] + c) * sides
                place = places[link] + c
                for q in range(sides):
                    total = 0.0
                    for k in range(SIZE):
                        total += y[place + k * lengths[m]] * inner[source + k * sides + q]
                    rest[target + q] += total


@distinct_arrays
def add_returned(
    first: Integer,
    last: Integer,
    begins: ConstantIntegers,
    columns: ConstantIntegers,
    places: ConstantIntegers,
    wides: ConstantIntegers,
    lengths: ConstantIntegers,
    y: ConstantReals,
    sides: Integer,
    rest: ConstantReals,
    inner: Reals,
) -> None:
    """``inner += Y rest`` for the members ``first … last``."""
    for m in range(first, last):
        target = m * SIZE * sides
        for link in range(begins[m], begins[m + 1]):
            for c in range(wides[link]):
                source = (columns[link] + c) * sides
                place = places[link] + c
                for q in range(sides):
                    value = rest[source + q]
                    for k in range(SIZE):
                        inner[target + k * sides + q] += y[place + k * lengths[m]] * value


@distinct_arrays
def put_images(
    i: Integer,
    size: Integer,
    starts: ConstantIntegers,
    links: ConstantIntegers,
    members: ConstantIntegers,
    begins: ConstantIntegers,
    columns: ConstantIntegers,
    places: ConstantIntegers,
    wides: ConstantIntegers,
    lengths: ConstantIntegers,
    y: ConstantReals,
    stride: Integer,
    line: ConstantReals,
    images: Reals,
) -> None:
    """``Y Z`` at the links of the block row i of the rest; ``images`` are panels as ``y`` is.

    ``line`` is that block row of the symmetric ``Z``, (size, …), its rows ``stride`` apart.
    """
    for t in range(starts[i], starts[i + 1]):
        link = links[t]
        m = members[link]
        for a in range(size):
            for k in range(SIZE):
                total = 0.0
                for j in range(begins[m], begins[m + 1]):
                    place = places[j] + k * lengths[m]
                    column = a * stride + columns[j]
                    for b in range(wides[j]):
                        total += y[place + b] * line[column + b]
                images[places[link] + k * lengths[m] + a] = total


@distinct_arrays
def images_dense(
    first: Integer,
    last: Integer,
    heads: ConstantIntegers,
    sizes: ConstantIntegers,
    starts: ConstantIntegers,
    links: ConstantIntegers,
    members: ConstantIntegers,
    begins: ConstantIntegers,
    columns: ConstantIntegers,
    places: ConstantIntegers,
    wides: ConstantIntegers,
    lengths: ConstantIntegers,
    y: ConstantReals,
    width: Integer,
    inverse: ConstantReals,
    images: Reals,
) -> None:
    """``Y Z`` at the links of the block rows ``first … last``, where ``inverse`` is all of ``Z`` (width, width)."""
    for i in range(first, last):
        line = inverse[heads[i] * width :]
        put_images(i, sizes[i], starts, links, members, begins, columns, places, wides, lengths, y, width, line, images)


@distinct_arrays
def images_sparse(
    first: Integer,
    last: Integer,
    heads: ConstantIntegers,
    sizes: ConstantIntegers,
    starts: ConstantIntegers,
    links: ConstantIntegers,
    members: ConstantIntegers,
    begins: ConstantIntegers,
    columns: ConstantIntegers,
    places: ConstantIntegers,
    wides: ConstantIntegers,
    lengths: ConstantIntegers,
    y: ConstantReals,
    width: Integer,
    pointers: ConstantIntegers,
    indices: ConstantIntegers,
    inverse: ConstantReals,
    images: Reals,
    line: Reals,
) -> None:
    """The same where ``Z`` is known at entries alone: row r at ``pointers[r] … pointers[r + 1]``, both triangles.

    ``line`` is scratch for the widest block row, (rows, width), zero before and after.
    """
    for i in range(first, last):
        for a in range(sizes[i]):
            for e in range(pointers[heads[i] + a], pointers[heads[i] + a + 1]):
                line[a * width + indices[e]] = inverse[e]
        put_images(i, sizes[i], starts, links, members, begins, columns, places, wides, lengths, y, width, line, images)
        for a in range(sizes[i]):
            for e in range(pointers[heads[i] + a], pointers[heads[i] + a + 1]):
                line[a * width + indices[e]] = 0.0


@distinct_arrays
def put_inverse_blocks(
    first: Integer,
    last: Integer,
    begins: ConstantIntegers,
    places: ConstantIntegers,
    wides: ConstantIntegers,
    lengths: ConstantIntegers,
    y: ConstantReals,
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
    for m in range(first, last):
        own = m * (SIZE * SIZE)
        length = lengths[m]
        for k in range(SIZE):
            for e in range(SIZE):
                inner[own + k * SIZE + e] = 0.0
            inner[own + k * SIZE + k] = 1.0
        for link in range(begins[m], begins[m + 1]):
            place = places[link]
            for k in range(SIZE):
                for c in range(wides[link]):
                    for e in range(SIZE):
                        inner[own + k * SIZE + e] += images[place + k * length + c] * y[place + e * length + c]
                    total = 0.0
                    for e in range(k, SIZE):
                        total -= roots[own + e * SIZE + k] * images[place + e * length + c]
                    across[place + k * length + c] = total
        for k in range(SIZE):
            for e in range(SIZE):
                total = 0.0
                for a in range(k, SIZE):
                    for b in range(e, SIZE):
                        total += roots[own + a * SIZE + k] * inner[own + a * SIZE + b] * roots[own + b * SIZE + e]
                diagonal[own + k * SIZE + e] = total
