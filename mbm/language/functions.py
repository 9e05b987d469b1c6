"""Functions that users define: ``defun``, ``lambda``, ``defmacro``."""

from __future__ import annotations

from dataclasses import field

from mbm.language import faults
from mbm.language.parameters import Parameters, bind, parse_parameters
from mbm.language.scope import LocalScope
from mbm.language.values import Call, Callable_, Macro, Scope, Value
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol, Text
from mbm.values import dataclass

DEFUN_USAGE = '(defun name (a b &optional (c 1.0) &key (:tag d)) "doc" body…)'
MACRO_USAGE = "(defmacro name (a b) body…)"


@dataclass(frozen=True, slots=True, kw_only=True)
class Definition:
    """A ``defun`` or ``defmacro`` as read: nothing is evaluated yet."""

    name: str
    parameters: Parameters
    doc: str
    body: tuple[Form, ...]
    span: Span
    is_macro: bool


def parse_definition(form: Sequence) -> Definition:
    """Read ``(defun name (…) "doc" body…)`` or ``(defmacro …)``."""
    is_macro = form.head == "defmacro"
    usage = MACRO_USAGE if is_macro else DEFUN_USAGE
    items = form.items
    if len(items) < 4 or not isinstance(items[1], Symbol):
        raise MbmError(faults.bad_form(form.span, f"this `{form.head}` is not complete", usage))
    body = items[3:]
    doc = ""
    if isinstance(body[0], Text) and len(body) > 1:
        doc, body = body[0].value, body[1:]
    parameters = parse_parameters(items[2], items[1].name)
    return Definition(
        name=items[1].name, parameters=parameters, doc=doc, body=body, span=items[1].span, is_macro=is_macro
    )


@dataclass(frozen=True, slots=True, eq=False)
class UserFunction(Callable_):
    """A function with the scope it was defined in."""

    name: str
    parameters: Parameters
    body: tuple[Form, ...]
    scope: Scope = field(repr=False)

    def call(self, call: Call) -> Value:
        """The value of the last form of the body."""
        inner = bind(call.evaluator, self.parameters, call.arguments, name=self.name, span=call.span, scope=self.scope)
        return evaluate_body(call, self.body, inner)


@dataclass(frozen=True, slots=True, eq=False)
class UserMacro(Macro):
    """A macro: takes forms, gives the form that stands in its place."""

    name: str
    parameters: Parameters
    body: tuple[Form, ...]
    scope: Scope = field(repr=False)

    def expand(self, call: Call) -> Value:
        """The form that stands in the place of the call."""
        inner = bind(call.evaluator, self.parameters, call.forms, name=self.name, span=call.span, scope=self.scope)
        return evaluate_body(call, self.body, inner)

    def call(self, call: Call) -> Value:
        """The value of the expansion, in the scope of the call."""
        return call.evaluator.arrived(self.expand(call), call.form, call.scope)


def evaluate_body(call: Call, body: tuple[Form, ...], scope: LocalScope) -> Value:
    """The value of the last form."""
    for form in body[:-1]:
        call.evaluator.evaluate(form, scope)
    return call.evaluator.evaluate(body[-1], scope)


def bind_definition(definition: Definition, scope: Scope) -> UserFunction | UserMacro:
    """The function or macro that a definition makes in ``scope``."""
    make = UserMacro if definition.is_macro else UserFunction
    return make(definition.name, definition.parameters, definition.body, scope)
