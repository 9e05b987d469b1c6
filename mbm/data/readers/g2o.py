"""g2o and TORO pose graphs: vertices with their initial poses, edges with measured relative poses and information.

Read are ``VERTEX_SE2``, ``EDGE_SE2``, ``VERTEX_SE3:QUAT``, ``EDGE_SE3:QUAT`` and ``FIX`` of g2o (Kümmerle and others
2011), ``VERTEX2``, ``EDGE2``, ``VERTEX3``, ``EDGE3`` of TORO (Grisetti and others 2007), whose Euler angles become
quaternions. ``PARAMS_…`` and ``EQUIV`` lines are passed over, and what stands behind a ``#``.

Vertices have the columns ``id x y theta`` or ``id x y z qx qy qz qw``, and ``fixed`` (1 where a ``FIX`` line names
them, else 0); edges ``from to dx dy dtheta`` or ``from to dx dy dz dqx dqy dqz dqw`` and the matrix ``information``,
**rotation first** as everywhere in mbm: for the differences ``(θ, x, y)`` or ``(ω, x, y, z)``, where files have the
rotation last. It belongs to ``R_mᵀ (t − t_m)``, the difference along the axes of the measured pose, as in g2o, GTSAM
and mbm; with ``:information from`` to ``t − t_m`` along the axes of the frame ``from``, as Ceres' example reads such
files, and is turned to mbm's. Vertices of a file that has edges only are the ids of these, in ascending order, without
numbers. Rows are the lines of the file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mbm.data.cells import row_numbers
from mbm.data.content import BLANKS, read_text
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import LARGEST_DEVIATION, Line, line_numbers, lines_of, number_columns, number_table
from mbm.data.types import ManyReader, RawTable
from mbm.problem.tables import Argument, ArgumentKind, ColumnGroup, Numbers
from mbm.rotations import matrix_of_quaternion, planar, unit
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

VERTICES, EDGES = "vertices", "edges"
INFORMATION, MEASURED, FROM = "information", "measured", "from"
SPACE = 3
PLANE_POSE = ("x", "y", "theta")
SPACE_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
EULER_POSE = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """A kind of line: the table it belongs to, the numbers of its pose, and where information entries stand.

    ``dimension`` is 2 or 3; ``information`` has the places (row, column) of the upper triangle as the file orders them.
    """

    table: str
    dimension: int
    pose: tuple[str, ...]
    information: tuple[tuple[int, int], ...] = ()


def _upper(size: int) -> tuple[tuple[int, int], ...]:
    return tuple((i, j) for i in range(size) for j in range(i, size))


TORO_ORDER = ((0, 0), (0, 1), (1, 1), (2, 2), (0, 2), (1, 2))
"""TORO's plane edges: ff fs ss rr fr sr (forward, sideward, rotation)."""

RECORDS: Mapping[str, Record] = {
    "VERTEX_SE2": Record(table=VERTICES, dimension=2, pose=PLANE_POSE),
    "VERTEX2": Record(table=VERTICES, dimension=2, pose=PLANE_POSE),
    "VERTEX_SE3:QUAT": Record(table=VERTICES, dimension=3, pose=SPACE_POSE),
    "VERTEX3": Record(table=VERTICES, dimension=3, pose=EULER_POSE),
    "EDGE_SE2": Record(table=EDGES, dimension=2, pose=PLANE_POSE, information=_upper(3)),
    "EDGE2": Record(table=EDGES, dimension=2, pose=PLANE_POSE, information=TORO_ORDER),
    "EDGE_SE3:QUAT": Record(table=EDGES, dimension=3, pose=SPACE_POSE, information=_upper(6)),
    "EDGE3": Record(table=EDGES, dimension=3, pose=EULER_POSE, information=_upper(6)),
}
FIX = "FIX"
PASSED_OVER = ("EQUIV", "PARAMS_")


def read(path: Path) -> Mapping[str, RawTable | MbmError]:
    """Read a pose graph.

    Raises MbmError as ``read_text`` does, and malformed-record, mixed-records, short-row, long-row; in the place of a
    table no-records.
    """
    with np.errstate(all="ignore"):  # numbers that are not finite are found where they are used
        return _read(path)


