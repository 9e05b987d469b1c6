"""Other minima beside those of many solves: looked for in a sample of them, and where there are some, in all.

Solves of one problem with other data have other minima in about the same places. What a sample has none of is not
looked for in the others; a solve that may have one is looked at again by itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache
from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.descent import native_sets, weighted
from mbm.estimation.batches.parts import Part
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.solve import minimum_at
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Columns, Which
from mbm.estimation.minimise.native.system import NativeSystem
from mbm.estimation.search.beside import (
    BACK,
    BOTH_ZERO,
    PLAUSIBLE,
    ROUGHLY,
    Centre,
    looks_beside,
    minima_beside,
)
from mbm.estimation.search.facing import facing
from mbm.estimation.search.twins import derived_agreement, separation
from mbm.estimation.settings import Settings
from mbm.estimation.solve.estimate import assemble
from mbm.kernels.types import KernelSet
from mbm.problem.types import Problem
from mbm.solver import description as of
from mbm.text.types import MbmError
from mbm.values import dataclass

FEWEST, MOST, SHARE = 2, 16, 500
"""Solves in the sample: one of so many, but so many at least and at most."""

WIDE = 100.0
"""Times as much as what the data do not exclude, a minimum of the sample may cost: elsewhere it may cost less."""

NOT_SO_WIDE = 2.0
"""The same where each solve has to be looked at by itself."""

TEMPLATES = 3
"""Other minima of the sample that are looked for in all solves."""

SIMILAR = 5.0
"""Standard deviations below which two of them, relative to the minima they are beside, are the same."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beside:
    """The other minima (P, N) of the sample, and the ones beside which they are (P, N).

    ``several``: each solve weighs its rows by factors of its own. ``native`` (None: constraints, corrections of
    measured columns) follows points down.
    """

    stack: Stack
    native: NativeSystem | None
    others: Floats
    owners: Floats
    estimated: bool
    several: bool

    def looked_at(self, which: range, columns: Columns) -> Columns:
        """The columns of some solves, in which none is clean that may have another minimum."""
        asked = np.flatnonzero(columns.clean)
        if not len(asked):
            return columns
        numbers, points = which.start + asked, columns.points[asked]
        factors = columns.noise[asked] if self.several else None
        native = self.native
        if native is None:
            return replace(columns, clean=np.zeros_like(columns.clean))
        if factors is not None:
            native, numbers = weighted(self.stack, native, numbers, None, factors), np.arange(len(asked))
        cost = columns.least[asked]
        variance = cost / np.maximum(columns.dof[asked], 1) if self.estimated else np.ones(len(asked))
        most = cost + PLAUSIBLE * variance + BOTH_ZERO
        found = np.zeros(len(asked), dtype=bool)
        for other, owner in zip(self.others, self.owners, strict=True):
            for starts in (np.tile(other, (len(asked), 1)), self._moved(points, other, owner)):
                ends = native.solve(starts, numbers)
                low = np.flatnonzero(ends.results[:, of.COST] <= most)
                where = Portion(self.stack, which.start + asked[low], None, None if factors is None else factors[low])
                scale = columns.scale[asked[low]] / np.sqrt(variance[low])[:, None]
                found[low] |= self._differs(where, points[low], ends.numbers[low], scale)
        clean = columns.clean.copy()
        clean[asked[found]] = False
        return replace(columns, clean=clean)

    def _moved(self, points: Floats, other: Floats, owner: Floats) -> Floats:
        """As far from points (K, N) as one minimum of the sample is from the other; rotations are those of the one."""
        moved = points + (other - owner)
        for curved in self.stack.equations.layout.curved:
            moved[:, curved.numbers] = other[curved.numbers]
        return moved

    def _differs(self, where: Portion, points: Floats, ends: Floats, scale: Floats) -> Mask:
        """Which ends (K, N) are other minima than points (K, N), not ones between which a stated start decides."""
        equations = self.stack.equations
        apart = np.square(separation(equations, points, ends) * scale).sum(axis=1)
        residuals = where.residuals(points)
        differ = np.abs(where.residuals(ends) - residuals).max(axis=1, initial=0.0)
        layout = equations.layout
        decided = (np.isfinite(layout.start) & ~layout.guessed & (ends != points)).any(axis=1)
        alike = decided & (differ <= ROUGHLY * (1.0 + np.abs(residuals).max(axis=1, initial=0.0)))
        return np.asarray((apart > BACK) & ~alike)


def sample(
    problem: Problem,
    kernels: KernelSet,
    part: Part,
    settings: Settings,
    cache: EvaluationCache,
    answers: Callable[[Which], Columns],
) -> Beside | None:
    """What to look for in all solves of a part; None where the sample has no other minima."""
    stack = part.bound
    if not looks_beside(part.first, settings, problem):
        return None
    count = min(max(stack.solves // SHARE, FEWEST), MOST)
    dear = stack.errors is not None or bool(part.first.constraints)
    wide = NOT_SO_WIDE if dear else WIDE
    unknown = [i for i, block in enumerate(problem.blocks) if block.unknown_factor]
    several = bool(unknown) and len(problem.blocks) > 1
    others: list[Floats] = []
    owners: list[Floats] = []
    picked = (2 * np.arange(count) + 1) * stack.solves // (2 * count)
    parts = ((picked[part], answers(picked[part])) for part in stack.slices(picked))
    for number, columns, place in ((n, each, k) for which, each in parts for k, n in enumerate(which.tolist())):
        if not columns.solved[place]:
            continue
        try:
            tables = part.sets.selection(number).tables
            equations, binder = assemble(problem, kernels, tables, {}, cache)
        except MbmError:
            continue  # it says so where it is solved
        if several:
            equations = equations.with_factors(_by_row(equations, columns.noise[place]))
        minimum = minimum_at(equations, columns, place)
        variance = minimum.cost / max(int(columns.dof[place]), 1) if unknown else 1.0
        about = Centre(
            minimum=minimum,
            factor=columns.factor[place],
            variance=variance,
            most=minimum.cost + wide * (PLAUSIBLE * variance + BOTH_ZERO),
            told=None,
        )
        agrees = derived_agreement(problem, binder, kernels)
        beside = minima_beside(equations, about, settings, problem, agrees)
        for each in facing(problem, tables, equations, minimum, beside):
            shifts = np.array(owners).reshape(-1, len(minimum.point)) + (each.minimum.point - minimum.point)
            apart = separation(equations, np.array(others).reshape(shifts.shape), shifts) * columns.scale[place]
            near = np.square(apart).sum(axis=1) <= SIMILAR**2 * variance
            if len(others) < TEMPLATES and not near.any():
                others.append(each.minimum.point)
                owners.append(minimum.point)
    if not others:
        return None
    native = None if dear else native_sets(stack, settings)
    return Beside(
        stack=stack,
        native=native,
        others=np.array(others),
        owners=np.array(owners),
        estimated=bool(unknown),
        several=several,
    )


def _by_row(equations: Assembled, factors: Floats) -> Floats:
    """The noise factors of all residuals, from those (blocks,) of the blocks."""
    found = np.ones(equations.whole)
    for group in equations.groups:
        found[group.first : group.first + group.count] = factors[group.kernel.owner]
    return found
