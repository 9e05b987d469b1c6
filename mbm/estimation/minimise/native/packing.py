"""Groups of equations → the flat arrays that `mbm.solver.description` describes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.surface import affine_by_products
from mbm.equations.types import Equations, Floats, Indices, Mask
from mbm.equations.whitening import Whitener
from mbm.estimation.minimise.native.iteration import Iteration
from mbm.machine.kinds import LANES
from mbm.machine.records import slot
from mbm.solver import description as of
from mbm.values import dataclass

ROWS_AT_A_TIME = 128
"""Residuals that are triangularised at a time: with 25 unknowns they take 27 kB, which stay in the cache."""

TRIANGULAR = 1e-14
"""A share of a whitening matrix beside its triangle that is the rounding of its inversion."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fused:
    """A function for the rows of some groups.

    ``table`` is what `description.UNITED_AT` points to, ``reals`` counts the parameters and weights of the rows. The
    code lives as long as this does.
    """

    table: Indices
    reals: int
    library: object = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Limits:
    """All constraints of some equations as one row of a kernel: what addresses give, and which (k,) are equations."""

    values: int
    jacobian: int
    equality: Mask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """Rows of all blocks of some data sets: the four arrays, and ``data`` (sets, stride)."""

    parameters: Floats
    weights: Floats
    index: Indices
    columns: Indices
    data: Indices


def weights_of(group: Group, factors: Floats | None, left_out: Floats | None) -> Floats:
    """What whitens the rows of a group, (rows, weights of a row).

    ``factors`` (rows, outputs) divide the whitened residuals; ``left_out`` (rows, units) is 0 for units that take no
    part, else 1.
    """
    parts = []
    for k, each in enumerate(group.whiteners):
        weights = each.weights
        if factors is not None:
            own = factors[:, each.first : each.last]
            weights = weights / (own if weights.ndim == 2 else own[:, :, None])
        if left_out is not None:
            weights = np.where(left_out[:, k].reshape(-1, *([1] * (weights.ndim - 1))) == 0.0, 0.0, weights)
        parts.append(weights.reshape(len(weights), prod(weights.shape[1:])))
    return parts[0] if len(parts) == 1 else np.hstack(parts)


def triangle_kind(each: Whitener) -> int | None:
    """0 for factors, 1 for lower and 2 for upper triangular matrices; None for other ones."""
    if each.weights.ndim == 2:
        return 0
    size = np.abs(each.weights).max(initial=0.0)
    for kind, other in ((1, np.triu(each.weights, 1)), (2, np.tril(each.weights, -1))):
        if np.abs(other).max(initial=0.0) <= TRIANGULAR * size:
            return kind
    return None


def rows_of(equations: Assembled) -> Rows:
    """The rows of one data set."""
    parameters: list[Floats] = []
    weights: list[Floats] = []
    index: list[Indices] = []
    columns: list[Indices] = []
    places = [0, 0, 0, 0]
    column = equations.columns
    taken = None
    if equations.rows is not None:
        taken = np.zeros(equations.whole, dtype=np.float64)
        taken[equations.rows] = 1.0
    data = [equations.count]
    for group in (*equations.groups, *equations.constraints):
        parts: list[NDArray[Any]] = [
            group.parameters.ravel(),
            np.zeros(0),
            group.places.ravel(),
            column[group.touched].ravel(),
        ]
        if group.whiteners:
            lines = slice(group.first, group.first + group.count)
            shape = (group.rows, group.kernel.outputs)
            factors = None if equations.factors is None else equations.factors[lines].reshape(shape)
            picked = None
            if taken is not None:
                picked = taken[lines].reshape(shape)[:, [w.first for w in group.whiteners]]
            parts[1] = weights_of(group, factors, picked).ravel()
        data += [*places, group.rows]
        places = [place + len(part) for place, part in zip(places, parts, strict=True)]
        parameters.append(parts[0])
        weights.append(parts[1])
        index.append(parts[2])
        columns.append(parts[3])
    return Rows(
        parameters=_joined(parameters, np.float64),
        weights=_joined(weights, np.float64),
        index=_joined(index, np.int64),
        columns=_joined(columns, np.int64),
        data=np.array([data], dtype=np.int64),
    )


