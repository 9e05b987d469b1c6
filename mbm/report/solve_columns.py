"""Many solves in columns: one value for each solve, whether there are reports of them or columns from the beginning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mbm.equations.types import Indices
from mbm.report.blocks import BlockReports, ManyReports
from mbm.report.elements import solve_scalars
from mbm.report.numbers import NUMBERS, USUAL
from mbm.report.types import Floats, Key, Mask, SolveReport, SolveStatus
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScalarColumn:
    """One scalar of all solves, in the unit shown: ``values`` and ``sigmas`` (T,); ``there`` where a solve has it.

    ``bounds`` (T, 2) are guaranteed ones; NaN where there are none.
    """

    name: str
    values: Floats
    sigmas: Floats
    there: Mask
    bounds: Floats

    @property
    def sides(self) -> Iterator[tuple[str, Floats]]:
        """What follows the name in titles, and the numbers: standard deviations, or bounds if there are any."""
        if bool(np.isnan(self.bounds).all()):
            yield ".sigma", self.sigmas
        else:
            yield from ((".low", self.bounds[:, 0]), (".high", self.bounds[:, 1]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolveColumns:
    """T solves: their keys, statuses, the numbers called `USUAL` (None: there is none), scalars in their order.

    ``stated``: no noise was estimated.
    """

    keys: Sequence[Mapping[str, Key]]
    statuses: Sequence[SolveStatus]
    fits: Mapping[str, Sequence[float | int | None]]
    scalars: tuple[ScalarColumn, ...]
    stated: bool

    @property
    def key_names(self) -> list[str]:
        """The names of all keys, in the order in which they first occur."""
        return list(dict.fromkeys(name for key in self.keys for name in key))


def solve_columns(solves: Sequence[SolveReport]) -> SolveColumns:
    """The solves in columns; those of blocks without a report for each."""
    made = _Maker(len(solves))
    if not isinstance(solves, ManyReports):
        for place, solve in enumerate(solves):
            made.add(place, solve)
        return made.finished()
    *ranks, alone = solves.ranks
    for places, block in zip(ranks, solves.blocks, strict=True):
        if len(block):
            made.add_block(places, block)
    for place, report in zip(alone.tolist(), solves.alone.values(), strict=True):
        made.add(place, report)
    return made.finished()


class _Maker:
    """Fills the columns of ``count`` solves."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.keys: list[Mapping[str, Key]] = [{}] * count
        self.statuses = [SolveStatus.CONVERGED] * count
        self.fits: dict[str, list[float | int | None]] = {name: [None] * count for name in USUAL}
        self.scalars: dict[str, ScalarColumn] = {}
        self.ranks: dict[str, tuple[int, int]] = {}
        self.stated = True

    def column(self, name: str, place: int, rank: int) -> ScalarColumn:
        """The column of a scalar, made when it is first met; its ``rank`` is that among those of the solve there."""
        self.ranks[name] = min((place, rank), self.ranks.get(name, (place, rank)))
        found = self.scalars.get(name)
        if found is None:
            values, sigmas = np.full(self.count, np.nan), np.full(self.count, np.nan)
            there, bounds = np.zeros(self.count, dtype=bool), np.full((self.count, 2), np.nan)
            found = ScalarColumn(name=name, values=values, sigmas=sigmas, there=there, bounds=bounds)
            self.scalars[name] = found
        return found

    def add(self, place: int, solve: SolveReport) -> None:
        """A solve that has a report."""
        self.keys[place] = solve.key
        self.statuses[place] = solve.status
        self.stated &= all(factor is None for factor in solve.noise.values())
        for name in USUAL:
            self.fits[name][place] = getattr(solve, name)
        for rank, scalar in enumerate(solve_scalars(solve)):
            column = self.column(scalar.name, place, rank)
            column.values[place], column.sigmas[place], column.there[place] = scalar.value, scalar.sigma, True
            if scalar.bounds is not None:
                column.bounds[place] = scalar.bounds

    def add_block(self, places: Indices, reports: BlockReports) -> None:
        """The solves of a block, which stand at ``places``."""
        columns, begin = reports.block.columns, reports.block.which.start
        for i, place in enumerate(places.tolist()):
            self.keys[place] = reports.key(i)
        self.stated &= not reports.problem.estimates_noise
        for summary in NUMBERS:
            if not summary.extra:
                fits = self.fits[summary.name]
                for place, number in zip(places.tolist(), _numbers(summary.columns(columns)), strict=True):
                    fits[place] = number
        for rank, name, own, values, sigmas in reports.scalars():
            if len(own):
                there = places[own]
                column = self.column(name, int(there[0]), rank)
                column.values[there], column.sigmas[there], column.there[there] = values, sigmas, True
        for number, report in reports.apart.items():
            self.add(int(places[number - begin]), report)

    def finished(self) -> SolveColumns:
        """What was filled."""
        return SolveColumns(
            keys=self.keys,
            statuses=self.statuses,
            fits=self.fits,
            scalars=tuple(self.scalars[name] for name in sorted(self.scalars, key=self.ranks.__getitem__)),
            stated=self.stated,
        )


def _numbers(values: Floats) -> Iterator[float | int | None]:
    """Numbers as Python has them, None in place of NaN."""
    return (None if value != value else value for value in values.tolist())
