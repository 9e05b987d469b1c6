"""Blocks of many solves as a sequence of reports: each report is made when it is asked for, columns as they are."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import overload

import numpy as np

from mbm.problem.types import BlockRole, Problem
from mbm.report.elements import element_names, shown_sigma, shown_values
from mbm.report.filled import families, filled
from mbm.report.from_solution import report_of
from mbm.report.types import DerivedValue, Estimate, Floats, Key, Mask, SolveReport, SolveStatus
from mbm.solution.many.types import Block


class BlockReports:
    """The solves of a block: reports of those that were solved apart, the others made when they are asked for.

    ``from_columns`` (K,) says which are alike but for numbers, so that columns have all that is to be said of them.
    """

    def __init__(
        self, problem: Problem, block: Block, apart: Mapping[int, SolveReport], *, covariance_full: bool
    ) -> None:
        self.problem = problem
        self.block = block
        self.apart = apart
        self._full = covariance_full
        alike = all(
            each.role is BlockRole.OBSERVATION or (each.role is BlockRole.PRIOR and each.table is None)
            for each in problem.blocks
        )
        self.from_columns: Mask = block.columns.clean & (block.columns.dof > 0) & alike

    def __len__(self) -> int:
        return len(self.block.which)

    def report(self, place: int) -> SolveReport:
        """The solve at a place (from 0) in the block."""
        found = self.apart.get(self.block.which.start + place)
        if found is not None:
            return found
        if not self.from_columns[place] or not self.complete:
            return self._made(place)
        return filled(self.model, self.items, self.problem, self.block, place)

    def _made(self, place: int) -> SolveReport:
        """The report of a solve, from all that is to be said of it."""
        solution = self.block.solution(self.block.which.start + place)
        return report_of(self.problem, solution, covariance_full=self._full)

    @cached_property
    def complete(self) -> bool:
        """Whether columns have what is to be said of priors."""
        return len(self.model.priors) == int(self.block.columns.priors.shape[1])

    @cached_property
    def model(self) -> SolveReport:
        """The report of the first solve ``from_columns``: but for numbers, those of the others are like it."""
        return self._made(int(np.flatnonzero(self.from_columns)[0]))

    @cached_property
    def items(self) -> tuple[Estimate | DerivedValue, ...]:
        """The estimates, then the derived quantities, of all solves: families over the solves."""
        return tuple(families(self.problem, self.block))

    def scalars(self) -> Iterator[tuple[str, Floats, Floats]]:
        """Name, values (K,) and sigmas (K,) of each scalar of the clean solves, in the units that are shown."""
        for item in self.items:
            values = np.reshape(shown_values(item), (len(self), -1))
            sigmas = np.reshape(shown_sigma(item), (len(self), -1))
            for i, name in enumerate(element_names(item.quantity)):
                yield name, values[:, i], sigmas[:, i]

    def key(self, place: int) -> Mapping[str, Key]:
        """The key of the solve at a place in the block."""
        cells = self.block.keys[self.block.which.start + place]
        return dict(zip(self.block.names, cells, strict=True))

    def statuses(self) -> list[SolveStatus]:
        """The status of each solve."""
        found = [SolveStatus.CONVERGED] * len(self)
        for number, report in self.apart.items():
            found[number - self.block.which.start] = report.status
        return found


class ManyReports(Sequence[SolveReport]):
    """The reports of the solves of several blocks, one after the other."""

    def __init__(self, blocks: Sequence[BlockReports]) -> None:
        self.blocks = tuple(blocks)
        self._ends = np.cumsum([len(block) for block in blocks]).tolist()

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    @overload
    def __getitem__(self, index: int) -> SolveReport: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[SolveReport]: ...

    def __getitem__(self, index: int | slice) -> SolveReport | Sequence[SolveReport]:
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        place = index + len(self) if index < 0 else index
        if not 0 <= place < len(self):
            raise IndexError(index)
        number = bisect_right(self._ends, place)
        return self.blocks[number].report(place - (self._ends[number - 1] if number else 0))

    def statuses(self) -> list[SolveStatus]:
        """The status of each solve, without making its report."""
        return [status for block in self.blocks for status in block.statuses()]

    def noted(self) -> Iterator[SolveReport]:
        """The solves of which more is to be said than their columns hold."""
        return (block.apart[number] for block in self.blocks for number in sorted(block.apart))


def block_reports(problem: Problem, block: Block, *, covariance_full: bool) -> BlockReports:
    """A block, with reports of what was solved apart."""
    apart = {number: report_of(problem, each, covariance_full=covariance_full) for number, each in block.apart.items()}
    return BlockReports(problem, replace(block, apart={}), apart, covariance_full=covariance_full)
