"""Blocks of many solves as a sequence of reports: each report is made when it is asked for, columns as they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import TypeAlias, TypeVar

import numpy as np

from mbm.equations.corrected import CorrectedColumn
from mbm.equations.layout import Layout
from mbm.equations.types import Indices
from mbm.estimation.batches.answers import REMARKED
from mbm.estimation.batches.types import Block, Corrections
from mbm.problem.types import BlockRole, Problem
from mbm.report.elements import element_names, shown_sigma, shown_values
from mbm.report.filled import families, filled
from mbm.report.from_solution import report_of
from mbm.report.later import Later, LaterByNumber
from mbm.report.residuals import column_corrections
from mbm.report.root_means import RootMeans, of_block
from mbm.report.row_data import RawResiduals
from mbm.report.types import (
    DerivedValue,
    Estimate,
    Floats,
    Key,
    Mask,
    SolveReport,
    SolveStatus,
)
from mbm.text.types import Diagnostic
from mbm.values import replace

T = TypeVar("T")
K = TypeVar("K")

Kind: TypeAlias = tuple[Layout, bytes]
"""What reports of solves are told apart by that differ in more than numbers."""

MOST_KINDS = 100
"""Kinds of solves whose models are kept: where members are told by name, each solve may be of its own."""


class BlockReports:
    """The solves of a block, those that were solved ``apart`` by their numbers.

    ``from_columns`` (K,) says which are alike but for numbers, and which constraints hold the estimates, so that
    columns have all that is to be said of them. ``models`` are the reports of those of each kind, of all blocks.
    """

    def __init__(
        self,
        problem: Problem,
        block: Block,
        apart: Mapping[int, SolveReport],
        models: dict[Kind, SolveReport],
        *,
        covariance_full: bool,
    ) -> None:
        self.problem = problem
        self.block = block
        self.apart = apart
        self._full = covariance_full
        self.from_columns: Mask = block.columns.clean & (block.columns.dof > 0)
        self._models = models

    def __len__(self) -> int:
        return len(self.block.which)

    def report(self, place: int) -> SolveReport:
        """The solve at a place (from 0) in the block."""
        found = self.apart.get(self.block.which.start + place)
        if found is not None:
            return found
        if not self.from_columns[place] or not self.complete:
            return self._made(place)
        report = filled(self.like(place), self.items, self.corrected(place), self.problem, self.block, place)
        return replace(_said(report, self.remarks(place)), raw_residuals=lambda: self.raw_residuals(place))

    def remarks(self, place: int) -> tuple[Diagnostic, ...]:
        """The warnings about the solve at a place that its numbers alone give rise to."""
        return tuple(make() for make in self.block.columns.remarks.get(place, ()))

    def raw_residuals(self, place: int) -> Mapping[str, RawResiduals]:
        """What is said of the raw residuals of each observation in the solve at a place, by its name."""
        return {name: each.of(place) for name, each in self._root_means.items()}

    @cached_property
    def _root_means(self) -> Mapping[str, RootMeans]:
        with self.block.lock:
            return of_block(self.problem, self.block)

    def corrected(self, place: int) -> tuple[CorrectedColumn, ...]:
        """The corrections of measured values in the solve at a place."""
        return column_corrections(self._corrections, place)

    @cached_property
    def _corrections(self) -> tuple[Corrections, ...]:
        with self.block.lock:
            return self.block.corrections()

    def _made(self, place: int) -> SolveReport:
        """The report of a solve, from all that is to be said of it."""
        solution = self.block.solution(self.block.which.start + place)
        return report_of(self.problem, solution, covariance_full=self._full)

    @cached_property
    def complete(self) -> bool:
        """Whether columns have what is to be said of priors: these have no rows of which some solves have fewer."""
        columns = self.block.columns
        stated = [number for number, each in enumerate(self.problem.blocks) if each.role is BlockRole.PRIOR]
        used = columns.used[self.from_columns][:, stated]
        return bool((used == used[:1]).all()) and len(self.model.priors) == int(columns.priors.shape[1])

    @cached_property
    def model(self) -> SolveReport:
        """The report of a solve like the first of those ``from_columns``, without remarks."""
        return self.like(int(np.flatnonzero(self.from_columns)[0]))

    def kind(self, place: int) -> bytes:
        """What solves ``from_columns`` are told apart by: the equations that they have rows of, the constraints that
        are pushed against, and, where more than numbers is said of members, who they are.
        """
        limits, block = self.block.columns.limits, self.block
        pushed = b"" if limits is None else limits.pushed[place].tobytes()
        if not block.members or not self._idle:
            return self._there[place] + pushed
        members = (block.member_keys(entry, place) for entry in block.layout.entries)
        return repr([self._there[place], pushed, *members]).encode()

    @cached_property
    def _there(self) -> list[bytes]:
        """Which equations and constraints have rows in use, solve by solve."""
        columns = self.block.columns
        rows = columns.used if columns.limits is None else np.hstack([columns.used, columns.limits.rows])
        return [line.tobytes() for line in rows > 0]

    @cached_property
    def _idle(self) -> bool:
        """Whether there are members that no equation mentions."""
        estimated = self.block.layout.fixed.copy()
        estimated[self.block.free] = True
        return not bool(estimated.all())

    def like(self, place: int) -> SolveReport:
        """The report of a solve ``from_columns`` of the kind of another: but for numbers, that is like it."""
        kind = self.block.layout, self.kind(place)
        found = self._models.get(kind)
        if found is None:
            found = _unremarked(self._made(place))
            kept(self._models, kind, found)
        return found

    @cached_property
    def items(self) -> tuple[Estimate | DerivedValue, ...]:
        """The estimates, then the derived quantities, of all solves: families over the solves."""
        return tuple(families(self.problem, self.block))

    def scalars(self) -> Iterator[tuple[int, str, Indices, Floats, Floats]]:
        """The scalars of the solves that are not ``apart``, in the units that are shown: rank among those of a solve,
        name, and the places (k,) in the block of the solves that have it, with values (k,) and sigmas (k,) there.
        """
        begin = self.block.which.start
        there = np.array([begin + i not in self.apart for i in range(len(self))], dtype=bool)
        every = np.flatnonzero(there)
        rank = 0
        for item in self.items:
            values = np.reshape(shown_values(item), (len(self), -1))
            sigmas = np.reshape(shown_sigma(item), (len(self), -1))
            if item.quantity.name not in self.block.members:
                for i, name in enumerate(element_names(item.quantity, self._keys(item.quantity.name, 0))):
                    yield rank + i, name, every, values[every, i], sigmas[every, i]
            else:
                found: dict[str, list[tuple[int, int]]] = {}
                for place in every.tolist():
                    for i, name in enumerate(element_names(item.quantity, self._keys(item.quantity.name, place))):
                        found.setdefault(name, []).append((place, i))
                for name, pairs in found.items():
                    places, which = np.array(pairs, dtype=np.int64).T
                    yield rank + int(which[0]), name, places, values[places, which], sigmas[places, which]
            rank += values.shape[1]

    def _keys(self, name: str, place: int) -> tuple[Key, ...] | None:
        """The keys of the members of an unknown in a solve; None where it has none."""
        entry = self.block.layout.by_name.get(name)
        return None if entry is None else self.block.member_keys(entry, place)

    def key(self, place: int) -> Mapping[str, Key]:
        """The key of the solve at a place in the block."""
        cells = self.block.keys[self.block.which.start + place]
        return dict(zip(self.block.names, cells, strict=True))

    def noted(self) -> Iterator[tuple[int, SolveReport]]:
        """The solves of which more is to be said than numbers, with their numbers among all; those ``from_columns``
        with the numbers of another.
        """
        limits, begin = self.block.columns.limits, self.block.which.start
        places = {number - begin for number in self.apart}
        if limits is not None:
            places |= set(np.flatnonzero(self.from_columns & limits.pushed.any(axis=1)).tolist())
        places |= {place for place in self.block.columns.remarks if self.from_columns[place]}
        for place in sorted(places):
            found = self.apart.get(begin + place)
            if found is None:
                like = self.like(place)
                found = replace(_said(like, self.remarks(place)), key=self.key(place))
            yield int(self.block.places[place]), found

    def statuses(self) -> list[SolveStatus]:
        """The status of each solve."""
        found = [SolveStatus.CONVERGED] * len(self)
        for number, report in self.apart.items():
            found[number - self.block.which.start] = report.status
        return found


class ManyReports(Later[SolveReport]):
    """The reports of the solves of several blocks, and of those solved ``alone``, in the order of their numbers.

    ``ranks`` has the places, from 0, of the solves of each block among all these, and of those alone.
    """

    def __init__(self, blocks: Sequence[BlockReports], alone: Mapping[int, SolveReport]) -> None:
        self.blocks = tuple(blocks)
        self.alone, self.numbers_alone = alone, tuple(alone)
        parts = [*(block.block.places for block in blocks), np.fromiter(alone, np.int64, len(alone))]
        order = np.argsort(np.concatenate(parts), kind="stable")
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        ends = np.cumsum([len(part) for part in parts])
        self.ranks: tuple[Indices, ...] = tuple(np.split(rank, ends[:-1]))
        owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])[order]
        self._owners: list[int] = owner.tolist()
        self._places: list[int] = (order - np.concatenate([[0], ends])[owner]).tolist()

    def __len__(self) -> int:
        return len(self._owners)

    def _alone(self, place: int) -> SolveReport:
        return self.alone[self.numbers_alone[place]]

    def each(
        self, of_blocks: Callable[[BlockReports], Iterator[T]], of_report: Callable[[SolveReport], T]
    ) -> Iterator[T]:
        """What is made of each solve, in their order: of those of blocks one after the other, of the others singly."""
        made = [of_blocks(block) for block in self.blocks]
        for owner, place in zip(self._owners, self._places, strict=True):
            yield next(made[owner]) if owner < len(made) else of_report(self._alone(place))

    def at(self, place: int) -> SolveReport:
        """The report at a place."""
        owner, own = self._owners[place], self._places[place]
        return self.blocks[owner].report(own) if owner < len(self.blocks) else self._alone(own)

    def statuses(self) -> list[SolveStatus]:
        """The status of each solve, without making its report."""
        return list(self.each(lambda block: iter(block.statuses()), lambda report: report.status))

    def noted(self) -> Iterator[SolveReport]:
        """The solves of which more is to be said than their columns hold."""
        found = [pair for block in self.blocks for pair in block.noted()]
        found += self.alone.items()
        return (report for _, report in sorted(found, key=lambda pair: pair[0]))


def block_reports(
    problem: Problem, block: Block, models: dict[Kind, SolveReport], *, covariance_full: bool
) -> BlockReports:
    """A block; reports of what was solved apart are made when they are asked for, too."""
    makers = {
        number: partial(report_of, problem, each, covariance_full=covariance_full)
        for number, each in block.apart.items()
    }
    apart = LaterByNumber(makers, block.lock)
    return BlockReports(problem, replace(block, apart={}), apart, models, covariance_full=covariance_full)


def _unremarked(report: SolveReport) -> SolveReport:
    """A report without the warnings that its own numbers give rise to."""
    found = report.examined()
    others = tuple(each for each in found.diagnostics if each.code.name not in REMARKED)
    return replace(report, examination=replace(found, diagnostics=others))


def _said(report: SolveReport, remarks: tuple[Diagnostic, ...]) -> SolveReport:
    """A report with further warnings before its own."""
    found = report.examined()
    return replace(report, examination=replace(found, diagnostics=(*remarks, *found.diagnostics)))


def kept(models: dict[K, T], kind: K, model: T) -> None:
    """The ``model`` among those that are kept; all others are forgotten where these are too many."""
    if len(models) >= MOST_KINDS:
        models.clear()
    models[kind] = model
