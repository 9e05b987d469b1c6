"""Blocks whose rows share noise → the patterns of their residuals.

Errors that groups of rows share become the orthonormal directions along which they enlarge the variance.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from math import isfinite

import numpy as np
from scipy.sparse import csr_array, hstack
from scipy.sparse.csgraph import connected_components

from mbm.equations.binding import Group
from mbm.equations.structure import LARGEST_RHO, Chains, Common, Pattern, Stated, Structure
from mbm.equations.types import Floats, Indices
from mbm.problem import faults
from mbm.problem.noise import Correlation
from mbm.problem.previous import chains
from mbm.problem.rows import row_values
from mbm.problem.tables import Table
from mbm.problem.types import Block, Problem, RowValues
from mbm.text.types import MbmError, Span
from mbm.values import dataclass

MOST_DENSE = 20_000_000
"""Numbers of a matrix of rows by common errors that depend on one another: 160 MB, and minutes of work."""

NEGLIGIBLE = 1e-14
"""Singular value, beside the largest, that is a rounding."""


def entry(deviations: Floats, members: Indices) -> csr_array:
    """Z (r, groups) of one common error: what it does to each line (r,), and which group the line belongs to."""
    count = int(members.max(initial=-1)) + 1
    lines = np.arange(len(members))
    return csr_array((deviations, (lines, members)), shape=(len(members), count))


def together(entries: list[csr_array]) -> csr_array:
    """Z of several common errors, whose squares add up."""
    return csr_array(hstack(entries, format="csr"))


def directions(raw: csr_array, along: Chains | Stated | None) -> Common:
    """The left singular vectors of ``W Z`` and its squared singular values, W being that of the correlation ``along``.

    Groups of rows that no common error connects are taken apart.
    """
    if along is not None:
        dense = along.independent(np.asarray(raw.toarray()))
        return _joined([(np.arange(raw.shape[0]), *_singular(dense))], raw.shape[0])
    squares = raw.multiply(raw)
    if int(np.diff(raw.indptr).max(initial=0)) <= 1:
        lengths = np.sqrt(np.asarray(squares.sum(axis=0)).ravel())
        kept = np.flatnonzero(lengths > 0.0)
        unit = csr_array(raw[:, kept].multiply(1.0 / lengths[kept]))
        return Common(vectors=unit, squares=np.square(lengths[kept]))
    linked = csr_array(raw.T @ raw)
    count, of_column = connected_components(linked, directed=False)
    columns = raw.tocsc()
    parts = []
    for number in range(count):
        mine = columns[:, np.flatnonzero(of_column == number)].tocsr()
        rows = np.flatnonzero(np.diff(mine.indptr))
        parts.append((rows, *_singular(np.asarray(mine[rows].toarray()))))
    return _joined(parts, raw.shape[0])


def _singular(matrix: Floats) -> tuple[Floats, Floats]:
    """Left singular vectors, and squared singular values, that are not zero."""
    if not matrix.size:
        return np.zeros((len(matrix), 0)), np.zeros(0)
    vectors, values, _ = np.linalg.svd(matrix, full_matrices=False)
    kept = values > NEGLIGIBLE * max(float(values[0]), 1e-300)
    return vectors[:, kept], np.square(values[kept])


def _joined(parts: list[tuple[Indices, Floats, Floats]], rows: int) -> Common:
    lines, columns, cells, squares, first = [], [], [], [], 0
    for places, vectors, values in parts:
        lines.append(np.repeat(places, len(values)))
        columns.append(np.tile(first + np.arange(len(values)), len(places)))
        cells.append(vectors.ravel())
        squares.append(values)
        first += len(values)
    data = (np.concatenate(cells), (np.concatenate(lines), np.concatenate(columns))) if parts else None
    unit = csr_array(data, shape=(rows, first)) if data is not None else csr_array((rows, 0))
    return Common(vectors=unit, squares=np.concatenate(squares) if squares else np.zeros(0))


def finished(pattern: Pattern) -> Pattern:
    """The pattern with the directions of its common errors, as its correlation along the rows has them."""
    if pattern.raw is None:
        return pattern
    return replace(pattern, common=directions(pattern.raw, pattern.along))


def with_rho(pattern: Pattern, rho: float) -> Pattern:
    """The same with another correlation of neighbouring rows."""
    if pattern.chains is None:
        raise TypeError(pattern)
    return finished(replace(pattern, chains=Chains(gaps=pattern.chains.gaps, rho=rho)))


ASYMMETRY = 1e-6
"""Difference of two entries of a correlation matrix that should be one number: files have six digits or more."""

FIRST_RHO = 0.0
"""Where the search for an unknown correlation begins: rows that are independent."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rows:
    """The rows of a block in use: ``positions`` (rows,) in its table, ``lines`` (rows, k) of their residuals.

    ``weights`` (rows, k) are one over their standard deviations.
    """

    table: Table
    positions: Indices
    lines: Indices
    weights: Floats


