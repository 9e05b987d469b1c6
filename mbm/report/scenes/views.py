"""Where each camera stood and what it saw, whatever the equations say it with. Expressions at the estimates, for the
rows of a group of equations; some unknowns may be put elsewhere.

A projection knows the point X_c in the frame of its camera. As a function of one pose T = (R, t) of the problem that
is ``A T(X) + b``, or ``A T⁻¹(X) + b`` where T is the pose of the camera in the world; A and b are what else moves the
point (a rig, a hand). All of it follows from values: with t = 0 and R the identity and the three half turns, whose sum
is zero, the mean of X_c is b; by t it changes by A, or by −A with R the identity; and A is a rotation, so that its
determinant tells the two apart. Then X follows, also where it is no unknown but data.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import TypeAlias

import numpy as np

from mbm.equations.binding import Group
from mbm.estimation.search.solution import Solution
from mbm.expression.nodes import Column, ColumnMember, Component, Expression, Member, externals, leaves
from mbm.expression.projection import Projection
from mbm.problem.naming import key_text
from mbm.problem.rows import member_cells
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import BlockRole, Problem, UnknownKind
from mbm.report.root_means import rows_of
from mbm.report.scenes import faults
from mbm.report.types import Floats, Mask
from mbm.rotations import matrix_of_quaternion, unit
from mbm.text.types import MbmError
from mbm.values import dataclass


class RowsOf:
    """The rows (R,) of a group, at the estimates of a solution."""

    def __init__(self, problem: Problem, solution: Solution, group: Group) -> None:
        self.problem, self.solution, self.group = problem, solution, group
        self.rows = rows_of(problem, solution, group)

    def values(self, roots: Sequence[Expression], instead: Mapping[str, Sequence[float]] | None = None) -> Floats:
        """The values (R, k) of expressions; unknowns named in ``instead`` have those numbers in all rows."""
        return self.rows.values(roots, instead)

    def unknowns(self, roots: tuple[Expression, ...], kind: UnknownKind, size: int) -> dict[str, Member | None]:
        """The unknowns of a kind and size that expressions use, with the members that they pick, in their order."""
        used = {leaf.unknown: leaf.member for leaf in leaves(roots) if isinstance(leaf, Component)}
        wanted = [u.name for u in self.problem.unknowns if u.kind is kind and u.size == size]
        return {name: used[name] for name in wanted if name in used}

    def member_table(self, leaf: Component | Column) -> Table | None:
        """The table that has a row for each of the members among which a leaf picks, by its key."""
        if isinstance(leaf, Column):
            return self.solution.tables.get(leaf.table)
        family = self.solution.layout.entry(leaf.unknown).unknown.family
        return None if family is None else self.solution.tables.get(family.rows)

    def places(self, table: Table, member: Member | None) -> list[int]:
        """The positions (R,) in a table of the members that are picked, by its key; -1 where it has none."""
        place = {key: i for i, key in enumerate(table.keys())}
        return [place.get(key, -1) for key in self.keys(member)]

    def keys(self, member: Member | None) -> list[CellKey]:
        """The keys (R,) of the members that are picked; one text for all where there is no family."""
        if member is None:
            return [""] * self.group.rows
        if isinstance(member, ColumnMember):
            cells = member_cells(member, self.rows.table, self.group.positions, self.solution.tables)
            return cells if len(cells) == self.group.rows else cells * self.group.rows
        return [member.key] * self.group.rows

    def key_texts(self, members: Sequence[Member | None]) -> list[str]:
        """The keys of several members (R,), one behind the other."""
        columns = [[shown_key(key) for key in self.keys(member)] for member in members if member is not None]
        return ["-".join(parts) for parts in zip(*columns, strict=True)] if columns else [""] * self.group.rows


def shown_key(key: CellKey) -> str:
    """A key as a name."""
    return key if isinstance(key, str) else key_text(key)


Photographs: TypeAlias = list[tuple[str, tuple[int, int]]]
"""The name of the file, width and height of an image, for each row."""

_RIGID = 1e-6
"""How far, relative to the distances at hand, a point may be from where a rigid motion puts it: rounding is 1e-12."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Views:
    """Rows (R,) of one equation that is the image of a point.

    ``rotation`` (R, 3, 3) and ``translation`` (R, 3) lead from the world to the camera, in the axes of the camera;
    ``world`` (R, 3) are the points. ``pose`` is the unknown that says where the camera was, ``outward``: it leads
    from the camera to the world. ``photo`` and ``camera`` (R,) name the members of poses and of the camera, ``file``
    (R,) the image if that is known, else "", ``point`` that of the family of points (None: they are in none).
    ``numbers`` (R, n) are those of the camera. ``measured`` (R, 2), None where it is not data; ``residual`` (R, 2);
    ``used`` (R,).
    """

    projection: Projection
    pose: str
    outward: bool
    rotation: Floats
    translation: Floats
    world: Floats
    photo: list[str]
    file: list[str]
    camera: list[str]
    point: list[str] | None
    numbers: Floats
    measured: Floats | None
    residual: Floats
    used: Mask
    size: tuple[Floats, Floats] | None


