"""Sparse Cholesky by CHOLMOD (Chen, Davis, Hager and Rajamanickam 2008), where scikit-sparse is installed.

About twice as fast as the fronts of this package on large pose graphs. The inverse on the pattern is left to those.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.sparse.cholesky import factorise
from mbm.sparse.fronts import Fronts
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CholmodFactor:
    """``numeric`` solves; ``entries`` are those of the matrix that it was made of, as ``tree`` was told of them."""

    numeric: Any
    tree: Fronts
    entries: Floats

    def solve(self, right: Floats) -> Floats:
        """``A⁻¹ right`` for a right side (n, k)."""
        return np.asarray(self.numeric(right), dtype=np.float64)

    def inverse(self, entries: int) -> Floats:
        """The elements of the inverse at the ``entries`` entries of the matrix."""
        factor = factorise(self.tree, self.entries)
        if factor is None:
            message = "the fronts find a matrix indefinite that CHOLMOD has a factor of"
            raise ArithmeticError(message)
        return factor.inverse(entries)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Symbolic:
    """CHOLMOD's analysis of a pattern; ``pointers``, ``indices`` are the lower triangle by columns."""

    analysed: Any
    pointers: Indices
    indices: Indices
    tree: Fronts

    def factorise(self, entries: Floats) -> CholmodFactor | None:
        """The factor of the matrix with these entries; None: not positive."""
        from sksparse.cholmod import CholmodNotPositiveDefiniteError

        size = len(self.pointers) - 1
        try:
            numeric = self.analysed.cholesky(_lower(entries, self.pointers, self.indices, size))
        except CholmodNotPositiveDefiniteError:
            return None
        return CholmodFactor(numeric=numeric, tree=self.tree, entries=entries)


def symbolic(keys: Indices, width: int, tree: Fronts) -> Symbolic | None:
    """The analysis of entries at ``keys`` (row · width + column, ascending, upper triangle); None without CHOLMOD."""
    if find_spec("sksparse") is None:
        return None
    from sksparse import cholmod

    if not hasattr(cholmod, "analyze"):  # from scikit-sparse 0.5 on functions have other names
        return None
    columns, indices = np.divmod(keys, width)
    pointers = np.asarray(np.searchsorted(columns, np.arange(width + 1)))
    matrix = _lower(np.ones(len(keys)), pointers, indices, width)
    return Symbolic(analysed=cholmod.analyze(matrix), pointers=pointers, indices=indices, tree=tree)


def _lower(entries: Floats, pointers: Indices, indices: Indices, size: int) -> Any:
    from scipy.sparse import csc_matrix

    return csc_matrix((entries, indices.astype(np.int32), pointers.astype(np.int32)), shape=(size, size))
