"""Sparse Cholesky by fronts (Duff and Reid 1983): factor, solutions, and the inverse at the entries of the matrix.

A front of ``width`` columns and ``size`` rows holds the upper triangle ``R`` of ``A = Rᵀ R`` as a *panel*
(width, size), row by row. Fronts come in postorder: the updates that wait for a front lie on top of a stack when it is
its turn. Its own rows stand first among its ``rows`` (places in the permuted matrix), ascending; those below them are
rows ``into`` of its parent.

The table of a front is `FRONT` numbers at ``k · FRONT`` of ``table``, as named here.
"""

from __future__ import annotations

from math import isfinite, sqrt

from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals, distinct_arrays

WIDTH = 0
SIZE = 1
PARENT = 2
"""The front that takes over the rows below, -1: there is none."""
ROWS_AT = 3
"""Offset of its rows in ``rows``, and of those below its own ones, moved by ``width``, in ``into``."""
ENTRIES_AT = 4
ENTRIES = 5
"""Offset and number of the matrix's entries that are its own, in ``source`` and ``target``."""
PANEL_AT = 6
PART_AT = 7
"""Offset of its part of the inverse in the scratch for that."""
FRONT = 8

DEEP = 8
"""Rows of a panel that are worked on together."""


@distinct_arrays
def subtract_pair(length: Integer, stride: Integer, left: ConstantReals, right: ConstantReals, target: Reals) -> None:
    """``target -= leftᵀ right`` for two columns of ``left`` and `DEEP` rows; rows are ``stride`` apart."""
    for b in range(length):
        first = 0.0
        second = 0.0
        for p in range(DEEP):
            factor = right[p * stride + b]
            first += left[p * stride] * factor
            second += left[p * stride + 1] * factor
        target[b] -= first
        target[stride + b] -= second


@distinct_arrays
def subtract_multiple(length: Integer, factor: Real, row: ConstantReals, target: Reals) -> None:
    """``target -= factor · row``."""
    for b in range(length):
        target[b] -= factor * row[b]


@distinct_arrays
def product(length: Integer, a: ConstantReals, b: ConstantReals) -> Real:
    """``a · b``."""
    total = 0.0
    for i in range(length):
        total += a[i] * b[i]
    return total


@distinct_arrays
def factorise_front(width: Integer, size: Integer, whole: Reals) -> Integer:
    """The first ``width`` rows of ``R``, and what is left for the others, in the upper triangle (size, size).

    Returns 0, or the number (from 1) of the column that is not positive.
    """
    begin = 0
    while begin < width:
        end = begin + DEEP
        if end > width:
            end = width
        for k in range(begin, end):
            line = whole[k * size + k :]
            for p in range(begin, k):
                subtract_multiple(size - k, whole[p * size + k], whole[p * size + k :], line)
            if not (line[0] > 0.0) or not isfinite(line[0]):
                return k + 1
            factor = 1.0 / sqrt(line[0])
            for j in range(size - k):
                line[j] *= factor
        i = end
        if end - begin == DEEP:
            while i + 2 <= size:
                row = begin * size + i
                subtract_pair(size - i, size, whole[row:], whole[row:], whole[i * size + i :])
                i += 2
        while i < size:
            for p in range(begin, end):
                subtract_multiple(size - i, whole[p * size + i], whole[p * size + i :], whole[i * size + i :])
            i += 1
        begin = end
    return 0


@distinct_arrays
def add_update(count: Integer, size: Integer, update: ConstantReals, into: ConstantIntegers, whole: Reals) -> None:
    """``whole[into, into] += update`` in upper triangles (count, count) and (size, size)."""
    for i in range(count):
        line = into[i] * size
        for j in range(i, count):
            whole[line + into[j]] += update[i * count + j]


