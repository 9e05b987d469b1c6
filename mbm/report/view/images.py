"""Measured image points beside those that the answer predicts, with the uncertainty of the prediction. The values of
expressions at an answer, row by row.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeVar

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.gathering import picked_members
from mbm.equations.layout import places_in
from mbm.estimation.search.solution import Solution
from mbm.expression.evaluate import Lookup, Values, evaluate
from mbm.expression.nodes import Column, ColumnMember, Component, Expression, Leaf, Parameter, leaves
from mbm.expression.rows import RowChoice
from mbm.problem.rows import Positions, lookup, member_cells
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.report.types import Floats, Mask
from mbm.report.view.seeings import ContourSeeing, CurveSeeing, LineSeeing, Seeing, Sight
from mbm.text.printer import plain_number
from mbm.values import dataclass


def answer_lookup(
    solution: Solution,
    table: Table | None,
    positions: Positions | None,
    given: Mapping[Parameter, Floats] | None = None,
) -> Lookup:
    """Values of leaves at the estimates, for the rows at ``positions``; parameters are ``given``."""
    data = lookup(table, positions, solution.tables)

    def value(leaf: Leaf) -> Values:
        if isinstance(leaf, Component):
            return _component(leaf, solution, table, positions)
        if isinstance(leaf, Parameter):
            if given is None or leaf not in given:
                raise TypeError(leaf)
            return given[leaf]
        return data(leaf)

    return value


def stepped(known: Lookup, target: object, step: float) -> Lookup:
    """Values where the leaf of the identity ``target`` is greater by ``step``."""

    def value(leaf: Leaf) -> Values:
        found = known(leaf)
        return found + step if isinstance(leaf, Column | Component) and leaf.identity == target else found

    return value


def _component(leaf: Component, solution: Solution, table: Table | None, positions: Positions | None) -> Values:
    entry = solution.layout.entry(leaf.unknown)
    shape = entry.unknown.shape
    within = int(np.ravel_multi_index(tuple(i - 1 for i in leaf.index), shape)) if shape else 0
    member = 0 if leaf.member is None else picked_members(entry, leaf.member, table, positions, solution.tables)
    found = solution.numbers[entry.offset + np.asarray(member) * entry.unknown.size + within]
    return float(found) if np.ndim(found) == 0 else np.asarray(found)


def values_of(elements: tuple[Expression, ...], known: Lookup, rows: int) -> Floats:
    """Values (rows, n) of expressions."""
    return np.stack([np.broadcast_to(v, rows) for v in evaluate(elements, known)], axis=1).astype(np.float64)


MOST_COVARIANCES = 400
"""Predictions of one picture whose covariance is computed."""

Names = tuple[str, ...]
AnySeeing = TypeVar("AnySeeing", Seeing, ContourSeeing, CurveSeeing, LineSeeing)

_FRAMES = {
    "opencv": np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]),
    "paper": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "opengl": np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]),
}
"""Right, up and forward in the frame of a camera, by its axes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageRows:
    """Rows of one equation, and what a camera sees of them at the answer.

    ``measured`` and ``predicted`` (n, 2) in the unit of the image; ``covariance`` (n, 2, 2) that of the prediction, NaN
    where it is not known; ``points`` (n, 3) in the frames of their cameras. ``photo`` names the image of each row,
    ``columns`` are those of the table that hold these names.
    """

    seeing: Seeing
    clause: str
    table: Table | None
    positions: np.ndarray | None
    measured: Floats
    predicted: Floats
    covariance: Floats
    points: Floats
    used: Mask
    outlier: Mask
    photo: Names

    @property
    def sight(self) -> Sight:
        """The camera and what it sees."""
        return self.seeing.sight


def right_up_forward(axes: str) -> Floats:
    """The directions (3, 3) of a camera in its own frame."""
    return _FRAMES[axes]


def image_rows(problem: Problem, solution: Solution, seeings: Sequence[Seeing]) -> Iterator[ImageRows]:
    """The rows of all equations that compare image points."""
    for seeing, group, table in with_groups(problem, solution, seeings):
        yield _rows(solution, seeing, group, table, problem.blocks[seeing.at.block].name)


