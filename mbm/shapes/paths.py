"""Paths to features: quoted, ``'(board (vertex 1))``, or flat, ``board/vertex/1``, into one row of segments."""

from __future__ import annotations

from mbm.expression.nodes import Opaque
from mbm.language.coerce import integer, text
from mbm.language.values import Call, Value
from mbm.shapes import faults
from mbm.text.types import Bracket, Form, MbmError, Numeral, Sequence, Span, Symbol, Text
from mbm.values import dataclass

NUMBERED = ("vertex", "line", "plane", "curve")
"""Kinds of features that take a number."""

KINDS = (*NUMBERED, "origin", "axis")
KINDS_NOT_YET = {"silhouette": "silhouettes"}


@dataclass(frozen=True, slots=True)
class ElementName:
    """``(leg 2)`` in a path: the name that an array of the model holds."""

    array: str
    index: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """One step of a path: a name, a number, or an element of an array of names."""

    step: str | int | ElementName
    span: Span

    @property
    def name(self) -> str | None:
        """The step, if it is a name."""
        return self.step if isinstance(self.step, str) else None


def segments_of(value: Value, span: Span, call: Call) -> tuple[Segment, ...]:
    """The segments of a path that is a quoted list, a quoted name, or a text.

    Raises:
        MbmError: not built like a path.
        StaticColumnNeeded: the path stands in a data column.

    """
    if isinstance(value, Sequence | Symbol | Text):
        return tuple(_written(value, call))
    return flat_segments(text(value, span, "a path: a quoted list or a text"), span)


def flat_segments(path: str, span: Span) -> tuple[Segment, ...]:
    """The segments of ``part/part/kind/number``."""
    pieces = [piece.strip() for piece in path.split("/")]
    if not all(pieces):
        raise MbmError(faults.bad_path(span, f"the path `{path}` has an empty piece" if path else "the path is empty"))
    return tuple(Segment(step=int(p) if _is_number(p) else p, span=span) for p in pieces)


def _is_number(piece: str) -> bool:
    return piece.isascii() and piece.isdigit() and len(piece) < 10


def _written(form: Form, call: Call) -> list[Segment]:
    """Lists nest at their end, ``(a (b (vertex 1)))``; what is written flat, ``(a b vertex 1)``, means the same."""
    segments: list[Segment] = []
    waiting: list[Form] = [form]
    while waiting:
        item = waiting.pop()
        if isinstance(item, Sequence) and item.bracket is Bracket.ROUND and item.items:
            head, *rest = item.items
            if isinstance(head, Sequence):
                segments.append(element_segment(head, call))
                waiting.extend(reversed(rest))
            else:
                waiting.extend(reversed(item.items))
        elif isinstance(item, Symbol) and segments and segments[-1].name in NUMBERED:
            segments.append(number_segment(item, call))
        elif isinstance(item, Symbol):
            segments.append(Segment(step=item.name, span=item.span))
        elif isinstance(item, Text):
            segments.extend(flat_segments(item.value, item.span))
        elif isinstance(item, Numeral):
            segments.append(number_segment(item, call))
        else:
            raise MbmError(faults.bad_path(item.span, "this is neither a name nor a number of a path"))
    return segments


def number_segment(form: Form, call: Call) -> Segment:
    """The number of a feature, known while compiling or read from a data column."""
    value = call.evaluator.wanted(form, call.scope)
    if isinstance(value, Opaque):
        raise MbmError(faults.bad_path(form.span, "the number of the feature is not known here"))
    return Segment(step=integer(value, form.span, "the number of a feature"), span=form.span)


def element_segment(form: Sequence, call: Call) -> Segment:
    """``(leg 2)``."""
    if form.head is None or len(form.items) != 2:
        raise MbmError(faults.bad_path(form.span, "a part's name is a symbol or an array element `(leg 2)`"))
    index = integer(call.evaluator.wanted(form.items[1], call.scope), form.items[1].span, "an index")
    return Segment(step=ElementName(form.head, index), span=form.span)
