"""Layout tree → lines, none longer than need be, in as few as look good."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import groupby

from mbm.text.layout_tree import WIDEST, Context, Group, Item, Node, Note, Piece
from mbm.values import dataclass

_INDENT = 2
_FARTHEST_SHARED = 72
_DEEPEST_CHAIN = 70
"""Beyond this column a list is not opened behind others on one line, which also bounds the search."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """Laid-out text. The first line begins where the block stands, the others at column 0; notes by line number."""

    lines: tuple[str, ...]
    notes: tuple[tuple[int, Note], ...] = ()

    def cost(self, column: int, tail: int) -> tuple[int, int]:
        """Columns beyond the widest, and lines; ``tail`` characters follow the last line."""
        widths = [len(line) for line in self.lines]
        widths[0] += column
        widths[-1] += tail
        return sum(max(width - WIDEST, 0) for width in widths), len(widths)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plan:
    """One way to lay out a group: its items by rows, and where rows begin.

    ``opens`` says whether the last item of a row may begin on it although it goes on below.
    """

    rows: tuple[tuple[Item, ...], ...]
    indent: int
    opens: bool


class Layouter:
    """Lays out nodes; keeps what it has found, for the same node is tried at the same column many times."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, int, int, int], Block] = {}

    def block(self, node: Node, column: int, tail: int, base: int) -> Block:
        """The best layout of a node that begins at ``column`` and is followed by ``tail`` characters.

        ``base`` is the column in which the line began that a chain of shapes is opened on.
        """
        if isinstance(node, Piece):
            return Block(lines=tuple(node.text.split("\n")))
        if node.flat is not None and column + len(node.flat) + tail <= WIDEST:
            return Block(lines=(node.flat,))
        if not node.rule.chain:
            base = column
        key = (id(node), column, tail, base)
        if key not in self._known:
            self._known[key] = self._broken(node, column, tail, base)
        return self._known[key]

    def _broken(self, group: Group, column: int, tail: int, base: int) -> Block:
        candidates = [self._planned(group, plan, column, tail, base) for plan in _plans(group, column, base)]
        if group.flat is not None:
            candidates.append(Block(lines=(group.flat,)))
        return min(candidates, key=lambda candidate: candidate.cost(column, tail))

    def _planned(self, group: Group, plan: _Plan, column: int, tail: int, base: int) -> Block:
        """The group by a plan. Lines are aligned with the first argument only where that stands beside the head."""
        flow = _Flow(self, group, plan, column, tail, base)
        block = flow.block()
        if group.rule.align and flow.moved and plan.indent != column + _INDENT:
            plan = replace(plan, indent=column + _INDENT)
            block = _Flow(self, group, plan, column, tail, base).block()
        return block


def _plans(group: Group, column: int, base: int) -> Iterator[_Plan]:
    """The ways to lay out a group that does not fit on one line; of equally good ones the first is taken."""
    rule, items = group.rule, group.items
    first = 1 + rule.first
    indent = _indent(group, column, base)
    if group.grouped:
        yield _Plan(rows=_written_rows(items, None if rule.loose else first), indent=indent, opens=True)
        return
    if rule.fill or all(isinstance(node, Piece) for item in items for node in item.nodes):
        head = items if rule.loose else items[:first]
        yield _Plan(rows=(head, items[len(head) :]), indent=indent, opens=False)
    else:
        kept = 2 if rule.align else first
        yield _Plan(rows=(items[:kept], *_single_rows(items[kept:])), indent=indent, opens=False)
    opens = rule.loose and rule.items is not Context.CLAUSE and column <= _DEEPEST_CHAIN
    if opens and all(item.flat is not None and indent + len(item.flat) <= WIDEST for item in items[:-1]):
        yield _Plan(rows=(items,), indent=indent, opens=True)
    if rule.align and group.headed and len(items) > 1:
        yield _Plan(rows=(items[:1], *_single_rows(items[1:])), indent=column + _INDENT, opens=False)


def _indent(group: Group, column: int, base: int) -> int:
    """Where the lines behind the first begin."""
    inside = column + len(group.opening)
    if group.rule.chain:
        return base + _INDENT
    if not group.headed:
        return inside
    if not group.rule.align:
        return column + _INDENT
    head = group.items[0].flat
    begins_there = len(group.items) > 1 and not (group.rule.keep and group.items[1].new_row)
    return inside + len(head) + 1 if head is not None and begins_there else column + _INDENT


def _single_rows(items: tuple[Item, ...]) -> Iterator[tuple[Item, ...]]:
    """Each item on a row of its own, but options that follow one another on one."""
    for options, run in groupby(items, key=lambda item: len(item.nodes) > 1):
        if options:
            yield tuple(run)
        else:
            yield from ((item,) for item in run)


def _written_rows(items: tuple[Item, ...], most: int | None) -> tuple[tuple[Item, ...], ...]:
    """The items by the lines they were written on, at most ``most`` of them on the first."""
    rows: list[list[Item]] = [[]]
    for place, item in enumerate(items):
        if (place and item.new_row) or (place == most and len(rows) == 1):
            rows.append([])
        rows[-1].append(item)
    return tuple(tuple(row) for row in rows)


