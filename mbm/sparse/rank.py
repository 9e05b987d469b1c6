"""Block Jacobian → what it leaves free, and the inverse on all that it determines.

Free directions of single members show in the diagonal blocks of the family that is eliminated; common ones are found by
inverse iteration (block of trial vectors, Rayleigh-Ritz). Whether a direction is free is decided on ``‖J v‖``, not on
``JᵀJ``, whose rounding hides all singular values below 1e-8. Where what is determined is weakly so, all is done again
by the triangle of the Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.solver.decisions import CERTAIN, GAP, ROUNDED_DEPENDENCE, SUSPECT
from mbm.sparse.inverse import LocalNull, SparseInverse
from mbm.sparse.normal import Normal
from mbm.sparse.structure import Structure, Values
from mbm.sparse.system import Factorised, Plan, factorised
from mbm.sparse.triangles import PART, triangularised
from mbm.values import dataclass

TRIALS = 12
MOST = 96
"""Trial vectors in the search for free directions, at first and at most."""

ROUNDS = 6
"""Inverse iterations; each takes a direction that is 1e-4 less free down by that factor at least."""

SHIFTS = (1e-12, 1e-10, 1e-8)
"""What makes the scaled matrix invertible, until it is."""

FINE = (ROUNDED_DEPENDENCE**2,)
"""The same for the triangle of the Jacobian itself: nothing, beside what is not free."""

HARDLY_SEEN = 1e-8
"""Curvatures of single members, relative to those of their columns, below which a direction is looked at by itself."""

WEAK = 1e-5
"""Singular values, relative to the largest, below which the rounding of ``JᵀJ`` would take digits from a variance."""

Factoring: TypeAlias = Callable[[Floats], Factorised | None]
"""From what is added to the diagonal (columns,) of the scaled matrix to its factors."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Decision:
    """``null`` (columns, g) common and ``inverse.local`` single free directions in scaled coordinates.

    ``smallest``, ``largest``: singular values of the scaled Jacobian on what is determined; ``unused`` (columns,) live
    columns that are zero; ``complete`` False: there may be more free directions than were looked for; ``triangular``:
    the inverse is of the triangle of the Jacobian, as the normal equations lose what is weakly determined.
    """

    inverse: SparseInverse
    unused: Mask
    smallest: float
    largest: float
    complete: bool
    triangular: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scaled:
    """The Jacobian ``values`` with each column multiplied by its factor (columns,), which is not written out."""

    plan: Plan
    values: Values
    factors: Floats

    @property
    def structure(self) -> Structure:
        return self.plan.structure

    def normal(self) -> Normal:
        return self.plan.accumulate(self.values, self.factors)

    def image(self, step: Floats) -> Floats:
        return self.plan.image(self.values, self.factors * step)

    def gradient(self, residuals: Floats) -> Floats:
        return self.factors * self.plan.gradient(self.values, residuals)

    def written(self) -> Values:
        return self.structure.weighted(self.values, self.factors)


def decided(found: Plan, values: Values, held: Mask, *, affine: bool = False) -> Decision:
    """The rank decision for the Jacobian ``values``; columns in ``held`` (columns,) do not move.

    That of ``affine`` equations whose derivatives are products of data carries no more than roundings, so that no gap
    makes a direction free.
    """
    layout = found.structure
    still = layout.dead | held
    squares = np.where(still, 0.0, found.squares(values))
    zero = squares <= 0.0
    scale = np.where(zero, 1.0, np.sqrt(np.where(zero, 1.0, squares)))
    scaled = _Scaled(plan=found, values=values, factors=np.where(zero, 0.0, 1.0 / scale))
    normal = scaled.normal()
    largest = _largest(scaled)
    local = _local(scaled, normal, zero)
    normal = _pinned(found, normal, local)
    added = np.where(zero, 1.0, 0.0)
    factor: Factoring = partial(factorised, found, normal)
    null, smallest, complete = _common(scaled, _shifted(factor, added, SHIFTS), zero, largest, affine)
    triangular = smallest <= WEAK * largest
    if triangular:
        factor = partial(triangularised, found, scaled.written(), rows=_rows(local, layout.columns))
        null, smallest, complete = _common(scaled, _shifted(factor, added, FINE), zero, largest, affine)
    added[_pivots(null)] += 1.0
    factors = factor(added) or _shifted(factor, added, SHIFTS)
    if factors is None:
        message = "the scaled equations are not finite"
        raise ArithmeticError(message)
    inverse = SparseInverse(factors=factors, scale=scale, null=null, local=local, zero=zero)
    return Decision(
        inverse=inverse,
        unused=zero & ~still,
        smallest=smallest,
        largest=largest,
        complete=complete,
        triangular=triangular,
    )


def _local(scaled: _Scaled, normal: Normal, zero: Mask) -> LocalNull:
    """Free directions of single members of the eliminated family: their diagonal block does not see them."""
    layout, gone = scaled.structure, scaled.plan.elimination
    if gone is None:
        return LocalNull(columns=slice(0, 0), members=np.empty(0, dtype=np.int64), vectors=np.empty((0, 1)))
    number = gone.family
    family = layout.families[number]
    blocks = normal.blocks[number, number].copy()
    each = np.arange(family.size)
    blocks[:, each, each] += zero[family.columns].reshape(family.members, family.size)
    curvatures, vectors = np.linalg.eigh(blocks)
    members, chosen = [], []
    for k in range(family.size):
        suspects = np.flatnonzero(curvatures[:, k] < HARDLY_SEEN)
        if not suspects.size:
            break
        trial = np.zeros(layout.columns)
        trial[family.columns].reshape(family.members, family.size)[suspects] = vectors[suspects, :, k]
        image = np.square(scaled.image(trial))
        felt = np.zeros(family.members)
        for piece in layout.pieces:
            for local, of in enumerate(piece.families):
                if of == number:
                    np.add.at(felt, piece.members[local], image[piece.residuals].reshape(piece.rows, -1).sum(axis=1))
        free = suspects[np.sqrt(felt[suspects]) <= CERTAIN]
        members.append(free)
        chosen.append(vectors[free, :, k])
    return LocalNull(
        columns=family.columns,
        members=np.concatenate(members) if members else np.empty(0, dtype=np.int64),
        vectors=np.concatenate(chosen) if chosen else np.empty((0, family.size)),
    )