def with_groups(
    problem: Problem, solution: Solution, seeings: Sequence[AnySeeing]
) -> Iterator[tuple[AnySeeing, Group, Table | None]]:
    """Equations about images with each group of rows that they have, and the table of these."""
    for seeing in seeings:
        table = problem.blocks[seeing.at.block].table
        for group in solution.groups:
            if (group.kernel.owner, group.kernel.case) == (seeing.at.block, seeing.at.case) and group.rows:
                yield seeing, group, None if table is None else solution.tables[table]


def _rows(solution: Solution, seeing: Seeing, group: Group, table: Table | None, clause: str) -> ImageRows:
    sight = seeing.sight
    known = answer_lookup(solution, table, group.positions)
    predicted = values_of(sight.image, known, group.rows)
    own = slice(seeing.at.output, seeing.at.output + 2)
    with solution.lock:
        residual = group.written.values(solution.numbers)[:, own] * seeing.sign
    lines = np.arange(group.first, group.first + group.count).reshape(group.rows, -1)[:, own]
    every = np.ones(group.rows, dtype=bool)
    return ImageRows(
        seeing=seeing,
        clause=clause,
        table=table,
        positions=group.positions,
        measured=predicted - residual,
        predicted=predicted,
        covariance=_covariances(solution, group, own),
        points=values_of(sight.point, known, group.rows),
        used=every if solution.weights is None else np.asarray((solution.weights[lines] > 0.0).all(axis=1)),
        outlier=~every if solution.outliers is None else np.asarray(solution.outliers[lines].any(axis=1)),
        photo=_photos(sight, table, group, solution),
    )


@np.errstate(all="ignore")
def _covariances(solution: Solution, group: Group, own: slice) -> Floats:
    """J Σ Jᵀ (n, 2, 2) of the predictions; NaN for large problems, many rows, and where nothing is known."""
    found = np.full((group.rows, 2, 2), np.nan)
    factor, free = solution.covariance.factor, len(solution.free)
    if not solution.sigma_known or not free or factor.shape[0] != free or group.rows > MOST_COVARIANCES:
        return found
    columns = places_in(solution.free, len(solution.layout.number))
    spread = group.dense_jacobian(solution.numbers, columns, free)[:, own] @ factor
    return np.asarray(spread @ spread.transpose(0, 2, 1))


def _photos(sight: Sight, table: Table | None, group: Group, solution: Solution) -> Names:
    """The image of each row: what keys of families make its camera and the pose of that, but for those of points."""
    names = [_texts(member, table, group, solution) for member in dict.fromkeys(_members(sight))]
    return tuple(" ".join(dict.fromkeys(parts)) for parts in zip(*names, strict=True)) or ("",) * group.rows


def _members(sight: Sight) -> Iterator[ColumnMember]:
    """The members, by keys of the rows, that are no points: of families that the lens needs, and of those that turn."""
    plain = points_seen(sight.point) if sight.family is None else {sight.family}
    for leaf in leaves((*sight.lens, *sight.point)):
        if isinstance(leaf, Component) and isinstance(leaf.member, ColumnMember) and leaf.unknown not in plain:
            yield leaf.member
        if isinstance(leaf, Column) and leaf.row is RowChoice.KEYED and isinstance(leaf.member, ColumnMember):
            yield leaf.member


def points_seen(formulas: Sequence[Expression]) -> frozenset[str]:
    """Families of three numbers that are the only ones of their key: the points that are seen, not where from."""
    keys: dict[object, set[str]] = {}
    sizes: dict[str, int] = {}
    for leaf in leaves(tuple(formulas)):
        if isinstance(leaf, Component) and leaf.member is not None:
            keys.setdefault(leaf.member, set()).add(leaf.unknown)
            sizes[leaf.unknown] = max(sizes.get(leaf.unknown, 0), *leaf.index, 0)
    if len(keys) < 2:
        return frozenset()
    return frozenset(name for names in keys.values() if len(names) == 1 for name in names if sizes[name] == 3)


def _texts(member: ColumnMember, table: Table | None, group: Group, solution: Solution) -> list[str]:
    texts = [key_text(cell) for cell in member_cells(member, table, group.positions, solution.tables)]
    return texts if len(texts) == group.rows else texts * group.rows


def key_text(key: CellKey) -> str:
    """A key as people read it."""
    return key if isinstance(key, str) else str(plain_number(key))
