"""Functions in Python: ``(external "module:function" arg… :size n [:jacobian "module:function"] [:batch true])``.

Nothing is looked up or imported here: the value names a function and its arguments, and a solve that is allowed to
calls it.
"""

from __future__ import annotations

import re

from mbm.expression.nodes import Apply, Expression, External, Operation, Output
from mbm.language import faults
from mbm.language.scope import integer, scalar, vector
from mbm.language.values import (
    SCALARS,
    Array,
    Builtin,
    Call,
    ListValue,
    Placeable,
    PoseValue,
    RotationValue,
    Value,
    describe,
)
from mbm.text.types import Form, Keyword, MbmError
from mbm.values import dataclass

USAGE = '(external "module:function" arg … :size n [:jacobian "module:function"] [:batch true])'
_OPTIONS = ("size", "jacobian", "batch")
_PLACE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")
"""``package.module:function``, as entry points are written."""


@dataclass(frozen=True, slots=True)
class _Given:
    """A value with the form that it came from."""

    value: Value
    form: Form


def _external(call: Call) -> Value:
    positional, options = _sorted(call)
    if "size" not in options:
        raise MbmError(faults.bad_form(call.span, "`external` does not say how many numbers it gives", USAGE))
    size = integer(options["size"].value, options["size"].form.span, "the number of values")
    if size < 1:
        raise MbmError(faults.wrong_kind(options["size"].form.span, "a number of values from 1", str(size)))
    call.evaluator.budget.check_length(size, call.form)
    call.evaluator.budget.make(size, call.form)
    batch = options["batch"].value if "batch" in options else False
    if not isinstance(batch, bool):
        raise MbmError(faults.wrong_kind(options["batch"].form.span, "`true` or `false`", describe(batch)))
    arrays = [_argument(given) for given in positional[1:]]
    external = External(
        function=_place(positional[0]),
        jacobian=_place(options["jacobian"]) if "jacobian" in options else None,
        size=size,
        shapes=tuple(shape for shape, _ in arrays),
        batch=batch,
        span=call.span,
    )
    elements = tuple(element for _, own in arrays for element in own)
    made = tuple(
        Apply(Operation.EXTERNAL, elements, span=call.span, output=Output(external, index)) for index in range(size)
    )
    return made[0] if size == 1 else Array((size,), made)


def _sorted(call: Call) -> tuple[list[_Given], dict[str, _Given]]:
    """The arguments, and the options by name."""
    given = [_Given(value, form) for value, form in zip(call.arguments, call.forms, strict=True)]
    first = next((i for i, each in enumerate(given) if isinstance(each.value, Keyword)), len(given))
    options: dict[str, _Given] = {}
    for i in range(first, len(given), 2):
        name = given[i].value
        if not isinstance(name, Keyword) or name.name not in _OPTIONS or name.name in options or i + 1 == len(given):
            raise MbmError(faults.bad_form(given[i].form.span, "the options of `external` do not fit", USAGE))
        options[name.name] = given[i + 1]
    if first == 0:
        raise MbmError(faults.bad_form(call.span, "`external` names no function", USAGE))
    return given[:first], options


def _place(given: _Given) -> str:
    """``module:function``: written in the problem, never taken from a table."""
    if not isinstance(given.value, str):
        raise MbmError(faults.wrong_kind(given.form.span, 'a text "module:function"', describe(given.value)))
    if _PLACE.fullmatch(given.value) is None:
        raise MbmError(faults.bad_form(given.form.span, "this names no function of a module", '"module:function"'))
    return given.value


def _argument(given: _Given) -> tuple[tuple[int, ...], tuple[Expression, ...]]:
    """Shape and elements of an argument; a rotation is its matrix."""
    value, span = given.value, given.form.span
    if isinstance(value, SCALARS):
        return (), (scalar(value, span),)
    if isinstance(value, RotationValue):
        return value.matrix.shape, value.matrix.elements
    if isinstance(value, PoseValue):
        wanted = "numbers, vectors, matrices and rotations"
        raise MbmError(faults.wrong_kind(span, wanted, f"{describe(value)}; give its rotation and its translation"))
    if isinstance(value, Array) and value.is_matrix:
        return value.shape, value.elements
    if isinstance(value, Array | ListValue | Placeable):
        made = vector(value, span)
        return made.shape, made.elements
    return (), (scalar(value, span, "a number, a vector or a matrix"),)


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("external", USAGE, "Numbers that a function in Python gives; it runs only where that is allowed.", 1, None, _external),
)  # fmt: skip
