"""How each kind of list is laid out: which items stay on the line of its head, and how the others go on."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum, auto
from itertools import takewhile

from mbm.text.types import Bracket, Sequence, Symbol
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
