"""Calling a model: arguments bound, declarations evaluated, shapes described; equal arguments give one shape."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import field

from mbm.expression.algebra import number
from mbm.expression.forms import number_form
from mbm.expression.nodes import Apply, Column, Component, Constant, Expression, Leaf, Number, Opaque, Parameter, leaves
from mbm.language import faults as language_faults
from mbm.language.functions import Definition, Parameters, bind
from mbm.language.scope import LocalScope, opaque_element
from mbm.language.session import MODEL_USAGE
from mbm.language.values import (
    FORMS,
    SCALARS,
    Array,
    Call,
    Callable_,
    CameraValue,
    Evaluator,
    FamilyValue,
    ListValue,
    PoseValue,
    RotationValue,
    Scope,
    TextColumn,
    Value,
)
from mbm.shapes import faults
from mbm.shapes.description import Site, describe_shapes
from mbm.shapes.types import ModelCall, ModelConstraint, ModelFunction, Shape
from mbm.text.build import sequence, symbol, text
from mbm.text.suggest import closest
from mbm.text.types import Bracket, Form, Keyword, MbmError, Numeral, Sequence, Span, Symbol, Text
from mbm.values import dataclass


class OpaqueFamily(FamilyValue):
    """A family of unknowns whose members are forms ``(name key)``."""

    __slots__ = ()


def opaque_argument(evaluator: Evaluator, form: Form) -> Value:
    """What stands for an argument that is evaluated only where the form built from it arrives.

    Literals are what they are, literal vectors go element by element. A name that the problem knows as a vector, matrix
    or family keeps its shape, with forms for elements; everything else is one number given by its form.
    """
    if isinstance(form, Numeral | Text):
        return evaluator.evaluate(form, evaluator.world)
    if isinstance(form, Keyword):
        return form
    if isinstance(form, Symbol):
        return _opaque_name(evaluator, form)
    if form.bracket is Bracket.SQUARE or form.head == "list":
        items = form.items if form.bracket is Bracket.SQUARE else form.items[1:]
        return ListValue(tuple([opaque_argument(evaluator, item) for item in items]))
    return Opaque(form, form.span)


def _opaque_name(evaluator: Evaluator, form: Symbol) -> Value:
    known = evaluator.world.lookup(form.name, form.span)
    if isinstance(known, FamilyValue):
        return OpaqueFamily(known.name, known.keys, lambda key: Opaque(_member(form, key), form.span))
    if isinstance(known, Array):
        name = Opaque(form, form.span)
        rows = [opaque_element(name, i + 1) for i in range(known.shape[0])]
        if known.is_matrix:
            return Array(known.shape, tuple(_inner(row, j + 1) for row in rows for j in range(known.shape[1])))
        return Array(known.shape, tuple(rows))
    return Opaque(form, form.span)


def _inner(row: Opaque, column: int) -> Opaque:
    """``(M i j)`` for the row ``(M i)``."""
    items = row.form.items if isinstance(row.form, Sequence) else (row.form,)
    span = row.form.span
    return Opaque(sequence((*items, number_form(number(column), span)), span), row.span)


def _member(name: Symbol, key: str | float | Column | TextColumn) -> Form:
    return sequence((name, _key(key, name.span)), name.span)


def _key(key: str | float | Column | TextColumn, span: Span) -> Form:
    if isinstance(key, str):
        return text(key, span)
    if isinstance(key, Column | TextColumn):
        return symbol(key.name, span)
    return number_form(Number(int(key) if key == int(key) else key), span)


def is_opaque(value: Value) -> bool:
    """Whether a value holds forms that are not evaluated yet, or what runs along a curve."""
    if isinstance(value, SCALARS):
        return any(isinstance(leaf, Opaque | Parameter) for leaf in leaves((value,)))
    if isinstance(value, Array):
        return any(isinstance(leaf, Opaque | Parameter) for leaf in leaves(value.elements))
    if isinstance(value, ListValue):
        return any(is_opaque(item) for item in value.items)
    return isinstance(value, OpaqueFamily)


CONSTRAINT_TYPES = ("=", ">", "<", ">=", "<=", "normal", "uniform")
_DECLARE_USAGE = "(declare (name form)… (array name (element…))…)"
_FEWEST_FORMS = {"normal": 3, "uniform": 3}


class ModelLog:
    """Which models a compilation used: what the problem needs to join the models' constraints to its own.

    ``calls`` holds one call for each distinct model-with-arguments, in the order of first use. ``quoted`` holds the
    model forms that ``get-vertex-from-model`` was given: evaluated in the problem's scope, they are logged as calls.
    """

    def __init__(self) -> None:
        self.calls: list[ModelCall] = []
        self.quoted: list[Form] = []

    def note_quoted(self, form: Form) -> None:
        """Keep a quoted model, once."""
        if form not in self.quoted:
            self.quoted.append(form)


class Model(ModelFunction):
    """A model of the user as a function. It remembers its shapes: equal arguments give one and the same shape."""

    def __init__(self, definition: Definition, scope: Scope, log: ModelLog | None = None) -> None:
        self._definition = definition
        self._scope = scope
        self._built: dict[Hashable, Shape] = {}
        self._identities = Identities()
        self.log = log

    @property
    def name(self) -> str:
        """The model's name."""
        return self._definition.name

    @property
    def parameters(self) -> Parameters:
        """Its argument block."""
        return self._definition.parameters

    @property
    def from_library(self) -> bool:
        """Never: the library has a class of its own."""
        return False

    def call(self, call: Call) -> Value:
        """The shape for evaluated arguments."""
        return self.build(call.evaluator, arrived_arguments(call), call.span)

    def build(self, evaluator: Evaluator, arguments: tuple[Value, ...], span: Span) -> Shape:
        """The shape for ``arguments``, evaluated before if they have been met before.

        Raises:
            MbmError: arguments that do not fit, or a body that describes no shape.
            StaticColumnNeeded: the value of a data column decides what the shape is.

        """
        bound = bind(evaluator, self.parameters, arguments, name=self.name, span=span, scope=self._scope)
        key = tuple((name, self._identities.key(value)) for name, value in bound.variables.items())
        shape = self._built.get(key)
        if shape is None:
            content = call_model(evaluator, self._definition, bound, span)
            shape = self._built[key] = Shape(content=content, span=span)
            if self.log is not None and not any(is_opaque(v) for v in bound.variables.values()):
                self.log.calls.append(content)
        return shape


