"""Expressions, tables and the layout of the unknowns → the network of one solve."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import TypeAlias

import numpy as np

from mbm.equations.gathering import picked_members
from mbm.equations.layout import Layout, layout
from mbm.equations.types import Indices, Mask
from mbm.estimation.intervals import arithmetic as of, faults
from mbm.estimation.intervals.arithmetic import EXTENSIONS, PI_HIGH, Floats
from mbm.estimation.intervals.contraction import extension
from mbm.estimation.intervals.network import Demand, Network, Node, Wanted
from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Apply, Column, Component, Constant, Expression, Number, Operation, nearest, postorder
from mbm.files.memory import check_memory
from mbm.problem import faults as problem_faults
from mbm.problem.checks import used_rows
from mbm.problem.kinds import Relation
from mbm.problem.naming import place_of
from mbm.problem.rows import Positions, lookup, rows_of
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Equation, Problem
from mbm.text.types import MbmError
from mbm.values import dataclass

TURNING = frozenset({Operation.WRAP, Operation.SIN, Operation.COS, Operation.TAN})
"""Operations for which an angle counts but for whole turns."""
DIRECTIONS = frozenset({Operation.ATAN2, Operation.WRAP})
"""Operations whose angle lies in one turn, unless it counts but for whole turns."""
SUMS = frozenset({Operation.ADD, Operation.SUBTRACT, Operation.NEGATE, Operation.AS_ANGLE, Operation.HELD})
"""Operations that keep whole turns whole."""

PER_NUMBER = 200
"""Bytes for one intermediate value of a box: its interval, and what is at work in a sweep."""

Key: TypeAlias = tuple[object, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """The rows that expressions are read in: those at ``positions`` of ``table``, or once without one."""

    table: Table | None = None
    positions: Positions | None = None

    @property
    def count(self) -> int:
        """How many."""
        return 1 if self.positions is None else len(self.positions)

    @property
    def key(self) -> Key:
        """What tells them from others."""
        return () if self.table is None or self.positions is None else (self.table.name, self.positions.tobytes())


def network(problem: Problem, tables: Mapping[str, Table], starts: Mapping[str, Floats]) -> Network:
    """The network of one solve; ``starts`` (SI, by name) take the place of what the problem says of fixed unknowns.

    Raises:
        MbmError: an operation without an interval extension, a bound that is no number ≥ 0, too-much-memory.

    """
    found = layout(problem, tables, starts)
    made = _Builder(found, tables)
    demands: list[Demand] = []
    for block in problem.blocks:
        mask = used_rows(block, tables)
        for case in block.cases:
            table = None if block.table is None else tables[block.table]
            positions = None if table is None else rows_of(case.static, table)
            if positions is not None and mask is not None:
                positions = positions[mask[positions]]
            rows = Rows(table=table, positions=positions)
            if rows.count:
                for equation in case.equations:
                    demands += _demands(made, equation, rows, observed=block.role is BlockRole.OBSERVATION)
    wanted: list[Wanted] = []
    for owner, derived in enumerate(problem.derived):
        for each in derived.cases:
            table = None if derived.table is None else tables[derived.table]
            positions = None if table is None else rows_of(each.static, table)
            rows = Rows(table=table, positions=positions)
            if rows.count:
                nodes = tuple(made.node(value, rows) for value in each.values)
                wanted.append(Wanted(owner=owner, nodes=nodes, positions=positions, angle=derived.turns))
    numbers = sum(node.rows for node in made.nodes)
    check_memory(PER_NUMBER * numbers, f"one box of {numbers:,} intermediate values", problem.span)
    low, high, full_turn = _stated(found)
    free = np.zeros(len(low), dtype=bool)
    free[found.number[~found.fixed]] = True
    return Network(
        layout=found,
        nodes=_judged(made.nodes, demands, wanted),
        demands=tuple(demands),
        wanted=tuple(wanted),
        low=low,
        high=high,
        free=free,
        full_turn=full_turn,
    )


def _demands(made: _Builder, equation: Equation, rows: Rows, *, observed: bool) -> list[Demand]:
    """What an equation demands: an absolute value within the bound, zero, or none above zero."""
    nodes = [made.node(component, rows) for component in equation.components]
    if equation.relation is Relation.NOT_ABOVE_ZERO:
        return [Demand(node=node, allowed=of.interval(-np.inf, 0.0), observed=observed) for node in nodes]
    if equation.relation is Relation.ZERO:
        return [Demand(node=node, allowed=of.interval(0.0, 0.0), observed=observed) for node in nodes]
    bounds = evaluate(equation.noise, lookup(rows.table, rows.positions, made.tables))
    found = []
    for node, values in zip(nodes, bounds, strict=True):
        bound = np.broadcast_to(np.asarray(values, dtype=np.float64), (rows.count,))
        wrong = np.flatnonzero(~(np.isfinite(bound) & (bound >= 0)))
        if wrong.size:
            row = None if rows.positions is None else int(rows.positions[wrong[0]])
            raise MbmError(faults.bad_bound(equation, rows.table, row, float(bound[wrong[0]])))
        found.append(Demand(node=node, allowed=(-bound[None], bound[None].copy()), observed=observed))
    return found


def _stated(found: Layout) -> tuple[Floats, Floats, Mask]:
    """What is known of the numbers before any equation: ``:in``, signs, what is fixed, and that angles are turns."""
    low, high = np.full(len(found.start), -np.inf), np.full(len(found.start), np.inf)
    lower = np.where(found.positive, np.maximum(found.lower, 0.0), found.lower)
    low[found.number], high[found.number] = lower, found.upper
    angle = np.zeros(len(low), dtype=bool)
    angle[found.number[found.angle]] = True
    full_turn = angle & ~(np.isfinite(low) & np.isfinite(high))
    low, high = np.where(full_turn, -PI_HIGH, low), np.where(full_turn, PI_HIGH, high)
    fixed = found.number[found.fixed]
    full_turn[fixed] = False
    low[fixed] = high[fixed] = found.start[fixed]
    return low, high, full_turn


class _Builder:
    """Makes nodes, each once. Local to one network."""

    def __init__(self, found: Layout, tables: Mapping[str, Table]) -> None:
        self.layout = found
        self.tables = tables
        self.nodes: list[Node] = []
        self._numbers: dict[Key, int] = {}

    def node(self, root: Expression, rows: Rows) -> int:
        """The number of the node of an expression."""
        made: dict[int, int] = {}
        for each in postorder((root,)):
            if isinstance(each, Apply):
                made[id(each)] = self._applied(each, tuple(made[id(a)] for a in each.arguments))
            else:
                made[id(each)] = self._leaf(each, rows)
        return made[id(root)]

    def _kept(self, key: Key, node: Node) -> int:
        found = self._numbers.get(key)
        if found is None:
            found = self._numbers[key] = len(self.nodes)
            self.nodes.append(node)
        return found

    def _known(self, low: Floats, high: Floats) -> int:
        """Known numbers (rows,); equal ones in all rows are one."""
        if len(low) > 1 and bool((low == low[0]).all() and (high == high[0]).all()):
            low, high = low[:1], high[:1]
        pair = (np.asarray(low, dtype=np.float64)[None], np.asarray(high, dtype=np.float64)[None])
        return self._kept(("known", pair[0].tobytes(), pair[1].tobytes()), Node(rows=len(low), known=pair))

    def _leaf(self, leaf: Expression, rows: Rows) -> int:
        if isinstance(leaf, Number):
            value = nearest(leaf.value)
            exact = not isinstance(leaf.value, Fraction | int) or Fraction(value) == leaf.value
            low, high = (value, value) if exact else (np.nextafter(value, -np.inf), np.nextafter(value, np.inf))
            return self._known(np.array([low]), np.array([high]))
        if isinstance(leaf, Component):
            return self._component(leaf, rows)
        if not isinstance(leaf, Constant | Column):
            raise TypeError(leaf)
        values = np.atleast_1d(np.asarray(lookup(rows.table, rows.positions, self.tables)(leaf), dtype=np.float64))
        return self._known(values, values)

    def _component(self, leaf: Component, rows: Rows) -> int:
        entry = self.layout.entry(leaf.unknown)
        member: Indices | int = 0
        if leaf.member is not None:
            member = picked_members(entry, leaf.member, rows.table, rows.positions, self.tables)
        place = entry.offset + np.atleast_1d(member) * entry.unknown.size + place_of(leaf.index, entry.unknown.shape)
        if bool((place == place[0]).all()):
            place = place[:1]
        return self._kept(("unknown", place.tobytes()), Node(rows=len(place), places=place))

    def _applied(self, node: Apply, arguments: tuple[int, ...]) -> int:
        operation = node.operation
        if operation is Operation.FINITE:  # cells in use are finite, and boxes are
            return self._known(np.ones(1), np.ones(1))
        if operation is Operation.HYPOT:
            squares = tuple(self._square(a) for a in arguments)
            return self._made(Operation.SQRT, (self._made(Operation.ADD, squares),))
        if operation is Operation.ATAN2 and (angle := self._angle_of(arguments)) is not None:
            return self._made(Operation.WRAP, (angle,))
        if operation is Operation.MULTIPLY and arguments[0] == arguments[1]:
            return self._square(arguments[0])
        if operation not in EXTENSIONS and operation is not Operation.POWER:
            what, hint = f"`{operation.value}`, whose bounds are not known", "use another `:method`"
            raise MbmError(problem_faults.not_for_intervals(node.span, what, hint))
        return self._made(operation, arguments)

    def _angle_of(self, arguments: tuple[int, ...]) -> int | None:
        """The angle of which ``arguments`` are sine and cosine, as those of a heading are."""
        sine, cosine = (self.nodes[a] for a in arguments)
        same = sine.operation is Operation.SIN and cosine.operation is Operation.COS
        return sine.arguments[0] if same and sine.arguments == cosine.arguments else None

    def _square(self, argument: int) -> int:
        return self._made(Operation.POWER, (argument, self._known(np.full(1, 2.0), np.full(1, 2.0))))

    def _made(self, operation: Operation, arguments: tuple[int, ...]) -> int:
        """An operation on nodes; computed at once where all are known."""
        if operation in (Operation.ADD, Operation.MULTIPLY):
            arguments = tuple(sorted(arguments))
        rows = max(self.nodes[a].rows for a in arguments)
        node = Node(rows=rows, operation=operation, arguments=arguments)
        if operation is Operation.POWER:
            exponent = self.nodes[arguments[1]]
            if exponent.known is not None and exponent.rows == 1:
                rows = self.nodes[arguments[0]].rows
                node = Node(rows=rows, operation=operation, arguments=arguments[:1], exponent=exponent.known)
        known = [self.nodes[a].known for a in node.arguments]
        if all(each is not None for each in known):
            with np.errstate(all="ignore"):
                low, high = extension(node, tuple(each for each in known if each is not None))
            if bool((low <= high).all()):
                return self._known(low[0], high[0])
        return self._kept((operation, *arguments), node)


def _judged(nodes: list[Node], demands: list[Demand], wanted: list[Wanted]) -> tuple[Node, ...]:
    """The nodes with what their uses say of them: which need not exist, and which count but for whole turns."""
    needed, turning = [np.zeros(node.rows, dtype=bool) for node in nodes], [True] * len(nodes)
    used = [False] * len(nodes)
    for demand in demands:
        needed[demand.node][:], turning[demand.node] = True, False
    for each in wanted:
        for number in each.nodes:
            turning[number] &= each.angle
            used[number] = True
    for number in reversed(range(len(nodes))):
        node = nodes[number]
        for argument in node.arguments:
            used[argument] = True
            whole = node.operation in TURNING or (node.operation in SUMS and turning[number])
            turning[argument] = turning[argument] and whole
        for argument, rows in _needed(node, needed[number], nodes):
            needed[argument] |= rows if nodes[argument].rows > 1 else rows.any()
    angles = [False] * len(nodes)
    found = []
    for number, node in enumerate(nodes):
        sums = node.operation in SUMS and any(angles[a] for a in node.arguments)
        angles[number] = turning[number] and used[number] and (node.operation in DIRECTIONS or sums)
        found.append(replace(node, lenient=not needed[number].all(), turning=angles[number]))
    return tuple(found)


def _needed(node: Node, rows: Mask, nodes: list[Node]) -> Iterator[tuple[int, Mask]]:
    """The arguments of a node, and the rows (rows,) in which each has to exist, as the node has to in ``rows``."""
    if node.operation is Operation.IF:
        test = nodes[node.arguments[0]].known
        if test is not None:  # the data decide
            yield node.arguments[1], rows & (test[0][0] >= 1.0)
            yield node.arguments[2], rows & (test[1][0] <= 0.0)
    elif node.operation not in LENIENT:
        for argument in node.arguments:
            yield argument, rows


LENIENT = frozenset(
    {Operation.IF, Operation.AND, Operation.OR, Operation.NOT, Operation.LESS, Operation.LESS_EQUAL, Operation.EQUAL}
)
"""Operations whose arguments need not all exist."""
