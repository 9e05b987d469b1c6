"""Forms and comments → the tree that is laid out: pieces of text in groups, with the author's line breaks noted.

How each kind of list is laid out: which items stay on the line of its head, and how the others go on.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from enum import Enum, auto
from itertools import takewhile
from typing import TypeAlias

from mbm.text.comments import Comment
from mbm.text.types import Bracket, Form, Keyword, Sequence, Source, Symbol
from mbm.values import dataclass


class Context(Enum):
    """What a form is read as, by its position; only its layout depends on it."""

    TOP = auto()
    CLAUSE = auto()
    SHAPE = auto()
    EXPRESSION = auto()
    ENTRY = auto()
    """An item of a clause, a binding, a row: a name and what is said about it, or plain data."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """The layout of a list that is not put on one line."""

    first: int = 0
    """Items that stay on the line of the head, if the author has not grouped the items himself."""
    loose: bool = True
    """Further items may stay there, too."""
    keep: bool = True
    """The author's grouping of items on lines is kept; otherwise the list is joined where it fits on one line."""
    fill: bool = False
    """Without the author's grouping, items are filled into lines, not put one on each."""
    align: bool = False
    """The other lines begin under the first argument, not two columns right of the bracket."""
    chain: bool = False
    """A last item that opens on the same line is continued two columns right of where that line begins."""
    items: Context = Context.EXPRESSION
    """What the items behind the first ones are."""


_CALL = Rule(keep=False, align=True)
_DATA = Rule(fill=True, align=True, items=Context.ENTRY)
_NAMED = Rule(first=1, keep=False, fill=True)
_SHAPE = Rule(chain=True, items=Context.SHAPE)
_CLAUSE = Rule(first=1, fill=True, items=Context.ENTRY)
_CLAUSE_LIST = Rule(loose=False, fill=True, items=Context.ENTRY)
_EXPRESSIONS = Rule(loose=False, fill=True)
_BODY = Rule(first=1, loose=False)

_DEFINITIONS = {
    "problem": Rule(first=1, items=Context.CLAUSE),
    "defun": Rule(first=2, loose=False),
    "defmacro": Rule(first=2, loose=False),
    "defmodel": Rule(first=2, loose=False, items=Context.SHAPE),
    "defconst": Rule(first=1),
}
_MODEL = Rule(first=1, loose=False, items=Context.SHAPE)

_CLAUSES = _DEFINITIONS | {
    "data": Rule(first=2, fill=True, items=Context.ENTRY),
    "pair": Rule(first=2, fill=True, items=Context.ENTRY),
    "unknowns": _CLAUSE_LIST,
    "constants": _CLAUSE_LIST,
    "define": _CLAUSE_LIST,
    "derive": _CLAUSE_LIST,
    "dynamics": _EXPRESSIONS,
    "constraints": _EXPRESSIONS,
    "states": Rule(first=1, loose=False, items=Context.ENTRY),
    "solve": Rule(first=1, fill=True, align=True),
}

_SHAPES = {
    "trans": Rule(first=1, chain=True, items=Context.SHAPE),
    "rotate": Rule(first=1, chain=True, items=Context.SHAPE),
    "scale": Rule(first=1, chain=True, items=Context.SHAPE),
    "part": Rule(first=1, chain=True, items=Context.SHAPE),
    "for": Rule(first=1, loose=False, chain=True, items=Context.SHAPE),
    "declare": _CLAUSE_LIST,
    "constraints": _EXPRESSIONS,
    "vertexes": _CLAUSE_LIST,
    "lines": _CLAUSE_LIST,
    "planes": _CLAUSE_LIST,
}

_CALLS = {
    "let": _BODY,
    "let*": _BODY,
    "lambda": Rule(first=1),
    "for": Rule(first=1, loose=False, fill=True),
    "cond": Rule(align=True, items=Context.ENTRY),
    "trans": Rule(first=1, keep=False),
    "rotate": Rule(first=1, keep=False),
    "transform": Rule(first=1, keep=False),
    "table": Rule(first=1, fill=True, items=Context.ENTRY),
}