def call_model(evaluator: Evaluator, definition: Definition, bound: LocalScope, span: Span) -> ModelCall:
    """The node of one call; ``bound`` holds the parameters."""
    preamble = read_preamble(evaluator, definition.body, bound)
    if not preamble.shapes:
        message = f"the model `{definition.name}` has no shape"
        raise MbmError(language_faults.bad_form(definition.span, message, MODEL_USAGE))
    site = Site(evaluator=evaluator, scope=preamble.scope, names={})
    return ModelCall(
        name=definition.name,
        arguments=bound.variables,
        arrays=preamble.arrays,
        constraints=preamble.constraints,
        children=describe_shapes(preamble.shapes, site),
        span=span,
    )


def arrived_arguments(call: Call) -> tuple[Value, ...]:
    """The arguments of a call of a model; quoted forms are evaluated where they arrived."""
    at = call.forms if len(call.forms) == len(call.arguments) else (call.form,) * len(call.arguments)
    return tuple([call.evaluator.arrived(v, f, call.scope) for v, f in zip(call.arguments, at, strict=True)])


def make_model(definition: Definition, scope: Scope) -> Callable_:
    """The function that a model definition makes in ``scope``."""
    return Model(definition, scope)


def model_maker(log: ModelLog) -> Callable[[Definition, Scope], Callable_]:
    """``make_model`` that notes in ``log`` which models are used."""
    return lambda definition, scope: Model(definition, scope, log)


@dataclass(frozen=True, slots=True, kw_only=True)
class Preamble:
    """The scope that the shapes are read in, the arrays declared, the constraints, and the shapes' forms."""

    scope: Scope = field(repr=False)
    arrays: dict[str, ListValue]
    constraints: tuple[ModelConstraint, ...]
    shapes: tuple[Form, ...]


def read_preamble(evaluator: Evaluator, body: tuple[Form, ...], scope: Scope) -> Preamble:
    """Evaluate ``declare``, where later names see earlier ones, and keep ``constraints`` as forms."""
    arrays: dict[str, ListValue] = {}
    blocks: list[Sequence] = []
    position = 0
    for form in body:
        head = form.head if isinstance(form, Sequence) else None
        if not isinstance(form, Sequence) or head not in ("declare", "constraints"):
            break
        if head == "declare":
            for item in form.items[1:]:
                scope = _declared(evaluator, item, scope, arrays)
        else:
            blocks.append(form)
        position += 1
    for form in body[position:]:
        if isinstance(form, Sequence) and form.head in ("declare", "constraints"):
            raise MbmError(
                language_faults.bad_form(
                    form.span, f"`{form.head}` stands before the shapes", "(name (argument…) (declare …) shape…)"
                )
            )
    constraints = tuple(_constraint(item, scope) for block in blocks for item in block.items[1:])
    return Preamble(scope=scope, arrays=arrays, constraints=constraints, shapes=body[position:])


