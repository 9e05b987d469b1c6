"""Measured values against the model, at the rows of the data and beyond them, made ready for a picture. Pose graphs
and networks as maps: where the members of families are, and which measurements join two of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from mbm.equations.binding import measured_side
from mbm.equations.layout import Entry, Layout, places_in
from mbm.equations.types import Indices
from mbm.estimation.search.solution import Solution
from mbm.expression.evaluate import Values, evaluate
from mbm.expression.nodes import Column, Component, Expression, Leaf, externals, leaves
from mbm.expression.rows import RowChoice
from mbm.expression.units import parse_unit
from mbm.problem.joining import grid_rows
from mbm.problem.residual_units import columns_of, observations_of
from mbm.problem.rows import column_numbers, lookup
from mbm.problem.tables import ROW, Table
from mbm.problem.types import BlockRole, Derived, Problem, UnknownKind
from mbm.report.elements import unit_text
from mbm.report.predictions import Prediction, prediction
from mbm.report.residuals import normalised
from mbm.report.row_data import Curve, Map, PlotData
from mbm.report.spreads import ConsideredConstant
from mbm.report.types import Floats, Mask, Result, SolveReport
from mbm.scales import SI, Scale

Considered: TypeAlias = tuple[ConsideredConstant, ...]
"""Constants with an uncertainty, and what they do."""


def plot_data(problem: Problem, solution: Solution, considered: Considered = ()) -> tuple[PlotData, ...]:
    """For each observation whose measured side has one or two columns: measured and model, over what they depend on.

    Then the numbers that are derived over grids, unless one is the model of such an observation and drawn with it.
    """
    found = [_of_block(problem, solution, i, considered) for i in range(len(problem.blocks))]
    drawn = [each for each in found if each is not None]
    known = {derived.name for _, derived in drawn if derived is not None}
    apart = [_of_grid(problem, solution, each, considered) for each in problem.derived if each.name not in known]
    return (*(data for data, _ in drawn), *(data for data in apart if data is not None))


def with_bands(result: Result) -> Result:
    """The result with the constants that it considers in the bands of its plots."""

    def of(solve: SolveReport) -> SolveReport:
        made_from = solve.made_from
        if made_from is None or not solve.considered:
            return solve

        def drawn() -> tuple[PlotData, ...]:
            problem, solution = made_from()
            with solution.lock:
                return plot_data(problem, solution, solve.considered)

        return replace(solve, pictures=drawn)

    return replace(result, solves=tuple(of(solve) for solve in result.solves))


def _of_block(
    problem: Problem, solution: Solution, i: int, considered: Considered
) -> tuple[PlotData, Derived | None] | None:
    """An observation, and the derived quantity that is drawn with it."""
    block = problem.blocks[i]
    if block.role is not BlockRole.OBSERVATION or block.table is None:
        return None
    groups = [g for g in solution.groups if g.kernel.owner == i and g.rows]
    sides = [measured_side(problem, g, solution.tables) for g in groups]
    if not groups or any(s is None for s in sides):
        return None
    measured = np.vstack([s for s in sides if s is not None])
    if measured.shape[1] > 2:
        return None
    model = measured + np.vstack([g.written.values(solution.numbers) for g in groups])
    positions = np.concatenate([g.positions for g in groups if g.positions is not None])
    order = np.argsort(positions, kind="stable")
    first = block.cases[0].equations
    labels = tuple(_label(e, j) for j, e in enumerate(m for q in first for m in q.measured or ()))
    name = _abscissa(tuple(c for q in first for c in q.components), set(labels), block.table)
    at = column_numbers(solution.tables[block.table], name)[positions[order]] if name is not None else None
    over = next((each for each in problem.derived if along(problem, each, i, name)), None)
    made = None if over is None else band(problem, solution, over, block.name, considered)
    curve: Curve | None
    if made is not None and made.table is not None and over is not None and over.grid is not None:
        curve = curve_of(made, made.table.numbers(over.grid.variable))
        curve = _changed(curve, curve.abscissa, (made.item.quantity.scale.to_si,))
    else:
        over, curve = None, None if name is None or at is None else smooth(problem, solution, i, name, at)
    data = PlotData(
        clause=block.name,
        measured=measured[order],
        model=model[order],
        labels=labels,
        abscissa=at,
        abscissa_label=name,
        curve=curve,
    )
    return _in_units(data, solution.tables[block.table]), over


def _in_units(data: PlotData, table: Table) -> PlotData:
    """The numbers in the units that their columns state."""
    across, name = _scale(table, data.abscissa_label)
    scales, labels = zip(*(_scale(table, label) for label in data.labels), strict=True)
    curve, changes = data.curve, tuple(scale.from_si for scale in scales)
    if curve is not None:
        curve = _changed(curve, across.from_si(curve.abscissa), changes)
    return replace(
        data,
        measured=_columns(data.measured, changes),
        model=_columns(data.model, changes),
        labels=tuple(str(label) for label in labels),
        abscissa=None if data.abscissa is None else across.from_si(data.abscissa),
        abscissa_label=name,
        curve=curve,
    )


def _changed(curve: Curve, abscissa: Floats, changes: Sequence[Callable[[Floats], Floats]]) -> Curve:
    """A curve with other numbers in its columns."""
    inner, outer = (None if each is None else changes[0](each) for each in (curve.band, curve.reading))
    return replace(curve, abscissa=abscissa, values=_columns(curve.values, changes), band=inner, reading=outer)


def _columns(numbers: Floats, changes: Sequence[Callable[[Floats], Floats]]) -> Floats:
    """Numbers (n, c), each column changed."""
    return np.stack([change(numbers[:, j]) for j, change in enumerate(changes)], axis=-1)


def _scale(table: Table, name: str | None) -> tuple[Scale, str | None]:
    """The scale of a column, and its name with the unit; SI and the name as it is where there is none."""
    column = None if name is None else table.columns.get(name)
    unit = None if column is None or column.unit is None else parse_unit(column.unit)
    return (SI, name) if unit is None else (unit.scale, f"{name} ({unit.symbol})")


def _of_grid(problem: Problem, solution: Solution, derived: Derived, considered: Considered) -> PlotData | None:
    """A number that is derived over a grid, in the units that it is reported in."""
    made = band(problem, solution, derived, None, considered)
    grid = derived.grid
    if made is None or made.table is None or grid is None:
        return None
    unit = unit_text(made.item.quantity)
    return PlotData(
        clause=derived.name,
        measured=np.empty((0, 1)),
        model=np.empty((0, 1)),
        labels=(f"{derived.name} ({unit})" if unit else derived.name,),
        abscissa=np.empty(0),
        abscissa_label=grid.variable if grid.unit is None else f"{grid.variable} ({grid.unit.symbol})",
        curve=curve_of(made, grid.scale.from_si(made.table.numbers(grid.variable))),
    )


def _label(node: Expression, number: int) -> str:
    return node.name if isinstance(node, Column) else f"component {number + 1}"


def _abscissa(nodes: tuple[Expression, ...], measured: set[str], table: str) -> str | None:
    """The one column that the model depends on besides the measured ones, if there is just one."""
    names = {
        leaf.name
        for leaf in leaves(nodes)
        if isinstance(leaf, Column) and leaf.table == table and leaf.row is RowChoice.EACH and leaf.name != ROW
    }
    rest = names - measured
    return next(iter(rest)) if len(rest) == 1 else None


SMOOTH = 200
"""Points of a curve: more than pixels tell apart."""


@np.errstate(all="ignore")
def smooth(problem: Problem, solution: Solution, block: int, abscissa: str, stretch: Floats) -> Curve | None:
    """The model of an observation along a column over the ``stretch`` of numbers that it has.

    None where more than that column and the unknowns decides it: members of families, rows chosen otherwise, functions
    in Python, or the cut of an angle.
    """
    stated = problem.blocks[block]
    if stated.table is None or len(stated.cases) != 1 or not len(stretch):
        return None
    equations = stated.cases[0].equations
    components = tuple(node for each in equations for node in each.components)
    measured = tuple(node for each in equations for node in each.measured or ())
    if not _along(components, stated.table, {abscissa} | columns_of(measured, stated.table)):
        return None
    at = np.linspace(stretch.min(), stretch.max(), SMOOTH)
    table = solution.tables[stated.table]
    row = next((g.positions[:1] for g in solution.groups if g.kernel.owner == block and g.positions is not None), None)
    known = lookup(table, row, solution.tables)

    def value(leaf: Leaf) -> Values:
        if isinstance(leaf, Component):
            return _number(solution.layout, solution.numbers, leaf)
        if isinstance(leaf, Column) and leaf.table == table.name and leaf.name == abscissa:
            return at
        return known(leaf)

    sides = zip(evaluate(components, value), evaluate(measured, value), strict=True)
    values = np.column_stack([np.broadcast_to(np.asarray(a + b), at.shape) for a, b in sides])
    return Curve(abscissa=at, values=values) if np.isfinite(values).all() else None


def band(
    problem: Problem, solution: Solution, derived: Derived, clause: str | None, considered: Considered
) -> Prediction | None:
    """A number that is derived over a grid, at enough values for a picture; readings are those of ``clause``.

    None for what is no number, or not over a grid.
    """
    if derived.grid is None or derived.kind is not None or derived.shape or solution.elsewhere is None:
        return None
    grid = derived.grid if derived.grid.count >= SMOOTH else replace(derived.grid, count=SMOOTH)
    return prediction(problem, solution, derived, grid_rows(grid), clause=clause, considered=considered)


def curve_of(found: Prediction, abscissa: Floats) -> Curve:
    """The curve of a prediction, its numbers in the unit shown."""
    reading = found.reading
    return Curve(
        abscissa=abscissa,
        values=found.item.quantity.scale.from_si(np.asarray(found.item.value))[:, None],
        band=np.stack([found.intervals.low, found.intervals.high]),
        reading=None if reading is None else np.stack([reading.low, reading.high]),
        coverage=found.level,
    )


def along(problem: Problem, derived: Derived, block: int, abscissa: str | None) -> bool:
    """Whether a quantity over a grid is the MODEL of a block, and its variable the ``abscissa`` of that."""
    if derived.grid is None or abscissa is None:
        return False
    modelled = [each for each in observations_of(problem, derived) if each.block == block]
    return any(dict(each.columns) == {derived.grid.variable: abscissa} for each in modelled)


def _along(nodes: tuple[Expression, ...], table: str, columns: frozenset[str] | set[str]) -> bool:
    """Whether forms depend on these columns of the row at hand, and on plain unknowns."""
    if next(externals(nodes), None) is not None or any(node.angle for node in nodes):
        return False
    for leaf in leaves(nodes):
        if isinstance(leaf, Component) and (leaf.member is not None or leaf.unknown.endswith(")")):
            return False
        if isinstance(leaf, Column) and (leaf.row is not RowChoice.EACH or leaf.table != table):
            return False
    return columns_of(nodes, table) <= columns


def _number(layout: Layout, numbers: Floats, leaf: Component) -> float:
    entry = layout.entry(leaf.unknown)
    return float(numbers[entry.offset + entry.unknown.indices().index(leaf.index)])


_MOVING = (UnknownKind.POSE, UnknownKind.SIMILARITY)


def maps_of(problem: Problem, solution: Solution) -> tuple[Map, ...]:
    """The maps of the plane and of space: where something is measured between two places of one family; usually one."""
    return tuple(found for dimension in (2, 3) if (found := _map(problem, solution, dimension)) is not None)


def _map(problem: Problem, solution: Solution, dimension: int) -> Map | None:
    entries = [e for e in solution.layout.entries if e.keys is not None and _dimension(e) == dimension]
    entries.sort(key=lambda e: e.unknown.kind not in _MOVING)
    if not entries:
        return None
    node_of, first = np.full(len(solution.numbers), -1, dtype=np.int64), 0
    for entry in entries:
        numbers = np.repeat(np.arange(first, first + entry.members), entry.unknown.size)
        node_of[entry.range] = numbers
        first += entry.members
    edges, residuals = _edges(problem, solution, node_of)
    family = np.repeat(np.arange(len(entries)), [e.members for e in entries])
    if not (family[edges[:, 0]] == family[edges[:, 1]]).any():
        return None
    moving = np.concatenate([np.full(e.members, e.unknown.kind in _MOVING) for e in entries])
    return Map(
        places=np.concatenate([_places(e, solution) for e in entries]),
        spreads=np.concatenate([_spreads(e, solution) for e in entries]),
        moving=moving,
        edges=edges,
        residuals=residuals,
        next_to=_next_to(entries, edges, family, moving),
        unit="m" if _is_length(problem, entries) else "",
        name=", ".join(entry.unknown.name for entry in entries),
    )


def _dimension(entry: Entry) -> int:
    """The space that a family's members are places in; 0 if they are none."""
    unknown = entry.unknown
    if unknown.kind in _MOVING:
        return unknown.dimension
    return unknown.shape[0] if unknown.kind is UnknownKind.VECTOR and unknown.shape in ((2,), (3,)) else 0


