"""Sparse Cholesky by fronts (Duff and Reid 1983): factor, solutions, and the inverse at the entries of the matrix.

A front of ``width`` columns and ``size`` rows holds the upper triangle ``R`` of ``A = Rᵀ R`` as a *panel*
(width, size), row by row. Fronts come in postorder: the updates that wait for a front lie on top of a stack when it is
its turn. Its own rows stand first among its ``rows`` (places in the permuted matrix), ascending; those below them are
rows ``into`` of its parent.
"""

from __future__ import annotations

from math import isfinite, sqrt

from mbm.machine.records import Records, record, slots_of
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals, distinct_arrays


@record
class Front:
    """A front and its places in the tables of all."""

    width: Integer
    size: Integer
    parent: Integer
    """The front that takes over the rows below, -1: there is none."""
    rows_at: Integer
    """Offset of its rows in ``rows``, and of those below its own ones, moved by ``width``, in ``into``."""
    entries_at: Integer
    entries: Integer
    """Offset and number of the matrix's entries that are its own, in ``source`` and ``target``."""
    panel_at: Integer
    part_at: Integer
    """Offset of its part of the inverse in the scratch for that."""


FRONT = slots_of(Front)


@record
class Fronts:
    """All fronts of a matrix."""

    count: Integer
    fronts: Records[Front]
    rows: ConstantIntegers
    into: ConstantIntegers
    source: ConstantIntegers
    target: ConstantIntegers
    updates: Reals
    """Room for the stack …"""
    whole: Reals
    """… for the largest front …"""
    waiting: Integers
    """… and for ``2 · count`` integers."""


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
def factorise_fronts(tree: Fronts, entries: ConstantReals, panels: Reals) -> Integer:
    """The panels of the matrix with the given ``entries``, from the first front to the last.

    Returns 0, or the number (from 1) of the first front that is not positive.
    """
    whole = tree.whole
    waiting = tree.waiting
    top = 0
    pending = 0
    for k in range(tree.count):
        front = tree.fronts[k]
        width = front.width
        size = front.size
        for e in range(size * size):
            whole[e] = 0.0
        for e in range(front.entries_at, front.entries_at + front.entries):
            whole[tree.target[e]] = entries[tree.source[e]]
        while pending > 0 and tree.fronts[waiting[2 * pending - 2]].parent == k:
            child = tree.fronts[waiting[2 * pending - 2]]
            top = waiting[2 * pending - 1]
            add_update(
                child.size - child.width, size, tree.updates[top:], tree.into[child.rows_at + child.width :], whole
            )
            pending -= 1
        if factorise_front(width, size, whole) != 0:
            return k + 1
        panel = panels[front.panel_at :]
        for i in range(width):
            for j in range(i, size):
                panel[i * size + j] = whole[i * size + j]
        below = size - width
        if front.parent >= 0:
            update = tree.updates[top:]
            for i in range(below):
                for j in range(i, below):
                    update[i * below + j] = whole[(width + i) * size + width + j]
            waiting[2 * pending] = k
            waiting[2 * pending + 1] = top
            pending += 1
            top += below * below
    return 0


@distinct_arrays
def solve_fronts(tree: Fronts, panels: ConstantReals, sides: Integer, x: Reals) -> None:
    """``x = (Rᵀ R)⁻¹ x`` for right sides (n, sides) in the order of the fronts."""
    own = tree.whole
    for k in range(tree.count):
        front = tree.fronts[k]
        size = front.size
        panel = panels[front.panel_at :]
        places = tree.rows[front.rows_at :]
        for q in range(sides):
            for i in range(size):
                own[i] = x[places[i] * sides + q]
            for i in range(front.width):
                own[i] /= panel[i * size + i]
                subtract_multiple(size - i - 1, own[i], panel[i * size + i + 1 :], own[i + 1 :])
            for i in range(size):
                x[places[i] * sides + q] = own[i]
    for back in range(tree.count):
        front = tree.fronts[tree.count - 1 - back]
        size = front.size
        panel = panels[front.panel_at :]
        places = tree.rows[front.rows_at :]
        for q in range(sides):
            for i in range(size):
                own[i] = x[places[i] * sides + q]
            for down in range(front.width):
                i = front.width - 1 - down
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
def inverse_fronts(tree: Fronts, panels: ConstantReals, parts: Reals, result: Reals) -> None:
    """The elements of the inverse at the entries of the matrix, from the last front to the first.

    The rows below a front are rows of its parent, whose part of the inverse is known by then. ``parts`` has room for
    the parts of one path of the tree.
    """
    for back in range(tree.count):
        front = tree.fronts[tree.count - 1 - back]
        width = front.width
        size = front.size
        part = parts[front.part_at :]
        if size > width:
            above = tree.fronts[front.parent]
            high = above.size
            known = parts[above.part_at :]
            places = tree.into[front.rows_at + width :]
            for i in range(size - width):
                for j in range(size - width):
                    part[(width + i) * size + width + j] = known[places[i] * high + places[j]]
        inverse_front(width, size, panels[front.panel_at :], part)
        for e in range(front.entries_at, front.entries_at + front.entries):
            result[tree.source[e]] = part[tree.target[e]]