def structure_of(problem: Problem, tables: Mapping[str, Table], groups: tuple[Group, ...]) -> Structure:
    """What the residuals of some groups share, with what is unknown of it as it is at first.

    Raises:
        MbmError: common errors or correlations that are none, or more than there is room for.

    """
    found = []
    for number, block in enumerate(problem.blocks):
        if block.structure.joins and block.table is not None:
            rows = _rows(tables[block.table], [g for g in groups if g.kernel.owner == number and g.rows])
            if rows is not None:
                found.append(_pattern(number, block, tables, rows))
    return Structure(patterns=tuple(found))


def _rows(table: Table, groups: Iterable[Group]) -> _Rows | None:
    """The rows of some groups, in the order of the table."""
    parts = []
    for group in groups:
        outputs = group.kernel.outputs
        lines = group.first + np.arange(group.rows)[:, None] * outputs + np.arange(outputs)
        parts.append((np.asarray(group.positions), lines, np.hstack([w.weights for w in group.whiteners])))
    if not parts:
        return None
    positions, lines, weights = (np.concatenate(each) for each in zip(*parts, strict=True))
    order = np.argsort(positions, kind="stable")
    return _Rows(table=table, positions=positions[order], lines=lines[order], weights=weights[order])


def _pattern(owner: int, block: Block, tables: Mapping[str, Table], rows: _Rows) -> Pattern:
    structure = block.structure
    if structure.free:
        return Pattern(owner=owner, lines=rows.lines.ravel(), lower=np.eye(rows.lines.shape[1]))
    order, along = np.arange(rows.lines.size), None
    stated = None
    if structure.correlation is Correlation.AR1:
        rho = FIRST_RHO if structure.unknown else stated_rho(block.shared[-1], tables)
        order, along = _chained(rows, rho)
    elif structure.matrix is not None:
        order = np.arange(rows.lines.size).reshape(rows.lines.shape).T.ravel()  # component after component
        stated = _stated_matrix(block, tables[structure.matrix], rows)
    lines = rows.lines.ravel()[order]
    raw = None
    if structure.per:
        place = structure.place or block.span
        needed = rows.lines.size * _most(rows, structure.per, place)
        if needed > MOST_DENSE and (structure.correlation is not None or len(structure.per) > 1):
            raise MbmError(faults.noise_too_large(place, rows.lines.size, needed))
        entries = [
            entry((row_values(form, tables)[rows.positions] * rows.weights).ravel(), _members(rows, column, place))
            for column, form in zip(structure.per, block.shared, strict=False)
        ]
        _check(block, rows, entries_finite=[bool(np.isfinite(each.data).all()) for each in entries])
        raw = together(entries)[order]
    found = Pattern(owner=owner, lines=lines, chains=along, stated=stated, raw=raw, unknown=structure.unknown)
    return finished(found)


def _stated_matrix(block: Block, matrix: Table, rows: _Rows) -> Stated:
    """The Cholesky factor of the correlation of the rows in use, of a matrix for all rows of the table.

    Raises:
        MbmError: a matrix of another size, one that is not symmetric with ones on its diagonal, or not definite.

    """
    lower = correlation_root(block, matrix, rows.table, rows.positions)
    return Stated(lower=lower)