def views(problem: Problem, solution: Solution, form: str) -> list[Views]:
    """All images of points in the observations of a solve; ``form`` is the format that is to be written.

    Raises:
        MbmError: format-needs: there are none, or no pose says where the camera was.

    """
    found = list(_views(problem, solution, form))
    if not found:
        raise MbmError(faults.format_needs(form, "an observation `(= [u v] (project CAMERA POINT))`"))
    return found


def _views(problem: Problem, solution: Solution, form: str) -> Iterator[Views]:
    for group in solution.groups:
        block = problem.blocks[group.kernel.owner]
        if block.role is not BlockRole.OBSERVATION or not group.rows:
            continue
        rows, first = RowsOf(problem, solution, group), 0
        values = group.written.values(solution.numbers).copy()
        counts = np.ones(values.shape, dtype=bool)
        if solution.weights is not None:
            counts = solution.weights[group.first : group.first + group.count].reshape(values.shape) > 0.0
        if solution.outliers is not None:
            counts &= ~solution.outliers[group.first : group.first + group.count].reshape(values.shape)
        for equation in block.cases[group.kernel.case].equations:
            mine = slice(first, first + len(equation.components))
            first = mine.stop
            if equation.projection is None:
                continue
            if any(externals((*equation.projection.point, *equation.projection.focal))):
                raise MbmError(faults.format_needs(form, "points and cameras that no function in Python computes"))
            measured = None if equation.measured is None else rows.values(equation.measured)
            yield _view(rows, equation.projection, form, (measured, values[:, mine], counts[:, mine].min(axis=1)))


def _view(rows: RowsOf, projection: Projection, form: str, seen: tuple[Floats | None, Floats, Mask]) -> Views:
    """The views of one equation; ``seen`` is measured, residual, used."""
    poses = rows.unknowns(projection.point, UnknownKind.POSE, 7)
    if not poses:
        raise MbmError(faults.format_needs(form, f"a pose (`(pose 3)`) by which `{projection.camera}` sees its points"))
    pose = next((name for name, member in poses.items() if member is not None), next(iter(poses)))
    outward, rotation, translation, world = _moved(rows, projection, pose, form)
    numbers = (*projection.focal, *projection.center, *projection.distortion)
    members, photographs = _members(numbers), _photographs(rows)
    return Views(
        projection=projection,
        pose=pose,
        outward=outward,
        rotation=rotation,
        translation=translation,
        world=world,
        photo=rows.key_texts(list(poses.values())),
        file=_files(rows, poses, photographs),
        camera=rows.key_texts(members),
        point=_point_keys(rows, projection, world),
        numbers=rows.values(numbers),
        measured=seen[0],
        residual=seen[1],
        used=seen[2],
        size=_size(rows, numbers, photographs),
    )


