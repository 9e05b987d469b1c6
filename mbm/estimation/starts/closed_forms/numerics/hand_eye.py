"""Products of two unknown motions with known ones between them → the two (robot–world and hand–eye calibration)."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.rotations import nearest

APART = 1e-5
"""Relative gap of the largest singular values, below which the rotations are taken to turn about one axis."""

DETERMINED = 1e-6
"""Least singular value of the translations' equations beside the largest."""


def outer_and_inner(
    between: tuple[Floats, Floats], products: tuple[Floats, Floats]
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]] | None:
    """X and Z, each R (3, 3) and t (3,), with ``M = X A Z`` for motions A and M, each R (n, 3, 3) and t (n, 3).

    The rotations maximise ``Σ tr(Mᵀ X A Z)``, a bilinear form in X and Z: its largest singular vectors (Shah, ASME J.
    Mechanisms and Robotics 5 (3), 2013); the translations then solve linear equations. None if the motions A do not
    turn about two axes at least.
    """
    (A, a), (M, m) = between, products
    form = np.einsum("nil,njk->ijlk", M, A).reshape(9, 9)  # X_ij A_jk Z_kl M_il
    U, values, Vt = np.linalg.svd(form)
    if len(A) < 3 or not values[0] - values[1] > APART * values[0]:
        return None
    X, Z = U[:, 0].reshape(3, 3), Vt[0].reshape(3, 3).T
    sign = 1.0 if np.linalg.det(X) > 0 else -1.0
    X, Z = nearest(sign * X), nearest(sign * Z)
    matrix = np.concatenate([np.tile(np.eye(3), (len(A), 1, 1)), X @ A], axis=2).reshape(-1, 6)
    right = (m - a @ X.T).ravel()
    solution, _, _, sizes = np.linalg.lstsq(matrix / _scale(matrix), right, rcond=None)
    if not sizes[-1] > DETERMINED * sizes[0]:
        return None
    shifts = solution / _scale(matrix)
    return (X, shifts[:3]), (Z, shifts[3:])


def _scale(matrix: Floats) -> Floats:
    return np.asarray(np.linalg.norm(matrix, axis=0))
