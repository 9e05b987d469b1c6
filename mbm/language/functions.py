"""Functions that users define: ``defun``, ``lambda``, ``defmacro``; and those of installed packages.

Arguments: required, ``&optional (name default)``, ``&key (:tag variable)``; binding them to a call. Those of packages
are loaded when they are first called.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field

from mbm.language import faults
from mbm.language.scope import LocalScope
from mbm.language.values import Builtin, Call, Callable_, Evaluator, Macro, Scope, Value
from mbm.text.printer import print_beginning
from mbm.text.suggest import closest
from mbm.text.types import Form, Keyword, MbmError, Sequence, Span, Symbol, Text
from mbm.values import dataclass

USAGE = "(name … [&optional (name default)…] [&key (:tag name [default])…])"


_LONGEST_DEFAULT = 60
"""Characters of a default that a message shows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Optional:
    """A parameter with a default; ``tag`` is None for ``&optional``."""

    name: str
    default: Form | None
    tag: str | None
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """An argument block."""

    required: tuple[str, ...]
    optional: tuple[Optional, ...]
    keys: tuple[Optional, ...]

    def usage(self, name: str) -> str:
        """How a call is written."""
        parts = [name, *self.required]
        defaults = [None if o.default is None else print_beginning(o.default, _LONGEST_DEFAULT) for o in self.optional]
        parts += [
            f"[{o.name}]" if default is None else f"[{o.name} = {default}]"
            for o, default in zip(self.optional, defaults, strict=True)
        ]
        parts += [f"[:{k.tag} {k.name}]" for k in self.keys]
        return f"({' '.join(parts)})"


def parse_parameters(form: Form, owner: str) -> Parameters:
    """Read an argument block.

    Raises:
        MbmError: it is not built as ``USAGE`` says, or a name occurs twice.

    """
    if not isinstance(form, Sequence):
        raise MbmError(faults.bad_form(form.span, f"the parameters of `{owner}` should be a list", USAGE))
    required: list[str] = []
    optional: list[Optional] = []
    keys: list[Optional] = []
    seen: dict[str, Span] = {}
    section = "required"
    for item in form.items:
        if isinstance(item, Symbol) and item.name in ("&optional", "&key"):
            section = item.name
            continue
        if section == "required":
            if not isinstance(item, Symbol):
                raise MbmError(faults.bad_form(item.span, "a parameter should be a name", USAGE))
            required.append(item.name)
            name = item.name
        else:
            entry = _optional(item, section)
            (optional if section == "&optional" else keys).append(entry)
            name = entry.name
        if name in seen:
            raise MbmError(faults.duplicate_definition(item.span, name, seen[name]))
        seen[name] = item.span
    return Parameters(required=tuple(required), optional=tuple(optional), keys=tuple(keys))


def _optional(item: Form, section: str) -> Optional:
    if section == "&optional":
        if isinstance(item, Symbol):
            return Optional(name=item.name, default=None, tag=None, span=item.span)
        if isinstance(item, Sequence) and len(item.items) == 2 and isinstance(item.items[0], Symbol):
            return Optional(name=item.items[0].name, default=item.items[1], tag=None, span=item.span)
    elif isinstance(item, Symbol):
        return Optional(name=item.name, default=None, tag=item.name, span=item.span)
    elif isinstance(item, Sequence) and 2 <= len(item.items) <= 3:
        tag, name = item.items[0], item.items[1]
        if isinstance(tag, Keyword | Symbol) and isinstance(name, Symbol):
            default = item.items[2] if len(item.items) == 3 else None
            return Optional(name=name.name, default=default, tag=tag.name, span=item.span)
    raise MbmError(faults.bad_form(item.span, f"this is no {section} parameter", USAGE))


def bind(
    evaluator: Evaluator,
    parameters: Parameters,
    values: tuple[Value, ...],
    *,
    name: str,
    span: Span,
    scope: Scope,
) -> LocalScope:
    """The scope of a body: parameters bound to ``values`` over ``scope``; defaults see the parameters before them."""
    positional, tagged = _split(parameters, values, name)
    most = len(parameters.required) + len(parameters.optional)
    if not len(parameters.required) <= len(positional) <= most:
        raise MbmError(faults.wrong_arity(span, name, parameters.usage(name), len(positional)))
    variables: dict[str, Value] = dict(zip(parameters.required, positional, strict=False))
    inner = LocalScope(variables, scope)
    given = positional[len(parameters.required) :]
    for index, entry in enumerate(parameters.optional):
        if index < len(given):
            variables[entry.name] = given[index]
        else:
            variables[entry.name] = _default(evaluator, entry, name, span, inner, parameters)
    for entry in parameters.keys:
        if entry.tag in tagged:
            variables[entry.name] = tagged[entry.tag]
        else:
            variables[entry.name] = _default(evaluator, entry, name, span, inner, parameters)
    return inner


def _default(
    evaluator: Evaluator, entry: Optional, name: str, span: Span, scope: Scope, parameters: Parameters
) -> Value:
    if entry.default is None:
        raise MbmError(
            faults.bad_form(span, f"`{name}` needs a value for `{entry.tag or entry.name}`", parameters.usage(name))
        )
    return evaluator.evaluate(entry.default, scope)


def _split(
    parameters: Parameters, values: tuple[Value, ...], name: str
) -> tuple[list[Value], Mapping[str | None, Value]]:
    if not parameters.keys:
        return list(values), {}
    known = [k.tag for k in parameters.keys if k.tag is not None]
    positional: list[Value] = []
    tagged: dict[str | None, Value] = {}
    position = 0
    while position < len(values):
        value = values[position]
        if isinstance(value, Keyword):
            if value.name not in known:
                near = closest(value.name, known)
                fault = faults.unknown_keyword(value.span, value.name, f"`{name}`", (near,) if near else tuple(known))
                raise MbmError(fault)
            if position + 1 >= len(values):
                raise MbmError(faults.missing_keyword_value(value.span, value.name))
            tagged[value.name] = values[position + 1]
            position += 2
        else:
            positional.append(value)
            position += 1
    return positional, tagged


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


DEFUN_USAGE = '(defun name (a b &optional (c 1.0) &key (:tag d)) "doc" body…)'
MACRO_USAGE = "(defmacro name (a b) body…)"


@dataclass(frozen=True, slots=True, kw_only=True)
class Definition:
    """A ``defun``, ``defmacro`` or model as read: nothing is evaluated yet.

    The ``body`` of a model holds the declaration, constraints and shape descriptions.
    """

    name: str
    parameters: Parameters
    doc: str
    body: tuple[Form, ...]
    span: Span
    is_macro: bool = False


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
