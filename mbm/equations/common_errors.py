"""Errors that groups of rows share → the orthonormal directions along which they enlarge the variance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, hstack
from scipy.sparse.csgraph import connected_components

from mbm.equations.structure import Chains, Common, Pattern, Stated
from mbm.equations.types import Floats, Indices

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
