"""Which equation lays an estimated trajectory on a reference, and the poses of both at the estimates.

MEASURED says what the reference is: its position, a vector of two or three columns of the row, or its pose. MODEL is
the aligned estimate. How it turns the estimate follows from how it moves with the estimate's coordinates: the matrix
of its derivatives by them is a rotation, times the scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbm.equations.at_rows import AtRows, rows_at
from mbm.equations.binding import Group
from mbm.equations.layout import Layout
from mbm.expression.algebra import number
from mbm.expression.derivative import substituted
from mbm.expression.nodes import Column, Expression, Leaf, leaves
from mbm.expression.rows import RowChoice
from mbm.problem.tables import POSITION, Table
from mbm.problem.types import Block, BlockRole, Equation, Problem
from mbm.report.trajectories import faults
from mbm.report.trajectories.types import Floats, Indices, Path
from mbm.rotations import exponential, matrix_of_quaternion, nearest, planar, unit
from mbm.text.types import MbmError
from mbm.values import dataclass

QUATERNION = ("qw", "qx", "qy", "qz")
HEADINGS = ("theta", "th", "yaw", "heading")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Place:
    """Where a problem stands: its groups of equations, and the numbers of the unknowns."""

    problem: Problem
    groups: tuple[Group, ...]
    layout: Layout
    numbers: Floats
    tables: Mapping[str, Table]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Laid:
    """The poses of both sides at the rows (n,) of the table, from 0, that the observation uses, in their order.

    ``sides`` are what the names of the columns begin with, the estimate's first; ``unit`` is that of lengths.
    """

    table: Table
    positions: Indices
    reference: Path
    estimate: Path
    sides: tuple[str, str]
    unit: str | None
    factor: float


def trajectory_blocks(problem: Problem) -> tuple[Block, ...]:
    """The observations that lay a trajectory on another."""
    return tuple(block for block in problem.blocks if _equation(block) is not None)


def laid(place: Place, block: Block) -> Laid:
    """Both trajectories, for the rows that are used.

    Raises:
        MbmError: no-trajectory: no row is used; no-rotation: a quaternion is no rotation.

    """
    owner = next(i for i, each in enumerate(place.problem.blocks) if each is block)
    groups = [g for g in place.groups if g.kernel.owner == owner and g.rows]
    equation = _equation(block)
    if not groups or equation is None or block.table is None:
        raise MbmError(faults.no_trajectory(block.span, f"`{block.name}` has no rows"))
    reference_side, estimate_side = _sides(equation, block)
    found = [_of_group(place, block, group, (reference_side, estimate_side)) for group in groups]
    positions = np.concatenate([g.positions for g in groups if g.positions is not None])
    order = np.argsort(positions, kind="stable")
    paths = [_joined([each[side] for each in found], order) for side in (0, 1)]
    stated = equation.units[-1] if equation.units else None
    return Laid(
        table=place.tables[block.table],
        positions=positions[order],
        reference=paths[0],
        estimate=paths[1],
        sides=(estimate_side, reference_side),
        unit=None if stated is None else stated.symbol,
        factor=1.0 if stated is None else stated.scale.factor,
    )


def _joined(parts: Sequence[Path], order: Indices) -> Path:
    turned = [part.rotations for part in parts if part.rotations is not None]
    whole = Path(
        positions=np.concatenate([part.positions for part in parts]),
        rotations=np.concatenate(turned) if len(turned) == len(parts) else None,
    )
    return whole.take(order)


def _equation(block: Block) -> Equation | None:
    """The equation of a block that compares positions or poses of two trajectories, if that is what it does."""
    if block.role is not BlockRole.OBSERVATION or block.table is None or not block.cases:
        return None
    equations = [case.equations for case in block.cases]
    if any(len(each) != 1 for each in equations):
        return None
    (equation,) = equations[0]
    if not _is_pose(equation) and (equation.measured is None or len(equation.components) not in (2, 3)):
        return None
    return equation if _names(equation, block) is not None else None


def _is_pose(equation: Equation) -> bool:
    """Whether components are those of a pose: a rotation first, one number of it in the plane."""
    return equation.measured is None and len(equation.components) in (3, 6) and bool(equation.measured_columns)


def _names(equation: Equation, block: Block) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """The columns of the reference and of the estimate, where each has those of one thing."""
    measured = equation.measured_columns
    found = [
        leaf.name
        for leaf in leaves(equation.components)
        if isinstance(leaf, Column) and leaf.row is RowChoice.EACH and leaf.table == block.table
    ]
    model = tuple(dict.fromkeys(name for name in found if name not in measured))
    sides = (_side(measured), _side(model))
    return (measured, model) if None not in sides and sides[0] != sides[1] else None


def _side(columns: Sequence[str]) -> str | None:
    """What the names of a position's columns begin with: ``ref.`` of ``ref.x ref.y``."""
    begins = {name[: -len(last)] for name in columns for last in POSITION if name.endswith(last)}
    held = set(columns)
    begins = {b for b in begins if {f"{b}{axis}" for axis in POSITION[:2]} <= held and f"{b}w" not in held}
    return next(iter(begins)) if len(begins) == 1 else None


