"""What the routines for blocks work on, as records."""

from __future__ import annotations

from mbm.machine.records import record
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers

SIZE = 3
"""Columns of a member of the family that is eliminated; the texts are read with that of each problem in its place."""


def product_name(outputs: int, right: int) -> str:
    """The name of the routine that adds up products of blocks with right ones of shape (outputs, right)."""
    return f"add_products_{outputs}_{right}"


@record
class Products:
    """For target ``targets[t]`` the products of the rows ``rows[starts[t]:starts[t + 1]]``."""

    targets: ConstantIntegers
    starts: ConstantIntegers
    rows: ConstantIntegers
    values: ConstantReals
    """(rows, outputs, width)"""
    width: Integer
    high: Integer
    """Columns of the left block."""
    left: Integer
    right: Integer
    """Where the blocks' columns start in the values."""


@record
class Piece:
    """Rows with ``count`` local blocks each."""

    outputs: Integer
    width: Integer
    count: Integer
    rows: Integer
    starts: ConstantIntegers
    sizes: ConstantIntegers
    """Where each block starts in the values of a row, and its width."""
    heads: ConstantIntegers
    """Where the columns of its family begin."""
    members: ConstantIntegers
    """(count, rows)"""
    values: ConstantReals
    """(rows, outputs, width)"""


@record
class Nonzeros:
    """Nonzero ``chosen[k]`` of a kernel's row, of output ``lines[k]``, goes to ``targets[k]`` of the row."""

    count: Integer
    chosen: ConstantIntegers
    targets: ConstantIntegers
    lines: ConstantIntegers
    outputs: Integer
    length: Integer
    """Numbers of a row that the kernel puts out …"""
    wide: Integer
    """… and of the row they go to."""


@record
class Cross:
    """Blocks between the family that is eliminated and another one, ``wide`` columns each.

    Block p is of member ``members[p]`` and goes to ``targets[p]`` in the couplings; its element (e, c) stands at
    ``e · along + c · across``.
    """

    members: ConstantIntegers
    targets: ConstantIntegers
    lengths: ConstantIntegers
    """Of the panels of the members."""
    wide: Integer
    along: Integer
    across: Integer
    blocks: ConstantReals


@record
class Links:
    """The couplings ``Y`` of members to blocks of the rest, see `elimination`."""

    begins: ConstantIntegers
    columns: ConstantIntegers
    places: ConstantIntegers
    wides: ConstantIntegers
    lengths: ConstantIntegers
    y: ConstantReals


@record
class Rest:
    """Block rows of the rest: row i has ``sizes[i]`` rows from ``heads[i]`` on.

    Its links are ``links[starts[i]:starts[i + 1]]``; link l is of member ``members[l]``.
    """

    heads: ConstantIntegers
    sizes: ConstantIntegers
    starts: ConstantIntegers
    links: ConstantIntegers
    members: ConstantIntegers
    width: Integer
    """Columns of the rest."""


@record
class Entries:
    """Entries of a sparse matrix: those of row r are ``pointers[r] … pointers[r + 1]``, in the columns ``indices``."""

    pointers: ConstantIntegers
    indices: ConstantIntegers


@record
class Graph:
    """A graph whose nodes are to be eliminated, see `ordering`."""

    count: Integer
    columns: Integer
    """Of all nodes."""
    room: Integer
    """Numbers that there is room for in ``lists``."""
    sizes: ConstantIntegers
    """Columns of each node."""
    places: Integers
    counts: Integers
    lists: Integers
    work: Integers
    """``8 · count + columns + 1`` numbers of scratch, the first ``5 · count`` of them zero: what follows."""
    elements: Integers
    states: Integers
    seen: Integers
    outside: Integers
    cliques: Integers
    """Columns of each element."""
    degrees: Integers
    following: Integers
    previous: Integers
    heads: Integers
    """The nodes of equal degree, as lists."""