def _read(path: Path) -> Mapping[str, RawTable | MbmError]:
    text, digest = read_text(path, between=BLANKS)
    shown = path.as_posix()
    by_tag = _by_tag(lines_of(text), shown)
    fixed = {field for _, fields in by_tag.pop(FIX, []) for field in fields}
    dimension = RECORDS[next(iter(by_tag))].dimension if by_tag else 2
    edges = _table(by_tag, EDGES, shown)
    vertices = _table(by_tag, VERTICES, shown)
    found: dict[str, RawTable | MbmError] = {}
    if len(edges.rows):
        found[EDGES] = _edges(edges, dimension, shown, digest)
    else:
        found[EDGES] = MbmError(format_faults.no_records(DataPlace(file=shown), "edges"))
    if len(vertices.rows):
        found[VERTICES] = _vertices(vertices, dimension, fixed, shown, digest)
    elif len(edges.rows):
        ids = np.unique(edges.numbers[:, :2])
        unknown = np.full((len(ids), len(_pose(dimension))), np.nan)
        made = _Records(rows=row_numbers(1, len(ids)), numbers=np.column_stack([ids, unknown]))
        found[VERTICES] = _vertices(made, dimension, fixed, shown, digest)
    else:
        found[VERTICES] = MbmError(format_faults.no_records(DataPlace(file=shown), "vertices"))
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Records:
    """Records of one table: lines, and numbers (n, k): ids, pose (Euler angles turned to quaternions), information."""

    rows: np.ndarray
    numbers: Numbers


def _by_tag(lines: Sequence[Line], path: str) -> dict[str, list[Line]]:
    """The lines by their first field, which the lines given back lack; records of one dimension only."""
    found: dict[str, list[Line]] = {}
    first: tuple[str, int] | None = None
    for number, (tag, *fields) in lines:
        if tag in RECORDS:
            if first is None:
                first = (tag, number)
            elif RECORDS[tag].dimension != RECORDS[first[0]].dimension:
                place = DataPlace(file=path, row=number)
                raise MbmError(format_faults.mixed_records(place, tag, *first))
        elif tag.startswith(PASSED_OVER):
            continue
        elif tag != FIX:
            known = ", ".join(f"`{each}`" for each in RECORDS)
            reason = f"{format_faults.shown(tag)} is no kind of line that is read; those are {known} and `{FIX}`"
            raise MbmError(format_faults.malformed_record(DataPlace(file=path, row=number), reason))
        found.setdefault(tag, []).append((number, fields))
    return found


def _pose(dimension: int) -> tuple[str, ...]:
    return SPACE_POSE if dimension == SPACE else PLANE_POSE


def _table(by_tag: Mapping[str, list[Line]], table: str, path: str) -> _Records:
    """The records of all kinds that belong to a table, in the order of the lines."""
    rows, numbers = [], []
    for tag, lines in by_tag.items():
        record = RECORDS[tag]
        if record.table != table:
            continue
        count = 1 if table == VERTICES else 2
        ids = ("id",) if table == VERTICES else ("from", "to")
        entries = tuple(f"information entry {k + 1}" for k in range(len(record.information)))
        found = number_table(lines, (*ids, *record.pose, *entries), path)
        _check_ids(found[:, :count], lines, ids, path)
        pose = found[:, count : count + len(record.pose)]
        if record.pose is EULER_POSE:
            pose = np.column_stack([pose[:, :3], _euler_quaternions(pose[:, 3:])])
        if record.dimension == SPACE:
            _check_quaternions(pose[:, 3:], lines, path)
        entries_found = found[:, count + len(record.pose) :]
        numbers.append(np.column_stack([found[:, :count], pose, _rotation_first(entries_found, record)]))
        rows.append(line_numbers(number for number, _ in lines))
    if not rows:
        return _Records(rows=np.empty(0, dtype=np.int64), numbers=np.empty((0, 0)))
    order = np.argsort(np.concatenate(rows), kind="stable")
    return _Records(rows=np.concatenate(rows)[order], numbers=np.vstack(numbers)[order])


def _check_ids(ids: Numbers, lines: Sequence[Line], names: tuple[str, ...], path: str) -> None:
    wrong = np.argwhere(~np.isfinite(ids) | (ids != np.floor(ids)))
    if len(wrong):
        row, column = (int(i) for i in wrong[0])
        place = DataPlace(file=path, row=lines[row][0], column=names[column])
        reason = f"`{names[column]}` is {ids[row, column]:g}, no whole number"
        raise MbmError(format_faults.malformed_record(place, reason))