def _sides(equation: Equation, block: Block) -> tuple[str, str]:
    names = _names(equation, block)
    sides = [_side(each) for each in names or ()]
    if len(sides) != 2 or sides[0] is None or sides[1] is None:
        raise TypeError(block.name)
    return sides[0], sides[1]


def _of_group(place: Place, block: Block, group: Group, sides: tuple[str, str]) -> tuple[Path, Path]:
    """The reference and the aligned estimate in the rows of a group."""
    (equation,) = block.cases[group.kernel.case].equations
    rows = rows_at(place.problem, group, place.layout, place.tables, place.numbers)
    apart = group.values(place.numbers).copy()
    measured_side, model_side = sides
    size = _size(equation)
    turned = _rotations(rows, measured_side, size)
    if _is_pose(equation):
        spin = exponential(apart[:, :3]) if size == 3 else planar(apart[:, 0])
        if turned is None:
            raise MbmError(faults.no_trajectory(block.span, "the rotations of the reference are no columns of its own"))
        names = [f"{measured_side}{axis}" for axis in POSITION[:size]]
        where = rows.values([_column(rows, name) for name in names])
        moved = np.einsum("nij,nj->ni", turned, apart[:, -size:])
        own = np.einsum("nij,njk->nik", turned, spin)
        return Path(positions=where, rotations=turned), Path(positions=where + moved, rotations=own)
    where = rows.values(equation.measured or ())
    reference = Path(positions=where, rotations=turned)
    own = _rotations(rows, model_side, size)
    if own is not None and turned is not None:
        aligned = _turn(rows, equation, model_side)
        own = None if aligned is None else np.einsum("nij,njk->nik", aligned, own)
    else:
        own = None
    kept = reference if own is not None else Path(positions=where)
    return kept, Path(positions=where + apart, rotations=own)


def _size(equation: Equation) -> int:
    """2 in the plane, 3 in space."""
    count = len(equation.components)
    return count if not _is_pose(equation) else 3 if count == 6 else 2


def _column(rows: AtRows, name: str) -> Column:
    if rows.table is None:
        raise TypeError(name)
    return Column(rows.table.name, name)


def _rotations(rows: AtRows, side: str, size: int) -> Floats | None:
    """The rotations (n, d, d) of a side, if it has columns of them: a quaternion, or a heading in the plane."""
    columns = {} if rows.table is None else rows.table.columns
    names = [f"{side}{part}" for part in QUATERNION]
    if size == 3 and all(name in columns and not columns[name].is_text for name in names):
        quaternions = rows.values([_column(rows, name) for name in names])
        lengths = np.linalg.norm(quaternions, axis=1)
        wrong = np.flatnonzero(~((lengths > 0.0) & np.isfinite(lengths)))
        if wrong.size and rows.table is not None and rows.positions is not None:
            place = rows.table.place(int(rows.positions[wrong[0]]), names[0])
            raise MbmError(faults.no_rotation(place, float(lengths[wrong[0]])))
        return matrix_of_quaternion(unit(quaternions))
    heading = next((f"{side}{name}" for name in HEADINGS if f"{side}{name}" in columns), None)
    if size == 2 and heading is not None and not columns[heading].is_text:
        return planar(rows.values([_column(rows, heading)])[:, 0])
    return None


def _turn(rows: AtRows, equation: Equation, side: str) -> Floats | None:
    """How MODEL turns the estimate (n, d, d), None where it depends on less than its coordinates."""
    size = len(equation.components)
    names = [f"{side}{axis}" for axis in POSITION[:size]]
    held = [leaf for leaf in leaves(equation.components) if isinstance(leaf, Column) and leaf.name in names]
    if {leaf.name for leaf in held if isinstance(leaf, Column)} != set(names):
        return None

    def at(one: str | None) -> Floats:
        values: dict[Leaf, Expression] = {leaf: number(int(leaf.name == one)) for leaf in held}
        return rows.values(substituted(equation.components, values))

    origin = at(None)
    slopes = np.stack([at(name) - origin for name in names], axis=2)
    if np.ptp(slopes, axis=0).max(initial=0.0) <= 1e-12 * np.abs(slopes).max(initial=0.0):
        return np.broadcast_to(nearest(slopes[:1]), slopes.shape)
    return nearest(slopes)