def _moved(rows: RowsOf, projection: Projection, pose: str, form: str) -> tuple[bool, Floats, Floats, Floats]:
    """Whether the pose leads outwards, rotation and translation of the camera, and the points in the world."""

    def at(turn: int, along: int | None = None) -> Floats:
        numbers = np.zeros(7)
        numbers[turn] = 1.0
        if along is not None:
            numbers[4 + along] = 1.0
        return rows.values(projection.point, {pose: numbers.tolist()})

    still = at(0)
    moves = np.stack([at(0, along) - still for along in range(3)], axis=2)
    offset = (still + at(1) + at(2) + at(3)) / 4
    outward = bool((np.linalg.det(moves) < 0).all())
    own = -moves if outward else moves
    world = np.einsum("rji,rj->ri", own, still - offset)
    numbers = _pose_numbers(rows, projection, pose)
    turn, along = matrix_of_quaternion(unit(numbers[:, :4])), numbers[:, 4:]
    rotation = own @ (turn.transpose(0, 2, 1) if outward else turn)
    translation = offset - np.einsum("rij,rj->ri", rotation, along)
    if not outward:
        translation = offset + np.einsum("rij,rj->ri", own, along)
    there = rows.values(projection.point)
    found = np.einsum("rij,rj->ri", rotation, world) + translation
    size = np.abs(there).max(initial=0.0) + np.abs(world).max(initial=0.0)
    square = np.einsum("rij,rkj->rik", own, own) - np.eye(3)
    if not (np.abs(found - there).max(initial=0.0) <= _RIGID * size and np.abs(square).max(initial=0.0) <= _RIGID):
        raise MbmError(faults.format_needs(form, f"points that the pose `{pose}` moves as they are, by no scale"))
    return outward, rotation, translation, world


def _pose_numbers(rows: RowsOf, projection: Projection, pose: str) -> Floats:
    """The seven numbers (R, 7) of the pose of each row."""
    member = rows.unknowns(projection.point, UnknownKind.POSE, 7)[pose]
    return rows.values(tuple(Component(pose, (i,), member) for i in range(1, 8)))


def _members(numbers: tuple[Expression, ...]) -> list[Member]:
    """The members that the numbers of a camera belong to: its key."""
    found = [leaf.member for leaf in leaves(numbers) if isinstance(leaf, Component | Column)]
    return list(dict.fromkeys(member for member in found if member is not None))


def _size(rows: RowsOf, numbers: tuple[Expression, ...], photographs: Photographs) -> tuple[Floats, Floats] | None:
    """Width and height (R,) where the table of the cameras has such columns, or the rows were read from images."""
    for leaf in leaves(numbers):
        if not isinstance(leaf, Component | Column) or leaf.member is None:
            continue
        table = rows.member_table(leaf)
        if table is None or not {"width", "height"} <= set(table.columns):
            continue
        which = rows.places(table, leaf.member)
        if min(which, default=-1) >= 0:
            return table.numbers("width")[which], table.numbers("height")[which]
    if not photographs:
        return None
    width, height = np.array([pixels for _, pixels in photographs], dtype=np.float64).T
    return width, height


def _photographs(rows: RowsOf) -> Photographs:
    """The photographs (R,) that rows were measured in; none where any is from elsewhere."""
    own, positions = rows.rows.table, rows.group.positions
    if own is None or positions is None:
        return []
    sources = [own.source(int(position)) for position in positions]
    found = [(PurePath(each.path).name, each.pixels) for each in sources if each.pixels is not None]
    return found if len(found) == len(sources) else []


def _files(rows: RowsOf, poses: Mapping[str, Member | None], photographs: Photographs) -> list[str]:
    """The file (R,) of each image, as the rows were read from it, or as a column `name` of the poses' table says."""
    if photographs:
        return [name for name, _ in photographs]
    for pose, member in poses.items():
        table = rows.member_table(Component(pose, (1,), member))
        if table is None or "name" not in table.columns or table.columns["name"].texts is None:
            continue
        which, texts = rows.places(table, member), table.columns["name"].texts
        return [texts[i] if i >= 0 else "" for i in which]
    return [""] * rows.group.rows


def _point_keys(rows: RowsOf, projection: Projection, world: Floats) -> list[str] | None:
    """The keys of the family that holds the points, known by its values."""
    scale = np.abs(world).max(initial=0.0)
    for name, member in rows.unknowns(projection.point, UnknownKind.VECTOR, 3).items():
        if member is None:
            continue
        numbers = rows.values(tuple(Component(name, (i,), member) for i in (1, 2, 3)))
        if np.abs(numbers - world).max(initial=0.0) <= _RIGID * scale:
            return [shown_key(key) for key in rows.keys(member)]
    return None