class _Flow:
    """Puts the items of a group one after the other, by a plan."""

    def __init__(self, layouter: Layouter, group: Group, plan: _Plan, column: int, tail: int, base: int) -> None:
        self._layouter = layouter
        self._group = group
        self._plan = plan
        self._base = base
        self._tail = tail
        self._lines: list[str] = []
        self._notes: list[tuple[int, Note]] = []
        self._text = group.opening  # of the current line
        self._offset = column  # where the current line begins
        self._start = column  # the column in which the chain on the current line begins
        self._fresh = True  # nothing stands on the line yet, or the opening bracket alone
        self._full = False  # nothing can follow on the line
        self.moved = False  # the item behind the head went to a line of its own

    def block(self) -> Block:
        """The group as laid out by the plan."""
        self._start = self._base
        rows = [row for row in self._plan.rows if row]
        last_item = self._group.items[-1] if self._group.items else None
        for number, row in enumerate(rows):
            if number:
                self._new_line()
            for item in row:
                tail = self._tail + len(self._group.closing) if item is last_item else 0
                self._put(item, tail, last_of_row=item is row[-1])
        if last_item is not None and (last_item.ends_line or last_item.note is not None):
            self._new_line()
        self._lines.append(self._text + self._group.closing)
        return Block(lines=tuple(self._lines), notes=tuple(self._notes))

    def _column(self) -> int:
        return self._offset + len(self._text) + (0 if self._fresh else 1)

    def _new_line(self) -> None:
        if self._fresh and self._lines and not self._full:
            return
        self._lines.append(self._text.rstrip())
        self._text, self._offset, self._start = " " * self._plan.indent, 0, self._plan.indent
        self._fresh, self._full = True, False

    def _put(self, item: Item, tail: int, *, last_of_row: bool) -> None:
        if self._full or (item.blank and not self._fresh) or (item.ends_line and not self._fresh):
            self._new_line()
        if item.blank and self._lines:
            self._lines.append("")
        if not self._fits(item, tail) and not self._fresh and not self._opens_here(item, tail, last_of_row):
            self._new_line()
        if self._fresh and self._lines and self._group.headed and any(item is each for each in self._group.items[1:2]):
            self.moved = True
        block = self._item_block(item, self._column(), tail, self._start)
        self._append(block)
        self._full = item.ends_line or (len(block.lines) > 1 and isinstance(item.nodes[-1], Group))
        if item.note is not None:
            self._notes.append((len(self._lines), item.note))
            self._full = True

    def _fits(self, item: Item, tail: int) -> bool:
        """The item fits on the rest of the line; of a string or comment of several lines, the first line does."""
        node = item.nodes[0]
        if isinstance(node, Piece) and len(item.nodes) == 1 and node.flat is None:
            return self._column() + len(node.text.partition("\n")[0]) <= WIDEST
        return item.flat is not None and self._column() + len(item.flat) + tail <= WIDEST

    def _opens_here(self, item: Item, tail: int, last_of_row: bool) -> bool:
        """An item that does not fit on the rest of the line is better begun there than on a line of its own."""
        if len(self._group.items) and item is self._group.items[0]:
            return True
        if not (last_of_row and self._plan.opens):
            return False
        here, below = self._column(), self._plan.indent
        opened = self._item_block(item, here, tail, self._start).cost(here, tail)
        beneath = self._item_block(item, below, tail, below).cost(below, tail)
        return opened < (beneath[0], beneath[1] + 1)

    def _item_block(self, item: Item, column: int, tail: int, start: int) -> Block:
        if len(item.nodes) == 1:
            return self._layouter.block(item.nodes[0], column, tail, start)
        option = f"{item.nodes[0].flat} "
        value = self._layouter.block(item.nodes[1], column + len(option), tail, column + len(option))
        return Block(lines=(option + value.lines[0], *value.lines[1:]), notes=value.notes)

    def _append(self, block: Block) -> None:
        gap = "" if self._fresh else " "
        number = len(self._lines)
        self._notes.extend((number + line, note) for line, note in block.notes)
        self._text += gap + block.lines[0]
        for line in block.lines[1:]:
            self._lines.append(self._text)
            self._text, self._offset = line, 0
        self._fresh = False


def with_notes(block: Block) -> list[str]:
    """The lines with their comments: in the column where they were written, if the code leaves room.

    Comments of neighbouring lines share a column, unless that would push ragged ones far to the right.
    """
    notes = dict(block.notes)
    lines = list(block.lines)
    for run in _runs(sorted(notes)):
        columns = [max(notes[number].column, len(lines[number]) + 2) for number in run]
        written_together = len({notes[number].column for number in run}) == 1
        if written_together or max(columns) <= _FARTHEST_SHARED:
            columns = [max(columns)] * len(run)
        for number, column in zip(run, columns, strict=True):
            lines[number] = lines[number].ljust(column) + notes[number].text
    return lines


def _runs(numbers: Iterable[int]) -> list[list[int]]:
    runs: list[list[int]] = []
    for number in numbers:
        if runs and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return runs
