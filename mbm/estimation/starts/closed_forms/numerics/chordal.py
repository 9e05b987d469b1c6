"""Relative motions between many frames → where these are: rotations first, then translations, both linearly.

The chordal relaxation (Martinec and Pajdla 2007; Carlone and others 2015): matrices that fit all measured rotations
``R_j = R_i R_ij`` in least squares, each then brought to the nearest rotation; with these, translations that fit all
measured ones ``t_j = t_i + R_i t_ij``. No start is needed, and noise does not add up along a tree.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.rotations import nearest
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motions:
    """From frames ``first`` to frames ``second`` (m,): turns (m, d, d), shifts (m, d), which may be None.

    ``stiffness`` (m, 2) weighs the squared differences of turns and shifts.
    """

    first: Indices
    second: Indices
    turns: Floats
    shifts: Floats | None
    stiffness: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frames:
    """Rotations (n, d, d) and translations (n, d) of frames; those that are not ``known`` (n,) hold anything."""

    known: Mask
    rotations: Floats
    translations: Floats


def chordal(motions: Motions, frames: Frames) -> Frames | None:
    """All frames from those that are known, which every frame should be connected with; None where it fails."""
    free = np.flatnonzero(~frames.known)
    if not free.size:
        return frames
    rotations, translations = frames.rotations.copy(), frames.translations.copy()
    back = np.swapaxes(motions.turns, 1, 2)
    found = _laplacian_solution(
        motions, back, motions.stiffness[:, 0], np.swapaxes(rotations, 1, 2), np.zeros_like(back), frames.known
    )
    if found is None or not np.isfinite(found).all():
        return None
    rotations[free] = nearest(np.swapaxes(found, 1, 2))
    if motions.shifts is not None:
        moved = np.einsum("nij,nj->ni", rotations[motions.first], motions.shifts)[:, None, :]
        same = np.ones((len(moved), 1, 1))
        placed = _laplacian_solution(
            motions, same, motions.stiffness[:, 1], translations[:, None, :], moved, frames.known
        )
        if placed is None or not np.isfinite(placed).all():
            return None
        translations[free] = placed[:, 0, :]
    return Frames(known=np.ones_like(frames.known), rotations=rotations, translations=translations)


def _laplacian_solution(
    motions: Motions, turns: Floats, weight: Floats, values: Floats, shifts: Floats, known: Mask
) -> Floats | None:
    """What is free (f, b, k) of X (n, b, k) in ``X_j = A X_i + s``, in weighted least squares; A ``turns`` (m, b, b).

    The A are orthogonal, so the blocks on the diagonal of the normal equations are multiples of the identity.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import splu

    number = np.where(known, -1, np.cumsum(~known) - 1)
    count, size = int((~known).sum()), turns.shape[1]
    i, j = number[motions.first], number[motions.second]
    degree = np.zeros(count)
    np.add.at(degree, i[i >= 0], weight[i >= 0])
    np.add.at(degree, j[j >= 0], weight[j >= 0])
    if not (degree > 0.0).all():
        return None
    W, ahead, back = weight[:, None, None], turns, np.swapaxes(turns, 1, 2)
    right = np.zeros((count, size, values.shape[2]))
    # of a free frame behind: what the one before says of it; of a free frame before: what the one behind says
    np.add.at(right, j[j >= 0], (W * shifts)[j >= 0])
    np.add.at(right, i[i >= 0], -(W * (back @ shifts))[i >= 0])
    from_known, to_known = (i < 0) & (j >= 0), (j < 0) & (i >= 0)
    np.add.at(right, j[from_known], (W * (ahead @ values[motions.first]))[from_known])
    np.add.at(right, i[to_known], (W * (back @ values[motions.second]))[to_known])
    both = (i >= 0) & (j >= 0)
    inner = np.arange(size)
    rows = (j[both, None, None] * size + inner[:, None] + 0 * inner).ravel()
    columns = (i[both, None, None] * size + inner + 0 * inner[:, None]).ravel()
    entries = (-W * ahead)[both].ravel()
    line = np.arange(count * size)
    matrix = coo_array(
        (
            np.concatenate([entries, entries, np.repeat(degree, size)]),
            (np.concatenate([rows, columns, line]), np.concatenate([columns, rows, line])),
        ),
        shape=(count * size, count * size),
    ).tocsc()
    try:
        factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:  # singular: frames that nothing connects with a known one
        return None
    return np.asarray(factors.solve(right.reshape(count * size, -1))).reshape(count, size, -1)