def _declared(evaluator: Evaluator, item: Form, scope: Scope, arrays: dict[str, ListValue]) -> Scope:
    items = item.items if isinstance(item, Sequence) else ()
    if len(items) == 2 and isinstance(items[0], Symbol):
        arrays.pop(items[0].name, None)
        return LocalScope({items[0].name: evaluator.wanted(items[1], scope)}, scope)
    if len(items) == 3 and isinstance(item, Sequence) and item.head == "array":
        name, elements = items[1], items[2]
        if isinstance(name, Symbol) and isinstance(elements, Sequence):
            evaluator.budget.check_length(len(elements.items), elements)
            array = ListValue(tuple([_element(evaluator, e, scope) for e in elements.items]))
            arrays[name.name] = array
            return LocalScope({name.name: array}, scope)
    raise MbmError(language_faults.bad_form(item.span, "a declaration is (name form) or (array …)", _DECLARE_USAGE))


def _element(evaluator: Evaluator, form: Form, scope: Scope) -> Value:
    """An element of an array; a name that is no variable stands for itself: it names a part."""
    if isinstance(form, Symbol) and form.name != "pi" and scope.lookup(form.name, form.span) is None:
        return form
    return evaluator.wanted(form, scope)


def _constraint(form: Form, scope: Scope) -> ModelConstraint:
    kind = form.head if isinstance(form, Sequence) else None
    if not isinstance(form, Sequence) or kind is None:
        raise MbmError(faults.bad_constraint(form.span, "a constraint is a list with its type in front"))
    if kind not in CONSTRAINT_TYPES:
        message = f"`{kind}` is no type of constraint"
        raise MbmError(faults.bad_constraint(form.items[0].span, message, closest(kind, CONSTRAINT_TYPES)))
    fewest = _FEWEST_FORMS.get(kind, 2)
    if len(form.items) - 1 < fewest:
        raise MbmError(faults.bad_constraint(form.span, f"`{kind}` wants at least {fewest} forms"))
    return ModelConstraint(kind=kind, forms=form.items[1:], scope=scope, span=form.span)


class Identities:
    """Gives equal values equal keys. Subexpressions are numbered as they are met, so that shared ones cost once."""

    def __init__(self) -> None:
        self._numbers: dict[Hashable, int] = {}
        self._known: dict[int, tuple[int, Expression]] = {}
        """The number of each node by its address, which it keeps as long as it is held here."""

    def key(self, value: Value) -> Hashable:
        """A key that two values share if and only if they are the same value.

        Functions and shapes are the same only if they are one object; their keys hold while they live.
        """
        if isinstance(value, SCALARS):
            return self._expression(value)
        match value:
            case Array():
                return ("array", value.shape, tuple(self._expression(e) for e in value.elements))
            case ListValue():
                return ("list", tuple(self.key(item) for item in value.items))
            case RotationValue():
                return ("rotation", self.key(value.matrix))
            case PoseValue():
                scale = None if value.scale is None else self._expression(value.scale)
                translation = tuple(self._expression(e) for e in value.translation)
                return ("pose", self.key(value.rotation), translation, scale)
            case TextColumn():
                return ("texts", value.identity)
            case FamilyValue():
                return ("family", type(value), value.name)
            case CameraValue():
                numbers = (*value.focal, *value.center, *value.distortion, value.near)
                return ("camera", value.name, tuple(self._expression(e) for e in numbers), value.axes)
            case bool() | str():
                return (type(value), value)
        return ("form", value) if isinstance(value, FORMS) else ("object", id(value))

    def _expression(self, root: Expression) -> int:
        known = self._known
        waiting = [root]
        while waiting:
            node = waiting[-1]
            arguments = node.arguments if isinstance(node, Apply) else ()
            missing = [a for a in arguments if id(a) not in known]
            if missing and id(node) not in known:
                waiting += missing
                continue
            waiting.pop()
            if id(node) not in known:
                own = tuple(known[id(a)][0] for a in arguments)
                key = (node.operation, own) if isinstance(node, Apply) else _leaf(node)
                known[id(node)] = (self._numbers.setdefault(key, len(self._numbers)), node)
        return known[id(root)][0]


def _leaf(node: Leaf) -> Hashable:
    match node:
        case Number():
            return ("number", type(node.value), node.value, node.dimension, node.angle)
        case Constant():
            return ("constant", node.name, node.value)
        case Column():
            return ("column", node.identity)
        case Component():
            return ("unknown", node.identity)
        case Opaque():
            return ("opaque", node.form)
        case Parameter():
            return ("parameter", id(node))