def _pinned(found: Plan, normal: Normal, local: LocalNull) -> Normal:
    """The normal equations with unit weight along the free directions of single members."""
    if found.elimination is None or not len(local.members):
        return normal
    key = (found.elimination.family,) * 2
    blocks = normal.blocks[key].copy()
    np.add.at(blocks, local.members, local.vectors[:, :, None] * local.vectors[:, None, :])
    return replace(normal, blocks={**normal.blocks, key: blocks})


def _rows(local: LocalNull, columns: int) -> Any:
    """The free directions of single members as rows (k, columns) of unit weight."""
    from scipy.sparse import csr_array

    count, size = local.vectors.shape
    places = local.columns.start + local.members[:, None] * size + np.arange(size)
    return csr_array((local.vectors.reshape(-1), places.reshape(-1), np.arange(count + 1) * size), (count, columns))


def _common(
    scaled: _Scaled, factors: Factorised | None, zero: Mask, largest: float, affine: bool
) -> tuple[Floats, float, bool]:
    """Free directions (columns, g), the smallest singular value of the others, and whether all free ones were found."""
    live = int((~zero).sum())
    trials = min(TRIALS, live)
    if not trials or factors is None or largest == 0.0:
        return np.zeros((len(zero), 0)), largest, True
    while True:
        directions = np.random.default_rng(0).standard_normal((len(zero), trials))
        directions[zero] = 0.0
        for _ in range(ROUNDS):
            directions = factors.solve(orthonormal(directions))
            directions[zero] = 0.0
        basis = orthonormal(directions)
        images = [scaled.image(direction) for direction in basis.T]
        _, singular, right = np.linalg.svd(_triangle(images))
        singular, right = singular[::-1], right[::-1]
        free = free_count(singular / largest, affine)
        if free < trials or trials >= min(MOST, live):
            return basis @ right[:free].T, float(singular[min(free, trials - 1)]), free < trials
        trials = min(2 * trials, MOST, live)


def orthonormal(columns: Floats) -> Floats:
    """An orthonormal basis (n, k) of the space of the columns (n, k), k ≤ n, at any condition.

    The QR decomposition of tall matrices by parts of their rows: the triangles of the parts, one below the other, are
    decomposed again (Demmel, Grigori, Hoemmen and Langou 2012).
    """
    part = max(PART, columns.shape[1])
    parts = [np.linalg.qr(columns[first : first + part]) for first in range(0, len(columns), part)]
    joint = np.linalg.qr(np.concatenate([triangle for _, triangle in parts]))[0]
    ends = np.cumsum([len(triangle) for _, triangle in parts])
    found, first = np.empty(columns.shape), 0
    for (basis, _), turn in zip(parts, np.split(joint, ends[:-1]), strict=True):
        found[first : first + len(basis)] = basis @ turn
        first += len(basis)
    return found


def _triangle(columns: list[Floats]) -> Floats:
    """The upper triangle of a QR decomposition of a matrix given by columns, a part of the rows at a time."""
    found = np.zeros((0, len(columns)))
    for first in range(0, len(columns[0]), PART):
        part = np.stack([column[first : first + PART] for column in columns], axis=1)
        found = np.asarray(np.linalg.qr(np.concatenate([found, part]), mode="r"), dtype=np.float64)
    return found


def free_count(shares: Floats, affine: bool = False) -> int:
    """How many of the singular values (ascending, relative to the largest) are zero."""
    count, certain = 0, ROUNDED_DEPENDENCE if affine else CERTAIN
    for k, share in enumerate(shares.tolist()):
        following = float(shares[k + 1]) if k + 1 < len(shares) else 1.0
        if share <= certain or (not affine and share <= SUSPECT and share * GAP <= following):
            count = k + 1
        elif share > SUSPECT:
            break
    return count


def _shifted(factor: Factoring, added: Floats, shifts: tuple[float, ...]) -> Factorised | None:
    for shift in shifts:
        factors = factor(added + shift)
        if factors is not None:
            return factors
    return None


def _largest(scaled: _Scaled) -> float:
    """The largest singular value, to the few digits that a comparison needs: power iteration."""
    columns = scaled.structure.columns
    direction = np.full(columns, 1.0 / np.sqrt(max(columns, 1)))
    size = 0.0
    for _ in range(12):
        direction = scaled.gradient(scaled.image(direction))
        size = float(np.linalg.norm(direction))
        if size == 0.0:
            return 0.0
        direction = direction / size
    return float(np.sqrt(size))


def _pivots(null: Floats) -> Indices:
    """The columns that hold the free directions best: pivots of a QR decomposition of the directions (columns, g)."""
    rest = null.T.copy()
    found = np.empty(len(rest), dtype=np.int64)
    for k in range(len(rest)):
        lengths = np.square(rest).sum(axis=0)
        found[k] = np.argmax(lengths)
        across = rest[:, found[k]] / np.sqrt(lengths[found[k]])
        rest -= np.outer(across, across @ rest)
    return found