def _places(entry: Entry, solution: Solution) -> Floats:
    """Translations, or vectors, (members, d)."""
    numbers = solution.numbers[entry.range].reshape(entry.members, -1)
    dimension = _dimension(entry)
    held = 0 if entry.unknown.kind is UnknownKind.VECTOR else 4 if dimension == 3 else 1
    return np.asarray(numbers[:, held : held + dimension])


def _spreads(entry: Entry, solution: Solution) -> Floats:
    """Covariances (members, d, d) of the places; NaN where they are not known, 0 of what is fixed."""
    dimension = _dimension(entry)
    found = np.full((entry.members, dimension, dimension), np.nan)
    factor = solution.covariance.factor
    if not solution.sigma_known or not len(solution.free) or factor.shape[0] != len(solution.free):
        return found
    row_of = places_in(solution.free, len(solution.layout.number))
    unknown = np.zeros(len(row_of), dtype=bool)
    unknown[solution.free] = ~solution.observability.estimable
    freedom = entry.unknown.freedom
    turning = 0 if entry.unknown.kind is UnknownKind.VECTOR else 3 if dimension == 3 else 1
    own = entry.first + freedom * np.arange(entry.members)[:, None] + turning + np.arange(dimension)
    rows = np.where((row_of[own] >= 0)[:, :, None], factor[row_of[own]], 0.0)
    rows[unknown[own].any(axis=1)] = np.nan
    return np.asarray(rows @ rows.transpose(0, 2, 1))


