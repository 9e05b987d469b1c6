"""What the sparse solver computes with: a protocol with two sides, NumPy and SciPy, or compiled routines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, TypeAlias

from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices
from mbm.sparse.normal import Normal, NormalPattern
from mbm.sparse.structure import Structure, Values

Places: TypeAlias = tuple[Indices, Indices, Indices]
"""Which nonzeros of a kernel, their places in a row of values, their outputs."""


class Arithmetic(Protocol):
    """The work on blocks, for the pattern and the elimination that it was made for."""

    def put_jacobian(
        self, group: Group, numbers: Floats, weights: Floats, places: Places, values: Floats, target: Floats
    ) -> None:
        """The kernel of a group at the vector of all numbers (N,): its outputs to ``values`` (rows, outputs).

        The nonzeros of its Jacobian, multiplied by the weights (rows, outputs) of their outputs, go to their places in
        ``target`` (rows, outputs, width).
        """
        ...

    def products(self, pattern: NormalPattern, values: Values) -> Mapping[tuple[int, int], Floats]:
        """The blocks of ``JᵀJ``."""
        ...

    def gradient(self, layout: Structure, values: Values, residuals: Floats) -> Floats:
        """``Jᵀ r`` (columns,) for residuals (m,)."""
        ...

    def squares(self, layout: Structure, values: Values) -> Floats:
        """The squared norms of the columns (columns,)."""
        ...

    def image(self, layout: Structure, values: Values, step: Floats) -> Floats:
        """``J step`` (m,) for a step (columns,)."""
        ...

    def roots(self, blocks: Floats, added: Floats) -> Floats | None:
        """``L⁻¹`` (members, size, size), lower triangles, of ``L Lᵀ`` = blocks with ``added`` (members, size) on the
        diagonals; None where one is not positive definite.
        """
        ...

    def couplings(self, normal: Normal, roots: Floats) -> Floats:
        """``Y = L⁻¹ W`` as panels, flat."""
        ...

    def reduce(self, y: Floats, matrix: Floats) -> None:
        """``matrix -= YᵀY``, at least the upper triangle of the matrix (width, width)."""
        ...

    def reduce_entries(self, y: Floats, keys: Indices, entries: Floats) -> None:
        """The same for entries at ``keys`` (row · width + column, ascending, upper triangle)."""
        ...

    def solved(self, lower: Floats, right: Floats) -> Floats:
        """``(L Lᵀ)⁻¹ right`` (width, k) for a dense lower triangle."""
        ...

    def rooted(self, roots: Floats, right: Floats, *, transposed: bool) -> Floats:
        """``L⁻¹ right``, or ``L⁻ᵀ right``, for right sides (members · size, k)."""
        ...

    def carried(self, y: Floats, inner: Floats) -> Floats:
        """``Yᵀ inner`` (width, k) for (members · size, k)."""
        ...

    def returned(self, y: Floats, rest: Floats) -> Floats:
        """``Y rest`` (members · size, k) for (width, k)."""
        ...

    def inverse_diagonal(self, y: Floats, roots: Floats, rest: Any) -> Floats:
        """The blocks of the inverse at the family alone; ``rest`` as below."""
        ...

    def inverse_blocks(self, y: Floats, roots: Floats, rest: Any) -> tuple[Floats, Floats]:
        """The inverse at the family: panels ``-L⁻ᵀ Y Z`` as ``y``, blocks ``L⁻ᵀ (I + Y Z Yᵀ) L⁻¹``.

        ``rest`` is the inverse ``Z`` of the reduced matrix: an array (width, width), or a SciPy CSR array, both
        triangles, with the entries at the pattern of ``YᵀY`` at least.
        """
        ...
