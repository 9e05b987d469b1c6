"""What a name at the head of a list means in a model's body: a part, or one of the library's models."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mbm.language.curves import CurveValue
from mbm.language.functions import UserFunction, UserMacro
from mbm.language.values import Callable_, Evaluator, ListValue, Scope, Value
from mbm.shapes.surface import CLAUSES
from mbm.shapes.types import ModelFunction, Shape
from mbm.text.types import Bracket, Form, Keyword, Sequence, Symbol

TRANSFORMS = ("trans", "rotate", "scale", "transform")
CURVES = ("curve", "polyline", "spline")
SWEEP_USAGES: Mapping[str, str] = MappingProxyType(
    {
        "extrude": "(extrude PROFILE length)",
        "revolve": "(revolve PROFILE angle)",
        "sweep": "(sweep PROFILE PATH)",
    }
)
_BODIES = ("let", "let*", "if", "cond")
_WORDS = frozenset({*CLAUSES, *TRANSFORMS, *CURVES, *SWEEP_USAGES, "perse", "or", "for", "mesh", "part", "point"})


def is_users(function: Callable_ | None) -> bool:
    """Whether the user defined this function or model: then no part has its name without ``(part …)``."""
    if isinstance(function, UserFunction | UserMacro):
        return True
    return isinstance(function, ModelFunction) and not function.from_library


def names_part_of_array(value: Value | None) -> bool:
    """Whether a value is an array of names, as parts take theirs from."""
    return isinstance(value, ListValue) and any(isinstance(item, Symbol | str) for item in value.items)


def fits(function: ModelFunction, form: Sequence, evaluator: Evaluator, scope: Scope) -> bool:
    """Whether ``form`` calls this model of the library: as many arguments as it takes, none of them a shape."""
    arguments = form.items[1:]
    most = len(function.parameters.required) + len(function.parameters.optional)
    return len(function.parameters.required) <= len(arguments) <= most and are_values(arguments, evaluator, scope)


def are_values(arguments: tuple[Form, ...], evaluator: Evaluator, scope: Scope) -> bool:
    """Whether there are arguments and none describes a shape."""
    return bool(arguments) and not any(describes_shape(a, evaluator, scope) for a in arguments)


def describes_shape(form: Form, evaluator: Evaluator, scope: Scope) -> bool:
    """Whether a form reads as a shape rather than as a number. Nothing is evaluated."""
    if isinstance(form, Symbol):
        return isinstance(scope.lookup(form.name, form.span), Shape | CurveValue)
    if not isinstance(form, Sequence) or form.bracket is not Bracket.ROUND or not form.items:
        return False
    head = form.items[0]
    if isinstance(head, Sequence):
        inner = head.items[0] if head.items else None
        named = scope.lookup(inner.name, inner.span) if isinstance(inner, Symbol) else None
        return names_part_of_array(named) or (isinstance(inner, Symbol) and inner.name in CLAUSES)
    if not isinstance(head, Symbol):
        return False
    function = evaluator.vocabulary.functions.get(head.name)
    if is_users(function):
        return isinstance(function, ModelFunction)
    if head.name in _WORDS or isinstance(function, ModelFunction):
        return True
    if head.name in _BODIES:
        last = form.items[-1]
        if head.name == "cond" and isinstance(last, Sequence) and last.items:
            last = last.items[-1]
        return not isinstance(last, Keyword) and describes_shape(last, evaluator, scope)
    known = function is not None or head.name in evaluator.vocabulary.special_forms
    return not known and scope.lookup(head.name, head.span) is None