def correlation_root(block: Block, matrix: Table, table: Table, positions: Indices) -> Floats:
    """The same for some rows of a table."""
    whole, place = len(matrix), block.structure.place or block.span
    if whole != table.provenance.rows:
        what = f"the matrix has {whole} rows, and `{table.name}` {table.provenance.rows}"
        raise MbmError(faults.bad_correlation(place, what))
    numbers = np.column_stack([matrix.numbers(name) for name in matrix.columns])
    if not bool(np.isfinite(numbers).all()) or float(np.abs(numbers - numbers.T).max()) > ASYMMETRY:
        raise MbmError(faults.bad_correlation(place, "the correlation matrix is not symmetric"))
    if float(np.abs(np.diag(numbers) - 1.0).max()) > ASYMMETRY:
        raise MbmError(faults.bad_correlation(place, "the diagonal of the correlation matrix is not 1"))
    mine = table.rows[positions] - 1
    try:
        return np.asarray(np.linalg.cholesky(numbers[np.ix_(mine, mine)]))
    except np.linalg.LinAlgError:
        raise MbmError(faults.bad_correlation(place, "the correlation matrix is not positive definite")) from None


def _check(block: Block, rows: _Rows, *, entries_finite: list[bool]) -> None:
    """Refuse common errors that are no numbers."""
    if all(entries_finite):
        return
    span = block.shared[entries_finite.index(False)].span
    raise MbmError(faults.bad_noise(span, "a common error is not finite", None))


def _members(rows: _Rows, column: str, place: Span) -> Indices:
    """For each line the number of its row's value in a column.

    Raises:
        MbmError: a row without a value, with the ``place`` of the clause.

    """
    keys = rows.table.keys(column)
    cells = [keys[position] for position in rows.positions.tolist()]
    gap = next((i for i, cell in enumerate(cells) if isinstance(cell, float) and not isfinite(cell)), None)
    if gap is not None:
        where, cell = rows.table.place(int(rows.positions[gap]), column), float(cells[gap])
        raise MbmError(faults.not_finite_cell(where, column, cell, place, faults.Leave.OBSERVED))
    numbers = {cell: i for i, cell in enumerate(dict.fromkeys(cells))}
    of_row = np.array([numbers[cell] for cell in cells], dtype=np.int64)
    return np.repeat(of_row, rows.lines.shape[1])


def _most(rows: _Rows, columns: tuple[str, ...], place: Span) -> int:
    """The common errors of all columns together."""
    return sum(int(_members(rows, column, place).max(initial=-1)) + 1 for column in columns)


def stated_rho(values: RowValues, tables: Mapping[str, Table]) -> float:
    """The correlation of neighbouring rows that is stated."""
    rho = float(row_values(values, tables)[0, 0])
    if not abs(rho) <= LARGEST_RHO:
        raise MbmError(
            faults.bad_noise(values.span, f"the correlation of neighbouring rows is {rho:g}, beyond ±1", None)
        )
    return rho


def _chained(rows: _Rows, rho: float) -> tuple[Indices, Chains]:
    """The order of the lines, each component of each key by itself, and the gaps between them."""
    chain, place = (each[rows.positions] for each in chains(rows.table))
    component = np.broadcast_to(np.arange(rows.lines.shape[1]), rows.lines.shape).ravel()
    of_lines = [np.repeat(each, rows.lines.shape[1]) for each in (place, chain)]
    order, gaps = chained(*of_lines, component)
    return order, Chains(gaps=gaps, rho=rho)


def chained(place: Floats, *keys: Floats | Indices) -> tuple[Indices, Indices]:
    """The order in which lines follow one another within equal keys, and the gap (r,) to the one before; 0: none."""
    order = np.lexsort((place, *keys))
    gaps = np.diff(place[order], prepend=0.0)
    begins = np.ones(len(order), dtype=bool)
    begins[1:] = np.any([np.diff(key[order]) != 0 for key in keys], axis=0)
    return order, np.where(begins, 0, gaps).astype(np.int64)