def _joined(parts: Sequence[NDArray[Any]], kind: type) -> NDArray[Any]:
    """One array, never empty: what stands at its end may be pointed to, though it is not read."""
    return np.ascontiguousarray(np.concatenate([*parts, np.zeros(1, dtype=kind)]), dtype=kind)


def rounded_up(rows: int) -> int:
    """Rows in whole kernel blocks."""
    return -(-rows // LANES) * LANES


def structure_of(equations: Assembled) -> object:
    """What `system_arrays` depends on beside the numbers of rows, to be looked up by; addresses follow from it."""
    layout = equations.layout
    groups = tuple(
        (
            g.number,
            g.shared,
            g.shared_columns,
            g.losses,
            tuple((w.last, w.weights.shape[1:], triangle_kind(w)) for w in g.whiteners),
        )
        for g in (*equations.groups, *equations.constraints)
    )
    numbers = (equations.free, layout.number, equations.lower, equations.upper, equations.positive, equations.equality)
    curved = tuple((c.piece, c.numbers.tobytes(), c.coordinates.tobytes()) for c in layout.curved)
    return groups, equations.linear, len(layout.start), tuple(each.tobytes() for each in numbers), curved


def system_arrays(
    equations: Assembled,
    addresses: Sequence[tuple[int, int, int]],
    iteration: Iteration,
    *,
    most_rows: Sequence[int],
    at_a_time: int = ROWS_AT_A_TIME,
    summed_from: int = 0,
    fused: Fused | None = None,
) -> tuple[Indices, Floats]:
    """``system`` and ``constants`` for the groups of ``equations`` with up to ``most_rows`` rows each.

    ``at_a_time`` residuals go through kernels together. ``addresses`` are those of values, Jacobian and sums (0: none)
    of each group's kernel, in the order of the groups, then constraints; ``summed_from`` is the number of rows from
    which the sums are taken, ``fused`` the function for the rows of some groups.
    """
    n = equations.dimension
    groups = (*equations.groups, *equations.constraints)
    blocks, tail, losses = _blocks(equations, addresses, len(groups) * of.BLOCK, of.BOUNDS_AT + 2 * n)
    padded = [rounded_up(rows) for rows in most_rows]
    outputs, tangents, weights = blocks[:, [of.Block.outputs, of.Block.tangents, of.Block.weights]].T
    values = sum(g.kernel.outputs * r for g, r in zip(groups, most_rows, strict=True) if not g.whiteners)
    chunk = max([ROWS_AT_A_TIME, min(at_a_time, int(outputs @ padded)), *(LANES * outputs).tolist()])
    chunk += -chunk % LANES
    kernels = (outputs + blocks[:, of.Block.nonzero_count]) * LANES * (chunk // (LANES * outputs))
    sums = np.where(blocks[:, of.Block.normal] == 0, 0, tangents * (tangents + 1) // 2 + tangents + 2)
    sizes = (
        (of.Problem.residual_blocks, len(equations.groups)),
        (of.Problem.constraint_blocks, len(equations.constraints)),
        (of.Problem.most_multipliers, values),
        (of.Problem.most_residuals, int(outputs @ padded) + 4),
        (of.Problem.most_inputs, int((blocks[:, of.Block.variables] + blocks[:, of.Block.parameters]) @ padded)),
        (of.Problem.most_weights, int(np.where(weights > 0, weights, 2 * outputs) @ padded)),
        (of.Problem.chunk, chunk),
        (of.Problem.most_outputs, int(np.maximum(kernels, sums).max(initial=0))),
        (of.Problem.summed_from, summed_from),
    )
    system = _described(equations, equations, iteration, sizes, [blocks.ravel(), *tail], fused)
    return system, _constants(equations, iteration, losses)


def function_arrays(
    equations: Equations, base: Assembled | None, iteration: Iteration, fused: Fused, limits: Limits | None = None
) -> tuple[Indices, Floats]:
    """``system`` and ``constants`` for equations of which ``fused`` gives the residuals, ``limits`` the constraints.

    ``base`` are those whose unknowns they have; None: a point is the coordinates, which steps add to.
    """
    rows = equations.count
    numbers = equations.dimension if base is None else len(base.layout.start)
    count = 0 if limits is None else len(limits.equality)
    sizes = (
        (of.Problem.constraint_blocks, int(count > 0)),
        (of.Problem.most_multipliers, count),
        (of.Problem.most_residuals, rows + 4 + LANES * count),
        (of.Problem.most_inputs, LANES * numbers * int(count > 0)),
        (of.Problem.most_weights, LANES * 2 * count),
        (of.Problem.most_outputs, LANES * count * (1 + equations.dimension)),
        (of.Problem.chunk, max(rows + -rows % 4, LANES * count)),
        (of.Problem.profiled, bool(getattr(equations, "profiled", False))),
    )
    tables = [] if limits is None else _limit_block(limits, numbers, equations.dimension)
    system = _described(equations, base, iteration, sizes, tables, fused)
    return system, _constants(equations, iteration, [])


def _limit_block(limits: Limits, numbers: int, n: int) -> list[Indices]:
    """The table of the one block of constraints: each depends on every number and every coordinate."""
    count = len(limits.equality)
    block = np.zeros(of.BLOCK, dtype=np.int64)
    outputs, tangents = np.divmod(np.arange(count * n), n)
    nonzeros = np.stack([outputs, tangents, np.full(count * n, -1)], axis=1).ravel()
    for at, value in (
        (of.Block.values, limits.values),
        (of.Block.jacobian, limits.jacobian),
        (of.Block.outputs, count),
        (of.Block.variables, numbers),
        (of.Block.tangents, n),
        (of.Block.nonzero_count, count * n),
        (of.Block.noise, -1),
        (slot(of.Block, "units"), of.BLOCK),
        (slot(of.Block, "nonzeros"), of.BLOCK),
        (slot(of.Block, "equality"), of.BLOCK + nonzeros.size),
    ):
        block[at] = value
    return [block, nonzeros, limits.equality.astype(np.int64)]


def _described(
    equations: Equations,
    base: Assembled | None,
    iteration: Iteration,
    sizes: Sequence[tuple[int, int]],
    tables: Sequence[Indices],
    fused: Fused | None,
) -> Indices:
    """The header, with what ``sizes`` puts there, and its tables: coordinates, components, then the blocks' own."""
    n = equations.dimension
    number_of = np.arange(n) if base is None else base.layout.number[base.free]
    components = np.zeros((0, of.PIECE), dtype=np.int64) if base is None else _pieces(base)
    blocks_at = of.HEADER + 2 * n + components.size
    header = np.zeros(of.HEADER, dtype=np.int64)
    for at, value in (
        (of.Problem.numbers, n if base is None else len(base.layout.start)),
        (of.Problem.n, n),
        (of.Problem.component_count, len(components)),
        (of.Problem.linear, equations.linear),
        (of.Problem.affine, base is not None and affine_by_products(base)),
        (of.Problem.boxed, _boxed(equations)),
        (of.Problem.iterations, iteration.most),
        (of.Problem.strict, iteration.strict),
        (of.Problem.rule, iteration.rule),
        (of.Problem.exact, iteration.exact),
        (of.Problem.direct, iteration.direct),
        (slot(of.Problem, "number_of"), of.HEADER),
        (slot(of.Problem, "positive"), of.HEADER + n),
        (slot(of.Problem, "components"), of.HEADER + 2 * n),
        (slot(of.Problem, "blocks"), blocks_at),
        *sizes,
    ):
        header[at] = value
    last: list[Indices] = []
    if fused is not None:
        header[slot(of.Problem, "fused")] = blocks_at + sum(table.size for table in tables)
        header[of.Problem.fused_reals] = fused.reals
        last.append(fused.table)
    parts = [header, number_of, equations.positive, components.ravel(), *tables, *last]
    return np.concatenate(parts).astype(np.int64)


def _constants(equations: Equations, iteration: Iteration, losses: Sequence[Floats]) -> Floats:
    """The tolerance, the bounds, and the parameters of losses."""
    head = np.zeros(of.BOUNDS_AT)
    head[of.TOLERANCE] = iteration.tolerance
    return np.ascontiguousarray(np.concatenate([head, equations.lower, equations.upper, *losses]), dtype=np.float64)


def _blocks(
    equations: Assembled, addresses: Sequence[tuple[int, int, int]], end: int, losses_at: int
) -> tuple[Indices, list[Indices], list[Floats]]:
    """The table of blocks, what stands ``end`` behind its beginning, and in ``constants`` from ``losses_at`` on."""
    groups = (*equations.groups, *equations.constraints)
    blocks = np.zeros((len(groups), of.BLOCK), dtype=np.int64)
    tail: list[Indices] = []
    constants: list[Floats] = []
    for line, group, address in zip(blocks, groups, addresses, strict=True):
        # tables are found from where the block begins, and one block is behind the other
        tables, losses = _tables(group, losses_at, equations)
        line[: of.Block.weights] = (
            *address[:2],
            group.kernel.outputs,
            len(group.kernel.variables),
            len(group.kernel.parameters),
            len(group.kernel.tangents),
            len(group.kernel.jacobian_rows),
            0 if all(group.shared) else len(group.kernel.variables),
            0 if all(group.shared_columns) else len(group.kernel.tangents),
        )
        line[of.Block.weights] = sum(int(np.prod(w.weights.shape[1:])) for w in group.whiteners)
        line[of.Block.unit_count] = len(group.whiteners)
        line[of.Block.noise] = -1
        line[of.Block.normal] = address[2]
        for name, table in zip(("units", "nonzeros", "equality"), tables, strict=True):
            line[slot(of.Block, name)] = end
            end += table.size
            tail.append(table.ravel())
        constants.append(losses)
        losses_at += losses.size
        end -= of.BLOCK
    return blocks, tail, constants


def blocks_of(system: Indices) -> Indices:
    """The blocks that a description of equations has, one to a line."""
    first, count = system[slot(of.Problem, "blocks")], system[of.Problem.residual_blocks]
    count += system[of.Problem.constraint_blocks]
    return np.asarray(system[first : first + count * of.BLOCK].reshape(count, of.BLOCK))


def _boxed(equations: Equations) -> bool:
    bounded = np.isfinite(equations.lower) | np.isfinite(equations.upper) | equations.positive
    return bool(bounded.any())


def _pieces(equations: Assembled) -> Indices:
    """The pieces that do not vary by addition and have a free coordinate."""
    layout = equations.layout
    column = equations.columns
    found = []
    for curved in layout.curved:
        for numbers, coordinates in zip(curved.numbers, curved.coordinates, strict=True):
            columns = column[coordinates]
            if (columns >= 0).any():
                line = np.full(of.PIECE, -1, dtype=np.int64)
                line[of.Component.kind] = of.PIECES[curved.piece.label]
                line[of.Component.number_0 : of.Component.number_0 + len(numbers)] = numbers
                line[of.Component.column_0 : of.Component.column_0 + len(columns)] = columns
                found.append(line)
    return np.array(found, dtype=np.int64).reshape(-1, of.PIECE)


def _tables(group: Group, losses_at: int, equations: Assembled) -> tuple[tuple[Indices, ...], Floats]:
    """Units, nonzeros and equality flags of a block, and the parameters of its losses."""
    units, losses = [], []
    factor = np.full(group.kernel.outputs, -1, dtype=np.int64)
    place = 0
    for k, each in enumerate(group.whiteners):
        kind = triangle_kind(each) or 0
        loss = group.losses[k] if group.losses else None
        units.append((each.first, each.last, place, kind, of.NO_LOSS if loss is None else loss.number, losses_at))
        size = each.last - each.first
        if kind == 0:
            factor[each.first : each.last] = place + np.arange(size)
        place += size * size if kind else size
        if loss is not None:
            losses += [loss.scale, loss.shape]
            losses_at += 2
    rows = group.kernel.jacobian_rows
    nonzeros = np.stack([rows, group.kernel.jacobian_columns, factor[rows]], axis=1)
    equality = np.zeros(0, dtype=np.int64)
    if not group.whiteners:
        equality = equations.equality[group.first : group.first + group.kernel.outputs].astype(np.int64)
    return (np.array(units, dtype=np.int64).reshape(-1, of.UNIT), nonzeros, equality), np.array(losses)