def _edges(problem: Problem, solution: Solution, node_of: Indices) -> tuple[Indices, Floats]:
    """Pairs (m, 2) of places that a measurement joins, and the root mean square (m,) of its normalised residual."""
    pairs, sizes = [np.zeros((0, 2), dtype=np.int64)], [np.zeros(0)]
    whitened = normalised(solution)
    for group in solution.groups:
        if problem.blocks[group.kernel.owner].role is not BlockRole.OBSERVATION or not group.index.shape[1]:
            continue
        nodes = node_of[group.index]
        last = nodes.max(axis=1)
        least = np.where(nodes < 0, len(node_of), nodes).min(axis=1)
        two = (last > least) & ((nodes < 0) | (nodes == least[:, None]) | (nodes == last[:, None])).all(axis=1)
        residuals = whitened[group.first : group.first + group.count].reshape(group.rows, -1)
        pairs.append(np.stack([least, last], axis=1)[two])
        sizes.append(np.sqrt((residuals[two] ** 2).mean(axis=1)))
    return np.concatenate(pairs), np.concatenate(sizes)


def _next_to(entries: Sequence[Entry], edges: Indices, family: Indices, moving: Mask) -> Mask:
    """Which edges (m,) join neighbours in the order of the keys of one family of poses: the odometry."""
    order = np.concatenate([np.array(list(_ranks(entry)), dtype=np.int64) for entry in entries])
    a, b = edges.T
    return np.asarray(moving[a] & moving[b] & (family[a] == family[b]) & (np.abs(order[a] - order[b]) == 1))


def _ranks(entry: Entry) -> Iterator[int]:
    """The place of each member in the order of the keys; that of the table where they are texts."""
    keys = entry.keys or ()
    if not all(isinstance(key, float | int) for key in keys):
        yield from range(len(keys))
        return
    yield from np.argsort(np.argsort(np.array(keys, dtype=float), kind="stable"), kind="stable").tolist()


def _is_length(problem: Problem, entries: Sequence[Entry]) -> bool:
    """Whether all families are known to be places in metres."""
    from mbm.report.quantities import quantity_of

    return all(quantity_of(problem, entry.unknown).unit == "m" for entry in entries)