@distinct_arrays
def factorise_fronts(
    count: Integer,
    table: ConstantIntegers,
    into: ConstantIntegers,
    source: ConstantIntegers,
    target: ConstantIntegers,
    entries: ConstantReals,
    panels: Reals,
    updates: Reals,
    whole: Reals,
    waiting: Integers,
) -> Integer:
    """The panels of the matrix with the given ``entries``, from the first front to the last.

    ``updates`` has room for the stack, ``whole`` for the largest front, ``waiting`` for ``2 · count`` integers. Returns
    0, or the number (from 1) of the first front that is not positive.
    """
    top = 0
    pending = 0
    for k in range(count):
        front = k * FRONT
        width = table[front + WIDTH]
        size = table[front + SIZE]
        for e in range(size * size):
            whole[e] = 0.0
        for e in range(table[front + ENTRIES_AT], table[front + ENTRIES_AT] + table[front + ENTRIES]):
            whole[target[e]] = entries[source[e]]
        while pending > 0 and table[waiting[2 * pending - 2] * FRONT + PARENT] == k:
            child = waiting[2 * pending - 2] * FRONT
            top = waiting[2 * pending - 1]
            below = table[child + SIZE] - table[child + WIDTH]
            add_update(below, size, updates[top:], into[table[child + ROWS_AT] + table[child + WIDTH] :], whole)
            pending -= 1
        if factorise_front(width, size, whole) != 0:
            return k + 1
        panel = table[front + PANEL_AT]
        for i in range(width):
            for j in range(i, size):
                panels[panel + i * size + j] = whole[i * size + j]
        below = size - width
        if table[front + PARENT] >= 0:
            for i in range(below):
                for j in range(i, below):
                    updates[top + i * below + j] = whole[(width + i) * size + width + j]
            waiting[2 * pending] = k
            waiting[2 * pending + 1] = top
            pending += 1
            top += below * below
    return 0


@distinct_arrays
def solve_fronts(
    count: Integer,
    table: ConstantIntegers,
    rows: ConstantIntegers,
    panels: ConstantReals,
    sides: Integer,
    own: Reals,
    x: Reals,
) -> None:
    """``x = (Rᵀ R)⁻¹ x`` for right sides (n, sides) in the order of the fronts; ``own``: room for the largest front."""
    for k in range(count):
        front = k * FRONT
        size = table[front + SIZE]
        panel = panels[table[front + PANEL_AT] :]
        places = rows[table[front + ROWS_AT] :]
        for q in range(sides):
            for i in range(size):
                own[i] = x[places[i] * sides + q]
            for i in range(table[front + WIDTH]):
                own[i] /= panel[i * size + i]
                subtract_multiple(size - i - 1, own[i], panel[i * size + i + 1 :], own[i + 1 :])
            for i in range(size):
                x[places[i] * sides + q] = own[i]
    for back in range(count):
        front = (count - 1 - back) * FRONT
        width = table[front + WIDTH]
        size = table[front + SIZE]
        panel = panels[table[front + PANEL_AT] :]
        places = rows[table[front + ROWS_AT] :]
        for q in range(sides):
            for i in range(size):
                own[i] = x[places[i] * sides + q]
            for down in range(width):
                i = width - 1 - down
                own[i] -= product(size - i - 1, panel[i * size + i + 1 :], own[i + 1 :])
                own[i] /= panel[i * size + i]
                x[places[i] * sides + q] = own[i]


@distinct_arrays
def inverse_front(width: Integer, size: Integer, panel: ConstantReals, part: Reals) -> None:
    """The rows of the inverse ``Z`` that belong to a front, where ``part`` (size, size) holds those below them already.

    ``R Z = R⁻ᵀ`` row by row from below (Takahashi, Fagan and Chin 1973).
    """
    for down in range(width):
        k = width - 1 - down
        above = panel[k * size + k + 1 :]
        line = part[k * size + k + 1 :]
        rest = size - k - 1
        for j in range(rest):
            line[j] = 0.0
        for i in range(rest):
            subtract_multiple(rest, above[i], part[(k + 1 + i) * size + k + 1 :], line)
        factor = 1.0 / panel[k * size + k]
        for j in range(rest):
            line[j] *= factor
            part[(k + 1 + j) * size + k] = line[j]
        part[k * size + k] = factor * (factor - product(rest, above, line))


@distinct_arrays
def inverse_fronts(
    count: Integer,
    table: ConstantIntegers,
    into: ConstantIntegers,
    source: ConstantIntegers,
    target: ConstantIntegers,
    panels: ConstantReals,
    parts: Reals,
    result: Reals,
) -> None:
    """The elements of the inverse at the entries of the matrix, from the last front to the first.

    The rows below a front are rows of its parent, whose part of the inverse is known by then. ``parts`` has room for
    the parts of one path of the tree.
    """
    for back in range(count):
        front = (count - 1 - back) * FRONT
        width = table[front + WIDTH]
        size = table[front + SIZE]
        part = parts[table[front + PART_AT] :]
        if size > width:
            above = table[front + PARENT] * FRONT
            high = table[above + SIZE]
            known = parts[table[above + PART_AT] :]
            places = into[table[front + ROWS_AT] + width :]
            for i in range(size - width):
                for j in range(size - width):
                    part[(width + i) * size + width + j] = known[places[i] * high + places[j]]
        inverse_front(width, size, panels[table[front + PANEL_AT] :], part)
        for e in range(table[front + ENTRIES_AT], table[front + ENTRIES_AT] + table[front + ENTRIES]):
            result[source[e]] = part[target[e]]