def rule_for(form: Sequence, context: Context) -> Rule:
    """The rule for a list in a context."""
    head = form.head
    if head == "observe" and context is Context.CLAUSE:
        names = takewhile(lambda item: isinstance(item, Symbol), form.items[1:])
        return replace(_BODY, first=len(tuple(names)))
    if head is None and not (context is Context.SHAPE and form.bracket is Bracket.ROUND):
        return _DATA
    match context:
        case Context.TOP if head not in _CLAUSES and len(form.items) > 1 and isinstance(form.items[1], Sequence):
            return _MODEL
        case Context.TOP | Context.CLAUSE:
            return _CLAUSES.get(head or "", _CLAUSE)
        case Context.SHAPE:
            return _SHAPES.get(head or "", _SHAPE)
        case Context.ENTRY if head not in _CALLS:
            return _NAMED
        case _:
            return _CALLS.get(head or "", _CALL)


def item_context(form: Sequence, rule: Rule, place: int) -> Context:
    """What the item at ``place`` (0 = the head) of a list is read as."""
    if place == 0:
        return Context.ENTRY
    if form.head == "observe" and not isinstance(form.items[place], Symbol):
        return Context.EXPRESSION
    return Context.ENTRY if place <= rule.first and rule is not _NAMED and rule.keep else rule.items


DEEPEST_LAYOUT = 60
"""Groups nested deeper are left as they are written."""

