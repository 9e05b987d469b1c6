"""``(chessboard "a*.jpg" 9 6 25mm)``, ``(contour "a.png" :threshold 90)``: a path, and what a format asks for."""

from __future__ import annotations

import math

from mbm.expression.algebra import known_value
from mbm.expression.nodes import Constant, Number, nearest
from mbm.expression.units import NONE, Dimension, base
from mbm.language import faults as language_faults
from mbm.language.values import Evaluator, Scope, describe
from mbm.problem.clauses import split_options
from mbm.problem.tables import Argument, ArgumentKind, Format
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol, Text
from mbm.values import dataclass

METRE = base("m")
MOST_COUNT = 1000
"""Of columns, rows and the like: beyond it no image has room."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Given:
    """The path and the arguments by name, in the order of the format; ``length`` is the unit of one that states it."""

    path: str
    values: tuple[tuple[str, float | str], ...]
    length: tuple[str, Span] | None


def read_arguments(evaluator: Evaluator, scope: Scope, form: Sequence, known: Format) -> Given:
    """What stands in a source behind its head.

    Raises:
        MbmError: bad-form, unknown-keyword, wrong-kind, bad-argument … at the place of what is wrong.

    """
    head = form.head or ""
    required = [a for a in known.arguments if a.required]
    optional = {a.name: a for a in known.arguments if not a.required}
    options = split_options(form.items[1:], form.span, owner=f"`{head}`", known=tuple(optional))
    if len(options.positional) != 1 + len(required) or not isinstance(options.positional[0], Text):
        wanted = ", ".join(f"`{a.name}`" for a in required)
        message = f"`{head}` takes a path or pattern of paths{', and ' + wanted if wanted else ''}"
        raise MbmError(language_faults.bad_form(form.span, message, usage(head, known)))
    path = options.positional[0].value
    forms = dict(zip((a.name for a in required), options.positional[1:], strict=True))
    values: dict[str, float | str] = {name: a.default for name, a in optional.items() if a.default is not None}
    length: tuple[str, Span] | None = None
    for argument in known.arguments:
        place = forms.get(argument.name, options.get(argument.name))
        if place is None:
            continue
        if argument.kind in (ArgumentKind.WORD, ArgumentKind.FILE):
            values[argument.name] = _text(place, argument)
            continue
        value, dimension = _number(evaluator, scope, place, argument)
        values[argument.name] = value
        if length is None and argument.kind is ArgumentKind.LENGTH and dimension is not None:
            length = dimension.symbol(), place.span
    ordered = tuple((a.name, values[a.name]) for a in known.arguments if a.name in values)
    return Given(path=path, values=ordered, length=length)


def usage(head: str, known: Format) -> str:
    """``(chessboard "path" columns rows size)``; of a file of several tables with the one that is meant."""
    required = [a.name for a in known.arguments if a.required]
    optional = [f"[:{a.name} {_shown(a)}]" for a in known.arguments if not a.required]
    return " ".join([f'({head} "path"', *(f":{part}" for part in known.parts), *required, *optional]) + ")"


def _shown(argument: Argument) -> str:
    if argument.kind is ArgumentKind.WORD:
        return "|".join(argument.choices)
    return '"path"' if argument.kind is ArgumentKind.FILE else argument.kind.value.split()[-1]


def _text(form: Form, argument: Argument) -> str:
    if argument.kind is ArgumentKind.FILE:
        if not isinstance(form, Text):
            raise MbmError(language_faults.wrong_kind(form.span, f"a path for `{argument.name}`", form.span.text))
        return form.value
    if not isinstance(form, Symbol) or form.name not in argument.choices:
        wanted = f"{' or '.join(f'`{choice}`' for choice in argument.choices)} for `{argument.name}`"
        raise MbmError(language_faults.wrong_kind(form.span, wanted, f"`{form.span.text}`"))
    return form.name


def _number(evaluator: Evaluator, scope: Scope, form: Form, argument: Argument) -> tuple[float, Dimension | None]:
    wanted = f"{argument.kind} for `{argument.name}`"
    value = evaluator.wanted(form, scope)
    if not isinstance(value, Number | Constant):
        raise MbmError(language_faults.wrong_kind(form.span, wanted, describe(value)))
    number, dimension = nearest(known_value(value)), value.dimension
    fits = (None, METRE) if argument.kind is ArgumentKind.LENGTH else (None, NONE)
    if dimension not in fits:
        raise MbmError(language_faults.wrong_kind(form.span, wanted, f"`{form.span.text}`"))
    most = min(argument.most, MOST_COUNT) if argument.kind is ArgumentKind.COUNT else argument.most
    whole = argument.kind is not ArgumentKind.COUNT or number.is_integer()
    positive = argument.kind is not ArgumentKind.LENGTH or number > 0
    if not (math.isfinite(number) and whole and positive and argument.least <= number <= most):
        limits = f" from {argument.least:g} to {most:g}" if math.isfinite(most) else " above 0"
        raise MbmError(language_faults.wrong_kind(form.span, wanted + limits, f"`{form.span.text}`"))
    return number, dimension
