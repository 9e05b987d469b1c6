"""Elements by index, from 1, and members of families by key."""

from __future__ import annotations

from mbm.expression.nodes import Column, Number, Opaque, nearest
from mbm.language import faults
from mbm.language.coerce import integer, opaque_element, scalar
from mbm.language.values import Array, FamilyValue, ListValue, TextColumn, Value, describe
from mbm.text.suggest import suggestion
from mbm.text.types import Form, MbmError, Sequence, Span


def element(value: Value, arguments: tuple[Value, ...], form: Sequence) -> Value:
    """``(v 2)``, ``(M 1 3)``, ``(leg i)``, ``(cam camera)``, ``(theta finger 2)``; more arguments go on inside."""
    if not arguments:
        raise MbmError(faults.bad_index(form.span, f"{describe(value)} is indexed, but no index is given"))
    forms = form.items[1:]
    position = 0
    while position < len(arguments):
        value, used = _step(value, arguments[position:], forms[position:], form)
        position += used
    return value


def _step(value: Value, arguments: tuple[Value, ...], forms: tuple[Form, ...], form: Sequence) -> tuple[Value, int]:
    span = forms[0].span
    if isinstance(value, FamilyValue):
        return value.member(family_key(value, arguments[0], span)), 1
    if isinstance(value, Opaque):
        return opaque_element(value, integer(arguments[0], span, "an index")), 1
    if isinstance(value, ListValue):
        return value.items[_position(arguments[0], len(value.items), span)], 1
    if not isinstance(value, Array):
        raise MbmError(faults.bad_index(form.span, f"{describe(value)} cannot be indexed"))
    if not value.is_matrix:
        return value.elements[_position(arguments[0], value.shape[0], span)], 1
    height, width = value.shape
    first = _position(arguments[0], height, span) * width
    row = value.elements[first : first + width]
    if len(arguments) == 1:
        return Array((len(row),), row), 1
    return row[_position(arguments[1], len(row), forms[1].span)], 2


def _position(value: Value, length: int, span: Span) -> int:
    index = integer(value, span, "an index (a whole number)")
    if not 1 <= index <= length:
        raise MbmError(faults.bad_index(span, f"index {index} is outside 1 … {length}", "indices count from 1"))
    return index - 1


def family_key(family: FamilyValue, value: Value, span: Span) -> str | float | Column | TextColumn:
    """A literal key, checked, or the column that holds the key of each row."""
    if isinstance(value, Column | TextColumn):
        return value
    key: str | float
    if isinstance(value, str):
        key = value
    else:
        number = scalar(value, span, f"a key of `{family.name}`")
        if not isinstance(number, Number):
            raise MbmError(
                faults.bad_index(span, f"the key of `{family.name}` is computed", "use a literal or a column as key")
            )
        key = nearest(number.value)
    if key not in family.keys:
        shown = f"`{key}`" if isinstance(key, str) else f"{key:g}"
        hint = suggestion(str(key), sorted(str(k) for k in family.keys), None)
        raise MbmError(faults.bad_index(span, f"`{family.name}` has no member {shown}", hint))
    return key