WIDEST = 100
"""Columns of a line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """A comment at the end of a line; ``column`` (from 0) is where the author wrote it."""

    text: str
    column: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """Text that is printed as it is; it may hold line breaks (strings, block comments)."""

    text: str

    @property
    def flat(self) -> str | None:
        """The text, if it is one line."""
        return None if "\n" in self.text else self.text


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """What stands in a group: a form, an option with its value, or a comment."""

    nodes: tuple[Node, ...]
    new_row: bool
    """It begins a line in the source."""
    blank: bool
    """A blank line stands before it."""
    ends_line: bool = False
    """It is a line comment: nothing can follow on its line."""
    note: Note | None = None

    @property
    def flat(self) -> str | None:
        """The item on one line, or None if it cannot or should not be."""
        if self.note is not None or self.ends_line or self.blank:
            return None
        parts = [node.flat for node in self.nodes]
        return " ".join(part for part in parts if part is not None) if None not in parts else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """A bracketed list: ``opening`` is the bracket with the quotes before it."""

    opening: str
    closing: str
    items: tuple[Item, ...]
    rule: Rule
    headed: bool
    """The first item is a head, the others are its arguments."""
    flat: str | None
    """The list on one line, or None if it cannot or should not be."""

    grouped: bool
    """The author distributed the items over several lines, and that is kept."""


Node: TypeAlias = Piece | Group


def build_tree(
    forms: tuple[Form, ...], comments: tuple[Comment, ...], source: Source, squared: frozenset[int]
) -> tuple[Item, ...]:
    """The top-level items of a source; ``squared`` are the offsets of lists to be printed with square brackets."""
    builder = _Builder(source, comments, squared)
    return builder.items([(form, Context.TOP) for form in forms], 0, len(source.text), 0)


class _Builder:
    """Walks forms and comments side by side, in the order of the text."""

    def __init__(self, source: Source, comments: tuple[Comment, ...], squared: frozenset[int]) -> None:
        self._source = source
        self._comments = comments
        self._taken = 0  # comments that are in the tree already
        self._squared = squared

    def items(self, forms: Iterable[tuple[Form, Context]], start: int, end: int, depth: int) -> tuple[Item, ...]:
        """The forms and the comments between two offsets."""
        items: list[Item] = []
        last = start  # where the previous item ends
        for form, context in forms:
            core = _core(form)
            last = self._take_comments(items, last, core.span.start)
            begins = form.span.start if form.span.start >= last else core.span.start
            gap = self._source.text[last:begins]
            node = self._node(form, context, depth)
            last = form.span.end
            before = items[-1] if items else None
            if depth and before is not None and _awaits_value(before) and not isinstance(form, Keyword):
                items[-1] = replace(before, nodes=(*before.nodes, node))
            else:
                items.append(Item(nodes=(node,), new_row="\n" in gap, blank=bool(items) and gap.count("\n") > 1))
        self._take_comments(items, last, end)
        return tuple(_hoisted(item) for item in items)

    def _take_comments(self, items: list[Item], last: int, end: int) -> int:
        """Adds the comments up to ``end``; gives the offset behind the last of them, or ``last``."""
        while self._taken < len(self._comments) and self._comments[self._taken].span.start < end:
            comment = self._comments[self._taken]
            self._taken += 1
            gap = self._source.text[last : comment.span.start]
            last = comment.span.end
            if not comment.block and items and "\n" not in gap:
                note = Note(text=comment.span.text, column=comment.span.column - 1)
                items[-1] = replace(items[-1], note=note)
                continue
            blank = bool(items) and gap.count("\n") > 1
            piece = Piece(text=comment.span.text)
            items.append(Item(nodes=(piece,), new_row="\n" in gap, blank=blank, ends_line=not comment.block))
        return last

    def _node(self, form: Form, context: Context, depth: int) -> Node:
        core = _core(form)
        quotes = "".join(_quotes(form))
        if not isinstance(core, Sequence):
            gap = " " if quotes.endswith(",") and core.span.text.startswith("@") else ""
            return Piece(text=quotes + gap + core.span.text)
        if depth >= DEEPEST_LAYOUT:
            while self._taken < len(self._comments) and self._comments[self._taken].span.start < core.span.end:
                self._taken += 1
            return Piece(text=quotes + core.span.text)
        rule = rule_for(core, context)
        contexts = [(item, item_context(core, rule, place)) for place, item in enumerate(core.items)]
        square = core.bracket is Bracket.SQUARE or core.span.start in self._squared
        return _group(
            opening=quotes + ("[" if square else "("),
            closing="]" if square else ")",
            items=self.items(contexts, core.span.start + 1, core.span.end - 1, depth + 1),
            rule=rule,
            headed=core.head is not None,
        )


def _group(*, opening: str, closing: str, items: tuple[Item, ...], rule: Rule, headed: bool) -> Group:
    parts = [item.flat for item in items]
    grouped = rule.keep and any(item.new_row for item in items[1:])
    flat = None
    if not grouped and None not in parts:
        flat = opening + " ".join(part for part in parts if part is not None) + closing
    return Group(opening=opening, closing=closing, items=items, rule=rule, headed=headed, flat=flat, grouped=grouped)


def _hoisted(item: Item) -> Item:
    """A comment behind the last item of a list moves behind the list: the bracket is closed before the comment."""
    node = item.nodes[-1]
    if item.note is not None or not isinstance(node, Group) or not node.items:
        return item
    last = node.items[-1]
    if last.note is None:
        return item
    closed = _group(
        opening=node.opening,
        closing=node.closing,
        items=(*node.items[:-1], _hoisted(replace(last, note=None))),  # which may make room for one further in
        rule=node.rule,
        headed=node.headed,
    )
    return replace(item, nodes=(*item.nodes[:-1], closed), note=last.note)


def _awaits_value(item: Item) -> bool:
    """It is an option without its value yet."""
    node = item.nodes[0]
    return (
        len(item.nodes) == 1
        and isinstance(node, Piece)
        and node.text.startswith(":")
        and item.note is None
        and not item.ends_line
    )


def _core(form: Form) -> Form:
    """The form behind its quotes."""
    while _is_quoted(form) and isinstance(form, Sequence):
        form = form.items[1]
    return form


def _quotes(form: Form) -> list[str]:
    quotes = []
    while _is_quoted(form) and isinstance(form, Sequence):
        quotes.append(form.items[0].span.text)
        form = form.items[1]
    return quotes


def _is_quoted(form: Form) -> bool:
    """It is written with a prefix, not spelt ``(quote x)``."""
    return isinstance(form, Sequence) and not form.span.source.text.startswith(("(", "["), form.span.start)