def _check_quaternions(quaternions: Numbers, lines: Sequence[Line], path: str) -> None:
    """What is far from length 1 is no rotation."""
    lengths = np.sqrt(np.square(quaternions).sum(axis=1))
    wrong = np.flatnonzero(~(np.abs(lengths - 1) < LARGEST_DEVIATION))
    if wrong.size:
        row = int(wrong[0])
        reason = f"its quaternion has the length {lengths[row]:g}, not 1"
        raise MbmError(format_faults.malformed_record(DataPlace(file=path, row=lines[row][0]), reason))


def _rotation_first(entries: Numbers, record: Record) -> Numbers:
    """Information entries (n, k) of the upper triangle, with the rotation's rows and columns before the others'."""
    if not record.information:
        return entries
    size = 1 + max(column for _, column in record.information)
    turned = 1 if record.dimension != SPACE else SPACE
    # where row i of the file's order (position, rotation) comes to stand
    stands = [*range(turned, size), *range(turned)]
    place = {tuple(sorted((stands[i], stands[j]))): k for k, (i, j) in enumerate(record.information)}
    return entries[:, [place[pair] for pair in _upper(size)]]


def _vertices(records: _Records, dimension: int, fixed: set[str], path: str, digest: str) -> RawTable:
    names = ("id", *_pose(dimension), "fixed")
    fixed_ids = {float(field) for field in fixed if field.lstrip("+-").isdigit()}
    is_fixed = np.array([float(each in fixed_ids) for each in records.numbers[:, 0].tolist()])
    numbers = np.column_stack([records.numbers, is_fixed])
    rows = line_numbers(records.rows)
    return RawTable(path=path, sha256=digest, columns=number_columns(names, numbers), file_rows=rows, key="id")


def _edges(records: _Records, dimension: int, path: str, digest: str) -> RawTable:
    size = 6 if dimension == SPACE else 3
    places = _upper(size)
    entries = tuple(f"information{i + 1}{j + 1}" for i, j in places)
    names = ("from", "to", *(f"d{name}" for name in _pose(dimension)), *entries)
    square = tuple(entries[places.index((min(i, j), max(i, j)))] for i in range(size) for j in range(size))
    return RawTable(
        path=path,
        sha256=digest,
        columns=number_columns(names, records.numbers),
        file_rows=line_numbers(records.rows),
        groups={INFORMATION: ColumnGroup(shape=(size, size), columns=square)},
    )


def told(table: RawTable, arguments: Mapping[str, float | str]) -> RawTable:
    """The edges with the information as the data clause says that the file has it."""
    return _along_the_measured(table) if arguments.get(INFORMATION) == FROM else table


def _along_the_measured(edges: RawTable) -> RawTable:
    """Edges with the translation's information turned to the axes of the measured frame: ``TᵀΩT``, T = (1, R_m)."""
    cells = {column.name: column.numbers for column in edges.columns}
    group = edges.groups[INFORMATION]
    size = group.shape[0]
    given = np.stack([np.asarray(cells[name]) for name in group.columns], axis=-1).reshape(-1, size, size)
    turn = np.tile(np.eye(size), (len(given), 1, 1))
    first = size // 2
    if first == SPACE:
        pose = np.stack([np.asarray(cells[name]) for name in ("dqw", "dqx", "dqy", "dqz")], axis=-1)
        turn[:, first:, first:] = matrix_of_quaternion(unit(pose))
    else:
        turn[:, first:, first:] = planar(np.asarray(cells["dtheta"]))
    found = np.einsum("nji,njk,nkl->nil", turn, given, turn).reshape(len(given), -1)
    turned = dict(zip(group.columns, found.T, strict=True))
    columns = tuple(replace(c, numbers=turned[c.name]) if c.name in turned else c for c in edges.columns)
    return replace(edges, columns=columns)


def _euler_quaternions(angles: Numbers) -> Numbers:
    """Quaternions (n, 4), real part last, of roll, pitch and yaw (n, 3): Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, cp, cy = np.cos(angles / 2).T
    sr, sp, sy = np.sin(angles / 2).T
    return np.column_stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


READER = ManyReader(
    name="g2o",
    extensions=(".g2o", ".graph"),
    parts=(VERTICES, EDGES),
    read=read,
    of_part={
        EDGES: (
            Argument(
                name=INFORMATION,
                kind=ArgumentKind.WORD,
                required=False,
                default=MEASURED,
                choices=(MEASURED, FROM),
            ),
        )
    },
    told=told,
)
