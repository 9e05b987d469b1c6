"""Tall matrices → their triangle: all that least squares needs of them."""

from __future__ import annotations

from typing import cast

import numpy as np

from mbm.equations.types import Floats

BLOCK = 512
NARROW = 32
"""Matrices of at most so many columns are reduced in blocks of so many rows, which stay in the cache: three times
faster than all at once for a dozen columns, no gain beyond (measured)."""


def triangle(matrix: Floats) -> Floats:
    """``R`` (n, n) of the QR decomposition of a matrix (m, n), m >= n; its rows may differ in sign.

    Narrow ones by the reduction tree of Demmel, Grigori, Hoemmen and Langou (2012), as stable as Householder's.
    """
    rows, columns = matrix.shape
    blocks = rows // BLOCK
    if columns > NARROW or blocks < 2:
        return cast(Floats, np.linalg.qr(matrix, mode="r"))
    whole = matrix[: blocks * BLOCK].reshape(blocks, BLOCK, columns)
    tops = cast(Floats, np.linalg.qr(whole, mode="r"))
    return triangle(np.vstack([tops.reshape(-1, columns), matrix[blocks * BLOCK :]]))
