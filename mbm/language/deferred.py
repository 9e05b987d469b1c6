"""Functions of the vocabulary that are loaded when they are first called: those of installed packages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

from mbm.language import faults
from mbm.language.values import Builtin, Call, Callable_, Value
from mbm.text.types import MbmError, Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class DeferredFunction(Callable_):
    """A function that ``load`` gives; it is told where the call stands, and raises MbmError there."""

    name: str
    load: Callable[[Span], Builtin] = field(repr=False)

    def call(self, call: Call) -> Value:
        """The value for evaluated arguments.

        Raises:
            MbmError: it cannot be loaded, or takes another number of arguments.
        """
        function, given = self.load(call.span), call.arguments
        if len(given) < function.minimum or (function.maximum is not None and len(given) > function.maximum):
            raise MbmError(faults.wrong_arity(call.span, self.name, function.usage, len(given)))
        if not function.takes_forms:
            pairs = zip(given, call.forms, strict=True)
            given = tuple(call.evaluator.arrived(value, form, call.scope) for value, form in pairs)
        return call.evaluator.call(function, given, call.form, call.scope)
