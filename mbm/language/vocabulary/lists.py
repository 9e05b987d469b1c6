"""Lists: making, walking, folding (LANGUAGE §2)."""

from __future__ import annotations

from mbm.expression.algebra import number
from mbm.language import faults
from mbm.language.scope import integer, list_items
from mbm.language.values import Builtin, Call, Callable_, ListValue, Macro, Value, describe
from mbm.text.types import Bracket, MbmError, Sequence


def invoke(call: Call, function: Value, *arguments: Value) -> Value:
    """Call a function value with values, on behalf of ``call``."""
    if not isinstance(function, Callable_) or isinstance(function, Macro):
        raise MbmError(faults.wrong_kind(call.forms[0].span, "a function", describe(function)))
    if isinstance(function, Builtin):
        few = len(arguments) < function.minimum
        if few or (function.maximum is not None and len(arguments) > function.maximum):
            raise MbmError(faults.wrong_arity(call.span, function.name, function.usage, len(arguments)))
    if isinstance(function, Builtin):  # the bodies of others count themselves
        call.evaluator.budget.spend(1, call.form)
    # The arguments have no forms of their own: what is wrong with one of them is said at the whole call.
    form = Sequence(items=(call.form,) * (1 + len(arguments)), bracket=Bracket.ROUND, span=call.span)
    return call.evaluator.arrived(call.evaluator.call(function, arguments, form, call.scope), call.form, call.scope)


def _list(call: Call) -> Value:
    return ListValue(call.arguments)


def _append(call: Call) -> Value:
    lists = [list_items(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True)]
    call.evaluator.budget.check_length(sum(map(len, lists)), call.form)
    return ListValue(tuple(item for items in lists for item in items))


def _length(call: Call) -> Value:
    return number(len(list_items(call.arguments[0], call.forms[0].span)), call.span)


def _range(call: Call) -> Value:
    first, last = (integer(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True))
    call.evaluator.budget.check_length(last - first + 1, call.form)
    call.evaluator.budget.make(max(0, last - first + 1), call.form)
    return ListValue(tuple(number(i) for i in range(first, last + 1)))


def _map(call: Call) -> Value:
    lists = [list_items(v, f.span) for v, f in zip(call.arguments[1:], call.forms[1:], strict=True)]
    if len({len(items) for items in lists}) > 1:
        shown = " and ".join(str(len(items)) for items in lists)
        raise MbmError(faults.length_clash(call.span, "`map` over lists", f"lengths {shown}"))
    return ListValue(tuple([invoke(call, call.arguments[0], *items) for items in zip(*lists, strict=True)]))


def _reduce(call: Call) -> Value:
    items = list(list_items(call.arguments[1], call.forms[1].span))
    if len(call.arguments) == 3:
        items.insert(0, call.arguments[2])
    if not items:
        raise MbmError(
            faults.bad_form(call.span, "`reduce` of an empty list needs a start", "(reduce function list [start])")
        )
    result = items[0]
    for item in items[1:]:
        result = invoke(call, call.arguments[0], result, item)
    return result


def _apply(call: Call) -> Value:
    last = list_items(call.arguments[-1], call.span)
    return invoke(call, call.arguments[0], *call.arguments[1:-1], *last)


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("list", "(list a …)", "A list; a list of numbers is a vector where one is wanted.", 0, None, _list, True),
    Builtin("append", "(append a b …)", "One list of the elements of several.", 0, None, _append, True),
    Builtin("length", "(length a)", "The number of elements.", 1, 1, _length, True),
    Builtin("range", "(range a b)", "The whole numbers a … b; empty if b < a.", 2, 2, _range),
    Builtin("map", "(map f list …)", "f of each element (of each of several lists together).", 2, None, _map, True),
    Builtin("reduce", "(reduce f list [start])", "f(f(f(start, a), b), c) …", 2, 3, _reduce, True),
    Builtin("apply", "(apply f a … list)", "f of the arguments that the list holds.", 2, None, _apply, True),
)
